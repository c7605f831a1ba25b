"""The board file of a UCL/OpenMPD board (`.pat`): its serial number, wiring and calibration.

Its lists follow one another. A list may be wrapped over several lines, as in 8 of the 74 published files; it begins on
a line of its own. Numbers are separated by commas, and a line may end with one. OpenMPD's own driver reads numbers,
not lines.

| list | content |
|---|---|
| serial number | of the FTDI chip: line 1 |
| count | number of transducers: line 2 |
| levels | steps of phase in a period: line 3 |
| positions | position of each transducer, `(x, y, z)` [m], in the board's frame: from line 4 on |
| pins | pin of each transducer, its place on the wire |
| phase offsets | phase offset of each transducer [degrees], to be subtracted from the delay |
| amplitude factors | amplitude factor of each transducer, 0..1; all 1 where the file ends before them |
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import CalibrationError

_SIZE_MOST = 1 << 20  # a board file has about 12 kB
_SPAN_MOST = 1.0  # [m] from the middle: a file in millimetres exceeds it
_PLACE = re.compile(r"\(([^()]*)\)")


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
    """Read a board file; raises `CalibrationError` naming file, list, the line that it begins in, and what is wrong."""
    lines = _Lines(path)
    if not lines.ended and lines.line != 1:
        raise CalibrationError(f"{path}: line 1 is empty, but should hold the serial number of the board")
    serial = lines.single("the serial number of the board")
    count, levels = lines.whole("the count of transducers"), lines.whole("the steps of phase")
    place = lines.take("the positions", count, lambda line: line.count(")"))
    position = place.positions()
    place.require("a position", position, "within 1 m of the middle", np.abs(position) <= _SPAN_MOST)
    wiring = lines.take("the pins", count, _word_count)
    pin = wiring.numbers()
    wiring.require("a pin", pin, f"a whole number in 0..{count - 1}", np.isin(pin, np.arange(count)))
    if len(twice := np.flatnonzero(np.bincount(pin.astype(np.intp)) > 1)):
        raise wiring.wrong(f"have pin {twice[0]} more than once")
    phase = lines.take("the phase offsets", count, _word_count)
    offset = phase.numbers()
    phase.require("a phase offset", offset, "within 360 degrees", np.abs(offset) <= 360)
    return PatFile(path, serial, levels, position, pin.astype(np.intp), offset, _gain(lines, count))


def _gain(lines: _Lines, count: int) -> NDArray[np.float64]:
    """The amplitude factors, which end the file; all 1 where it has ended before them."""
    if lines.ended:
        return np.ones(count)
    factors = lines.take("the amplitude factors", count, _word_count)
    gain = factors.numbers()
    factors.require("an amplitude factor", gain, "in 0..1", (gain >= 0) & (gain <= 1))
    if not lines.ended:
        raise factors.wrong(f"should end the file, but line {lines.line} follows them")
    return gain


@dataclass(frozen=True)
class _List:
    """A list of the file, all its lines together."""

    path: Path
    name: str
    line: int
    """Line that it begins in, from 1."""
    text: str

    def numbers(self) -> NDArray[np.float64]:
        """Its numbers."""
        return self._parse([word for line in self.text.splitlines() for word in _words(line)])

    def positions(self) -> NDArray[np.float64]:
        """Its positions, shape [transducer, 3]."""
        if _PLACE.sub("", self.text).strip(", \t\n"):
            raise self.wrong("should be `(x, y, z)` only")
        position: list[NDArray[np.float64]] = []
        for place in _PLACE.findall(self.text):
            words = [word.strip() for word in place.split(",")]
            if len(words) != 3:
                raise self.wrong(f"have one with {len(words)} numbers where 3 belong: '({place[:40]})'")
            position.append(self._parse(words))
        return np.array(position)

    def require(self, what: str, value: NDArray[np.float64], bound: str, holds: NDArray[np.bool_]) -> None:
        """Raise unless all values hold."""
        if not holds.all():
            raise self.wrong(f"have {what} of {value[~holds][0]:g}, which is not {bound}")

    def wrong(self, what: str) -> CalibrationError:
        """The error of this list."""
        return CalibrationError(f"{self.path}: {self.name}, which begin in line {self.line}, {what}")

    def _parse(self, words: list[str]) -> NDArray[np.float64]:
        for word in words:
            if not _is_number(word):
                raise self.wrong(f"have {word[:20]!r} where a number belongs")
        return np.array([float(word) for word in words])


class _Lines:
    """The file's lines that are not blank, taken one after the other."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines = [(number, line) for number, line in enumerate(_text_lines(path), 1) if line]
        self._next = 0

    @property
    def ended(self) -> bool:
        """Whether all lines were taken."""
        return self._next == len(self._lines)

    @property
    def line(self) -> int:
        """Number of the next line, from 1."""
        return self._lines[self._next][0]

    def single(self, name: str) -> str:
        """The next line."""
        if self.ended:
            raise CalibrationError(f"{self._path}: ends where {name} should be")
        self._next += 1
        return self._lines[self._next - 1][1]

    def whole(self, name: str) -> int:
        """The next line, which is a whole number from 1."""
        text = self.single(name)
        if not (text.isascii() and text.isdecimal() and len(text) < 6 and int(text) > 0):
            raise CalibrationError(f"{self._path}: {name} is {text[:20]!r}, but should be a whole number from 1")
        return int(text)

    def take(self, name: str, count: int, count_in: Callable[[str], int]) -> _List:
        """The next lines, until they hold `count` items."""
        first, held, last = self._next, 0, 0
        while held < count:
            last = count_in(self.single(f"item {held + 1} of {count} of {name}"))
            held += last
        numbers, taken = zip(*self._lines[first : self._next], strict=True)
        whole = _List(self._path, name, numbers[0], "\n".join(taken))
        if held > count:
            without = f" ({held - last} without line {numbers[-1]})" if len(taken) > 1 else ""
            raise whole.wrong(f"hold {held} items{without} where {count} belong")
        return whole


def _unblocked(path: str, flags: int) -> int:
    """Open a file without waiting, as a pipe would for its writer."""
    return os.open(path, flags | os.O_NONBLOCK)


def _text_lines(path: Path) -> list[str]:
    try:
        with open(path, "rb", opener=_unblocked) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise CalibrationError(f"{path}: is no regular file, so it is no board file")
            content = file.read(_SIZE_MOST + 1)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > _SIZE_MOST:
        raise CalibrationError(f"{path}: is larger than 1 MiB, so it is no board file")
    try:
        return [line.strip() for line in content.decode("utf-8-sig").splitlines()]
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{path}: is not text, so it is no board file") from error


def _words(line: str) -> list[str]:
    return [word.strip() for word in line.rstrip(", \t").split(",")]


def _word_count(line: str) -> int:
    return len(_words(line))


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
