"""The fictional board of docs/formats/emulator.md: 16 x 16 transducers at 10.5 mm."""

from __future__ import annotations

from functools import cache

import numpy as np

from ...array import ArrayModel, UsbIdentity
from ...flat_arrays import flat_array, flat_grid


@cache
def emulator_model() -> ArrayModel:
    """The model, the same each time."""
    # its wire runs along columns like a snake: columns from +x to -x, the first from +y down, the next up, in turn
    column, step = np.divmod(np.arange(256), 16)
    order = np.where(column % 2 == 0, 15 - step, step) * 16 + (15 - column)
    return flat_array(
        "emulator",
        flat_grid(16, 16, 10.5e-3),
        order,
        fifo_frames=2048,
        frame_bytes=512,
        usb=UsbIdentity(0x1209, 0x0001, "palpate", "emulated 256-transducer array"),
        embedded=True,
    )
