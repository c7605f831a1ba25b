"""A model of a SonicSurface at the other end of a pseudo-terminal, whose tty layer is the system's own."""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from palpate.device.boards.sonicsurface.model import BAUD, SonicBoard
from palpate.device.clock import MonotonicClock


class PtyBoard:
    """Reads what is sent to `path` at the rate of the line, byte after byte."""

    def __init__(self, *, baud: float = BAUD, sender: float = 230_400.0) -> None:
        self.master, self._slave = os.openpty()
        self.path = os.ttyname(self._slave)
        self.board = SonicBoard(MonotonicClock(), record=10_000, baud=baud, chip_bytes=64)
        self.board.set_line(sender)
        self.received = bytearray()
        self.is_stalled = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read, name="pty-board", daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Hang the line up: whoever has the port open finds it gone."""
        self._stop.set()
        self._thread.join()
        for end in (self.master, self._slave):
            if end >= 0:
                os.close(end)
        self.master = self._slave = -1

    def settle(self) -> None:
        """Until nothing has come for a while."""
        before = -1
        while before != len(self.received) or self.board.queued:
            before = len(self.received)
            time.sleep(0.05)

    def _read(self) -> None:
        while not self._stop.is_set():
            if self.is_stalled or not select.select([self.master], [], [], 0.01)[0]:
                time.sleep(0.001)
                continue
            data = memoryview(os.read(self.master, 64))
            self.received += data
            while data and not self._stop.is_set():
                data = data[self.board.accept(data) :]
                if data:
                    time.sleep(0.0005)


@contextmanager
def pty_board(**options: float) -> Iterator[PtyBoard]:
    board = PtyBoard(**options)
    try:
        yield board
    finally:
        board.unplug()
