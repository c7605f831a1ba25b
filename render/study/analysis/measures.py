"""Measures: one number for each participant and cell of the design, such as p_cc, a rating or a threshold."""

from dataclasses import dataclass, field
from itertools import chain
from typing import NamedTuple

import numpy as np

from ..plan.study_plan import Factors

Level = str | float
"""A value of a factor."""
CellKey = tuple[tuple[str, Level], ...]
"""A cell's levels of all factors but one."""


class Cell(NamedTuple):
    """A cell of the design: a block, or within a block a pair or a stimulus."""

    name: str
    factors: Factors
    """Its values of the keys of the plan's `for`."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number for each participant and cell; what is compared between cells, and with chance."""

    name: str
    """In tables and files: `p_cc`, `confidence`."""
    title: str
    """For people: "proportion of answers for cc", "confidence"."""
    unit: str = ""
    codes: tuple[str, ...]
    cells: tuple[Cell, ...]
    values: np.ndarray = field(repr=False)
    """float64, shape [participant, cell]; nan where there is none."""
    successes: np.ndarray | None = field(default=None, repr=False)
    """int64, shape [participant, cell]: of a proportion, the answers that it counts."""
    counts: np.ndarray | None = field(default=None, repr=False)
    """int64, shape [participant, cell]: of a proportion, all answers."""
    chance: float | None = None
    """Value that answers at random have."""
    low: float | None = None
    high: float | None = None
    """Bounds of the scale, where there are any."""

    @property
    def factors(self) -> dict[str, tuple[Level, ...]]:
        """Levels of each factor, in the plan's order; factors with one level are left out."""
        names = dict.fromkeys(name for cell in self.cells for name in cell.factors)
        levels = {
            name: tuple(dict.fromkeys(own.factors[name] for own in self.cells if name in own.factors)) for name in names
        }
        return {name: own for name, own in levels.items() if len(own) > 1}

    def cells_at(self, factor: str, level: Level) -> dict[CellKey, list[int]]:
        """Numbers of the cells at a level of a factor, by their levels of all other factors.

        Several cells have the same levels where a plan's tables repeat the values of their `for`.
        """
        found: dict[CellKey, list[int]] = {}
        for number, cell in enumerate(self.cells):
            if cell.factors.get(factor) == level:
                others = sorted((name, own) for name, own in cell.factors.items() if name != factor)
                found.setdefault(tuple(others), []).append(number)
        return found

    def numbers_at(self, factor: str, level: Level) -> list[int]:
        """Numbers of all cells at a level of a factor."""
        return sorted(chain.from_iterable(self.cells_at(factor, level).values()))

    def at_level(self, factor: str, level: Level) -> np.ndarray:
        """The mean over all cells at a level, shape [participant]; nan where a cell lacks."""
        return self.values[:, self.numbers_at(factor, level)].mean(axis=1)

    def by_participant(self) -> np.ndarray:
        """The mean over all cells, shape [participant]; nan where a cell lacks."""
        return self.values.mean(axis=1)


def level_text(level: Level) -> str:
    """A level as people read it."""
    return level if isinstance(level, str) else f"{level:g}"


def level_label(factor: str, level: Level) -> str:
    """A level as people read it without its factor beside it: a number alone would say nothing."""
    return level if isinstance(level, str) else f"{factor} {level:g}"


def cell_text(cell: Cell) -> str:
    """A cell as people read it: its levels, or its name where the plan gives it none."""
    return ", ".join(level_text(own) for own in cell.factors.values()) or cell.name
