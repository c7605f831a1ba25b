"""How a board lays a frame out on the wire, and what layouts have in common. What is taken is in range.

A pulse of width w (in parts of half a period) has the fundamental amplitude sin(pi w / 2), so w = 2 / pi asin(a).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Turns = NDArray[np.float32]
Frames = NDArray[np.uint8]


def phase_byte(delay: Turns, steps: int) -> Frames:
    """The nearest step; a full turn (255.6 of 256 is nearest to it) wraps to 0 where steps is 256."""
    scaled = delay * np.float32(steps)
    scaled += np.float32(0.5)
    return scaled.astype(np.uint16).astype(np.uint8)


def level_byte(level: Turns) -> Frames:
    """An amplitude as 0..255, linear in pressure."""
    return (level * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def rounded_to_bytes(delay: Turns, level: Turns) -> tuple[Frames, Turns]:
    """Delays in 1/256 turn, and amplitudes in 1/255."""
    return phase_byte(delay, 256), level_byte(level).astype(np.float32) / np.float32(255)


@dataclass(frozen=True)
class PulseGrid:
    """Frames of a byte for the start of each transducer's pulse, in the order of the wire, then one for each width.

    A pulse narrower than half a turn starts later by half of what it lacks, so its middle stays.
    """

    turn: int
    """Starts in a turn."""
    half: int
    """Widths up to half a turn, the widest."""
    mark: int
    """Bits that the first byte of a frame has besides."""


@dataclass(frozen=True)
class Layout:
    """One board's frames: drives to bytes, and what bytes do. Everything is vectorised over frames.

    >>> from palpate.device import encode_frames
    >>> from palpate.device.boards.emulator.layout import LAYOUT
    >>> frames = encode_frames([[0.0] * 256] * 2, [1.0, 0.0], array="emulator")  # at full drive, and off
    >>> LAYOUT.emitting(frames).tolist(), LAYOUT.width(frames).tolist(), LAYOUT.amplitude_steps
    ([True, False], [1.0, 0.0], 255)
    """

    pack: Callable[[Turns, Turns, NDArray[np.intp], Frames], None]
    """Delay [turns], shape [frame, transducer], 0..1; amplitude, shape [frame, transducer] or [frame, 1]; wire order;
    where the frames go: shape [frame, frame_bytes], zeroed."""
    width: Callable[[Frames], NDArray[np.float32]]
    """Mean width of a pulse over all transducers, 0..1 in parts of half a period, shape [frame]."""
    emitting: Callable[[Frames], NDArray[np.bool_]]
    """Which frames make any sound, shape [frame]."""
    amplitude_steps: int
    """Steps of amplitude between 0 and 1: 1 can only be switched on and off."""
    off_bits: int = 0xFF
    """Bits of each byte that an off frame needs; the others are 0 in it, so that it is off byte for byte."""
    rounded: Callable[[Turns, Turns], tuple[Frames, Turns]] = rounded_to_bytes
    """Delay [turns], 0..1, shape [frame, transducer], and amplitude 0..1, shape [frame, 1], to the delay [turn / 256]
    and the amplitude that the board gives instead, of the same shapes: its steps, without its calibration. Predictions
    of pressure and noise use it."""
    pulses: PulseGrid | None = None
    """The grid of a board whose frames `PulseGrid` describes, so that kernels can pack them; None for others."""

    def __repr__(self) -> str:
        """One line."""
        return f"Layout({self.pack.__module__}, {self.amplitude_steps} steps of amplitude)"


def on_wire(value: Frames, order: NDArray[np.intp]) -> Frames:
    """Bytes of transducers, shape [frame, transducer] or [frame, 1], in the order of the wire."""
    return value if value.shape[1] == 1 else value[:, order]


def mean_of(table: NDArray[np.float32], places: Frames) -> NDArray[np.float32]:
    """Mean of what `table`, shape [256], has for the bytes of each frame, shape [frame, place]; shape [frame]."""
    mean = np.empty(len(places), np.float32)
    for start in range(0, len(places), _CHUNK_FRAMES):
        rows = slice(start, start + _CHUNK_FRAMES)
        table[places[rows]].mean(axis=1, dtype=np.float32, out=mean[rows])
    return mean


def any_of(places: NDArray[np.bool_] | Frames) -> NDArray[np.bool_]:
    """Which frames have a place, shape [frame, place], that is not 0; shape [frame]."""
    return np.asarray(places.any(axis=1))


LINEAR = (np.arcsin(np.arange(256) / 255) * 2 / np.pi).astype(np.float32)
"""Width of the pulse that gives a level 0..255 linear in pressure, shape [256]."""

_CHUNK_FRAMES = 256  # of 256 KiB temporaries, which stay in the cache
