"""Which axis of a sweep stands where in a picture: x, colours, columns of panels, dashes; or is averaged over.

A metric is drawn over the axes that it depends on. The length of contours, say, is the same whatever the sampling.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..plan.recipe import GROUPS, part_of
from .table import METRICS, differs, is_axis, is_missing, plain_cell

METRIC_GROUPS = {metric: group for group, metrics in METRICS.items() for metric in metrics} | {"jumps": "sampling"}
"""Group of each metric that a picture may show; jumps are those of all causes."""

COLOURS_GOOD, COLOURS_MOST = 10, 20  # that a reader can distinguish well, and at all
COLUMNS_MOST = 6
DASHES_MOST = 4
TICKS_MOST = 24  # words along an axis
NUMBERS_FEW = 3  # values from which a number makes a curve
REPLICATES = ("seed", "explorer")  # how often a person, and another person, explores: a point is their mean
HUE_FIRST = ("strategy", "hand", "sampling", "array", "step")
COLUMN_FIRST = ("object", "motion", "hand", "sampling")


@dataclass(frozen=True)
class Axis:
    """A column of the recipe that differs between rows."""

    name: str
    values: tuple[Any, ...]
    """Distinct ones: numbers ascending, words as they come."""
    code: np.ndarray
    """Which one each row has, shape [row]."""
    is_numeric: bool
    """Whether every row has a number."""

    def word(self, k: int) -> str:
        """A value as it is shown; numbers with their name where it stands alone."""
        value = self.values[k]
        if is_missing(value):
            return "none"
        return value if isinstance(value, str) else f"{value:g}"


@dataclass(frozen=True)
class FigureLayout:
    """Where axes stand."""

    x: Axis
    hue: Axis | None = None
    column: Axis | None = None
    dash: Axis | None = None
    averaged: tuple[Axis, ...] = ()
    """Replicates, and what there is no room for."""

    @property
    def places(self) -> tuple[str, ...]:
        """Names of the axes that have a place, "" where there is none."""
        return tuple(axis.name if axis else "" for axis in (self.x, self.hue, self.column, self.dash))


@dataclass(frozen=True)
class View:
    """Metrics that depend on the same axes, and how these are drawn."""

    layout: FigureLayout
    metrics: Mapping[str, np.ndarray]
    """Values of each by the rows of the layout: those of the table that differ in these axes."""
    omitted: tuple[str, ...]
    """Axes that vary in the sweep, and on which these metrics do not depend."""


def axis_of(name: str, values: Sequence[Any]) -> Axis:
    """An axis from a column."""
    cells = [plain_cell(value) for value in values]
    is_numeric = all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in cells)
    seen = list(dict.fromkeys(cells))
    distinct = sorted(seen) if is_numeric else seen  # type: ignore[type-var]  # numbers only, asked above
    place = {value: k for k, value in enumerate(distinct)}
    return Axis(name, tuple(distinct), np.array([place[cell] for cell in cells], np.int64), is_numeric)


def varying_axes(table: Mapping[str, Sequence[Any]]) -> list[Axis]:
    """Columns of the recipe that vary, each once: of those that distinguish the same rows the first counts."""
    axes = [axis_of(name, values) for name, values in table.items() if is_axis(name)]
    kept: list[Axis] = []
    for axis in axes:
        if len(axis.values) > 1 and not any(_determines(other, axis) and _determines(axis, other) for other in kept):
            kept.append(axis)
    return kept


def telling_axes(table: Mapping[str, Sequence[Any]]) -> list[Axis]:
    """Columns of the recipe that distinguish rows, without those that follow from the ones before."""
    kept: list[Axis] = []
    for name, values in table.items():
        if is_axis(name) and not _follows(axis := axis_of(name, values), kept):
            kept.append(axis)
    return kept


def _determines(one: Axis, other: Axis) -> bool:
    """Whether rows that agree in one axis agree in the other."""
    pairs = one.code * len(other.values) + other.code
    return len(np.unique(pairs)) == len(np.unique(one.code))


def choose_layout(table: Mapping[str, Sequence[Any]]) -> FigureLayout:
    """Give each axis that varies its place.

    | place | takes | at most |
    |---|---|---|
    | x | too many values for colours; else a number of 3 values or more; else words, the strategy last | 24 words |
    | colours | the strategy, else hand, sampling, array, other words, numbers | 10; the strategy 20 |
    | columns | the object, else motion, hand, sampling, others | 6 |
    | dashes | what is left, words before numbers, the fewest values first | 4 |
    | averaged over | seeds and explorers, and the rest | |

    An axis that follows from one that has a place (the scale of each object, say) needs none.
    """
    axes = varying_axes(table)
    seeds = [axis for axis in axes if axis.name.endswith(REPLICATES)]
    left = [axis for axis in axes if not any(axis is seed for seed in seeds)]
    x = _best_x(left) or axis_of("strategy", table.get("strategy") or [""] * len(table["recipe_hash"]))
    left = _without(left, x)
    hue = _first(left, HUE_FIRST, COLOURS_GOOD, avoid="object") or _first(
        [axis for axis in left if axis.name == "strategy"], HUE_FIRST, COLOURS_MOST
    )
    left = _without(left, hue)
    column = _first(left, COLUMN_FIRST, COLUMNS_MOST)
    left = _without(left, column)
    few = [axis for axis in left if len(axis.values) <= DASHES_MOST]
    dash = min(few, key=lambda axis: (axis.is_numeric, len(axis.values)), default=None)
    left = _without(left, dash)
    placed = [axis for axis in (x, hue, column, dash) if axis is not None]
    rest = [axis for axis in left if not _follows(axis, placed)]
    return FigureLayout(x, hue, column, dash, tuple(seeds + rest))


def choose_views(table: Mapping[str, Sequence[Any]], metrics: Mapping[str, np.ndarray]) -> list[View]:
    """Give the axes of each metric their places; recipes that share a result count once.

    metrics: values by name, one a row of the table; GROUPS has the parts of a recipe that each depends on.
    """
    varying = [name for name, values in table.items() if is_axis(name) and differs(values)]
    used = {name: table[name] for name in table if name in (*varying, "strategy", "recipe_hash")}
    shown = {axis.name for axis in varying_axes(used)}
    names_of: dict[tuple[str, ...], list[str]] = {}
    for metric in metrics:
        parts = GROUPS[METRIC_GROUPS.get(metric, "contours")]  # which a user's own metric is computed of
        names_of.setdefault(tuple(name for name in varying if part_of(name) not in parts), []).append(metric)
    views: list[View] = []
    for omitted, names in names_of.items():
        left = {name: values for name, values in used.items() if name not in omitted}
        rows = list(range(len(table["recipe_hash"])))
        if omitted:
            cells = [*(left[name] for name in varying if name in left), *(metrics[name] for name in names)]
            first: dict[tuple[Any, ...], int] = {}  # the first row of each combination of cells
            for row, values in enumerate(zip(*cells, strict=True)):
                first.setdefault(tuple(plain_cell(value) for value in values), row)
            rows = list(first.values())
        own = {name: [values[row] for row in rows] for name, values in left.items()}
        named = tuple(name for name in omitted if name in shown)
        views.append(View(choose_layout(own), {name: metrics[name][rows] for name in names}, named))
    return views


def _best_x(axes: Sequence[Axis]) -> Axis | None:
    """See `choose_layout`."""
    able = [axis for axis in axes if axis.is_numeric or len(axis.values) <= TICKS_MOST]

    def rank(axis: Axis) -> tuple[bool, bool, bool, int, bool]:
        crowd, curve = len(axis.values) > COLOURS_GOOD, axis.is_numeric and len(axis.values) >= NUMBERS_FEW
        return crowd, curve, axis.name != "strategy", len(axis.values), axis.is_numeric

    return max(able, key=rank, default=None)


def _first(axes: Sequence[Axis], order: Sequence[str], most: int, *, avoid: str = "") -> Axis | None:
    """Of axes with at most so many values the first in an order, then words before numbers; `avoid` only if it must."""

    def rank(axis: Axis) -> tuple[int, bool]:
        return (order.index(axis.name) if axis.name in order else len(order) + (axis.name == avoid), axis.is_numeric)

    return min((axis for axis in axes if len(axis.values) <= most), key=rank, default=None)


def _without(axes: Sequence[Axis], used: Axis | None) -> list[Axis]:
    """Axes but for one that has a place, and those that follow from it."""
    return [axis for axis in axes if used is None or not _determines(used, axis)]


def _follows(axis: Axis, placed: Sequence[Axis]) -> bool:
    """Whether an axis follows from several together."""
    code = np.zeros(len(axis.code), np.int64)
    for other in placed:
        code = np.unique(code * len(other.values) + other.code, return_inverse=True)[1]
    return len(axis.values) == 1 or len(np.unique(code * len(axis.values) + axis.code)) == len(np.unique(code))
