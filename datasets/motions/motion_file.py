"""Motion files, CSV and HDF5: named arrays in, named arrays out, each row with its place in the file.

| CSV                                  | what happens                                                       |
|--------------------------------------|--------------------------------------------------------------------|
| header `time,x,y,z,qx,qy,qz,qw`      | read; any order and case, also `time [s]` and `x [m]`              |
| the same with more columns           | read with a warning that names the columns that are left out       |
| header `x,y,z,qx,qy,qz,qw`           | read as poses without time                                         |
| any other header, none, empty file   | refused, showing what was found                                    |
| `;` or tabs between cells            | read; a comma is then a decimal comma, as in European spreadsheets |
| byte order mark, CRLF, blank lines   | read; blank lines are skipped but counted as lines                 |
| quotes, comments, empty cells        | read as `table_cells` describes                                    |
| missing or extra column, no number   | refused with the line in the file (from 1) and the column          |
| not UTF-8                            | refused                                                            |
"""

import io
import json
import re
from array import array
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ..bounded_file import open_regular, read_content, require_bytes
from ..errors import Hdf5Error, MotionError, RecordingWarning, name_nothing
from ..json_text import parse_json
from ..known_names import likely_file
from ..storage.durable import write_file
from ..storage.hdf5 import FAILURES
from ..storage.hdf5_declared import h5py
from ..storage.hdf5_opening import StrictFile, open_hdf5
from ..user_warnings import warn_user
from .table_cells import (
    Header,
    cells_of,
    header_of,
    not_a_number,
    not_utf8,
    number_in,
    text_lines,
    without_empty_end,
    wrong_count,
)

POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
TIME_COLUMN = "time"
_KNOWN = (TIME_COLUMN, *POSE_COLUMNS)
_OTHERS_SHOWN = 4  # of columns that are left out, in a warning
_ROWS_AT_ONCE = 65536  # of a CSV, after which what they take is counted
_SUFFIX_CSV = (".csv",)
_SUFFIX_HDF5 = (".h5", ".hdf5")
_COLUMN_IN_SI = re.compile(r"(time)(?:_s| *[\[(]s[\])])|([xyz])(?:_m| *[\[(]m[\])])")
_COLUMN_IN_MS = re.compile(r"time[ _]*[\[(]?ms[\])]?")


class MotionRows(NamedTuple):
    """The rows of a motion file as they stand there, unchecked."""

    time: NDArray[np.float64] | None
    """[s], shape [pose]; None where the file has no time."""
    pose: NDArray[np.float32] | NDArray[np.float64]
    """x y z [m], qx qy qz qw; shape [pose, 7]."""
    offset: float
    """The clock's reading at time 0 [s]."""
    seed: int | None
    """The seed of a synthetic motion."""
    place: Callable[[int], str]
    """Names a row as its file counts it, for messages."""
    provenance: Mapping[str, Any] | None = None
    """What made a synthetic motion, as JSON."""


def row_place(row: int) -> str:
    """Name a row of an array, counted from 0."""
    return f"row {row}"


def read_rows(path: Path) -> MotionRows:
    """Read a motion file; the suffix .csv, .h5 or .hdf5 selects the format. Raises MotionError with the path."""
    form = _form(path)
    try:
        return _rows_from_csv(path) if form == "csv" else _rows_from_hdf5(path)
    except FileNotFoundError:
        raise name_nothing(MotionError(f"{path}: no such motion file{likely_file(path)}")) from None
    except MotionError as error:
        raise MotionError(f"{path}: {error}") from None
    except OSError as error:
        raise MotionError(f"{path}: cannot be read as a motion: {error}") from error
    except MemoryError:
        raise MotionError(f"{path}: cannot be read as a motion: it takes more memory than there is") from None


def write_rows(path: Path, rows: MotionRows, *, overwrite: bool) -> None:
    """Write a motion file whole or not at all (temporary name, then rename). Raises MotionError with the path."""
    form = _form(path)
    if path.exists() and not overwrite:
        raise MotionError(f"{path}: exists already; overwrite=True replaces it")
    content = _csv_bytes(rows) if form == "csv" else _hdf5_bytes(rows)
    try:
        write_file(path, content)
    except OSError as error:
        raise MotionError(f"{path}: cannot be written: {error}") from error


