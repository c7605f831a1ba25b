"""Columns of a sweep's table that distinguish its recipes, as axes: for names of rows, and for the picture."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .table import is_axis, is_missing, plain_cell


@dataclass(frozen=True, eq=False)  # arrays have no one equality
class Axis:
    """A column of the recipe."""

    name: str
    values: tuple[Any, ...]
    """Distinct ones: numbers ascending, words as they come."""
    code: np.ndarray
    """Which one each row has, shape [row]."""
    is_numeric: bool
    """Whether every row has a number."""

    def word(self, k: int) -> str:
        """A value as it is shown."""
        value = self.values[k]
        if is_missing(value):
            return "none"
        return value if isinstance(value, str) else f"{value:g}"


def axis_of(name: str, values: Sequence[Any]) -> Axis:
    """An axis from a column."""
    cells = [plain_cell(value) for value in values]
    is_numeric = all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in cells)
    seen = list(dict.fromkeys(cells))
    distinct = sorted(seen) if is_numeric else seen  # type: ignore[type-var]  # numbers only, asked above
    place = {value: k for k, value in enumerate(distinct)}
    return Axis(name, tuple(distinct), np.array([place[cell] for cell in cells], np.int64), is_numeric)


def telling_axes(table: Mapping[str, Sequence[Any]]) -> list[Axis]:
    """Columns of the recipe that distinguish rows, without those that follow from the ones before."""
    kept: list[Axis] = []
    for name, values in table.items():
        if is_axis(name) and not follows(axis := axis_of(name, values), kept):
            kept.append(axis)
    return kept


def follows(axis: Axis, others: Sequence[Axis]) -> bool:
    """Whether rows that agree in all the others agree in an axis, too."""
    code = np.zeros(len(axis.code), np.int64)
    for other in others:
        code = np.unique(code * len(other.values) + other.code, return_inverse=True)[1]
    return len(axis.values) == 1 or len(np.unique(code * len(axis.values) + axis.code)) == len(np.unique(code))
