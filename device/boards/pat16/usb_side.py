"""Emulated PAT boards behind FT232H chips on a USB bus."""

from __future__ import annotations

from collections.abc import Sequence

from ...clock import Clock
from ...emulation.usb_bus import EmulatedBus
from .ftdi_model import FT232H_BYTE_RATE, FT232H_CHIP_BYTES, Ft232h
from .model import PatBoard


class PatBackend(EmulatedBus[PatBoard]):
    """A bus with arrays `pat16`: give it to pyusb, or to `find_arrays` and `open_link`, as the backend.

    Args:
        serials: serial number of each chip on the bus.
        clock: clock of all boards; None takes the monotonic one.
        record: how many of its last played frames each board keeps, for tests.
    """

    def __init__(self, serials: Sequence[str] = ("PATEMU01",), *, clock: Clock | None = None, record: int = 0) -> None:
        def plug(clock: Clock, serial: str, on_for_ns: int) -> Ft232h:
            board = PatBoard(
                clock, record=record, chip_bytes=FT232H_CHIP_BYTES, byte_rate=FT232H_BYTE_RATE, on_for_ns=on_for_ns
            )
            return Ft232h(clock, serial, board)

        super().__init__(plug, serials, clock=clock)
