"""How far a sweep is."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is."""

    recipes: int
    """Made, there already, or given up."""
    recipe_count: int
    poses: int
    """Rendered in this run."""
    rate: float
    """Poses a second."""
    seconds_left: float | None
    """To go; None before any result has come."""


def clock_time(seconds: float) -> str:
    """A duration for people: seconds, minutes, hours or days, in two of them."""
    whole = round(seconds)
    for unit, length, lower, below in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if whole >= length:
            return f"{whole // length} {unit} {whole % length // below} {lower}"
    return f"{whole} s" if seconds >= 9.5 else f"{seconds:.1f} s"
