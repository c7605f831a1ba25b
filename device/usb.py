"""The link to a board with the protocol of docs/emulator.md, over pyusb."""

from __future__ import annotations

import errno
import struct
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from .array import ArrayModel, array_model, array_names
from .clock import Clock, MonotonicClock
from .codec import off_frame
from .emulator import EmulatorBackend
from .errors import (
    DeviceBusyError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceStallError,
    DeviceTimeoutError,
    LinkError,
)
from .link import BoardStatus
from .pyusb import Backend, UsbDevice, UsbError, UsbTimeoutError, claim, devices, dispose

_BULK_OUT = 0x01
_VENDOR_OUT, _VENDOR_IN = 0x40, 0xC0
_SET_DIVIDER, _GET_STATUS, _CLEAR = 0x01, 0x02, 0x03
_STATUS = struct.Struct("<QQQIHBB")

_CONTROL_TIMEOUT_MS = 500
_WRITE_TIMEOUT_MS = 100  # beyond the playing time of what is written; a stop waits no longer than this
_FRUITLESS_MAX = 10  # writes in a row without a byte taken, before the array counts as hung

# errno: (error, what to do about it)
_MEANING: Mapping[int, tuple[type[LinkError], str]] = {
    errno.EACCES: (DevicePermissionError, "may not be opened by this user: add a udev rule for it, or use its group"),
    errno.EPERM: (DevicePermissionError, "may not be opened by this user: add a udev rule for it, or use its group"),
    errno.EBUSY: (DeviceBusyError, "is in use: stop the other player, or choose another serial number"),
    errno.ENODEV: (DeviceLostError, "is gone: it was unplugged or lost its power"),
    errno.ENOENT: (DeviceLostError, "is gone: it was unplugged, lost its power or was reconfigured"),
    errno.EPIPE: (DeviceStallError, "refused (stall): its firmware may not be the one this array model is for"),
    errno.ETIMEDOUT: (DeviceTimeoutError, "did not answer in time: check its cable, or switch it off and on"),
}


@dataclass(frozen=True)
class ArrayInfo:
    """An array that is plugged in."""

    array: str
    """Name of its model."""
    serial: str | None
    """Serial number; None if it has none, or if this user may not ask."""
    bus: int
    """Number of its bus."""
    address: int
    """Its address there."""
    accessible: bool
    """Whether this user may open it."""


def find_arrays(*, backend: Backend | None = None) -> tuple[ArrayInfo, ...]:
    """Every array on the bus of `backend` (None: libusb's, real USB) that a built-in model knows.

    A device of matching ids that this user may not open is listed as not accessible: what it is cannot be asked.
    Raises `NoBackendError` where libusb is missing.
    """
    found: list[ArrayInfo] = []
    for name in array_names():
        for device in _candidates(array_model(name), backend):
            strings = _strings(device)
            if strings is None or _is_model(array_model(name), strings):
                serial = strings[2] if strings else None
                found.append(ArrayInfo(name, serial, device.bus, device.address, strings is not None))
            dispose(device)
    return tuple(found)


