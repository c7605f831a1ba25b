"""How far loading has come: what tells a progress bar, if anybody looks."""

from collections.abc import Callable

Watch = Callable[[str, int, int], None]
"""Takes the name of a stage of loading, how much of it is done, and how much there is."""


def unwatched(stage: str, done: int, total: int) -> None:
    """A `Watch` that tells nobody."""
