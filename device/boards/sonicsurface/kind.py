"""UpnaLab's SonicSurface, its UART behind a serial adapter: geometry, frames, and its kind.

A frame is 0xFE, 256 delays of 0..31 in 1/32 turn or 32 for off, 0xFD. A pulse is half a period.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ...array import ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...errors import UpdateRateError
from ...flat_arrays import flat_array, flat_grid
from ...wire_layout import Layout, linear_levels

if TYPE_CHECKING:
    from .link import SonicLink
    from .model import SonicPorts


BAUD_PUBLISHED = 230400
"""Baud rate of SonicSurface's firmware as published [Bd]."""
_BITS_PER_BYTE = 10  # 8N1
_BAUD_LEAST, _BAUD_MOST = 1200, 12_000_000  # the fastest UART is an FT232H's


def sonicsurface_model(*, baud: int = BAUD_PUBLISHED) -> ArrayModel:
    """The board, its firmware compiled for a baud rate [Bd]; raises UpdateRateError for one that no adapter has."""
    return _at_rate(baud)  # whose cache then has one key for the default


@cache
def _at_rate(baud: int) -> ArrayModel:
    frame_bytes = 258
    if not _BAUD_LEAST <= baud <= _BAUD_MOST:
        raise UpdateRateError(f"{baud} Bd is outside {_BAUD_LEAST}..{_BAUD_MOST} Bd, which serial adapters have")
    byte_rate = baud / _BITS_PER_BYTE
    rate = byte_rate / frame_bytes
    # the board's layout repeats every 4 columns and 2 rows
    row, column = np.divmod(np.arange(256), 16)
    corner = np.array([[0, 7, 1, 2], [4, 3, 6, 5]])
    slot = 64 * (column // 4) + 8 * (row // 2) + corner[row % 2, column % 4]
    return flat_array(
        "sonicsurface",
        flat_grid(16, 16, 10.5e-3),
        np.argsort(slot),
        frame_clock=byte_rate,
        frame_clock_reason=f"its UART carries {rate:.1f} frames a second at {baud} Bd, or one pattern switched on and "
        f"off at up to {byte_rate:.6g} Hz",
        divider_max=frame_bytes,  # bytes of the line for each frame
        divider_default=frame_bytes,
        divider_sustained=frame_bytes,
        alternates=True,
        fifo_frames=3,  # adapters hold up to 640 bytes
        frame_bytes=frame_bytes,
        baud=baud,
    )


LAYOUT = Layout(turn=32, delay_at=slice(1, 257), levels=linear_levels(1), fixed={0: 0xFE, 257: 0xFD})


def _open_link(model: ArrayModel, request: LinkRequest) -> SonicLink:
    from .link import SonicLink  # who plays to another array needs no link to this one

    return SonicLink.open(model, request)


def _emulate(request: EmulationRequest) -> SonicPorts:
    from .model import BAUD, SonicPorts

    # boards with the published firmware do not sample at exactly the rate that hosts send at
    baud = BAUD if request.baud is None or request.baud == BAUD_PUBLISHED else request.baud
    return SonicPorts(request.serials or ("SONEMU01",), clock=request.clock, record=request.record, baud=baud)


KIND = ArrayKind(
    name="sonicsurface",
    aliases=("sonic-surface",),
    build=sonicsurface_model,
    layout=LAYOUT,
    open_link=_open_link,
    takes_baud=True,
    emulate=_emulate,
)
