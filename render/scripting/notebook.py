"""What notebooks show of a batch: a picture, and a page with its facts."""

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

UNITS = {"duration": "s", "length": "m", "draw": "Hz"}  # by the first word of a fact's name


@dataclass(frozen=True, repr=False)
class ShownPicture:
    """A PNG in memory, which a notebook shows where it ends a cell."""

    png: bytes

    def __repr__(self) -> str:
        """One line."""
        width, height = (int.from_bytes(self.png[at : at + 4], "big") for at in (16, 20))
        return f"ShownPicture(PNG of {width} x {height} pixels)"

    def _repr_png_(self) -> bytes:
        return self.png


def facts_page(title: str, facts: Mapping[str, object], png: bytes | None) -> str:
    """Facts as an HTML table, in which None has no row, and below it the picture, if there is one."""
    rows = ""
    for name, value in facts.items():
        if value is not None:
            cell = f"{value:.4g}" if isinstance(value, float) else escape(str(value))
            rows += (
                f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{cell} {UNITS.get(name.split('_')[0], '')}</td></tr>"
            )
    picture = "" if png is None else f'<img src="data:image/png;base64,{b64encode(png).decode()}"/>'
    return f"<table><caption>{escape(title)}</caption>{rows}</table>{picture}"
