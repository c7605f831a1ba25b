"""What arrays are called: the one name that files and results have, and what else people call them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from .errors import UnknownArrayError

ALIASES: Final[Mapping[str, tuple[str, ...]]] = {
    "emulator": (),
    "pat16": ("openmpd", "asierinho", "pat"),  # its makers' project, their driver, and what papers call such boards
    "sonicsurface": ("sonic-surface",),
    "autd3": ("autd",),
}
"""Other names of each built-in array, by its own."""


def canonical_name(name: str) -> str:
    """The array's own name, from that or an alias in any case, with or without `-`, `_` and blanks.

    Raises UnknownArrayError, with all names and aliases.
    """
    wanted = _letters(name)
    for own, others in ALIASES.items():
        if wanted in map(_letters, (own, *others)):
            return own
    known = ", ".join(f"{own} ({', '.join(others)})" if others else own for own, others in ALIASES.items())
    raise UnknownArrayError(f"unknown array {name!r}; known: {known}")


def _letters(name: str) -> str:
    return "".join(name.casefold().replace("-", "").replace("_", "").split())
