"""The transport over a serial line: never more bytes ahead of the line than a window, whatever the driver holds."""

from __future__ import annotations

import errno
import math
from array import array
from collections.abc import Callable
from typing import Final

from ..clock import Clock
from ..errors import LinkError, link_error
from ..link import never
from .serial_line import SerialPort
from .transport import Transport

BITS_PER_BYTE: Final = 10  # 8N1: a start and a stop bit
_LOOK_NS: Final = 2_000_000  # between looks at the port while waiting
_GONE: Final = (errno.EIO, errno.ENXIO, errno.EBADF)  # what a port says whose adapter was pulled


class SerialTransport(Transport):
    """Bytes to a serial port, in order.

    A driver takes kilobytes at once, which a slow line carries for a long time. So at most `window_bytes` are on the
    way: as many as the driver says that it holds, or as the line cannot have carried yet at its rate.

    Args:
        port: the port, opened.
        baud: the line's rate [Bd].
        who: name and place of the array, for messages.
        clock: clock of the line; None is real time.
    """

    name = "serial"

    def __init__(self, port: SerialPort, baud: int, *, who: str = "", clock: Clock | None = None) -> None:
        super().__init__(who, clock)
        self._port = port
        self._byte_ns = BITS_PER_BYTE * 1e9 / baud
        self._written = 0
        self._sent_by_ns = 0.0  # when the line is through with all that was written, if it is never held
        self._lost: LinkError | None = None  # why the port is of no use any more

    @property
    def bytes_under_way(self) -> int:
        """Bytes written that have not left on the line, as far as driver and clock tell; raises nothing."""
        return min(self._ahead(), self._written)

    @property
    def bytes_taken(self) -> int:
        """Bytes written that are not under way; without those that were lost with the port."""
        return self._written - min(self._ahead(), self._written)

    def submit(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Write all bytes as the window lets them through, or some of them once `abandon` holds."""
        left = memoryview(data)
        self._note_progress()
        while left:
            room = self._room(len(left))
            self._require_port()
            count = self._write(left[:room]) if room else 0
            left = left[count:]
            self.short_writes += count < room
            if count:
                self._note_progress()
            else:
                self._require_progress()
            if left:
                if abandon():
                    return
                self._wait()

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until nothing is under way; False if abandoned."""
        least = self._ahead()
        self._note_progress()
        while ahead := self._ahead():
            if abandon():
                return False
            if ahead < least:
                least = ahead
                self._note_progress()
            else:
                self._require_progress()
            self._wait()
        self._require_port()
        return True

    def cancel(self) -> None:
        """Let what is under way leave, which the window keeps short: drivers differ in what they can drop."""
        try:
            self.drain()
        except LinkError:
            self.is_exact = False
            raise

    def close(self) -> None:
        """Let go of the port; what is still under way is dropped."""
        if self._lost is None:
            self._lose(LinkError(f"array {self._who} is closed"))
        self._port.close()

    def _room(self, wanted: int) -> int:
        """How many bytes may be written now; one at least where nothing is under way."""
        window = self._line_window()
        if window is None:
            return wanted
        ahead = self._ahead()
        return min(wanted, max(window - ahead, 0 if ahead else 1))

    def _line_window(self) -> int | None:
        """Most bytes to have on the way."""
        return self.window_bytes

    def _write(self, data: memoryview) -> int:
        try:
            count = self._port.write(data)
        except OSError as error:
            raise self._lose(self._failure(error)) from error
        self._written += count
        self._sent_by_ns = max(self._sent_by_ns, self._clock.now_ns()) + count * self._byte_ns
        return count

    def _ahead(self) -> int:
        """Bytes before the next one, another program's among them, if the driver holds some."""
        return max(self._unsent(), self._waiting())

    def _unsent(self) -> int:
        """Bytes that the line can not have carried yet at its rate."""
        return max(math.ceil((self._sent_by_ns - self._clock.now_ns()) / self._byte_ns), 0)

    def _waiting(self) -> int:
        """Bytes that the driver says it holds."""
        if self._lost is None:
            try:
                return self._port.waiting()
            except OSError as error:
                self._lose(self._failure(error))
        return 0

    def _require_port(self) -> None:
        if self._lost is not None:
            raise self._lost

    def _lose(self, error: LinkError) -> LinkError:
        """Note that the port is of no use any more; what had not left it never will."""
        self.is_exact = self.is_exact and not self._unsent()
        self._written -= min(self._unsent(), self._written)
        self._sent_by_ns = 0.0
        self._lost = error
        return error

    def _failure(self, error: OSError) -> LinkError:
        self.is_exact = False
        return link_error(self._who, errno.ENODEV if error.errno in _GONE else error.errno, error)

    def _wait(self) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + _LOOK_NS)
