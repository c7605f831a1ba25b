"""Batches as HTML, for notebooks."""

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .rendered_batch import RenderedBatch

UNITS = {
    "duration": "s",
    "length_mean": "m",
    "length_longest": "m",
    "draw_frequency": "Hz",
    "draw_frequency_median": "Hz",
}


def facts_page(batch: "RenderedBatch") -> str:
    """A batch's facts as a table; None has no row."""
    rows = "".join(
        f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{_cell(value)} {UNITS.get(name, '')}</td></tr>"
        for name, value in batch.facts().items()
        if value is not None
    )
    return f"<table><caption>{escape(repr(batch))}</caption>{rows}</table>"


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))
