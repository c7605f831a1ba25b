"""Frames of a board as data: where the bytes of each transducer stand, and what they mean.

A pulse of width w (in parts of half a period) has the fundamental amplitude sin(pi w / 2), so w = 2 / pi asin(a).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .array import POINT_BYTES
from .errors import ArrayKindError

Frames = NDArray[np.uint8]
Numbers = NDArray[np.float32]
_CHUNK_FRAMES = 256  # of 256 KiB temporaries, which stay in the cache


@dataclass(frozen=True, eq=False)
class Levels:
    """Steps of amplitude of a board: level 0 is off, the last one is full pressure.

    >>> from palpate.device import linear_levels
    >>> levels = linear_levels(4)
    >>> levels
    Levels(4 above off)
    >>> levels.nearest([0.0, 0.2, 0.9]).tolist()
    [0, 1, 4]
    """

    amplitude: Numbers
    """Relative pressure of each level, 0 to 1, shape [level + 1]."""
    least: Numbers
    """Least amplitude that gets each level from 1 on, shape [level]."""
    width: Numbers
    """Width of the pulse that has the amplitude, in parts of half a period, shape [level + 1]."""

    def __eq__(self, other: object) -> bool:
        """Whether the same amplitudes have the same levels."""
        return isinstance(other, Levels) and self._key() == other._key()

    def __hash__(self) -> int:
        """By the values."""
        return hash(self._key())

    def _key(self) -> tuple[bytes, bytes, bytes]:
        return self.amplitude.tobytes(), self.least.tobytes(), self.width.tobytes()

    def __repr__(self) -> str:
        """One line."""
        return f"Levels({self.count} above off)"

    @property
    def count(self) -> int:
        """Levels above 0: 1 for a board that can only switch on and off."""
        return len(self.least)

    def nearest(self, amplitude: ArrayLike) -> NDArray[np.intp]:
        """Level of each amplitude 0..1."""
        return np.searchsorted(self.least, np.asarray(amplitude, np.float32), side="right")


def linear_levels(count: int) -> Levels:
    """So many levels, linear in pressure, the nearest of which is used.

    >>> from palpate.device import linear_levels
    >>> linear_levels(4).amplitude.tolist(), linear_levels(4).least.tolist()
    ([0.0, 0.25, 0.5, 0.75, 1.0], [0.125, 0.375, 0.625, 0.875])
    """
    return _levels(
        [level / count for level in range(count + 1)],
        [(level - 0.5) / count for level in range(1, count + 1)],
        [2 / math.pi * math.asin(level / count) for level in range(count + 1)],
    )


def pulse_levels(half: int) -> Levels:
    """Widths of a pulse up to half a period, which has so many steps; the nearest to 2 / pi asin(a) is used.

    >>> from palpate.device import pulse_levels
    >>> pulse_levels(2).width.tolist(), [round(a, 3) for a in pulse_levels(2).amplitude.tolist()]
    ([0.0, 0.5, 1.0], [0.0, 0.707, 1.0])
    """
    return _levels(
        [math.sin(math.pi / 2 * width / half) for width in range(half + 1)],
        [math.sin(math.pi / 2 * (width - 0.5) / half) for width in range(1, half + 1)],
        [width / half for width in range(half + 1)],
    )


def _levels(*columns: list[float]) -> Levels:
    # float64 functions of the C library differ in their last bit at most, which float32 does not see
    return Levels(*(np.array(column, np.float32) for column in columns))


@dataclass(frozen=True, kw_only=True)
class Layout:
    """One board's frames: a byte for the delay of each transducer, as a rule another for its level, and fixed bits.

    A delay is rounded to the nearest step, half up. Slices go over the bytes of a frame, in the order of the wire.
    Raises ArrayKindError for a number of steps or levels that does not fit, with the bound.

    >>> from palpate.device import encode_frames
    >>> from palpate.device.boards.emulator.kind import LAYOUT
    >>> frames = encode_frames([[0.0] * 256] * 2, [1.0, 0.0], array="emulator")  # at full drive, and off
    >>> LAYOUT.emitting(frames).tolist(), LAYOUT.width(frames).tolist(), LAYOUT.levels.count
    ([True, False], [1.0, 0.0], 255)
    """

    turn: int
    """Steps of delay in a turn: 1..256, or 1..255 without levels' bytes."""
    delay_at: slice
    """Bytes of delays."""
    levels: Levels
    level_at: slice | None = None
    """Bytes of levels; None: a transducer of level 0 has `turn` for its delay, which is off."""
    fixed: Mapping[int, int] = field(default_factory=dict[int, int])
    """Bits that certain bytes have in every frame."""
    is_pulse_start: bool = False
    """Whether a delay's byte is the start of a pulse, and levels are widths in the same steps: a pulse narrower than
    the widest starts later by half of what it lacks, so its middle stays."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        most = 255 if self.level_at is None else 256
        if not 1 <= self.turn <= most:
            raise ArrayKindError(f"turn must lie in 1..{most} steps, not {self.turn}")
        count, least = self.levels.count, self.levels.least
        shapes = self.levels.amplitude.shape, self.levels.width.shape
        if not 1 <= count <= 255 or set(shapes) != {(count + 1,)}:
            raise ArrayKindError(f"levels must be 1..255, with an amplitude and a width of each and of 0, not {count}")
        if not (least[0] > 0 and least[-1] <= 1 and (np.diff(least) >= 0).all()):
            raise ArrayKindError(f"least must rise from above 0 to 1 at most, not from {least[0]:g} to {least[-1]:g}")
        if count * self.later > self.turn / 2:
            raise ArrayKindError(f"levels of pulses must be at most turn = {self.turn}, not {count}")

    def bytes_of(self, frame_bytes: int, transducer_count: int) -> tuple[range, range | None]:
        """Bytes of the delays and of the levels of transducers in a frame.

        Raises ArrayKindError for slices that have not as many, go backwards or overlap, and for fixed bits that belong
        to delays or levels.
        """
        return _bytes_of(self, frame_bytes, transducer_count)

    def __hash__(self) -> int:
        """By what can be hashed: slices and dictionaries cannot."""
        return hash((self.turn, self.levels))

    def __repr__(self) -> str:
        """One line."""
        return f"Layout({self.turn} steps a turn, {self.levels.count} of amplitude)"

    @property
    def later(self) -> float:
        """Steps by which a pulse starts later for each level that it lacks."""
        return 0.5 if self.is_pulse_start else 0.0

    @property
    def is_switch(self) -> bool:
        """Whether a transducer is on or off, without levels between."""
        return self.levels.count == 1

    def faded(self, frame: bytes, transducer_count: int, step_count: int) -> list[bytes]:
        """The frame at falling levels, the last of them off; delays stay, so the focal point does.

        A board that can only switch has no levels between: for it, all of them are off. Plain Python: the writer of a
        live playback calls it where nothing new comes.
        """
        off = self.off_frame(len(frame)).tobytes()
        if self.level_at is None:
            return [off] * step_count
        delays, levels = self.bytes_of(len(frame), transducer_count)
        pairs = list(zip(delays, levels or (), strict=True))
        steps: list[bytes] = []
        for number in range(1, step_count):
            faded = bytearray(frame)
            for delay_at, level_at in pairs:
                level = frame[level_at]
                faded[level_at] = lower = level * (step_count - number) // step_count
                if self.later:  # a narrower pulse begins later, so that its middle stays
                    fixed = self.fixed.get(delay_at, 0)
                    start = (frame[delay_at] & ~fixed) + int((level - lower) * self.later)
                    faded[delay_at] = start % self.turn | fixed
            steps.append(bytes(faded))
        return [*steps, off]

    def off_frame(self, frame_bytes: int) -> Frames:
        """The frame of silence, shape [frame_bytes]; any part of it silences what it covers."""
        frame = self.fixed_bits(frame_bytes)
        if self.level_at is None:
            frame[self.delay_at] |= self.turn
        return frame

    def fixed_bits(self, frame_bytes: int) -> Frames:
        """Bits that every frame has, shape [frame_bytes]."""
        bits = np.zeros(frame_bytes, np.uint8)
        for byte, own in self.fixed.items():
            bits[byte] = own
        return bits

    def emitting(self, frames: Frames) -> NDArray[np.bool_]:
        """Which frames, shape [frame, frame_bytes], make any sound, shape [frame]."""
        if self.level_at is None:
            return np.asarray((frames[:, self.delay_at] < self.turn).any(axis=1))
        return np.asarray(frames[:, self.level_at].any(axis=1))

    def width(self, frames: Frames) -> Numbers:
        """Mean width of a pulse over all transducers, 0..1 in parts of half a period, shape [frame]."""
        value = np.arange(256)
        if self.level_at is None:
            table, at = (value < self.turn).astype(np.float32), self.delay_at
        else:
            table, at = self.levels.width[np.minimum(value, self.levels.count)], self.level_at
        mean = np.empty(len(frames), np.float32)
        for start in range(0, len(frames), _CHUNK_FRAMES):
            rows = slice(start, start + _CHUNK_FRAMES)
            table[frames[rows, at]].mean(axis=1, dtype=np.float32, out=mean[rows])
        return mean


@lru_cache(maxsize=64)
def _bytes_of(layout: Layout, frame_bytes: int, transducer_count: int) -> tuple[range, range | None]:
    found: dict[str, range] = {}
    for name, at in (("delay_at", layout.delay_at), ("level_at", layout.level_at)):
        if at is not None:
            own = found[name] = range(*at.indices(frame_bytes))
            if len(own) != transducer_count or own.step < 1:
                raise ArrayKindError(
                    f"{name} is {at}: {len(own)} bytes of a frame of {frame_bytes}, in steps of {own.step}, but "
                    f"{transducer_count} transducers need as many, in steps of 1 or more"
                )
    delay, level = found["delay_at"], found.get("level_at")
    if level is not None and (both := set(delay) & set(level)):
        raise ArrayKindError(f"byte {min(both)} of a frame has a delay and a level")
    own_bits = (1 << (layout.turn - (layout.level_at is not None)).bit_length()) - 1  # of delays, and of off
    for byte, bits in layout.fixed.items():
        used = own_bits if byte in delay else 0xFF if level is not None and byte in level else 0
        if not (0 <= byte < frame_bytes and 0 <= bits <= 255) or bits & used:
            raise ArrayKindError(
                f"fixed bits {bits:#x} of byte {byte} must be of a byte of the frame, 0..{frame_bytes - 1}, and not "
                f"among its delay's or level's bits {used:#x}"
            )
    return delay, level


_VALUES = POINT_BYTES // 4
_INTENSITY = 3  # place among the values of a point


@dataclass(frozen=True)
class FocusLayout:
    """Frames of focal points, from which the array's own driver finds phases: `ArrayKind.layout` of such an array.

    >>> import numpy as np
    >>> from palpate.device import FocusLayout
    >>> frames = np.float32([[0, 0, 0.2, 0.5], [0, 0, 0.2, 0]]).view(np.uint8)  # half the pressure, and silence
    >>> layout = FocusLayout()
    >>> layout, layout.emitting(frames).tolist()
    (FocusLayout(), [True, False])
    """

    is_switch = False
    """Whether a transducer is on or off: no, intensities are numbers."""

    def off_frame(self, frame_bytes: int) -> Frames:
        """The frame of silence, shape [frame_bytes]: intensity 0."""
        return np.zeros(frame_bytes, np.uint8)

    def emitting(self, frames: Frames) -> NDArray[np.bool_]:
        """Which frames, shape [frame, frame_bytes], make any sound, shape [frame]."""
        return np.asarray((_intensities(frames) > 0).any(axis=1))

    def width(self, frames: Frames) -> Numbers:
        """How hard frames may drive the array, 0..1, shape [frame]: width of pulses in parts of half a period.

        The driver does not say how it drives transducers. Supposed is an amplitude of all transducers that is the sum
        of the intensities, 1 at most: it is right for one focal point at the full use of the array, and too high
        otherwise, so limits stop early rather than late.
        """
        amplitude = np.minimum(_intensities(frames).sum(axis=1), np.float32(1))
        return np.asarray(np.float32(2 / math.pi) * np.arcsin(amplitude), np.float32)

    def faded(self, frame: bytes, transducer_count: int, step_count: int) -> list[bytes]:
        """The frame at falling intensities, the last of them off; positions stay."""
        values = np.frombuffer(frame, "<f4").reshape(-1, _VALUES)
        steps: list[bytes] = []
        for number in range(1, step_count):
            faded = values.copy()
            faded[:, _INTENSITY] *= np.float32((step_count - number) / step_count)
            steps.append(faded.tobytes())
        return [*steps, bytes(len(frame))]

    def assumed(self, transducer_count: int) -> Layout:
        """Steps of delays and levels that are supposed for predictions, as the driver's are not published: 256, 255."""
        return Layout(
            turn=256,
            delay_at=slice(0, transducer_count),
            levels=linear_levels(255),
            level_at=slice(transducer_count, 2 * transducer_count),
        )


def _intensities(frames: Frames) -> Numbers:
    """Intensity of each focal point, shape [frame, point]."""
    return np.ascontiguousarray(frames).view("<f4")[:, _INTENSITY::_VALUES]
