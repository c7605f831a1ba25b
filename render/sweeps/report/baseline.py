"""The baseline that a sweep is compared with, as a file that a person reviews: sorted, without times and makers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.errors import SweepStoreError
from ....datasets.sweeps.table import write_table
from ....datasets.sweeps.table_text import column_arrays
from ...errors import SweepError
from .compare import Baseline, Tolerance, as_floats, pair_rows, tolerance_of
from .table import UNITS, column_units, is_axis, is_metric, plain_cell, split_constants

Table = Mapping[str, Sequence[Any] | np.ndarray]


def write_baseline(
    path: Path, columns: Table, *, old: Baseline | None = None, tolerances: Sequence[Tolerance] = ()
) -> int:
    """Write a sweep's table (`tidy_columns`) as a baseline, whole or not at all, replacing an earlier one.

    The file holds the values of the recipes, their metrics and hashes; rows are sorted by the recipes' values, and what
    all rows share stands once. So equal results give equal bytes. A value that lies within its tolerance of the old
    baseline's stays the old one: the difference of two files shows what moved, and no other machine's rounding.

    Returns the number of recipes. Raises SweepError if a recipe has no whole results, or the file cannot be written.
    """
    varying, constants = baseline_table(columns, old=old, tolerances=tolerances)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_table(path, varying, units=column_units((*varying, *constants)), constants=constants)
    except (OSError, SweepStoreError) as error:
        raise SweepError(f"baseline {path} cannot be written ({error})") from error
    return len(varying["recipe_hash"])


def baseline_table(
    columns: Table, *, old: Baseline | None = None, tolerances: Sequence[Tolerance] = ()
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Columns and constants of a baseline, see `write_baseline`."""
    incomplete = np.flatnonzero(~np.asarray(columns.get("complete", ()), bool))
    if len(incomplete):
        raise SweepError(f"{len(incomplete)} recipes have no whole results, so there is no baseline of them")
    kept = [*filter(is_axis, columns), *filter(is_metric, columns), "recipe_hash"]
    arrays = column_arrays({name: columns[name] for name in kept})
    if old is not None:
        arrays |= _settled(old, arrays, (Tolerance(), *tolerances))
    varying, constants = split_constants(arrays)
    order = _sorted_rows([array for name, array in varying.items() if is_axis(name) or name == "recipe_hash"])
    return {name: array[order] for name, array in varying.items()}, dict(sorted(constants.items()))


def _settled(old: Baseline, arrays: Table, tolerances: Sequence[Tolerance]) -> dict[str, np.ndarray]:
    """Metrics in which values within the tolerance are the old ones."""
    pairs = pair_rows(old.columns, arrays).pairs
    now, before = (np.array(list(rows), int) for rows in (pairs.keys(), pairs.values()))
    out: dict[str, np.ndarray] = {}
    for name in (name for name in filter(is_metric, arrays) if name in old.columns):
        was, values = as_floats(old.columns[name])[before], as_floats(arrays[name])
        is_near = tolerance_of(name, tolerances).is_kept(was, values[now], UNITS.get(name, "1"))
        values[now[is_near]] = was[is_near]
        is_whole = np.asarray(arrays[name]).dtype.kind in "iu" and bool((values == np.rint(values)).all())
        out[name] = values.astype(np.int64) if is_whole else values
    return out


def _sorted_rows(columns: Sequence[np.ndarray]) -> list[int]:
    """Rows in order of their cells: what is missing, then numbers, then text."""

    def key(row: int) -> list[tuple[int, float, str]]:
        cells = [plain_cell(column[row]) for column in columns]
        return [(0, 0.0, "") if c is None else (2, 0.0, c) if isinstance(c, str) else (1, float(c), "") for c in cells]

    return sorted(range(len(columns[0])), key=key)
