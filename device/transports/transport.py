"""Bytes to one endpoint or line, in order, and never lost count of; and blocking writes, which any backend can do."""

from __future__ import annotations

import errno
from abc import ABC, abstractmethod
from array import array
from collections.abc import Callable
from typing import Final

from ..clock import Clock, MonotonicClock
from ..errors import link_error
from ..link import never
from .pyusb import UsbDevice, UsbError, UsbTimeoutError

HUNG_NS: Final = 1_000_000_000
"""Time in which nothing was taken, after which the device counts as hung [ns]."""
WRITE_TIMEOUT_MS: Final = 50  # a stop waits no longer than this


class Transport(ABC):
    """A way to one endpoint. Errors are `LinkError`s; every call ends within a bounded time. One thread uses it.

    After an error, `cancel` ends what is still under way.

    Args:
        who: name and serial number of the array, for messages.
        clock: clock by which the device counts as hung; None is real time.
    """

    name: str
    """Name for reports."""

    def __init__(self, who: str, clock: Clock | None) -> None:
        self.short_writes = 0
        """Transfers that took less than was offered, or nothing, and were continued."""
        self.is_exact = True
        """False after a blocking write that failed: pyusb does not say how much of it the device took."""
        self.window_bytes: int | None = None
        """Most bytes to have under way, one transfer excepted; None: as many as the transport can. Its owner sets
        it."""
        self._who = who
        self._clock: Clock = clock or MonotonicClock()
        self._hung_at_ns = 0

    @property
    @abstractmethod
    def bytes_taken(self) -> int:
        """Bytes that the device is known to have taken since the transport was made.

        Exact whenever nothing is under way and `is_exact`.
        """

    @property
    @abstractmethod
    def bytes_under_way(self) -> int:
        """Bytes submitted whose fate is not known yet; looks for what has arrived in the meantime."""

    @abstractmethod
    def submit(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Hand over bytes: return once they are under way (queued) or taken (sync).

        Waits while there is no room, in slices of at most 50 ms; after each it asks `abandon`, and if that holds it
        returns without having handed over (all of) them. The bytes must not change until they are taken. If an error
        has told of a stall, the halt of the endpoint is ended first.

        Raises `DeviceTimeoutError` if the device takes nothing for about a second, or whatever else went wrong with
        these or earlier bytes.
        """

    @abstractmethod
    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until nothing is under way; False if abandoned. Raises as `submit` does."""

    @abstractmethod
    def cancel(self) -> None:
        """End what is under way, the last first, so that only one write can be torn. Raises if that does not end."""

    @abstractmethod
    def close(self) -> None:
        """Cancel, and give back what the transport holds; the device stays open. Raises nothing."""

    def _note_progress(self) -> None:
        """Something was taken, or is awaited from now on: the device has a second from here."""
        self._hung_at_ns = self._clock.now_ns() + HUNG_NS

    def _require_progress(self) -> None:
        """Raise `DeviceTimeoutError` if nothing was taken for a second."""
        if self._clock.now_ns() >= self._hung_at_ns:
            raise link_error(self._who, errno.ETIMEDOUT)


class BulkTransport(Transport):
    """A transport to a bulk OUT endpoint of pyusb's device, opened and claimed."""

    def __init__(self, device: UsbDevice, endpoint: int, who: str, clock: Clock | None) -> None:
        super().__init__(who, clock)
        self.is_halted = False
        self._device = device
        self._endpoint = endpoint
        self._taken = 0

    @property
    def bytes_taken(self) -> int:
        """Bytes that the device is known to have taken."""
        return self._taken

    def _clear_halt(self) -> None:
        """End the halt of the endpoint after a stall."""
        try:
            self._device.clear_halt(self._endpoint)
        except UsbError as error:
            raise link_error(self._who, error.errno, error) from error
        self.is_halted = False


class SyncTransport(BulkTransport):
    """Blocking writes of at most 50 ms each; short counts are continued, and counted."""

    name = "sync"

    def __init__(self, device: UsbDevice, endpoint: int, *, who: str = "", clock: Clock | None = None) -> None:
        super().__init__(device, endpoint, who, clock)

    @property
    def bytes_under_way(self) -> int:
        """0: a write returns when its bytes are taken."""
        return 0

    def submit(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Write all bytes, or some of them once `abandon` holds, which is asked after each write that was short."""
        if self.is_halted:
            self._clear_halt()
        sent = 0
        self._note_progress()
        while sent < len(data):
            count = self._write(data[sent:] if sent else data)
            sent += count
            if sent == len(data):
                return
            self.short_writes += 1
            if count:
                self._note_progress()
            else:
                self._require_progress()
            if abandon():
                return

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Nothing is ever under way: True."""
        return True

    def cancel(self) -> None:
        """Nothing is ever under way: nothing happens."""

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
        self._taken += count
        return count
