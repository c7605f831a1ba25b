"""A table as CSV, which every program reads; that of a baseline begins with lines of what all of its rows share."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..bounded_file import read_content, require_bytes, require_parsable
from ..errors import SweepStoreError, name_nothing
from ..json_text import parse_json

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


Constant = str | int | float | bool | None

_FORMAT, _VERSION = "palpate text table", 1
_HEAD = f"# {_FORMAT} {_VERSION}: each line below of the form '# name = value' holds for all rows"
# As Python writes numbers. A hash of 32 digits is none, though all may be decimal ones.
_NUMBER = re.compile(r"-?(?:[0-9]{1,20}(?:\.[0-9]{1,25})?(?:e[+-]?[0-9]{1,3})?|inf)")
_WHOLE = re.compile(r"-?[0-9]{1,18}")
_FORMULA = re.compile(r"'*[=+\-@\t\r]")  # what begins a formula in spreadsheets; OWASP, "CSV Injection"
_GUARDED = re.compile(r"'+[=+\-@\t\r]")
_SPECIAL = re.compile(r'[,"#\r\n]')
_TRUTH = {"true": True, "false": False}
_EXACT = 1 << 53  # below it float64 holds every whole number


def csv_content(columns: Columns, constants: Mapping[str, Constant] | None = None) -> bytes:
    """A table as CSV: a line of names, then one a row; constants: None, or what all rows share, for lines above these.

    Numbers are the shortest text that gives the same float64 again; what is missing is empty; text that a spreadsheet
    would compute, such as a name that begins with `=`, gets a `'` in front, which reading takes away again.
    """
    lines: list[str] = []
    if constants is not None:
        shown = {name: json.dumps(_plain(value), ensure_ascii=False) for name, value in constants.items()}
        lines = [_HEAD, *(f"# {name} = {value}" for name, value in shown.items())]
    cells = [_cells(array.dtype.kind, array.tolist()) for array in columns.values()]
    lines += [",".join(row) for row in (map(_quoted, columns), *zip(*cells, strict=True))]
    return "".join(f"{line}\n" for line in lines).encode()


def read_csv(path: Path) -> Columns:
    """Columns of a table as CSV, with one of equal values for each constant.

    A column of numbers alone becomes int64 or float64, one of `true` and `false` bool, another one text.

    Raises:
        SweepStoreError: It is missing, too large, or no table of this form; names the line.
    """
    with naming_failures(path):
        content = read_content(path)
        require_parsable(content)
        lines = content.decode("utf-8-sig").split("\n")
    head = next((k for k, line in enumerate(lines) if not line.startswith("#")), len(lines))
    constants = _constants(path, [line.rstrip("\r") for line in lines[:head]])
    rows = _rows(path, "\n".join(lines[head:]), head)
    names = rows[0] if rows else []
    if len(set(names)) < len(names):
        raise SweepStoreError(f"{path}:{head + 1}: a column stands there more than once")
    columns = {name: _values(cells) for name, cells in zip(names, zip(*rows[1:], strict=True), strict=False)}
    columns = {name: columns.get(name, []) for name in names}  # without rows there are no cells
    shared = {name: value for name, value in constants.items() if name not in columns}
    with naming_failures(path):
        require_bytes(8 * len(rows) * len(shared), "its constants as columns")
    try:
        single = column_arrays({name: [value] for name, value in shared.items()})
        return column_arrays(columns) | {name: array.repeat(len(rows[1:])) for name, array in single.items()}
    except SweepStoreError as error:
        raise SweepStoreError(f"{path}: {error}") from error


def cell_text(value: Any) -> str:
    """A cell of a table as text, before it is quoted: the same for 7 and 7.0, empty for None and NaN."""
    plain = _plain(value)
    return "" if plain is None else str(plain)


def _constants(path: Path, lines: list[str]) -> dict[str, Constant]:
    """Constants that lines in front of the names hold."""
    match = re.match(rf"# {_FORMAT} ([0-9]{{1,9}})\b", lines[0]) if lines else None
    if lines and match is None:
        raise SweepStoreError(f"{path} is no table: a first line with # must begin with '# {_FORMAT} {_VERSION}'")
    if match is not None and int(match[1]) > _VERSION:
        raise SweepStoreError(f"{path} has format version {match[1]}, this palpate reads up to {_VERSION}")
    found: dict[str, Constant] = {}
    for number, line in enumerate(lines[1:], 2):
        name, equals, text = line[1:].partition(" = ")
        try:
            value: Any = parse_json(text, allow_nan=True) if equals else None
        except ValueError as error:
            raise SweepStoreError(f"{path}:{number}: the value of{name} is not JSON: {error}") from error
        if not equals:
            raise SweepStoreError(f"{path}:{number}: expected '# name = value', not {line[:80]!r}")
        if value is not None and not isinstance(value, str | int | float):
            raise SweepStoreError(f"{path}:{number}:{name} is {value!r}, expected text, a number, true, false or null")
        found[name.strip()] = value
    return found


def _rows(path: Path, text: str, first: int) -> list[list[str]]:
    """Rows of CSV that begins below `first` lines, the names included."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    rows: list[list[str]] = []
    try:
        for row in reader:
            if rows and len(row) != len(rows[0]):
                raise SweepStoreError(
                    f"{path}:{first + reader.line_num}: {len(row)} values, expected {len(rows[0])} as in the first row"
                )
            rows.append(row)
    except csv.Error as error:
        raise SweepStoreError(f"{path}:{first + reader.line_num}: {error}") from error
    return rows


def _values(cells: tuple[str, ...]) -> list[Any]:
    if all(not cell or _NUMBER.fullmatch(cell) for cell in cells):
        return [None if not cell else int(cell) if _WHOLE.fullmatch(cell) else float(cell) for cell in cells]
    if all(cell in _TRUTH for cell in cells):
        return [_TRUTH[cell] for cell in cells]
    return [cell[1:] if _GUARDED.match(cell) else cell for cell in cells]


def _cells(kind: str, values: list[Any]) -> list[str]:
    """A column as CSV; kind: of its dtype."""
    if kind == "b":
        return ["true" if value else "false" for value in values]
    if kind != "O":
        return [cell_text(value) for value in values]
    guarded = (f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text for text in values)
    return [_quoted(text) for text in guarded]


def _quoted(text: str) -> str:
    """A cell of CSV, in quotes if a reader would otherwise take a part of it for a separator or a comment.

    The csv module of Python 3.11 leaves a lone carriage return without quotes, which its reader takes for a line's end.
    """
    return '"' + text.replace('"', '""') + '"' if _SPECIAL.search(text) else text


def _plain(value: Any) -> Any:
    """A value with one text for each meaning: whole numbers without a decimal point, true as 1, NaN as None."""
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, bool) or (isinstance(value, float) and value.is_integer() and abs(value) < _EXACT):
        return int(value)
    return value
