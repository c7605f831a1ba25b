"""A sweep's table as an xarray Dataset: axes that vary become dimensions, metrics become variables.

| a column of the recipe | becomes |
|---|---|
| has one value in all rows | an attribute of the Dataset |
| varies | a dimension, with its values as coordinate |
| varies with another one (`zip`, `[sample]`): that one's value decides it | a coordinate along that dimension |

Combinations that the plan leaves out, and metrics that do not apply, are NaN. If rows do not differ in these
columns, or fewer than one cell in SPARSE would be filled, the only dimension is `recipe`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import SweepError
from .table import column_units, is_axis, is_metric, split_constants

if TYPE_CHECKING:
    import xarray as xr

SPARSE = 16
ROWS = "recipe"


@dataclass(frozen=True)
class _Axis:
    """A column of the recipe that varies."""

    name: str
    values: np.ndarray
    """Distinct ones: numbers ascending, texts as they come."""
    code: np.ndarray
    """Which of them each row has, shape [row]."""

    @classmethod
    def of(cls, name: str, column: np.ndarray) -> "_Axis":
        values, first, code = np.unique(column, return_index=True, return_inverse=True)
        if column.dtype.kind in "biuf":
            return cls(name, values, code)
        order = np.argsort(first)
        return cls(name, values[order], np.argsort(order)[code])

    def decides(self, other: "_Axis") -> bool:
        """Whether rows with the same value of this one have the same value of the other one."""
        return len(np.unique(np.stack([self.code, other.code]), axis=1).T) == len(self.values)

    def along(self, other: "_Axis") -> np.ndarray:
        """Its value for each value of an axis that decides it."""
        out = np.empty(len(other.values), self.values.dtype)
        out[other.code] = self.values[self.code]
        return out


def dataset_of(columns: Mapping[str, np.ndarray]) -> "xr.Dataset":
    """A table's metrics, and `complete`, over the axes that vary; raises SweepError if xarray is not installed."""
    try:
        import xarray as xr
    except ImportError as error:
        raise SweepError("a Dataset needs xarray: pip install xarray") from error
    varying, constants = split_constants(columns)
    axes = [_Axis.of(name, np.asarray(own)) for name, own in varying.items() if is_axis(name) and _varies(own)]
    constants |= {name: own[0] for name, own in varying.items() if is_axis(name) and len(own) and not _varies(own)}
    dimensions, decided = _dimensions(axes)
    shape, count = [len(axis.values) for axis in dimensions], len(columns["complete"])
    place = np.ravel_multi_index([axis.code for axis in dimensions], shape) if dimensions else np.zeros(count, int)
    if len(np.unique(place)) < count or np.prod(shape) > SPARSE * count:
        dimensions, decided = [_Axis(ROWS, np.arange(count), np.arange(count))], [(axis, 0) for axis in axes]
        shape, place = [count], np.arange(count)
    names = [axis.name for axis in dimensions]
    units = column_units(columns)

    def array(name: str, dims: list[str], values: np.ndarray) -> Any:
        return xr.Variable(dims, values, {"units": units[name]} if name in units else {})

    data = {
        name: array(name, names, _placed(np.asarray(own), place, shape))
        for name, own in columns.items()
        if is_metric(name) or name == "complete"
    }
    coordinates = {axis.name: array(axis.name, [axis.name], axis.values) for axis in dimensions}
    for axis, k in decided:
        coordinates[axis.name] = array(axis.name, [names[k]], axis.along(dimensions[k]))
    return xr.Dataset(data, coordinates, {name: value for name, value in constants.items() if value is not None})


def _varies(column: np.ndarray) -> bool:
    return len(np.unique(column)) > 1


def _dimensions(axes: list[_Axis]) -> tuple[list[_Axis], list[tuple[_Axis, int]]]:
    """Axes of which none decides another one, and the others with the number of one that decides it."""
    dimensions: list[_Axis] = []
    for axis in axes:
        if not any(known.decides(axis) for known in dimensions):
            dimensions = [known for known in dimensions if not axis.decides(known)] + [axis]
    others = [axis for axis in axes if axis not in dimensions]
    return dimensions, [(axis, next(k for k, own in enumerate(dimensions) if own.decides(axis))) for axis in others]


def _placed(column: np.ndarray, place: np.ndarray, shape: list[int]) -> np.ndarray:
    """Values at their places; NaN, or False, where there is none."""
    is_flag = column.dtype.kind == "b"
    out = np.full(int(np.prod(shape)), False if is_flag else np.nan, bool if is_flag else np.float64)
    out[place] = column
    return out.reshape(shape)
