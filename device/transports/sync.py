"""The transport that any backend of pyusb can do: one blocking write after the other."""

from __future__ import annotations

import errno
from array import array
from collections.abc import Callable
from typing import Final

from ..clock import Clock, MonotonicClock
from ..errors import link_error
from ..link import never
from .pyusb import UsbDevice, UsbError, UsbTimeoutError

WRITE_TIMEOUT_MS: Final = 50  # a stop waits no longer than this
HUNG_NS: Final = 1_000_000_000  # nothing taken for so long: the device counts as hung


class SyncTransport:
    """Blocking writes of at most 50 ms each; short counts are continued, and counted.

    Args:
        device: pyusb's device, opened and claimed.
        endpoint: address of the bulk OUT endpoint.
        who: name and serial number of the array, for messages.
        clock: clock by which the device counts as hung; None is real time.
    """

    name = "sync"
    bytes_under_way = 0
    window_bytes: int | None = None

    def __init__(self, device: UsbDevice, endpoint: int, *, who: str = "", clock: Clock | None = None) -> None:
        self.bytes_taken = 0
        self.short_writes = 0
        self.is_exact = True
        self.is_halted = False
        self._device = device
        self._endpoint = endpoint
        self._who = who
        self._clock: Clock = clock or MonotonicClock()

    def submit(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Write all bytes, or some of them once `abandon` holds, which is asked after each write that was short."""
        if self.is_halted:
            self.clear_halt()
        sent = 0
        hung_at_ns = self._clock.now_ns() + HUNG_NS
        while sent < len(data):
            count = self._write(data[sent:] if sent else data)
            sent += count
            if sent == len(data):
                return
            self.short_writes += 1
            now_ns = self._clock.now_ns()
            if count:
                hung_at_ns = now_ns + HUNG_NS
            elif now_ns >= hung_at_ns:
                raise link_error(self._who, errno.ETIMEDOUT)
            if abandon():
                return

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Nothing is ever under way: True."""
        return True

    def cancel(self) -> None:
        """Nothing is ever under way: nothing happens."""

    def forget_doubt(self) -> None:
        """Count as exact again."""
        self.is_exact = True

    def clear_halt(self) -> None:
        """End the halt of the endpoint after a stall."""
        try:
            self._device.clear_halt(self._endpoint)
        except UsbError as error:
            raise link_error(self._who, error.errno, error) from error
        self.is_halted = False

    def close(self) -> None:
        """Nothing is held: nothing happens."""

    def _write(self, data: array[int]) -> int:
        """One write: bytes taken, 0 at a timeout. pyusb raises nothing if some were taken before it."""
        try:
            count = self._device.write(self._endpoint, data, WRITE_TIMEOUT_MS)
        except UsbTimeoutError:
            return 0
        except UsbError as error:
            self.is_exact = False
            self.is_halted |= error.errno == errno.EPIPE
            raise link_error(self._who, error.errno, error) from error
        self.bytes_taken += count
        return count
