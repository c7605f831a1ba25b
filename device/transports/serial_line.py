"""Serial ports as a link sees them, and those of the system; nothing else imports pyserial."""

from __future__ import annotations

import importlib.util
import os
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from ..clock import Clock
from ..errors import NoBackendError

if TYPE_CHECKING:
    import serial


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


MISSING = "pyserial is not installed, so no serial port can be reached: pip install -e '.[serial]' in palpate's folder"


def require_pyserial() -> None:
    """Raise `NoBackendError` where pyserial is missing."""
    if importlib.util.find_spec("serial") is None:
        raise NoBackendError(MISSING)


class SystemPorts(SerialPorts):
    """The system's serial ports. Raises `NoBackendError` where pyserial is missing."""

    def __init__(self) -> None:
        require_pyserial()

    def listed(self) -> list[PortInfo]:
        """The ports of adapters that are plugged in, in the order of their names."""
        from serial.tools.list_ports import comports

        return [
            PortInfo(
                port.device,
                port.serial_number,
                " ".join(filter(None, [port.manufacturer, port.product])) or port.description,
                None if port.vid is None or port.pid is None else (port.vid, port.pid),
            )
            for port in sorted(comports(), key=lambda port: port.device)
        ]

    def open(self, path: str, *, baud: int) -> SerialPort:
        """Open a port for itself alone, as `SerialPorts.open`."""
        import serial

        try:
            port = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        except serial.SerialException as error:
            raise OSError(error.errno, str(error)) from error
        except (ValueError, OverflowError) as error:  # a rate that the system does not have
            raise OSError(None, str(error)) from error
        return _SystemPort(port)


class _SystemPort:
    """An opened port. It is written to by its file descriptor: pyserial's own `write` without a time limit does not
    return while the driver has no room, and with one it does not say how much of the bytes was taken."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    def write(self, data: memoryview) -> int:
        """Bytes taken; 0 while the driver has no room."""
        try:
            return os.write(self._port.fileno(), data)
        except BlockingIOError:
            return 0

    def waiting(self) -> int:
        """Bytes that the driver holds."""
        return self._port.out_waiting

    def drop_waiting(self) -> None:
        """Drop them."""
        self._port.reset_output_buffer()

    def close(self) -> None:
        """Close it; bytes that are left would keep the system from closing it for up to half a minute."""
        try:
            self.drop_waiting()
        except Exception:  # it is gone: termios has errors of its own
            pass
        finally:
            self._port.close()
