"""Motion files, CSV and HDF5: named arrays in, named arrays out, each row with its place in the file.

| CSV                                  | what happens                                                       |
|--------------------------------------|--------------------------------------------------------------------|
| header `time,x,y,z,qx,qy,qz,qw`      | read; the names in any order, blanks around them allowed           |
| header `x,y,z,qx,qy,qz,qw`           | read as poses without time                                         |
| any other header, none, empty file   | refused, showing what was found                                    |
| `;` or tabs between cells            | read; a comma is then a decimal comma, as in European spreadsheets |
| byte order mark, CRLF, blank lines   | read; blank lines are skipped but counted as lines                 |
| missing or extra column, no number   | refused with the line in the file (from 1) and the column          |
| not UTF-8                            | refused                                                            |
"""

import io
import json
from array import array
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ..bounded_file import open_regular, read_content, require_bytes, text_lines
from ..errors import Hdf5Error, MotionError, name_nothing
from ..json_text import parse_json
from ..known_names import likely_file
from ..storage.durable import write_file
from ..storage.hdf5 import FAILURES
from ..storage.hdf5_opening import StrictFile, open_hdf5
from ..storage.hdf5_structure import h5py
from .table_cells import number_in, separator_of, wrong_count

POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
TIME_COLUMN = "time"
_ROWS_AT_ONCE = 65536  # of a CSV, after which what they take is counted
_SUFFIX_CSV = (".csv",)
_SUFFIX_HDF5 = (".h5", ".hdf5")


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
        write_file(path, memoryview(content))
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
    columns: tuple[str, ...] = ()
    separator = ""
    numbers, line_number = array("d"), array("q")
    with open_regular(path) as stream:
        try:
            # Not splitlines: form feeds and Unicode separators end no line in an editor.
            for number, line in enumerate(text_lines(stream), start=1):
                if not line.strip():
                    continue
                if not columns:
                    separator = separator_of(line)
                    columns = _columns(number, line, separator)
                    continue
                numbers.extend(_row_numbers(number, line, columns, separator))
                line_number.append(number)
                if len(line_number) % _ROWS_AT_ONCE == 0:
                    require_bytes(8 * (len(numbers) + len(line_number)), "the table in it")
        except UnicodeDecodeError:
            raise MotionError(f"byte {_not_text(path)} is not UTF-8 text") from None
        except MotionError:
            raise
        except ValueError as error:
            raise MotionError(str(error)) from None
    if not columns:
        raise MotionError("empty file")
    table = np.frombuffer(numbers, dtype=np.float64).reshape(-1, len(columns))
    timed = TIME_COLUMN in columns
    order = [columns.index(name) for name in POSE_COLUMNS]
    first = order[0]
    in_order = order == list(range(first, first + len(POSE_COLUMNS)))
    pose = table[:, first : first + len(POSE_COLUMNS)] if in_order else table[:, order]

    def place(row: int) -> str:
        return f"line {line_number[row]}"

    return MotionRows(table[:, columns.index(TIME_COLUMN)] if timed else None, pose, 0.0, None, place)


def _not_text(path: Path) -> int:
    """The first byte of a file that is not UTF-8; reading by lines gives its position only within a block."""
    try:
        read_content(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        return error.start
    return 0


def is_pose_header(line: str) -> bool:
    """Whether a CSV's header names places without naming whose: of a palm's poses. A recording's names joints, too."""
    names = {name.strip() for name in line.split(separator_of(line))}
    return names.issuperset("xyz") and not names & {"joint", "landmark"}


def _columns(number: int, line: str, separator: str) -> tuple[str, ...]:
    found = tuple(name.strip() for name in line.split(separator))
    for known in ((TIME_COLUMN, *POSE_COLUMNS), POSE_COLUMNS):
        if len(found) == len(known) and set(found) == set(known):
            return found
    wanted = ",".join((TIME_COLUMN, *POSE_COLUMNS))
    shown = line.strip() if len(line) < 80 else f"{line.strip()[:80]}..."
    raise MotionError(f"line {number}: header {shown!r} is not {wanted!r} (in any order; time may be left out)")


def _row_numbers(number: int, line: str, columns: tuple[str, ...], separator: str) -> list[float]:
    cells = line.split(separator)
    if len(cells) != len(columns):
        raise MotionError(f"line {number}: {wrong_count(len(cells), len(columns), separator)}")
    values: list[float] = []
    for name, cell in zip(columns, cells, strict=True):
        try:
            values.append(number_in(cell, separator))
        except ValueError:
            raise MotionError(f"line {number}: {cell.strip()!r} in column {name} is not a number") from None
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
            if "/motion/pose" not in file.datasets:
                raise MotionError("an HDF5 file without /motion/pose")
            pose = _numbers(file, "/motion/pose", 2)
            time = _numbers(file, "/motion/time", 1) if "/motion/time" in file.datasets else None
            seed = file.whole("/motion" if "seed" in file.structure.attributes["/motion"] else "/", "seed")
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
    if own.is_text or len(own.shape) != rank:
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
