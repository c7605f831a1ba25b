"""Emulated buses by the name of the array on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, overload

from ..boards.emulator.usb_side import EmulatorBackend
from ..boards.pat16.ftdi_model import FT232H_BYTE_RATE, FT232H_CHIP_BYTES, Ft232h
from ..boards.pat16.model import PatBoard
from ..boards.sonicsurface.model import BAUD
from ..clock import Clock
from ..errors import UnknownArrayError
from .peripheral import EmulatedBoard
from .serial_bus import EmulatedPorts
from .usb_bus import EmulatedBus

__all__ = ["EmulatedBus", "emulated_backend"]


@overload
def emulated_backend(
    name: Literal["emulator"], *, clock: Clock | None = None, record: int = 0, serials: Sequence[str] | None = None
) -> EmulatorBackend: ...
@overload
def emulated_backend(
    name: Literal["pat16"], *, clock: Clock | None = None, record: int = 0, serials: Sequence[str] | None = None
) -> EmulatedBus[PatBoard]: ...
@overload
def emulated_backend(
    name: Literal["sonicsurface"],
    *,
    clock: Clock | None = None,
    record: int = 0,
    serials: Sequence[str] | None = None,
    baud: float = BAUD,
) -> EmulatedPorts: ...
@overload
def emulated_backend(
    name: str, *, clock: Clock | None = None, record: int = 0, serials: Sequence[str] | None = None, baud: float = BAUD
) -> EmulatedBus[EmulatedBoard] | EmulatedPorts: ...
def emulated_backend(
    name: str, *, clock: Clock | None = None, record: int = 0, serials: Sequence[str] | None = None, baud: float = BAUD
) -> EmulatedBus[EmulatedBoard] | EmulatedPorts:
    """A bus for pyusb, or serial ports, with models of a board; docs/formats/emulator.md has what they model.

    The boards have been switched on for a while; one that is plugged in again is fresh from power-up.

    Args:
        name: `emulator`, `pat16` (behind an FT232H) or `sonicsurface` (at serial ports).
        clock: clock of all boards; None takes the monotonic one.
        record: how many of its last played frames each board keeps, for tests.
        serials: serial number of each board on the bus; None is one board.
        baud: bits a second that a `sonicsurface` samples at [Bd]; others have none.

    Raises:
        UnknownArrayError: there is no model of that board.
    """
    if name == "emulator":
        return EmulatorBackend(serials or ("EMU0001",), clock=clock, record=record)
    if name == "pat16":

        def plug_pat(clock: Clock, serial: str, on_for_ns: int) -> Ft232h:
            board = PatBoard(
                clock, record=record, chip_bytes=FT232H_CHIP_BYTES, byte_rate=FT232H_BYTE_RATE, on_for_ns=on_for_ns
            )
            return Ft232h(clock, serial, board)

        return EmulatedBus(plug_pat, serials or ("PATEMU01",), clock=clock)
    if name == "sonicsurface":
        return EmulatedPorts(serials or ("SONEMU01",), clock=clock, record=record, baud=baud)
    raise UnknownArrayError(f"no board of array {name!r} is emulated; known: emulator, pat16, sonicsurface")
