"""Which rows of two tables are of the same recipe."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....datasets.sweeps.table_text import cell_text
from .table import is_axis, plain_cell


@dataclass(frozen=True)
class RowPairs:
    """Rows of an earlier table and of a new one that are of the same recipe."""

    pairs: Mapping[int, int]
    """Row of the earlier table by row of the new one, those of `renewed` included."""
    renewed: Mapping[int, int]
    """Of these the ones that agree in name only."""
    missing: tuple[int, ...]
    """Rows of the earlier table without a partner."""
    added: tuple[int, ...]
    """Rows of the new table without a partner."""


def pair_rows(old: Mapping[str, np.ndarray], new: Mapping[str, Sequence[Any] | np.ndarray]) -> RowPairs:
    """Match the rows of two tables by hash, and those that are left by name (`_renewed`)."""
    old_row = {str(key): i for i, key in enumerate(old["recipe_hash"]) if is_complete(old, i)}
    new_row = {str(key): i for i, key in enumerate(new["recipe_hash"])}
    pairs = {row: old_row[key] for key, row in new_row.items() if key in old_row}
    gone = [row for key, row in old_row.items() if key not in new_row]
    renewed = _renewed(old, gone, new, [row for row in new_row.values() if row not in pairs])
    pairs |= renewed
    found = set(pairs.values())
    missing = tuple(row for row in gone if row not in found)
    return RowPairs(pairs, renewed, missing, tuple(row for row in new_row.values() if row not in pairs))


def _renewed(
    old: Mapping[str, np.ndarray], gone: Sequence[int], new: Mapping[str, Any], added: Sequence[int]
) -> dict[int, int]:
    """Rows of a baseline by rows of a sweep that agree in all columns of the recipe: only hashes differ.

    gone, added: the rows that are looked at; those that several others agree with are left out. Values are compared as
    text, because a baseline that is text does not keep whether a name such as 7 is a number.
    """
    axes = [name for name in new if is_axis(name) and name in old]
    rows: list[dict[tuple[str, ...], list[int]]] = []
    for table, own in ((old, gone), (new, added)):
        alike: dict[tuple[str, ...], list[int]] = {}
        for row in own:
            alike.setdefault(tuple(cell_text(plain_cell(table[name][row])) for name in axes), []).append(row)
        rows.append(alike)
    before, now = rows
    return {now[key][0]: own[0] for key, own in before.items() if len(own) == 1 == len(now.get(key, ()))}


def is_complete(columns: Mapping[str, Sequence[Any] | np.ndarray], row: int) -> bool:
    """Whether a row has all results; so has every row of a table that does not say."""
    return "complete" not in columns or bool(columns["complete"][row])
