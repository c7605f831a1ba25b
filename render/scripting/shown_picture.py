"""A picture that a notebook shows where it ends a cell."""

from dataclasses import dataclass


@dataclass(frozen=True, repr=False)
class ShownPicture:
    """A PNG in memory."""

    png: bytes

    def __repr__(self) -> str:
        """One line."""
        width, height = (int.from_bytes(self.png[at : at + 4], "big") for at in (16, 20))
        return f"ShownPicture(PNG of {width} x {height} pixels)"

    def _repr_png_(self) -> bytes:
        return self.png
