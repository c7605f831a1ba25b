"""Reading JSON and CSV of recordings: what is not as documented is refused with its place in the file.

Vectors are lists or objects with x, y, z (and w); null and NaN are values that are not known.
"""

import csv
import io
import json
import math
import reprlib
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from ..bounded_file import ANY_SIZE, read_content, read_text, require_parsable
from ..errors import RecordingError
from ..json_text import parse_json
from ..motions.table_cells import COMMA, header_of, not_a_number, not_utf8, number_in, without_empty_end, wrong_count
from ..rigid import Numbers
from .lz_string import decompress_base64

LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
COLUMNS_MOST = 4096
"""Most columns of a CSV; those of two hands with everything that LeapC gives are 400."""
LINE_SUFFIXES = (".jsonl", ".ndjson")
"""Suffixes of JSON Lines."""
_AXES = "xyzw"
_BEYOND = 1e30  # no length, angle or time of a recording in any unit

Json = Any


def read_json(path: Path) -> Json:
    """The content of a JSON file, or of JSON Lines, one frame a line: {"frames": [...]} with what the first line has.

    A file that ends with .lz is decompressed. Raises RecordingError naming line and column where JSON breaks off.
    """
    try:
        if path.suffix.lower() == ".lz":
            return _value_of(decompress_base64(read_content(path)))
        text = read_text(path)
        return _json_lines(text) if path.suffix.lower() in LINE_SUFFIXES else _parse(text)
    except UnicodeDecodeError as error:
        raise RecordingError(not_utf8(error.object)) from None
    except json.JSONDecodeError as error:
        raise RecordingError(f"line {error.lineno} column {error.colno}: not JSON: {error.msg}") from None
    except RecordingError:
        raise
    except ValueError as error:
        raise RecordingError(f"not JSON that can be read: {error}") from None


def _value_of(text: str) -> Json:
    return parse_json(text, allow_nan=True, text_most=ANY_SIZE)


def _parse(text: str) -> Json:
    try:
        return _value_of(text)
    except json.JSONDecodeError as error:
        if error.msg != "Extra data":
            raise
        return _json_lines(text)


def _json_lines(text: str) -> Json:
    """Frames of JSON Lines; a first line without hands is the file's head."""
    require_parsable(text)
    values: list[Json] = []
    for number, line in enumerate(io.StringIO(text), start=1):
        if not line.strip():
            continue
        try:
            values.append(_value_of(line))
        except json.JSONDecodeError as error:
            raise RecordingError(
                f"line {number} column {error.colno}: neither JSON nor JSON Lines, one value a line: {error.msg}"
            ) from None
    head = cast("dict[str, Json]", values[0]) if values and isinstance(values[0], dict) else {"hands": None}
    return {"frames": values} if "hands" in head else {**head, "frames": values[1:]}


def entry(node: Json, name: str, place: str) -> Json:
    """The value of an object's entry. Raises RecordingError if there is no such entry."""
    if not isinstance(node, dict):
        raise RecordingError(f"{place}: must be an object with {name!r}, got {_describe(node)}")
    if name not in node:
        raise RecordingError(f"{place}: {name!r} is missing; there is {sorted(cast('dict[str, Json]', node))}")
    return cast(Json, node[name])


def optional(node: Json, name: str, place: str) -> Json:
    """The same, or None where the object has no such entry."""
    if not isinstance(node, dict):
        raise RecordingError(f"{place}: must be an object, got {_describe(node)}")
    return cast("dict[str, Json]", node).get(name)


def items(node: Json, place: str) -> list[Json]:
    """A list."""
    if not isinstance(node, list):
        raise RecordingError(f"{place}: must be a list, got {_describe(node)}")
    return cast("list[Json]", node)


def mapping(node: Json, place: str) -> dict[str, Json]:
    """An object, whatever its names."""
    if not isinstance(node, dict):
        raise RecordingError(f"{place}: must be an object, got {_describe(node)}")
    return cast("dict[str, Json]", node)


def number(node: Json, place: str) -> float:
    """A number; null, and what is beyond all measure, is NaN."""
    if node is None:
        return math.nan
    if isinstance(node, bool) or not isinstance(node, (int, float)):
        raise RecordingError(f"{place}: must be a number, got {_describe(node)}")
    return _measure(node)


def truth(node: Json, place: str) -> bool | None:
    """True or false, which 1 and 0 are too; null is None."""
    if node is None or isinstance(node, bool):
        return node
    if isinstance(node, (int, float)) and node in (0, 1):
        return bool(node)
    raise RecordingError(f"{place}: must be true or false, got {_describe(node)}")


def flags(node: Json, place: str) -> int:
    """An integer >= 0 that is used as flags."""
    value = number(node, place)
    if not (value >= 0.0 and value.is_integer()):
        raise RecordingError(f"{place}: must be a whole number, got {_describe(node)}")
    return int(value)


