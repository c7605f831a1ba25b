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
from ...wire_layout import Layout, pulse_levels

_MARK = 0x80
_DIVIDER_BYTE, _LOAD_BYTE = 26, 34


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


LAYOUT = Layout(  # delays of silent pulses say nothing
    turn=128,
    delay_at=slice(0, 256),
    levels=pulse_levels(64),
    level_at=slice(256, 512),
    fixed={0: _MARK},
    is_pulse_start=True,
)
