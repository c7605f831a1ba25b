"""Frames of a SonicSurface: 0xFE, 256 delays of 0..31 in 1/32 turn or 32 for off, 0xFD. A pulse is half a period."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...wire_layout import Frames, Layout, Turns, any_of, mean_of, phase_byte

_OFF = 32  # instead of a delay
_SWITCHED = (np.arange(256) < _OFF).astype(np.float32)


def _pack(delay: Turns, level: Turns, order: NDArray[np.intp], out: Frames) -> None:
    out[:, 0], out[:, -1] = 0xFE, 0xFD
    phase = phase_byte(delay, _OFF)
    phase &= _OFF - 1
    out[:, 1:-1] = np.where(level < np.float32(0.5), np.uint8(_OFF), phase)[:, order]


def _width(frames: Frames) -> NDArray[np.float32]:
    return mean_of(_SWITCHED, frames[:, 1:-1])


def _emitting(frames: Frames) -> NDArray[np.bool_]:
    return any_of(frames[:, 1:-1] < _OFF)


def _rounded(delay: Turns, level: Turns) -> tuple[Frames, Turns]:
    phase = phase_byte(delay, _OFF)
    phase &= _OFF - 1
    phase *= 256 // _OFF
    return phase, (level >= np.float32(0.5)).astype(np.float32)


LAYOUT = Layout(_pack, _width, _emitting, amplitude_steps=1, rounded=_rounded)
