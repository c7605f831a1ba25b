"""Measures: one number for each participant and block, such as p_CC, a rating or a threshold."""

from dataclasses import dataclass

import numpy as np

from ..plan.study_plan import PlannedBlock

Level = str | float
"""A value of a factor."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number for each participant and block; what is compared between blocks, and with chance."""

    name: str
    """In tables and files: `p_cc`, `confidence`."""
    title: str
    """For people: "proportion of answers for cc", "confidence"."""
    unit: str = ""
    codes: tuple[str, ...]
    blocks: tuple[PlannedBlock, ...]
    values: np.ndarray
    """float64, shape [participant, block]; nan where there is none."""
    counts: np.ndarray | None = None
    """int64, shape [participant, block]: answers that a proportion is made of."""
    chance: float | None = None
    """Value that answers at random have."""
    low: float | None = None
    high: float | None = None
    """Bounds of the scale, where there are any."""

    @property
    def factors(self) -> dict[str, tuple[Level, ...]]:
        """Levels of each factor, in the plan's order; those with one level are left out."""
        names = dict.fromkeys(name for block in self.blocks for name in block.factors)
        levels = {
            name: tuple(dict.fromkeys(own.factors[name] for own in self.blocks if name in own.factors))
            for name in names
        }
        return {name: own for name, own in levels.items() if len(own) > 1}

    def by_level(self, factor: str) -> dict[Level, np.ndarray]:
        """Of each level of a factor: the mean over its blocks, shape [participant]; nan where a block lacks."""
        return {
            level: self.values[:, [k for k, own in enumerate(self.blocks) if own.factors.get(factor) == level]].mean(
                axis=1
            )
            for level in self.factors[factor]
        }

    def by_participant(self) -> np.ndarray:
        """The mean over all blocks, shape [participant]; nan where a block lacks."""
        return self.values.mean(axis=1)
