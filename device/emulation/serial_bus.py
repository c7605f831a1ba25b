"""Emulated serial ports with boards behind them: adapters, the driver's buffer, plugs.

What passes through here is bytes; nothing here knows what they mean. docs/formats/emulator.md has what is modelled.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from ..clock import Clock, MonotonicClock
from ..transports.serial_line import PortInfo, SerialPort, SerialPorts

DRIVER_BYTES = 4096
"""Bytes that the driver takes ahead of the adapter: as much as Linux's drivers of USB adapters."""
ADAPTER_BYTES = 640
"""Bytes that the adapter takes ahead of the line: a CP2102's, the most of the usual ones."""


class SerialBoard(Protocol):
    """A model of a board at a serial line. Every call first does what is due by its clock."""

    @property
    def bytes_received(self) -> int:
        """Bytes taken from the driver since power-up."""
        ...

    @property
    def queued(self) -> int:
        """Bytes taken that have not been sent on the line."""
        ...

    def set_line(self, baud: float) -> None:
        """Bits a second that the sender sends [Bd]."""
        ...

    def accept(self, data: memoryview) -> int:
        """Take as many of the bytes as there is room for in driver and adapter; returns their count."""
        ...

    def drop_queued(self, keep: int) -> None:
        """Drop the bytes that have not been sent on the line yet, all but the first `keep`."""
        ...

    def power_off(self) -> None:
        """Lose the power: silent at once, everything queued is gone."""
        ...


BoardT = TypeVar("BoardT", bound=SerialBoard, covariant=True)


@dataclass(eq=False)
class _Adapter(Generic[BoardT]):
    """An adapter, its place, and the board at its line."""

    info: PortInfo
    board: BoardT
    plugged: bool = True
    is_open: bool = False


class EmulatedPorts(SerialPorts, Generic[BoardT]):
    """Serial ports with a board at each: give them to `open_link` and `find_serial_arrays` as the backend.

    Args:
        switch_on: makes a board fresh from power-up, with room for a count of bytes ahead of its line.
        serials: serial number of each adapter.
        clock: clock of all boards; None takes the monotonic one.
    """

    def __init__(
        self, switch_on: Callable[[Clock, int], BoardT], serials: Sequence[str], *, clock: Clock | None = None
    ) -> None:
        self._clock: Clock = clock or MonotonicClock()
        self._switch_on = switch_on
        self._adapters = [self._plug(number, serial) for number, serial in enumerate(serials)]

    @property
    def clock(self) -> Clock:
        """The boards' clock."""
        return self._clock

    def board(self, index: int = 0) -> BoardT:
        """The board at an adapter."""
        return self._adapters[index].board

    def path(self, index: int = 0) -> str:
        """What the port of an adapter is opened by."""
        return self._adapters[index].info.path

    def unplug(self, *, index: int = 0) -> None:
        """Pull the adapter, and with it the board's power: the array falls silent and the port is gone."""
        self._adapters[index].plugged = False
        self._adapters[index].board.power_off()

    def replug(self, *, index: int = 0) -> None:
        """Plug it in again: a board fresh from power-up."""
        self._adapters[index] = self._plug(index, self._adapters[index].info.serial)

    def listed(self) -> list[PortInfo]:
        """The adapters that are plugged in."""
        return [adapter.info for adapter in self._adapters if adapter.plugged]

    def open(self, path: str, *, baud: int) -> SerialPort:
        """Open a port for itself alone, as `SerialPorts.open`."""
        adapter = next((one for one in self._adapters if one.info.path == path and one.plugged), None)
        if adapter is None:
            raise _error(errno.ENOENT)
        if adapter.is_open:
            raise _error(errno.EAGAIN)
        adapter.is_open = True
        adapter.board.set_line(baud)
        return _Port(adapter)

    def _plug(self, number: int, serial: str | None) -> _Adapter[BoardT]:
        info = PortInfo(f"emulated:{number}", serial, "emulated serial adapter", (0x10C4, 0xEA60))
        return _Adapter(info, self._switch_on(self._clock, DRIVER_BYTES + ADAPTER_BYTES))


class _Port:
    """An opened port."""

    def __init__(self, adapter: _Adapter[SerialBoard]) -> None:
        self._adapter = adapter

    def write(self, data: memoryview) -> int:
        """Bytes that there was room for."""
        return self._require_plugged().board.accept(data)

    def waiting(self) -> int:
        """Bytes that the driver holds."""
        return max(self._require_plugged().board.queued - ADAPTER_BYTES, 0)

    def drop_waiting(self) -> None:
        """Drop them."""
        self._require_plugged().board.drop_queued(ADAPTER_BYTES)

    def close(self) -> None:
        """Let go of the port; the board goes on playing."""
        if self._adapter.plugged and self._adapter.is_open:
            self.drop_waiting()
        self._adapter.is_open = False

    def _require_plugged(self) -> _Adapter[SerialBoard]:
        if not self._adapter.plugged:
            raise _error(errno.EIO)
        return self._adapter


def _error(code: int) -> OSError:
    return OSError(code, os.strerror(code))
