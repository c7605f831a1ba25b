"""A queue of transfers to an emulated board: what `QueuedTransport` uses of libusb, on the board's own clock."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable
from typing import Any

from palpate.device.emulation.usb_bus import EmulatedBus
from palpate.device.transports.libusb import CANCELLED, COMPLETED, Completion


class BoardPipe:
    """Transfers that the board takes as it has room for them.

    reported: what the driver says of a cancelled transfer of which so many bytes were taken.
    """

    def __init__(self, bus: EmulatedBus[Any], *, reported: Callable[[int], int] = lambda taken: taken) -> None:
        self.done: deque[Completion] = deque()
        self.flight_max = 0
        self.fault: tuple[int, int | None] | None = None  # byte of the stream, status: None is NAK for ever
        self.struck = lambda: None
        self.halted = False
        self._bus = bus
        self._reported = reported
        self._flight: list[list] = []  # slot, bytes, how many of them were taken
        if clear := getattr(bus.board(), "clear", None):
            bus.board().clear = lambda: (clear(), self._take())  # a bus hands over whenever there is room

    def submit(self, slot: int, data: array) -> int:
        self.halted &= bool(self._flight)
        self._flight.append([slot, data.tobytes(), 0])
        self.flight_max = max(self.flight_max, len(self._flight))
        self._take()
        return 0

    def cancel(self, slot: int) -> int:
        self._take()
        for transfer in [transfer for transfer in self._flight if transfer[0] == slot]:
            self._flight.remove(transfer)
            self.done.append(Completion(slot, CANCELLED, self._reported(transfer[2])))
        return 0

    def handle_events(self, timeout: float) -> int:
        if timeout and self._flight:
            clock, (_, data, taken) = self._bus.clock, self._flight[0]
            room_ns = self._bus.board().room_at_ns(len(data) - taken)
            clock.sleep_until_ns(min(max(room_ns, clock.now_ns() + 1000), clock.now_ns() + round(timeout * 1e9)))
        self._take()
        return 0

    def close(self) -> None:
        self._flight.clear()

    def _take(self) -> None:
        board = self._bus.board()
        while self._flight and not self.halted:
            slot, data, taken = flight = self._flight[0]
            stop = len(data) if self.fault is None else taken + self.fault[0] - board.bytes_received
            flight[2] += board.accept(memoryview(data)[taken:stop])
            if self.fault is not None and board.bytes_received == self.fault[0]:
                self._strike(flight)
            elif flight[2] == len(data):
                self._flight.pop(0)
                self.done.append(Completion(slot, COMPLETED, flight[2]))
            else:
                return

    def _strike(self, flight: list) -> None:
        """The endpoint takes nothing more of what is under way."""
        assert self.fault is not None
        (_, status), self.fault = self.fault, None
        self.halted = True
        self.struck()
        if status is not None:
            self._flight.remove(flight)
            self.done.append(Completion(flight[0], status, flight[2]))
