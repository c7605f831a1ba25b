"""shinolab's AUTD3: 18 x 14 places at 10.16 mm, three of them taken by its screws."""

from __future__ import annotations

from functools import cache

import numpy as np

from ...array import ArrayModel
from ...flat_arrays import flat_array, flat_grid


@cache
def autd3_model() -> ArrayModel:
    """The model, the same each time."""
    row, column = np.divmod(np.arange(18 * 14), 18)
    screw = (row == 1) & np.isin(column, (1, 2, 16))
    return flat_array(
        "autd3",
        flat_grid(18, 14, 10.16e-3)[~screw],
        np.arange(249),
        divider_max=20000,  # 2 Hz; the board has 65535, but a bank of one frame and an off pattern would take too long
        divider_sustained=4,  # 100 Mbit/s carry no more of frames that change; a bank takes 1023
        burst_frames=1023,
        fifo_frames=0,
        frame_bytes=498,
    )
