"""Progress of loading: the callback type for a progress bar."""

from collections.abc import Callable

Watch = Callable[[str, int, int], None]
"""Called with the name of a stage of loading, the amount done, and the amount in all."""


def unwatched(stage: str, done: int, total: int) -> None:
    """A `Watch` that does nothing."""
