"""A table as text that people review in a diff: CSV, below lines that begin with # and hold what all rows share."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from ..bounded_file import read_content, require_bytes, require_parsable
from ..errors import SweepStoreError
from ..json_text import parse_json
from ..storage.durable import write_file
from ..storage.hdf5_columns import Columns, Values, column_array, column_arrays, naming_failures

CSV = ".csv"
"""What the name of a table as text ends with."""

CONSTANTS = "constants"
"""Attribute of a table: value by name of the columns that have one value in all rows, and are therefore left out."""

Constant = str | int | float | bool | None

_FORMAT, _VERSION = "palpate text table", 1
_HEAD = f"# {_FORMAT} {_VERSION}: each line below of the form '# name = value' holds for all rows"
# As Python writes numbers. A hash of 32 digits is none, though all may be decimal ones.
_NUMBER = re.compile(r"-?(?:[0-9]{1,20}(?:\.[0-9]{1,25})?(?:e[+-]?[0-9]{1,3})?|inf)")
_WHOLE = re.compile(r"-?[0-9]{1,18}")
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_GUARDED = re.compile(r"'+[=+\-@\t\r]")
_EXACT = 1 << 53  # below it float64 holds every whole number


def write_csv(
    path: str | Path, columns: Mapping[str, Values], attributes: Mapping[str, Any], *, units: object = None
) -> None:
    """Write a table as text, whole or not at all, replacing an earlier one.

    Numbers are the shortest text that gives the same float64 again; what is missing is empty; text that a spreadsheet
    would compute, such as a name that begins with `=`, gets a `'` in front, which reading takes away again. Of the
    attributes only CONSTANTS is kept, a mapping. units: not kept; here so that all writers of tables are called alike.

    Raises:
        SweepStoreError: Columns are impossible, or the file cannot be written; nothing is left behind.
    """
    del units
    arrays = column_arrays(columns)
    constants = attributes.get(CONSTANTS, {}).items()
    lines = [_HEAD, *(f"# {name} = {json.dumps(_plain(value), ensure_ascii=False)}" for name, value in constants)]
    lines.append(",".join(map(_quoted, arrays)))
    cells = [[_quoted(_guarded(cell_text(value))) for value in array.tolist()] for array in arrays.values()]
    lines += [",".join(row) for row in zip(*cells, strict=True)]
    try:
        write_file(Path(path), "".join(f"{line}\n" for line in lines).encode())
    except OSError as error:
        raise SweepStoreError(f"{path} cannot be written: {error.strerror or error}") from error


def read_csv(path: Path) -> tuple[Columns, dict[str, Constant]]:
    """Columns and constants of a table as text. A column of numbers alone becomes int64 or float64, another one text.

    Raises:
        SweepStoreError: It is missing, too large, or no table of this form; names the line.
    """
    with naming_failures(path):
        content = read_content(path)
        require_parsable(content)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SweepStoreError(f"{path} is not UTF-8 text: {error}") from error
    lines = text.split("\n")
    head = next((k for k, line in enumerate(lines) if not line.startswith("#")), len(lines))
    constants = _constants(path, [line.rstrip("\r") for line in lines[:head]])
    return _columns(path, "\n".join(lines[head:]), head), constants


def require_constants(path: Path, constants: object) -> dict[str, Constant]:
    """Constants that a file holds, if each is text, a number, true, false or null; else raises SweepStoreError."""
    if not isinstance(constants, dict):
        raise SweepStoreError(f"{path}: {CONSTANTS} is {type(constants).__name__}, expected an object")
    found = cast("dict[str, Any]", constants)
    for name, value in found.items():
        if value is not None and not isinstance(value, str | int | float):
            raise SweepStoreError(f"{path}: constant {name} is {value!r}, expected text, a number, true, false or null")
    return found


def constant_columns(path: Path, constants: Mapping[str, Constant], row_count: int) -> Columns:
    """A column of equal values for each constant; raises SweepStoreError for more bytes than a file may take."""
    with naming_failures(path):
        require_bytes(8 * row_count * len(constants), "its constants as columns")
    try:
        return {name: column_array(name, [value]).repeat(row_count) for name, value in constants.items()}
    except SweepStoreError as error:
        raise SweepStoreError(f"{path}: {error}") from error


def _constants(path: Path, lines: list[str]) -> dict[str, Constant]:
    match = re.match(rf"# {_FORMAT} ([0-9]{{1,9}})\b", lines[0]) if lines else None
    if match is None:
        raise SweepStoreError(f"{path} is no table: its first line must begin with '# {_FORMAT} {_VERSION}'")
    if int(match[1]) > _VERSION:
        raise SweepStoreError(f"{path} has format version {match[1]}, this palpate reads up to {_VERSION}")
    found: dict[str, Any] = {}
    for number, line in enumerate(lines[1:], 2):
        name, equals, value = line[1:].partition(" = ")
        try:
            found[name.strip()] = parse_json(value, allow_nan=True) if equals else None
        except ValueError as error:
            raise SweepStoreError(f"{path}:{number}: the value of{name} is not JSON: {error}") from error
        if not equals:
            raise SweepStoreError(f"{path}:{number}: expected '# name = value', not {line[:80]!r}")
    return require_constants(path, found)


def _columns(path: Path, text: str, first: int) -> Columns:
    """Columns of CSV that begins below `first` lines."""
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
    names = rows[0] if rows else []
    if len(set(names)) < len(names):
        raise SweepStoreError(f"{path}:{first + 1}: a column stands there more than once")
    cells = zip(*rows[1:], strict=True) if rows[1:] else [() for _ in names]
    try:
        return column_arrays({name: _values(own) for name, own in zip(names, cells, strict=True)})
    except SweepStoreError as error:
        raise SweepStoreError(f"{path}: {error}") from error


def _values(cells: tuple[str, ...]) -> list[Any]:
    if not all(not cell or _NUMBER.fullmatch(cell) for cell in cells):
        return [cell[1:] if _GUARDED.match(cell) else cell for cell in cells]
    return [None if not cell else int(cell) if _WHOLE.fullmatch(cell) else float(cell) for cell in cells]


def cell_text(value: Any) -> str:
    """A cell of a table as text, before it is quoted: the same for 7 and 7.0, empty for None and NaN."""
    plain = _plain(value)
    return "" if plain is None else str(plain)


def _quoted(text: str) -> str:
    """A cell of CSV, in quotes if a reader would otherwise take a part of it for a separator or a comment.

    The csv module of Python 3.11 leaves a lone carriage return without quotes, which its reader takes for a line's end.
    """
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',"#\r\n') else text


def _guarded(text: str) -> str:
    """A cell with a `'` in front of what begins a formula in spreadsheets; OWASP, "CSV Injection", lists the signs."""
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def _plain(value: Any) -> Any:
    """A value with one text for each meaning: whole numbers without a decimal point, true as 1, NaN as None."""
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, bool) or (isinstance(value, float) and value.is_integer() and abs(value) < _EXACT):
        return int(value)
    return value
