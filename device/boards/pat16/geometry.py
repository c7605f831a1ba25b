"""A UCL/OpenMPD board: 16 x 16 transducers at 10.5 mm, as published or as its own board file describes it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ...array import ArrayModel, UsbIdentity, frozen
from ...errors import CalibrationError
from ...flat_arrays import flat_array, flat_grid

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
