"""Serial ports as a link sees them: a port, and what has ports, which is the system or an emulation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

from ..clock import Clock


@dataclass(frozen=True)
class PortInfo:
    """A serial port that is there."""

    path: str
    """What it is opened by: `/dev/ttyUSB0`."""
    serial: str | None
    """Serial number of its adapter; None if it has none, as most with a CH340."""
    description: str
    """Maker and product of its adapter."""
    usb_ids: tuple[int, int] | None
    """Vendor and product id of its adapter; None if it is not on USB."""


class SerialPort(Protocol):
    """An opened port. Every failure is an `OSError` whose `errno` says what happened."""

    def write(self, data: memoryview) -> int:
        """Hand over as many bytes as there is room for, without waiting; returns their count."""
        ...

    def waiting(self) -> int:
        """Bytes that the driver holds and has not given to the adapter; 0 from a driver that does not say."""
        ...

    def drop_waiting(self) -> None:
        """Drop those bytes, as far as the driver can."""
        ...

    def close(self) -> None:
        """Let go of the port; what the driver still holds is dropped."""
        ...


class SerialPorts(ABC):
    """Something that has serial ports."""

    @property
    def clock(self) -> Clock | None:
        """Clock that what is behind the ports runs by; None is real time."""
        return None

    @abstractmethod
    def listed(self) -> list[PortInfo]:
        """The ports of adapters that are plugged in; none is opened for that."""

    @abstractmethod
    def open(self, path: str, *, baud: int) -> SerialPort:
        """Open a port for itself alone: 8 data bits, no parity, 1 stop bit, no flow control, `baud` [Bd].

        Raises OSError: ENOENT where there is no such port, EACCES, EAGAIN or EBUSY where another has it; another errno,
        or none, where it is no serial port or lacks that rate.
        """
