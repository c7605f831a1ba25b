"""Mean, deviation and extremes of a metric over all poses of a recipe, merged from those of its chunks."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

NOISE = 1e-6
"""A standard deviation below this share of the root mean square is rounding, and stands as 0: sums of squares are
float64 sums of up to 768 terms a part, right to about 1e-13, and sqrt(1e-13) of it is what their difference leaves."""


class Statistic(NamedTuple):
    """Of one metric over all poses to which it applies."""

    number: int
    """Of poses."""
    total: float
    squares: float
    least: float
    greatest: float

    @classmethod
    def merged(cls, parts: Iterable[Sequence[float]]) -> "Statistic":
        """From parts' [count, sum, sum of squares, least, greatest]: the same whatever their order."""
        used = [part for part in parts if part[0]]
        if len(used) < 2:  # most recipes have one part, and not every metric
            return cls(int(used[0][0]), *used[0][1:5]) if used else NOTHING
        return cls(
            sum(int(part[0]) for part in used),
            math.fsum(part[1] for part in used),
            math.fsum(part[2] for part in used),
            min(part[3] for part in used),
            max(part[4] for part in used),
        )

    @property
    def mean(self) -> float | None:
        """None without a pose."""
        return self.total / self.number if self.number else None

    @property
    def std(self) -> float | None:
        """Of the population; see NOISE for what counts as 0."""
        if not self.number:
            return None
        variance = math.fsum((self.squares, -self.total * (self.total / self.number))) / self.number
        return math.sqrt(variance) if variance > NOISE**2 * self.squares / self.number else 0.0

    @property
    def most(self) -> float | None:
        """None without a pose."""
        return self.greatest if self.number else None


NOTHING = Statistic(0, 0.0, 0.0, math.nan, math.nan)
