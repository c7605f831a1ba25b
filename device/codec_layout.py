"""How each board lays a frame out on the wire. Everything is vectorised over frames; what is taken is in range.

| board | delay | amplitude | places | marks |
|---|---|---|---|---|
| emulator | 1/256 turn, even bytes | 0..255 linear in pressure, odd bytes | 256 | none |
| pat16 | 1/128 turn, bytes 0..255: the start of a pulse | width of the pulse 0..64, bytes 256..511 | 256 | bit 7 |
| sonicsurface | 0..31 in 1/32 turn, bytes 1..256 | on or off (32) | 256 | 0xFE first, 0xFD last |
| autd3 | 1/256 turn, bytes 0..248 | 0..255 linear in pressure, bytes 249..497 | 249 | none |

A pulse of width w (in parts of half a period) has the fundamental amplitude sin(pi w / 2), so w = 2 / pi asin(a).
autd3's own table does that; the emulator is fictional and linear; a SonicSurface always sends half a period.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Turns = NDArray[np.float32]
Frames = NDArray[np.uint8]


@dataclass(frozen=True)
class Layout:
    """One board's frames."""

    pack: Callable[[Turns, Turns, NDArray[np.intp], Frames], None]
    """Delay [turns], shape [frame, transducer], 0..1; amplitude, shape [frame, transducer] or [frame, 1]; wire order;
    where the frames go: shape [frame, frame_bytes], zeroed."""
    width: Callable[[Frames], NDArray[np.float32]]
    """Mean width of a pulse over all transducers, 0..1 in parts of half a period, shape [frame]."""
    emitting: Callable[[Frames], NDArray[np.bool_]]
    """Which frames make any sound, shape [frame]."""
    amplitude_steps: int
    """Steps of amplitude between 0 and 1: 1 can only be switched on and off."""


def _pack_emulator(delay: Turns, level: Turns, order: NDArray[np.intp], out: Frames) -> None:
    out[:, 0::2] = _phase_byte(delay, 256)[:, order]
    out[:, 1::2] = _on_wire(_level_byte(level), order)


def _pack_pat16(delay: Turns, level: Turns, order: NDArray[np.intp], out: Frames) -> None:
    # Duty shrinks a pulse from its end, so half of what is missing is added to its start: its middle stays.
    duty = np.rint(np.arcsin(level) * np.float32(128 / np.pi))
    start = delay * np.float32(128)
    start += (64 - duty) * np.float32(0.5) + np.float32(0.5)
    out[:, :256] = (start.astype(np.uint16) & 0x7F).astype(np.uint8)[:, order]
    out[:, 0] |= PAT16_START
    out[:, 256:] = _on_wire(duty.astype(np.uint8), order)


def _pack_sonicsurface(delay: Turns, level: Turns, order: NDArray[np.intp], out: Frames) -> None:
    out[:, 0], out[:, -1] = 0xFE, 0xFD
    phase = _phase_byte(delay, SONICSURFACE_OFF)
    phase &= SONICSURFACE_OFF - 1
    out[:, 1:-1] = np.where(level < np.float32(0.5), np.uint8(SONICSURFACE_OFF), phase)[:, order]


def _pack_autd3(delay: Turns, level: Turns, order: NDArray[np.intp], out: Frames) -> None:
    out[:, :249] = _phase_byte(delay, 256)[:, order]
    out[:, 249:] = _on_wire(_level_byte(level), order)


def _phase_byte(delay: Turns, steps: int) -> Frames:
    """The nearest step; a full turn (255.6 of 256 is nearest to it) wraps to 0 where steps is 256."""
    scaled = delay * np.float32(steps)
    scaled += np.float32(0.5)
    return scaled.astype(np.uint16).astype(np.uint8)


def _level_byte(level: Turns) -> Frames:
    return (level * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _on_wire(value: Frames, order: NDArray[np.intp]) -> Frames:
    return value if value.shape[1] == 1 else value[:, order]


def _mean_of(table: NDArray[np.float32], places: Frames) -> NDArray[np.float32]:
    mean = np.empty(len(places), np.float32)
    for start in range(0, len(places), _CHUNK_FRAMES):
        rows = slice(start, start + _CHUNK_FRAMES)
        table[places[rows]].mean(axis=1, dtype=np.float32, out=mean[rows])
    return mean


def _any_of(places: NDArray[np.bool_] | Frames) -> NDArray[np.bool_]:
    return np.asarray(places.any(axis=1))


PAT16_START = 0x80
"""Bit 7 of a pat16 frame's first byte: a frame starts here."""
SONICSURFACE_OFF = 32
"""What a SonicSurface takes as silence instead of a phase."""

_LINEAR = (np.arcsin(np.arange(256) / 255) * 2 / np.pi).astype(np.float32)
_DUTY = (np.minimum(np.arange(256) & 0x7F, 64) / 64).astype(np.float32)
_SWITCHED = (np.arange(256) < SONICSURFACE_OFF).astype(np.float32)

_CHUNK_FRAMES = 256  # of 256 KiB temporaries, which stay in the cache

LAYOUTS: dict[str, Layout] = {
    "emulator": Layout(
        _pack_emulator, lambda frames: _mean_of(_LINEAR, frames[:, 1::2]), lambda frames: _any_of(frames[:, 1::2]), 255
    ),
    "pat16": Layout(
        _pack_pat16,
        lambda frames: _mean_of(_DUTY, frames[:, 256:]),
        lambda frames: _any_of(frames[:, 256:] & np.uint8(0x7F)),
        64,
    ),
    "sonicsurface": Layout(
        _pack_sonicsurface,
        lambda frames: _mean_of(_SWITCHED, frames[:, 1:-1]),
        lambda frames: _any_of(frames[:, 1:-1] < SONICSURFACE_OFF),
        1,
    ),
    "autd3": Layout(
        _pack_autd3, lambda frames: _mean_of(_LINEAR, frames[:, 249:]), lambda frames: _any_of(frames[:, 249:]), 255
    ),
}
"""By the name of the array."""
