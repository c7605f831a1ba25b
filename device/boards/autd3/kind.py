"""shinolab's AUTD3, 18 x 14 places of which its screws take three: geometry, frames, and its kind.

A frame has 249 delays in 1/256 turn, then 249 amplitudes, 0..255, linear in pressure by the board's own table.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ...array import ArrayModel
from ...array_kind import ArrayKind, LinkRequest
from ...flat_arrays import flat_array, flat_grid
from ...wire_layout import Layout, linear_levels

if TYPE_CHECKING:
    from .link import Autd3Link


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


LAYOUT = Layout(turn=256, delay_at=slice(0, 249), levels=linear_levels(255), level_at=slice(249, 498))


def _open_link(model: ArrayModel, request: LinkRequest) -> Autd3Link:
    from .link import open_autd3  # an optional package stands behind it

    return open_autd3(model, address=request.serial, emulated=request.emulated)


KIND = ArrayKind(
    name="autd3",
    aliases=("autd",),
    build=autd3_model,
    layout=LAYOUT,
    open_link=_open_link,
    emulates_itself=True,
    not_live="an autd3 gathers frames in banks of 0.1 s before it plays them, so it cannot follow a hand that moves "
    "now, nor begin a stimulus at once: record to a file, and play that",
    not_listed="an autd3 cannot be listed: serial=INTERFACE names the network interface that it hangs on",
)
