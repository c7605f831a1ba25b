"""Frames of a pat16: 256 bytes of delays, then 256 of amplitudes, seven bits each; bit 7 marks.

| bytes | bits 0..6 | bit 7 |
|---|---|---|
| 0..255 | start of the pulse in 1/128 turn | byte 0: a frame starts here |
| 26..33 | | a divider, lowest bit first |
| 34 | | the divider is there |
| 256..511 | width of the pulse, 0..64 | |
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import UpdateRateError
from ...wire_layout import Frames, Layout, PulseGrid, Turns, any_of, mean_of, on_wire

_MARK = 0x80
_DIVIDER_BYTE, _LOAD_BYTE = 26, 34
_DUTY = (np.minimum(np.arange(256) & 0x7F, 64) / 64).astype(np.float32)


def with_divider(frames: NDArray[np.uint8], divider: int) -> NDArray[np.uint8]:
    """Frames of a pat16, shape [..., 512], that also set its update rate to 40 kHz / divider, 1..255.

    Raises `UpdateRateError` for another divider.
    """
    if not 1 <= divider <= 255:
        raise UpdateRateError(f"divider {divider} is outside 1..255 of array pat16")
    marked = frames.copy()
    bits = marked[..., _DIVIDER_BYTE:_LOAD_BYTE]
    bits &= 0xFF ^ _MARK
    bits |= ((divider >> np.arange(8) & 1) * _MARK).astype(np.uint8)
    marked[..., _LOAD_BYTE] |= _MARK
    return marked


def _pulse(delay: Turns, level: Turns) -> tuple[Frames, Turns]:
    """Start and width of the pulse [turn / 128]."""
    # Duty shrinks a pulse from its end, so half of what is missing is added to its start: its middle stays.
    duty = np.rint(np.arcsin(level) * np.float32(128 / np.pi))
    start = delay * np.float32(128)
    start += (64 - duty) * np.float32(0.5) + np.float32(0.5)
    return (start.astype(np.uint16) & 0x7F).astype(np.uint8), duty


def _rounded(delay: Turns, level: Turns) -> tuple[Frames, Turns]:
    start, duty = _pulse(delay, level)
    middle = 2 * start.astype(np.int16) - (64 - duty).astype(np.int16)  # in 1/256 turn
    return (middle & 0xFF).astype(np.uint8), np.sin(duty * np.float32(np.pi / 128))


def _pack(delay: Turns, level: Turns, order: NDArray[np.intp], out: Frames) -> None:
    start, duty = _pulse(delay, level)
    out[:, :256] = start[:, order]
    out[:, 0] |= _MARK
    out[:, 256:] = on_wire(duty.astype(np.uint8), order)


def _width(frames: Frames) -> NDArray[np.float32]:
    return mean_of(_DUTY, frames[:, 256:])


def _emitting(frames: Frames) -> NDArray[np.bool_]:
    return any_of(frames[:, 256:] & np.uint8(0x7F))


LAYOUT = Layout(  # phases of silent pulses say nothing
    _pack,
    _width,
    _emitting,
    amplitude_steps=64,
    off_bits=_MARK,
    rounded=_rounded,
    pulses=PulseGrid(turn=128, half=64, mark=_MARK),
)
