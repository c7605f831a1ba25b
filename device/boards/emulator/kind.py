"""The fictional board `emulator` (docs/formats/emulator.md): geometry, frames, and its kind.

A frame has 256 places of two bytes: the delay in 1/256 turn, then the level, 0..255, linear in pressure.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from ...array import ArrayModel, UsbIdentity
from ...array_kind import ArrayKind, EmulationRequest
from ...clock import Clock
from ...emulation.usb_bus import EmulatedBus
from ...flat_arrays import flat_array, flat_grid
from ...wire_layout import Layout, linear_levels
from .link import UsbLink
from .model import Board, EmulatorUsb


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


LAYOUT = Layout(turn=256, delay_at=slice(0, 512, 2), levels=linear_levels(255), level_at=slice(1, 512, 2))


class EmulatorBackend(EmulatedBus[Board]):
    """A bus with arrays `emulator`: give it to pyusb, or to `find_arrays` and `open_link`, as the backend.

    Args:
        serials: serial number of each array on the bus.
        clock: clock of all boards; None takes the monotonic one.
        record: how many of its last played frames each board keeps, for tests.

    >>> from palpate.device import EmulatorBackend, Player, VirtualClock, array_model, open_link
    >>> bus = EmulatorBackend(["left", "right"], clock=VirtualClock(), record=10)
    >>> with open_link(array_model("emulator"), serial="right", backend=bus) as link:
    ...     report = Player(link).play([bytes([255] * 512) * 100], update_rate=10e3)
    >>> bus.board(1).frames_played, bus.board(1).emitting, bus.board(1).played.shape  # 100 and the off frame
    (101, False, (10, 512))
    """

    def __init__(self, serials: Sequence[str] = ("EMU0001",), *, clock: Clock | None = None, record: int = 0) -> None:
        def plug(clock: Clock, serial: str, on_for_ns: int) -> EmulatorUsb:
            return EmulatorUsb(serial, Board(clock, record=record))

        super().__init__(plug, serials, clock=clock)


def _emulate(request: EmulationRequest) -> EmulatorBackend:
    return EmulatorBackend(request.serials or ("EMU0001",), clock=request.clock, record=request.record)


KIND = ArrayKind(name="emulator", build=emulator_model, layout=LAYOUT, open_link=UsbLink.open, emulate=_emulate)
