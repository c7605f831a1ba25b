"""Point lists of DOLPHIN (.PTLIST): the focal points of a stimulus, one after the other.

DOLPHIN is the design tool of Mulot et al. 2021 (gitlab.com/h-reality/dolphin). What its paper says of the format, and
what had to be assumed because no file and no source was at hand:

| known | assumed |
|---|---|
| text; a header with number of steps, sample rate, maximum intensity | three numbers before the rows, on 1..3 lines |
| a row a step: x y z i | parted by commas, semicolons or blanks; written with commas, as DOLPHIN's recipes are |
| i is a step's pressure over the peak pressure | so 0..1; the maximum intensity, 0..1 too, scales it; written as 1 |
| | positions in metres (others: `unit`), the sample rate in hertz, z away from the device |

Blank lines are skipped but counted as lines.
"""

import io
import os
import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bounded_file import read_text, require_bytes
from ..errors import DatasetError, name_nothing
from ..known_names import likely_file
from ..storage.durable import write_file

HEADER = ("number of steps", "sample rate", "maximum intensity")
COLUMNS = ("x", "y", "z", "intensity")
REACH = 10.0  # [m] no focal point is farther away: another unit
_LINE_BYTES = 200  # that a line takes as a text of its own, and as a row of numbers
_SEPARATORS = re.compile(r"[,;\s]+")


class PointListError(DatasetError, ValueError):
    """A point list is malformed or cannot be read or written; the message names file, line and value."""


class PointList(NamedTuple):
    """Focal points of one stimulus."""

    position: NDArray[np.float32]
    """[m], shape [sample, 3]."""
    intensity: NDArray[np.float32]
    """Relative pressure amplitude 0..1 as in the rows, shape [sample]."""
    update_rate: float
    """Focal points a second [Hz]."""
    intensity_peak: float
    """The header's maximum intensity 0..1, by which `intensity` is to be multiplied."""


def read_ptlist(path: str | Path, *, unit: float = 1.0) -> PointList:
    """Read a .PTLIST file: the focal points of a stimulus, one after the other.

    unit: of the file's positions [m].
    Raises PointListError naming file and line: for a malformed header, rows that are not four finite numbers,
    intensities outside 0..1, positions farther than 10 m away, and another number of rows than the header declares.

    >>> from palpate.datasets import read_ptlist, write_ptlist
    >>> write_ptlist("two.PTLIST", [[0, 0, 0.2], [0.01, 0, 0.2]], [1, 0.5], update_rate=40000, overwrite=True)
    >>> points = read_ptlist("two.PTLIST")
    >>> points.position.shape, points.intensity, points.update_rate
    ((2, 3), array([1. , 0.5], dtype=float32), 40000.0)
    """
    path = Path(path)
    _require_unit(unit)
    try:
        text = read_text(path)
        require_bytes(_LINE_BYTES * (text.count("\n") + 1) + len(text), "what its lines hold")
        lines = text.splitlines()
    except FileNotFoundError:
        raise name_nothing(PointListError(f"{path}: no such point list{likely_file(path)}")) from None
    except (OSError, UnicodeDecodeError) as error:
        raise PointListError(f"{path}: cannot be read ({error})") from error
    try:
        count, update_rate, peak, body = _header(lines)
        rows = _rows(lines, body)
        if len(rows) != count:
            raise PointListError(f"the header says {count} steps, but there are {len(rows)} rows")
        rows[:, :3] *= unit
        _require_rows(rows, lambda row: f"line {_line_of(lines, body, row)}")
    except PointListError as error:
        raise PointListError(f"{path}: {error}") from None
    return PointList(rows[:, :3].astype(np.float32), rows[:, 3].astype(np.float32), update_rate, peak)


