"""Frames of the `emulator`: 256 places of two bytes, the delay in 1/256 turn, then 0..255 linear in pressure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...wire_layout import LINEAR, Frames, Layout, Turns, any_of, level_byte, mean_of, on_wire, phase_byte


def _pack(delay: Turns, level: Turns, order: NDArray[np.intp], out: Frames) -> None:
    out[:, 0::2] = phase_byte(delay, 256)[:, order]
    out[:, 1::2] = on_wire(level_byte(level), order)


def _width(frames: Frames) -> NDArray[np.float32]:
    return mean_of(LINEAR, frames[:, 1::2])


def _emitting(frames: Frames) -> NDArray[np.bool_]:
    return any_of(frames[:, 1::2])


LAYOUT = Layout(_pack, _width, _emitting, amplitude_steps=255)