class UsbLink:
    """An opened array; a context manager that closes it. Made by `UsbLink.open`.

    Not for several threads at once; a player uses it from one.
    """

    def __init__(self, model: ArrayModel, device: UsbDevice, serial: str | None, clock: Clock) -> None:
        self.array = model
        self.serial = serial
        self.clock = clock
        self.bytes_sent = 0
        self.short_writes = 0
        self._device = device
        self._divider = model.divider_max
        self._torn: int | None = None  # bytes sent of an incomplete frame; None: only the board knows
        self._halted = False

    @classmethod
    def open(
        cls,
        model: ArrayModel,
        *,
        serial: str | None = None,
        backend: Backend | None = None,
        clock: Clock | None = None,
    ) -> Self:
        """Find, open, configure and claim an array.

        Args:
            model: which kind.
            serial: which one; None takes the first.
            backend: pyusb's backend; None is libusb's, or a new emulated bus for an array that is only emulated.
            clock: clock for deadlines; None takes the emulated bus's own, else the monotonic one.

        Raises:
            DeviceNotFoundError, DeviceBusyError, DevicePermissionError, NoBackendError: as their names say.
        """
        bus = EmulatorBackend() if backend is None and model.embedded else backend
        if clock is None:
            clock = bus.clock if isinstance(bus, EmulatorBackend) else MonotonicClock()
        device, found_serial = _find(model, serial, bus)
        link = cls(model, device, found_serial, clock)
        try:
            link._configure()
            claim(device, 0)
        except UsbError as error:
            dispose(device)
            raise link._error(error) from error
        return link

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release and close the array; nothing happens if it is gone. What it plays, it goes on playing."""
        dispose(self._device)

    def set_divider(self, divider: int) -> None:
        """Set the update rate to carrier / divider; raises `UpdateRateError`, or `LinkError`."""
        self.array.update_rate(divider)
        self._request(_VENDOR_OUT, _SET_DIVIDER, value=divider)
        self._divider = divider

    def status(self) -> BoardStatus:
        """Ask the board for its counts, its FIFO and what is playing."""
        reply = self._request(_VENDOR_IN, _GET_STATUS, length=_STATUS.size)
        if len(reply) != _STATUS.size:
            raise LinkError(f"array {self._who()} answered a status of {len(reply)} bytes instead of {_STATUS.size}")
        status = BoardStatus(*_STATUS.unpack(reply))
        self._torn = status.torn_bytes
        return status

    def clear(self) -> None:
        """Drop the whole frames that are queued; a torn one stays and waits for its rest."""
        self._request(_VENDOR_OUT, _CLEAR)

    def write(self, data: array[int], *, abandon: Callable[[], bool] = lambda: False) -> int:
        """Send bytes; blocks while the FIFO is full. Short writes are continued and counted.

        Args:
            data: bytes to send. Only an array("B") passes through pyusb without an element-wise copy.
            abandon: asked after each short write; if it holds, the rest is not sent.

        Returns:
            How many bytes the array took: all, unless abandoned.

        Raises:
            DeviceTimeoutError: it took nothing for about a second.
            LinkError: whatever else happened.
        """
        playing_ms = len(data) / self.array.frame_bytes * self._divider / self.array.carrier * 1e3
        sent = fruitless = 0
        while sent < len(data):
            count = self._transfer(data[sent:] if sent else data, _WRITE_TIMEOUT_MS + round(playing_ms))
            sent += count
            fruitless = 0 if count else fruitless + 1
            if sent < len(data):
                self.short_writes += 1
                if abandon():
                    break
            if fruitless == _FRUITLESS_MAX:
                raise self._error(None, errno.ETIMEDOUT)
        return sent

    def send_off(self) -> None:
        """Complete a torn frame, its missing part silent, then queue the off frame; ends a halt first."""
        if self._halted:
            try:
                self._device.clear_halt(_BULK_OUT)
            except UsbError as error:
                raise self._error(error) from error
            self._halted = False
        torn = self.status().torn_bytes if self._torn is None else self._torn
        off = off_frame(array=self.array.name).tobytes()
        self.write(array("B", off[torn:] + off if torn else off))

    def _configure(self) -> None:
        """Configure the device unless it is: doing it again would fail while another player has claimed it."""
        try:
            self._device.get_active_configuration()
        except UsbError as error:
            if error.errno is not None:  # pyusb's own "not set" has no errno
                raise
            self._device.set_configuration()

    def _transfer(self, data: array[int], timeout_ms: int) -> int:
        """One bulk write: bytes taken, 0 at a timeout."""
        try:
            count = self._device.write(_BULK_OUT, data, timeout_ms)
        except UsbTimeoutError:
            return 0
        except UsbError as error:
            self._torn = None  # pyusb does not say how much was taken
            self._halted = error.errno == errno.EPIPE
            raise self._error(error) from error
        self.bytes_sent += count
        if self._torn is not None:
            self._torn = (self._torn + count) % self.array.frame_bytes
        return count

    def _request(self, kind: int, request: int, *, value: int = 0, length: int | None = None) -> bytes:
        try:
            reply = self._device.ctrl_transfer(kind, request, value, 0, length, _CONTROL_TIMEOUT_MS)
        except UsbError as error:
            raise self._error(error) from error
        return b"" if isinstance(reply, int) else reply.tobytes()

    def _error(self, error: UsbError | None, code: int | None = None) -> LinkError:
        return _translate(self._who(), code if error is None else error.errno, error)

    def _who(self) -> str:
        return f"{self.array.name} {self.serial}" if self.serial else self.array.name


def _translate(who: str, code: int | None, error: UsbError | None) -> LinkError:
    kind, advice = _MEANING.get(code or 0, (LinkError, f"failed: {error}"))
    return kind(f"array {who} {advice}")


def _candidates(model: ArrayModel, backend: Backend | None) -> list[UsbDevice]:
    return devices(vendor=model.usb.vendor, product=model.usb.product, backend=backend)


def _strings(device: UsbDevice) -> tuple[str | None, str | None, str | None] | None:
    """Manufacturer, product, serial number; None where this user may not ask, or the device is gone."""
    try:
        return device.manufacturer, device.product, device.serial_number
    except (UsbError, ValueError):  # pyusb: ValueError where no language can be read
        return None


def _is_model(model: ArrayModel, strings: tuple[str | None, str | None, str | None]) -> bool:
    return strings[:2] == (model.usb.manufacturer_string, model.usb.product_string)


def _find(model: ArrayModel, serial: str | None, backend: Backend | None) -> tuple[UsbDevice, str | None]:
    """The device, and its serial number."""
    seen: list[str] = []
    denied = False
    for device in _candidates(model, backend):
        strings = _strings(device)
        if strings is None:
            denied = True
        elif _is_model(model, strings):
            if serial in (None, strings[2]):
                return device, strings[2]
            seen.append(strings[2] or "(no serial number)")
        dispose(device)
    if denied:
        raise _translate(model.name, errno.EACCES, None)
    wanted = f"{model.name} {serial}" if serial else model.name
    there = f"found instead: {', '.join(seen)}" if seen else "plug it in and switch it on"
    raise DeviceNotFoundError(f"array {wanted} was not found: {there}")