def write_ptlist(
    path: str | Path,
    position: ArrayLike,
    intensity: ArrayLike,
    update_rate: float,
    *,
    unit: float = 1.0,
    overwrite: bool = False,
) -> None:
    """Write focal points as a .PTLIST file that `read_ptlist` reads back to the last bit of float32.

    position: [m], shape [sample, 3]. intensity: 0..1, shape [sample]. unit: of the file's positions [m].
    The file is whole or not there. Raises PointListError for what `read_ptlist` would refuse, naming the row, for
    several focal points at once, which the format cannot hold, and for a file that is there, unless `overwrite`.

    >>> from pathlib import Path
    >>> from palpate.datasets import write_ptlist
    >>> write_ptlist("two.PTLIST", [[0, 0, 0.2], [0.01, 0, 0.2]], [1, 0.5], update_rate=40000, overwrite=True)
    >>> Path("two.PTLIST").read_text().split()  # number of steps, rate, peak intensity; then x, y, z, intensity
    ['2,40000,1', '0,0,0.2,1', '0.01,0,0.2,0.5']
    """
    path = Path(path)
    if os.path.lexists(path) and not overwrite:
        raise PointListError(f"{path}: exists; overwrite=True replaces it")
    _require_unit(unit)
    where, strength = np.asarray(position, np.float64), np.asarray(intensity, np.float64)
    if where.ndim != 2 or where.shape[1] != 3 or strength.shape != where.shape[:1]:
        raise PointListError(
            "a point list holds one focal point at a time: position [sample, 3], intensity [sample], not "
            f"{list(where.shape)} and {list(strength.shape)}"
        )
    if len(where) == 0:
        raise PointListError("a point list must have a row, not none")
    if not (np.isfinite(update_rate) and update_rate > 0):
        raise PointListError(f"sample rate must be positive, not {update_rate} Hz")
    _require_rows(np.column_stack([where, strength]), lambda row: f"row {row}")
    rows = np.column_stack([where / unit, strength])
    text = io.StringIO()
    text.write(f"{len(rows)},{update_rate:.17g},1\n")
    np.savetxt(text, rows, fmt="%.9g", delimiter=",")
    try:
        write_file(path, text.getvalue().encode())
    except OSError as error:
        raise PointListError(f"{path}: cannot be written ({error.strerror or error})") from error


def _require_unit(unit: float) -> None:
    if not (np.isfinite(unit) and 0 < unit <= 1e3):
        raise PointListError(f"unit must be a length in metres above 0, at most 1000, not {unit}")


def _header(lines: list[str]) -> tuple[int, float, float, int]:
    """Number of steps, sample rate [Hz], maximum intensity, and the line on which rows may begin."""
    numbers: list[float] = []
    body = 0
    while len(numbers) < len(HEADER) and body < len(lines):
        for token in _tokens(lines[body]):
            name = HEADER[min(len(numbers), len(HEADER) - 1)]
            try:
                numbers.append(float(token))
            except ValueError:
                raise PointListError(f"line {body + 1}: {name} expected, not {token!r}") from None
        body += 1
    if len(numbers) != len(HEADER):
        raise PointListError(f"line {body}: the header must be {', '.join(HEADER)}, not {len(numbers)} numbers")
    count, rate, peak = numbers
    if not (1 <= count < np.inf and count == round(count)):
        raise PointListError(f"the number of steps must be whole and at least 1, not {count:g}")
    if not (np.isfinite(rate) and rate > 0):
        raise PointListError(f"the sample rate must be positive, not {rate:g} Hz")
    if not 0 <= peak <= 1:
        raise PointListError(f"the maximum intensity must lie in 0..1, not {peak:g}")
    return int(count), rate, peak, body


def _tokens(line: str) -> list[str]:
    return [token for token in _SEPARATORS.split(line) if token]


def _rows(lines: list[str], body: int) -> NDArray[np.float64]:
    """The rows from a line on, shape [row, 4]."""
    text = "\n".join(islice(lines, body, None)).replace(",", " ").replace(";", " ")
    if not text.strip():
        return np.zeros((0, len(COLUMNS)))
    try:
        rows = np.loadtxt(io.StringIO(text), comments=None, ndmin=2)
    except ValueError:
        rows = np.zeros((0, 0))
    if rows.shape[1] == len(COLUMNS):
        return rows
    for number, line in enumerate(islice(lines, body, None), body + 1):  # which line it was
        tokens = _tokens(line)
        if tokens and len(tokens) != len(COLUMNS):
            raise PointListError(f"line {number}: {len(COLUMNS)} numbers ({', '.join(COLUMNS)}) expected, not {line!r}")
        for name, token in zip(COLUMNS, tokens, strict=False):
            try:
                float(token)
            except ValueError:
                raise PointListError(f"line {number}: {name} must be a number, not {token!r}") from None
    raise PointListError("the rows are not numbers as NumPy reads them")


def _line_of(lines: list[str], body: int, row: int) -> int:
    """The line, from 1, of a row, from 0."""
    full = (number for number, line in enumerate(islice(lines, body, None), body + 1) if _tokens(line))
    return next(islice(full, row, None))


def _require_rows(rows: NDArray[np.float64], place: Callable[[int], str]) -> None:
    """Refuse rows out of range; positions in metres."""
    for name, column, low, high in (
        *((name, k, -REACH, REACH) for k, name in enumerate("xyz")),
        ("intensity", 3, 0, 1),
    ):
        bad = ~((rows[:, column] >= low) & (rows[:, column] <= high))
        if bad.any():
            row = int(np.argmax(bad))
            bound = "0..1" if column == 3 else f"{low:g}..{high:g} m"
            raise PointListError(f"{place(row)}: {name} must lie in {bound}, not {rows[row, column]:g}")
