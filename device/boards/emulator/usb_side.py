"""The emulated array `emulator` on its bus. What passes through here is bytes; nothing here knows what they mean."""

from __future__ import annotations

from collections.abc import Sequence

from ...clock import Clock
from ...emulation.faults import Fault, FaultKind
from ...emulation.peripheral import Descriptors, Peripheral
from ...emulation.usb_bus import EmulatedBus
from .model import Board

__all__ = ["BULK_OUT", "EmulatorBackend", "EmulatorUsb", "Fault", "FaultKind"]

VENDOR, PRODUCT = 0x1209, 0x0001  # pid.codes' shared product id for tests
MANUFACTURER_STRING, PRODUCT_STRING = "palpate", "emulated 256-transducer array"
BULK_OUT = 0x01

_OUT, _IN = 0x40, 0xC0
_SET_DIVIDER, _GET_STATUS, _CLEAR = 0x01, 0x02, 0x03


class EmulatorUsb(Peripheral[Board]):
    """The USB side of the board `emulator`, as docs/formats/emulator.md has it."""

    def __init__(self, serial: str, board: Board) -> None:
        descriptors = Descriptors(
            VENDOR, PRODUCT, MANUFACTURER_STRING, PRODUCT_STRING, serial, (BULK_OUT,), 512, device_class=0xFF
        )
        super().__init__(descriptors, board)

    def request(self, kind: int, request: int, value: int, index: int) -> bytes | None:
        """Answer a vendor request; None is a stall."""
        if (kind, request) == (_OUT, _SET_DIVIDER):
            return b"" if self.board.set_divider(value) else None
        if (kind, request) == (_OUT, _CLEAR):
            self.board.clear()
            return b""
        return self.board.status() if (kind, request) == (_IN, _GET_STATUS) else None


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