def _form(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix in _SUFFIX_CSV:
        return "csv"
    if suffix in _SUFFIX_HDF5:
        return "hdf5"
    known = ", ".join(_SUFFIX_CSV + _SUFFIX_HDF5)
    raise name_nothing(MotionError(f"{path}: unknown suffix {path.suffix!r} for a motion file; known: {known}"))


def _rows_from_csv(path: Path) -> MotionRows:
    numbers, line_number = array("d"), array("q")
    with open_regular(path) as stream:
        try:
            lines = text_lines(stream)  # not splitlines: form feeds and Unicode separators end no line in an editor
            header = header_of(lines)
            names = _names(header)
            taken = {name: index for index, name in enumerate(names) if name in _KNOWN}
            blank = f'{header.separator} \t"'
            for number, line in enumerate(lines, start=header.number + 1):
                if not line.strip().strip(blank):
                    continue
                numbers.extend(_row_numbers(number, line, header.separator, taken, len(names)))
                line_number.append(number)
                if len(line_number) % _ROWS_AT_ONCE == 0:
                    require_bytes(8 * (len(numbers) + len(line_number)), "the table in it")
        except UnicodeDecodeError:
            raise MotionError(not_utf8(read_content(path))) from None
        except MotionError:
            raise
        except ValueError as error:
            raise MotionError(str(error)) from None
    if others := [name for name in names if name and name not in taken]:
        shown = f"{', '.join(others[:_OTHERS_SHOWN])}{', ...' if len(others) > _OTHERS_SHOWN else ''}"
        warn_user(f"{path}: left out what is no column of a motion: {shown:.200}", RecordingWarning)
    columns = tuple(taken)
    table = np.frombuffer(numbers, dtype=np.float64).reshape(-1, len(columns))
    timed = TIME_COLUMN in columns
    order = [columns.index(name) for name in POSE_COLUMNS]
    first = order[0]
    in_order = order == list(range(first, first + len(POSE_COLUMNS)))
    pose = table[:, first : first + len(POSE_COLUMNS)] if in_order else table[:, order]

    def place(row: int) -> str:
        return f"line {line_number[row]}"

    return MotionRows(table[:, columns.index(TIME_COLUMN)] if timed else None, pose, 0.0, None, place)


def is_pose_table(lines: Iterable[str]) -> bool:
    """Whether a CSV's header names places without naming whose: of a palm's poses. A recording's names joints, too."""
    header = header_of(lines)
    try:
        names = {_column_name(cell) for cell in cells_of(header.line, header.separator)}
    except ValueError:
        return False
    return names.issuperset("xyz") and not names & {"joint", "landmark"}


def _column_name(cell: str) -> str:
    """A column's name in lower case, without a unit that palpate reads it in."""
    name = cell.strip().lower()
    found = _COLUMN_IN_SI.fullmatch(name)
    return name if found is None else found[1] or found[2]


def _names(header: Header) -> list[str]:
    """Names of columns; refused unless each of a pose is there once, and others only beside all of these and time."""
    if not header.number:
        raise MotionError("empty file")
    number, line, separator = header.number, header.line, header.separator
    names = [_column_name(cell) for cell in without_empty_end(cells_of(line, separator))]
    known = sorted(name for name in names if name in _KNOWN)
    if known == sorted(_KNOWN) or sorted(names) == sorted(POSE_COLUMNS):
        return names
    shown = line.strip() if len(line) < 80 else f"{line.strip()[:80]}..."
    way = ""
    if any(_COLUMN_IN_MS.fullmatch(name) for name in names):
        way = f"; times are in seconds: divide them by 1000, and name the column {TIME_COLUMN}"
    wanted = ",".join(_KNOWN)
    raise MotionError(f"line {number}: header {shown!r} is not {wanted!r} (in any order; time may be left out){way}")


def _row_numbers(number: int, line: str, separator: str, taken: Mapping[str, int], count: int) -> list[float]:
    """The numbers of a row of `count` cells in the columns of the indices `taken`."""
    try:
        cells = cells_of(line, separator)
    except ValueError as error:
        raise MotionError(f"line {number}: {error}") from None
    cells = without_empty_end(cells, count) if len(cells) > count else cells
    if len(cells) != count:
        raise MotionError(f"line {number}: {wrong_count(len(cells), count, separator)}")
    values: list[float] = []
    for name, index in taken.items():
        try:
            values.append(number_in(cells[index], separator))
        except ValueError:
            raise MotionError(f"line {number}: {not_a_number(cells[index], name)}") from None
    return values


def _csv_bytes(rows: MotionRows) -> bytes:
    clock = None if rows.time is None else _clock(rows.time, rows.offset)
    header = POSE_COLUMNS if clock is None else (TIME_COLUMN, *POSE_COLUMNS)
    lines = [",".join(header)]
    for index, row in enumerate(rows.pose):
        cells = [str(value) for value in row]  # shortest text that reads back as the same float32
        lines.append(",".join(cells if clock is None else [repr(float(clock[index])), *cells]))
    return ("\n".join(lines) + "\n").encode("ascii")


def _clock(time: NDArray[np.float64], offset: float) -> NDArray[np.float64]:
    clock = time + offset
    stuck = np.flatnonzero(np.diff(clock) <= 0.0)
    if stuck.size:
        row = int(stuck[0]) + 1
        raise MotionError(f"row {row}: a CSV cannot tell its time from the row before at the offset {offset!r} s")
    return clock


def _rows_from_hdf5(path: Path) -> MotionRows:
    try:
        with open_hdf5(path) as file:
            if "/motion/pose" not in file:
                raise MotionError("an HDF5 file without /motion/pose")
            pose = _numbers(file, "/motion/pose", 2)
            time = _numbers(file, "/motion/time", 1) if "/motion/time" in file else None
            own = file.whole("/motion", "seed")
            seed = file.whole("/", "seed") if own is None else own
            offset = file.number("/motion", "offset") or 0.0
            return MotionRows(time, pose, offset, seed, row_place, _provenance(file.attribute("/motion", "provenance")))
    except Hdf5Error as error:
        raise MotionError(str(error)) from None
    except (MotionError, FileNotFoundError, IsADirectoryError, PermissionError):
        raise
    except FAILURES as error:
        raise MotionError(f"not a readable HDF5 file ({error})") from error


def _provenance(value: object) -> dict[str, Any] | None:
    """A JSON object kept in an attribute, if there is one."""
    if value is None:
        return None
    try:
        made: Any = parse_json(value) if isinstance(value, str) else None
    except ValueError as error:
        raise MotionError(f"attribute provenance of /motion is not JSON: {error}") from None
    if not isinstance(made, dict):
        raise MotionError("attribute provenance of /motion is not a JSON object")
    return cast(dict[str, Any], made)


def _numbers(file: StrictFile, name: str, rank: int) -> NDArray[Any]:
    """As they are stored where that is float32 or float64: a copy in float64 would take twice the memory."""
    own = file.declared(name)
    if len(own.shape) != rank:
        raise MotionError(f"{name} is not an array of numbers of {rank} dimensions, but {own.dtype} {list(own.shape)}")
    values = file.read(name)
    return values if values.dtype.kind == "f" and values.itemsize >= 4 else values.astype(np.float64)


def _hdf5_bytes(rows: MotionRows) -> bytes:
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        file.attrs.update({"format": "palpate motion", "version": np.array([1, 0], dtype=np.int32)})
        group: Any = file.create_group("motion")
        group.attrs["offset"] = rows.offset
        if rows.seed is not None:
            group.attrs["seed"] = rows.seed
        if rows.provenance is not None:
            group.attrs["provenance"] = json.dumps(dict(rows.provenance), sort_keys=True)
        pose: Any = group.create_dataset("pose", data=rows.pose.astype(np.float32), fletcher32=True)
        pose.attrs.update({"units": "m (x y z), 1 (qx qy qz qw)", "frame": "array"})
        if rows.time is not None:
            time: Any = group.create_dataset("time", data=rows.time, fletcher32=True)
            time.attrs["units"] = "s"
    return image.getvalue()
