"""The transport that keeps the kernel supplied: several transfers under way at once, on pyusb's own libusb handle."""

from __future__ import annotations

import errno
from array import array
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from ..clock import Clock
from ..errors import LinkError, link_error
from ..link import never
from .libusb import CANCELLED, COMPLETED, STATUS_ERRNO, BulkQueue, Completion
from .pyusb import UsbDevice
from .transport import HUNG_NS, BulkTransport

QUEUE_DEPTH: Final = 16
"""Transfers under way at most: 1 MiB, which 50 ms at 20.5 MB/s are; at lower rates `window_bytes` bounds them first."""
CHUNK_BYTES: Final = 1 << 16
"""Most bytes of a transfer."""
WAIT_SLICE: Final = 0.02  # [s] between questions whether to go on; the contract is 50 ms


class Pipe(Protocol):
    """What is used of `BulkQueue`; a test puts its own in its place."""

    done: deque[Completion]

    def submit(self, slot: int, data: array[int]) -> int:
        """Errno, 0 if under way."""
        ...

    def cancel(self, slot: int) -> int:
        """Errno, 0 if it will end."""
        ...

    def handle_events(self, timeout: float) -> int:
        """Errno, 0 if nothing went wrong."""
        ...

    def close(self) -> None:
        """Free everything."""
        ...


@dataclass(eq=False)
class _Write:
    """A transfer that was submitted."""

    slot: int
    data: array[int]
    taken: int = 0
    """Bytes of it that the device took, once it has ended."""


class QueuedTransport(BulkTransport):
    """Up to `depth` transfers under way, in order.

    Args:
        device: pyusb's device, opened and claimed, on libusb's backend.
        endpoint: address of the bulk OUT endpoint.
        depth: how many transfers are under way at most.
        who: name and serial number of the array, for messages.
        clock: clock by which the device counts as hung; None is real time.
        pipe: the queue of transfers; None makes one of `device`.

    Raises:
        LinkError: the backend is not libusb's, or this pyusb hides what is needed.
    """

    name = "queued"  # libusb says of every transfer how much of it was taken, so the count stays exact

    def __init__(
        self,
        device: UsbDevice,
        endpoint: int,
        *,
        depth: int = QUEUE_DEPTH,
        who: str = "",
        clock: Clock | None = None,
        pipe: Pipe | None = None,
    ) -> None:
        if depth < 1:
            raise ValueError(f"depth is {depth}, but at least 1 transfer must be under way")
        super().__init__(device, endpoint, who, clock)
        self._pipe: Pipe = pipe or BulkQueue(device, endpoint, slots=depth)
        self._free = list(range(depth))
        self._writes: deque[_Write] = deque()  # under way, the first in front
        self._bytes_under_way = 0
        self._short: _Write | None = None
        self._behind_short = 0  # bytes taken of what was submitted behind it
        self._error: LinkError | None = None
        self._closed = False

    @property
    def bytes_under_way(self) -> int:
        """Bytes submitted whose fate is not known yet; looks for what has arrived in the meantime."""
        self._look(0.0)
        return self._bytes_under_way

    def submit(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Queue bytes, which must not change until they are taken; waits while there is no room."""
        if self._closed:
            raise LinkError(f"array {self._who} is closed")
        if self.is_halted and not self._error:
            self._clear_halt()
        for start in range(0, len(data), CHUNK_BYTES):
            chunk = data if len(data) <= CHUNK_BYTES else data[start : start + CHUNK_BYTES]
            self._look(0.0)
            self._settle()
            while not self._has_room(len(chunk)):
                if abandon():
                    return
                self._wait()
            self._launch(chunk)

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until nothing is under way; False if abandoned."""
        self._look(0.0)
        self._settle()
        while self._writes:
            if abandon():
                return False
            self._wait()
        return True

    def cancel(self) -> None:
        """End what is under way, the last first, so that only one write can be torn; forgets errors of it."""
        self._end_all()
        self._short = self._error = None

    def close(self) -> None:
        """Cancel, and free the transfers."""
        self._closed = True
        try:
            self.cancel()
        except LinkError:
            pass  # what does not end is left to the pipe, which keeps it
        finally:
            self._pipe.close()

    def _has_room(self, size: int) -> bool:
        if not self._writes or self.window_bytes is None:
            return bool(self._free)
        return bool(self._free) and self._bytes_under_way + size <= self.window_bytes

    def _launch(self, data: array[int]) -> None:
        """Submit, or wait for memory: usbfs bounds what all its users have under way together."""
        while (code := self._pipe.submit(self._free[-1], data)) == errno.ENOMEM and self._writes:
            self._wait()
        if code:
            self.is_halted |= code == errno.EPIPE
            raise link_error(self._who, code)
        if not self._writes:
            self._note_progress()
        self._writes.append(_Write(self._free.pop(), data))
        self._bytes_under_way += len(data)

    def _wait(self) -> None:
        """Until something has ended, for a slice at most; raises what went wrong."""
        self._look(WAIT_SLICE)
        self._settle()
        if self._writes:
            self._require_progress()

    def _look(self, timeout: float) -> None:
        """Take note of what has ended; raises nothing."""
        if self._writes and (code := self._pipe.handle_events(timeout)):
            self._error = self._error or link_error(self._who, code)
        while self._pipe.done:
            self._note(self._pipe.done.popleft())

    def _note(self, end: Completion) -> None:
        write = next(write for write in self._writes if write.slot == end.slot)
        self._writes.remove(write)
        write.taken = end.taken
        self._free.append(write.slot)
        self._bytes_under_way -= len(write.data)
        self._taken += write.taken
        if write.taken:
            self._note_progress()
        if self._short is not None:
            self._behind_short += write.taken
        elif end.status == COMPLETED and end.taken < len(write.data):
            self._short, self._behind_short = write, 0
        if end.status not in (COMPLETED, CANCELLED):
            code = STATUS_ERRNO.get(end.status, errno.EIO)
            self.is_halted |= code == errno.EPIPE
            self._error = self._error or link_error(self._who, code)

    def _settle(self) -> None:
        """Raise an error that was noted, once; continue a short write, if no later byte was taken before its rest."""
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        while (short := self._short) is not None:
            self.short_writes += 1
            behind = list(self._writes)
            self._end_all()
            self._short = None
            if self._behind_short:
                raise LinkError(
                    f"array {self._who} took {short.taken} bytes of a transfer of {len(short.data)}, and then "
                    f"{self._behind_short} bytes of what was behind: the stream is torn"
                )
            for data in (short.data[short.taken :], *(write.data for write in behind)):
                self._launch(data)

    def _end_all(self) -> None:
        """Cancel everything and wait for its end, which must come within about a second."""
        for write in reversed(self._writes):
            self._pipe.cancel(write.slot)
        limit_ns = self._clock.now_ns() + HUNG_NS
        while self._writes:
            self._look(WAIT_SLICE)
            if self._writes and self._clock.now_ns() >= limit_ns:
                raise link_error(self._who, errno.ETIMEDOUT)
