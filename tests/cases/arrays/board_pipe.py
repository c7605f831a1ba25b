"""A queue of transfers to an emulated board: what `QueuedTransport` uses of libusb, on the board's own clock."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable

from palpate.device.boards.pat16.model import PatBoard
from palpate.device.emulation.usb_bus import EmulatedBus
from palpate.device.transports.libusb import CANCELLED, COMPLETED, Completion


class BoardPipe:
    """Transfers that the board takes as it has room for them.

    reported: what the driver says of a cancelled transfer of which so many bytes were taken.
    """

    def __init__(self, bus: EmulatedBus[PatBoard], *, reported: Callable[[int], int] = lambda taken: taken) -> None:
        self.done: deque[Completion] = deque()
        self._bus = bus
        self._reported = reported
        self._flight: list[list] = []  # slot, bytes, how many of them were taken

    def submit(self, slot: int, data: array) -> int:
        self._flight.append([slot, data.tobytes(), 0])
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
        while self._flight:
            slot, data, taken = self._flight[0]
            self._flight[0][2] += self._bus.board().accept(memoryview(data)[taken:])
            if self._flight[0][2] < len(data):
                return
            self._flight.pop(0)
            self.done.append(Completion(slot, COMPLETED, len(data)))
