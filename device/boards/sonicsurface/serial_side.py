"""Emulated SonicSurface boards at serial ports."""

from __future__ import annotations

from collections.abc import Sequence

from ...clock import Clock
from ...emulation.serial_bus import EmulatedPorts
from .model import BAUD, SonicBoard


class SonicPorts(EmulatedPorts[SonicBoard]):
    """Serial ports with a SonicSurface at each: give them to `open_link` and `find_serial_arrays` as the backend.

    Args:
        serials: serial number of each adapter.
        clock: clock of all boards; None takes the monotonic one.
        record: how many of its last played patterns each board keeps, for tests.
        baud: bits a second that the boards sample at [Bd].
    """

    def __init__(
        self, serials: Sequence[str] = ("SONEMU01",), *, clock: Clock | None = None, record: int = 0, baud: float = BAUD
    ) -> None:
        def switch_on(clock: Clock, chip_bytes: int) -> SonicBoard:
            return SonicBoard(clock, record=record, baud=baud, chip_bytes=chip_bytes)

        super().__init__(switch_on, serials, clock=clock)
