"""Columns of a table: what a list of values becomes, and what no file holds."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import SweepStoreError, name_nothing

Values = Sequence[Any] | NDArray[Any]
"""A column: an array, or a list of str, float, int, bool and None."""

Columns = dict[str, NDArray[Any]]
"""Columns of equal length, by name."""


def column_arrays(columns: Mapping[str, Values]) -> Columns:
    """Columns as arrays of bool, a number type, or object for text. An array of numbers keeps its dtype.

    | list has | becomes | None is |
    |---|---|---|
    | only bool | bool | - |
    | int, bool | int64 | - |
    | bool, int or float, with None; None alone | float64 | NaN |
    | float, also with int and bool | float64 | NaN |
    | str | object, of str | "" |

    Raises:
        SweepStoreError: Lengths differ, or a column has a mixture of text and numbers, an int beyond 64 bits, text that
            UTF-8 cannot hold, or anything else; names the column.
    """
    arrays = {name: _column_array(name, values) for name, values in columns.items()}
    if len({len(array) for array in arrays.values()}) > 1:
        shown = ", ".join(f"{name}: {len(array)}" for name, array in list(arrays.items())[:8])
        raise SweepStoreError(f"columns of a table have equally many rows, not {shown}")
    if wrong := [name for name in arrays if not name or not name.isprintable()]:
        raise SweepStoreError(f"{wrong[0]!r} cannot name a column: it is empty, or has a control character")
    return arrays


def _column_array(name: str, values: Values) -> NDArray[Any]:
    if isinstance(values, np.ndarray):
        if values.ndim != 1:
            raise SweepStoreError(f"column {name} has shape {list(values.shape)}; a column has one dimension")
        if values.dtype.kind in "biuf":
            return values.astype(values.dtype.newbyteorder("="), copy=False)
    items: list[Any] = [cast("Any", item).item() if isinstance(item, np.generic) else item for item in values]
    kinds: set[type[Any]] = {type(item) for item in items}
    filled = kinds - {type(None)}
    if filled == {str}:
        return _text_array(name, ["" if item is None else item for item in items])
    if not filled <= {bool, int, float}:
        found = ", ".join(sorted(kind.__name__ for kind in filled))
        raise SweepStoreError(f"column {name} mixes {found}; a column has one of text or numbers")
    if kinds == {bool}:
        return np.array(items, np.bool_)
    try:
        if kinds and kinds <= {bool, int}:
            return np.array(items, np.int64)
        return np.array([np.nan if item is None else item for item in items], np.float64)
    except OverflowError as error:
        raise SweepStoreError(f"column {name} has a whole number beyond 64 bits") from error


def _text_array(name: str, items: list[str]) -> NDArray[Any]:
    for number, item in enumerate(items):
        if "\0" in item or (not item.isascii() and any("\ud800" <= sign <= "\udfff" for sign in item)):
            raise SweepStoreError(f"row {number} of column {name} is {item!r}, which is not text that files hold")
    texts = np.empty(len(items), object)
    texts[:] = items
    return texts


@contextmanager
def naming_failures(path: Path) -> Generator[None, None, None]:
    """Turns what the system and libraries raise for a bad file into a SweepStoreError that names it."""
    try:
        yield
    except FileNotFoundError:
        raise name_nothing(SweepStoreError(f"{path} does not exist")) from None
    except (OSError, ValueError, TypeError, LookupError, NotImplementedError, MemoryError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SweepStoreError(f"{path} cannot be read: {reason}") from error
