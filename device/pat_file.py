"""The board file of a UCL/OpenMPD board (`.pat`): its serial number, wiring and calibration.

Lists are separated by commas and may end with one:

| line | content |
|---|---|
| 1 | serial number of the FTDI chip |
| 2 | number of transducers |
| 3 | steps of phase in a period |
| 4 | position of each transducer, `(x, y, z)` [m], in the board's frame |
| 5 | pin of each transducer, its place on the wire |
| 6 | phase offset of each transducer [degrees], to be subtracted from the delay |
| 7 | amplitude factor of each transducer, 0..1; all 1 where there is no such line |
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .errors import DeviceError

_SIZE_MOST = 1 << 20  # a board file has about 12 kB
_SPAN_MOST = 1.0  # [m] from the middle: a file in millimetres exceeds it
_PLACE = re.compile(r"\(([^()]*)\)")


class CalibrationError(DeviceError, ValueError):
    """A board file that cannot be read or makes no sense, or none where one is needed."""


@dataclass(frozen=True, eq=False)
class PatFile:
    """What a board file says, transducers in its own order."""

    path: Path
    """Where it was read."""
    serial: str
    """Serial number of the board's FTDI chip."""
    levels: int
    """Steps of phase in a period."""
    position: NDArray[np.float64]
    """Middle of each transducer's face [m], shape [transducer, 3]."""
    pin: NDArray[np.intp]
    """Place of each transducer on the wire, shape [transducer]: a permutation."""
    phase_offset: NDArray[np.float64]
    """Phase that each transducer has of itself [degrees], shape [transducer]."""
    gain: NDArray[np.float64]
    """Factor on each transducer's amplitude, 0..1, shape [transducer]."""


def read_pat(path: Path) -> PatFile:
    """Read a board file; raises `CalibrationError` naming file, line and what is wrong."""
    lines = _lines(path)
    if not lines[0]:
        raise _wrong(path, 1, "is empty, but should hold the serial number of the board")
    count, levels = _whole(path, 2, lines[1]), _whole(path, 3, lines[2])
    position = np.array([_numbers(path, 4, text, 3) for text in _places(path, lines[3], count)])
    _require(path, 4, "a position", position, "within 1 m of the middle", np.abs(position) <= _SPAN_MOST)
    pin = _numbers(path, 5, lines[4], count)
    if not np.array_equal(np.sort(pin), np.arange(count)):
        raise _wrong(path, 5, f"is no permutation of the pins 0..{count - 1}")
    offset = _numbers(path, 6, lines[5], count)
    _require(path, 6, "a phase offset", offset, "within 360 degrees", np.abs(offset) <= 360)
    gain = _numbers(path, 7, lines[6], count) if len(lines) > 6 else np.ones(count)
    _require(path, 7, "an amplitude factor", gain, "in 0..1", (gain >= 0) & (gain <= 1))
    return PatFile(path, lines[0], levels, position, pin.astype(np.intp), offset, gain)


def _lines(path: Path) -> list[str]:
    try:
        with path.open("rb") as file:
            content = file.read(_SIZE_MOST + 1)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > _SIZE_MOST:
        raise CalibrationError(f"{path}: is larger than 1 MiB, so it is no board file")
    try:
        lines = [line.strip() for line in content.decode("utf-8-sig").splitlines()]
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{path}: is not text, so it is no board file") from error
    while lines and not lines[-1]:
        lines.pop()
    if len(lines) < 6:
        raise CalibrationError(f"{path}: has {len(lines)} lines, but a board file has 6 or 7")
    return lines


def _places(path: Path, line: str, count: int) -> list[str]:
    places = _PLACE.findall(line)
    if _PLACE.sub("", line).strip(", \t"):
        raise _wrong(path, 4, "should hold positions `(x, y, z)` only")
    if len(places) != count:
        raise _wrong(path, 4, f"has {len(places)} positions, but line 2 says {count}")
    return places


def _numbers(path: Path, line: int, text: str, count: int) -> NDArray[np.float64]:
    words = [word.strip() for word in text.rstrip(", \t").split(",")]
    if len(words) != count:
        raise _wrong(path, line, f"has {len(words)} numbers where {count} belong")
    for word in words:
        if not _is_number(word):
            raise _wrong(path, line, f"has {word[:20]!r} where a number belongs")
    return np.array([float(word) for word in words])


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def _whole(path: Path, line: int, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 0 < int(text) < 1 << 16):
        raise _wrong(path, line, f"has {text[:20]!r} where a whole number from 1 belongs")
    return int(text)


def _require(
    path: Path, line: int, what: str, value: NDArray[np.float64], bound: str, holds: NDArray[np.bool_]
) -> None:
    if not holds.all():
        raise _wrong(path, line, f"has {what} of {value[~holds][0]:g}, which is not {bound}")


def _wrong(path: Path, line: int, what: str) -> CalibrationError:
    return CalibrationError(f"{path}: line {line} {what}")
