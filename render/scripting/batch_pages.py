"""Batches as HTML, for notebooks."""

from base64 import b64encode
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


def batch_page(batch: "RenderedBatch", picture: bytes | None) -> str:
    """A batch's facts as a table, in which None has no row, and its picture as PNG, if there is one, below."""
    rows = "".join(
        f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{_cell(value)} {UNITS.get(name, '')}</td></tr>"
        for name, value in batch.facts().items()
        if value is not None
    )
    shown = "" if picture is None else f'<img src="data:image/png;base64,{b64encode(picture).decode()}"/>'
    return f"<table><caption>{escape(repr(batch))}</caption>{rows}</table>{shown}"


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))