def vector(node: Json, size: int, place: str) -> Numbers:
    """A vector of 3 or 4, or the 16 of a matrix: a list, or an object with x, y, z, w or 0, 1, 2; null is all NaN."""
    if node is None:
        return np.full(size, np.nan)
    if isinstance(node, dict) and "0" in node:  # JSON of a typed array, as Float32Array
        node = [entry(node, str(index), place) for index in range(len(cast("dict[str, Json]", node)))]
    elif isinstance(node, dict) and size <= len(_AXES):
        node = [entry(node, axis, place) for axis in _AXES[:size]]
    values = items(node, place)
    if len(values) != size:
        raise RecordingError(f"{place}: must have {size} numbers, got {len(values)}")
    return np.array([number(value, place) for value in values])


def unit_factor(head: Json, name: str, units: dict[str, float], default: str | None) -> float:
    """Metres or seconds in a file's unit; refused if the file must state it and does not."""
    unit = optional(head, name, "file") if isinstance(head, dict) else None
    unit = default if unit is None else unit
    if not isinstance(unit, str) or unit not in units:
        problem = "is missing" if unit is None else f"is {unit!r}"
        raise RecordingError(f"{name!r} {problem}; it must be one of {', '.join(units)}")
    return units[unit]


class Table(NamedTuple):
    """A CSV file with a header."""

    columns: list[str]
    rows: list[list[str]]
    lines: list[int]
    """Of each row, counted from 1."""
    separator: str = COMMA

    def numbers(self, names: list[str]) -> Numbers:
        """Columns as numbers, shape [row, name]; an empty cell is NaN. Raises RecordingError with line and column."""
        places = [self._column(name) for name in names]
        out = np.empty((len(self.rows), len(names)))
        for index, row in enumerate(self.rows):
            for target, place in enumerate(places):
                cell = row[place].strip()
                try:
                    out[index, target] = _measure(number_in(cell, self.separator)) if cell else math.nan
                except ValueError:
                    problem = not_a_number(cell, names[target])
                    raise RecordingError(f"line {self.lines[index]}: {problem}") from None
        return out

    def texts(self, name: str) -> list[str]:
        """A column as text."""
        place = self._column(name)
        return [row[place].strip() for row in self.rows]

    def has(self, name: str) -> bool:
        """Whether there is such a column."""
        return name in self.columns

    def time(self) -> Numbers:
        """The column `time_s`, `time_ms`, `time_us` or `time_ns` in seconds."""
        found = [unit for unit in TIME_UNITS if f"time_{unit}" in self.columns]
        if len(found) != 1:
            wanted = ", ".join(f"time_{unit}" for unit in TIME_UNITS)
            raise RecordingError(f"the header must have one of {wanted}; it has {', '.join(self.columns[:12])}")
        return self.numbers([f"time_{found[0]}"])[:, 0] * TIME_UNITS[found[0]]

    def _column(self, name: str) -> int:
        if name not in self.columns:
            raise RecordingError(f"column {name} is missing; the header has {', '.join(self.columns[:12])}")
        return self.columns.index(name)


def read_table(path: Path) -> Table:
    """Read a CSV file with a header; blank lines are skipped. Raises RecordingError with the line."""
    rows: list[list[str]] = []
    lines: list[int] = []
    content = read_content(path)
    require_parsable(content)
    try:
        with io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig", newline="") as file:
            header = header_of(file)
            named = next(csv.reader([header.line], delimiter=header.separator), list[str]())
            columns = without_empty_end([cell.strip() for cell in named])
            _require_columns(columns, f"line {header.number}")
            reader = csv.reader(file, delimiter=header.separator)
            for row in reader:
                if not any(cell.strip() for cell in row):
                    continue
                line = header.number + reader.line_num
                cells = without_empty_end(row, len(columns))
                if len(cells) != len(columns):
                    raise RecordingError(f"line {line}: {wrong_count(len(cells), len(columns), header.separator)}")
                rows.append(cells)
                lines.append(line)
    except UnicodeDecodeError:
        raise RecordingError(not_utf8(content)) from None
    except csv.Error as error:
        raise RecordingError(f"not a CSV file: {error}") from None
    if not rows:
        raise RecordingError("no row below the header" if columns else "empty file")
    return Table(columns, rows, lines, header.separator)


def _require_columns(columns: list[str], place: str) -> None:
    if len(columns) > COLUMNS_MOST:
        raise RecordingError(f"{place}: {len(columns)} columns, at most {COLUMNS_MOST} can be")
    twice = next((name for name, count in Counter(columns).items() if name and count > 1), None)
    if twice is not None:
        problem = f"column {twice} is there twice: a header must be there, and name each column once"
        raise RecordingError(f"{place}: {problem}")


def _measure(value: float) -> float:
    return float(value) if abs(value) < _BEYOND else math.nan


def _describe(node: Json) -> str:
    text = reprlib.repr(node)  # of what is nested as deeply as may be, too
    return text if len(text) <= 40 else f"{text[:40]}..."
