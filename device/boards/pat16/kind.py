"""UCL's OpenMPD board, as published or as its own board file describes it: geometry, frames, and its kind.

A frame has 256 bytes of delays, then 256 of amplitudes, seven bits each; bit 7 marks.

| bytes | bits 0..6 | bit 7 |
|---|---|---|
| 0..255 | start of the pulse in 1/128 turn | byte 0: a frame starts here |
| 26..33 | | a divider, lowest bit first |
| 34 | | the divider is there |
| 256..511 | width of the pulse, 0..64 | |
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...array import ArrayModel, UsbIdentity, frozen
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...clock import Clock
from ...errors import CalibrationError
from ...flat_arrays import flat_array, flat_grid
from ...wire_layout import Layout, pulse_levels

if TYPE_CHECKING:
    from ...emulation.usb_bus import EmulatedBus
    from .link import PatLink
    from .model import PatBoard


_PITCH = 10.5e-3  # [m]


def pat16_model(*, calibration: Path | None = None) -> ArrayModel:
    """The board of a board file, else as published ones describe it: each board needs its own (docs/guide/boards.md).

    Raises CalibrationError: the board file is wrong, or no pat16's.
    """
    return _published() if calibration is None else _calibrated(calibration)


@cache
def _published() -> ArrayModel:
    # The pin of each transducer, in palpate's order: the board's layout repeats every 4 columns and 2 rows.
    row, column = np.divmod(np.arange(256), 16)
    down = 15 - row
    corner = np.array([[1, 5], [0, 4], [3, 6], [2, 7]])
    pin = 248 - 64 * (column // 4) - 8 * (down // 2) + corner[column % 4, down % 2]
    return flat_array(
        "pat16",
        flat_grid(16, 16, _PITCH),
        np.argsort(pin),
        divider_sustained=3,
        burst_frames=28,
        fifo_frames=34,
        frame_bytes=512,
        calibrated=False,
        usb=UsbIdentity(0x0403, 0x6014, None, None),
    )


def _calibrated(path: Path) -> ArrayModel:
    """The board that a board file describes, its transducers put into our order."""
    from .board_file import read_pat  # most arrays have none

    file, board = read_pat(path), _published()
    count = board.transducer_count
    if len(file.pin) != count or file.levels != 128:
        raise CalibrationError(
            f"{path}: describes a board of {len(file.pin)} transducers and {file.levels} steps of phase, but a pat16 "
            f"has {count} and 128"
        )
    column, row = np.rint(file.position[:, :2].T / _PITCH + 7.5).astype(np.intp)
    rank = np.argsort(row * 16 + column)
    if (worst := np.abs(file.position[rank] - board.position).max()) > _PITCH / 2:
        raise CalibrationError(
            f"{path}: the positions are not 16 x 16 at 10.5 mm about the middle: one is {worst * 1e3:.4g} mm beside "
            "its place, but half a pitch is the bound"
        )
    return replace(
        board,
        position=frozen(file.position[rank].astype(np.float32)),
        wire_order=frozen(np.argsort(file.pin[rank])),
        delay_offset=frozen((file.phase_offset[rank] / 360).astype(np.float32)),
        gain=frozen(file.gain[rank].astype(np.float32)),
        calibrated=True,
        serial=file.serial,
    )


LAYOUT = Layout(  # delays of silent pulses say nothing
    turn=128,
    delay_at=slice(0, 256),
    levels=pulse_levels(64),
    level_at=slice(256, 512),
    fixed={0: 0x80},
    is_pulse_start=True,
)


def _open_link(model: ArrayModel, request: LinkRequest) -> PatLink:
    from .link import PatLink  # who plays to another array needs no link to this one

    return PatLink.open(model, request)


def _calibration_serial(path: Path) -> str:
    from .board_file import read_pat

    return read_pat(path).serial


def _emulate(request: EmulationRequest) -> EmulatedBus[PatBoard]:
    from ...emulation.usb_bus import EmulatedBus
    from .ftdi_model import FT232H_BYTE_RATE, FT232H_CHIP_BYTES, Ft232h
    from .model import PatBoard

    def plug(clock: Clock, serial: str, on_for_ns: int) -> Ft232h:
        board = PatBoard(
            clock,
            record=request.record,
            chip_bytes=FT232H_CHIP_BYTES,
            byte_rate=FT232H_BYTE_RATE,
            on_for_ns=on_for_ns,
        )
        return Ft232h(clock, serial, board)

    return EmulatedBus(plug, request.serials or ("PATEMU01",), clock=request.clock)


KIND = ArrayKind(
    name="pat16",
    aliases=("openmpd", "asierinho", "pat"),  # its makers' project, their driver, and what papers call such boards
    build=pat16_model,
    layout=LAYOUT,
    open_link=_open_link,
    calibration_serial=_calibration_serial,
    emulate=_emulate,
)
