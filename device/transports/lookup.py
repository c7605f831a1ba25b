"""Looking for arrays: which USB devices and serial ports may be one, and what each says of itself."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import NamedTuple, Protocol, cast, runtime_checkable

from ..array import ArrayModel
from ..clock import Clock
from ..errors import DeviceNotFoundError, DevicePermissionError, link_error
from ..registry import array_model, array_names
from .pyusb import Backend, UsbDevice, UsbError, devices, dispose
from .serial_line import PortInfo, SerialPort, SerialPorts


class DeviceStrings(NamedTuple):
    """Strings that a device gives; None where it has none."""

    manufacturer: str | None
    product: str | None
    serial: str | None


class DriverDevice(UsbDevice, Protocol):
    """A device that a driver of the operating system may hold: `usb.core.Device`, as far as that goes."""

    def is_kernel_driver_active(self, interface: int) -> bool:
        """Whether a driver holds the interface; NotImplementedError where the system cannot say."""
        ...

    def detach_kernel_driver(self, interface: int) -> None:
        """Take the interface from the driver."""
        ...

    def attach_kernel_driver(self, interface: int) -> None:
        """Give it back."""
        ...


@runtime_checkable
class ClockedBackend(Protocol):
    """A backend that has a clock, as only emulated buses do."""

    @property
    def clock(self) -> Clock:
        """Clock that its boards run by."""
        ...


def candidates(model: ArrayModel, backend: Backend | None) -> list[UsbDevice]:
    """Every device on the bus with ids of the array; none for an array that is not on USB.

    Raises `NoBackendError` where libusb is missing.
    """
    if model.usb is None:
        return []
    return devices(vendor=model.usb.vendor, product=model.usb.product, backend=backend)


def strings_of(device: UsbDevice) -> DeviceStrings:
    """What a device says of itself; raises `UsbError` where it may not be asked, or is gone."""
    try:
        return DeviceStrings(device.manufacturer, device.product, device.serial_number)
    except ValueError as error:  # pyusb's word for whatever kept it from asking
        raise _cause(device) from error


def _cause(device: UsbDevice) -> UsbError:
    """What keeps a device from being asked."""
    try:
        device.get_active_configuration()
    except UsbError as error:
        if error.errno is not None:  # pyusb's own "not set" has no errno
            return error
    return UsbError("its strings cannot be read", None, errno.EIO)


def matches(model: ArrayModel, strings: DeviceStrings) -> bool:
    """Whether a device with the array's ids may be it by its strings."""
    usb = model.usb
    return usb is not None and (
        usb.generic or (strings.manufacturer, strings.product) == (usb.manufacturer_string, usb.product_string)
    )


def find_device(model: ArrayModel, serial: str | None, backend: Backend | None) -> tuple[UsbDevice, str | None]:
    """The device to open as an array, not yet configured or claimed, and its serial number.

    Args:
        model: which kind.
        serial: which one; None takes that of the array's calibration, or the first.
        backend: pyusb's; None is libusb's.

    Raises:
        DeviceNotFoundError: there is none, or it is not on USB; or several have its chip, one that this user may not
            ask among them perhaps, and none was named.
        DevicePermissionError: there may be one, but this user may not ask.
        NoBackendError: libusb is missing.
    """
    if model.usb is None:
        raise DeviceNotFoundError(f"array {model.name} is not on USB, so it cannot be looked for there")
    wanted = serial if serial is not None else model.serial
    found: list[tuple[UsbDevice, str | None]] = []
    refusals: list[UsbError] = []
    for device in candidates(model, backend):
        try:
            strings = strings_of(device)
        except UsbError as error:
            refusals.append(error)
        else:
            if matches(model, strings):
                found.append((device, strings.serial))
        dispose(device)
    chosen = [one for one in found if wanted in (None, one[1])]
    serials = ", ".join(one[1] or "(no serial number)" for one in found)
    hidden = sum(error.errno in (errno.EACCES, errno.EPERM) for error in refusals) if wanted is None else 0
    if chosen and len(chosen) + hidden > 1 and model.usb.generic:
        raise DeviceNotFoundError(_which_of_them(model, len(chosen) + hidden, hidden, serials, wanted))
    if chosen:
        return chosen[0]
    who = f"{model.name} {wanted}" if wanted else model.name
    if refusals:
        raise link_error(who, refusals[0].errno, refusals[0]) from refusals[0]
    there = f"found instead: {serials}" if found else "plug it in and switch it on"
    raise DeviceNotFoundError(f"array {who} was not found: {there}")


def _which_of_them(model: ArrayModel, count: int, hidden: int, serials: str, wanted: str | None) -> str:
    """Why none of several adapters is opened, and how to say which one is meant."""
    if wanted is not None:
        return f"{count} adapters have the serial number {wanted} of array {model.name}: unplug all but one"
    unread = f", and {hidden} that this user may not ask" if hidden else ""
    return (
        f"array {model.name} is one of {count} adapters with its chip: {serials}{unread}. Say which by its serial "
        "number (serial=NUMBER): other things have that chip, too"
    )


def driver_is_bound(device: UsbDevice) -> bool:
    """Whether a driver of the operating system holds the device; False where the system cannot say."""
    try:
        return bool(cast("DriverDevice", device).is_kernel_driver_active(0))
    except (NotImplementedError, UsbError, ValueError):  # other systems; pyusb raises all of these
        return False


def emulated_clock(backend: Backend | None) -> Clock | None:
    """Clock that the boards of an emulated bus run by; None for any other bus."""
    return backend.clock if isinstance(backend, ClockedBackend) else None


def likely_ports(ports: SerialPorts) -> list[PortInfo]:
    """The ports that an array may be at: those of USB adapters, but for the chips of arrays that are on USB."""
    identities = [array_model(name).usb for name in array_names()]
    chips = [(usb.vendor, usb.product) for usb in identities if usb is not None]  # such as a pat16's FT232H
    return [info for info in ports.listed() if info.usb_ids is not None and info.usb_ids not in chips]


def choose_port(model: ArrayModel, wanted: str | None, ports: SerialPorts) -> PortInfo:
    """The port of an array.

    Args:
        model: which kind.
        wanted: serial number of the adapter, or path of the port; None takes the only one that there is.
        ports: what has the ports.

    Raises:
        DeviceNotFoundError: there is none, or there are several and none was named.
    """
    found = likely_ports(ports)
    there = ", ".join(map(_named, found))
    if wanted is None:
        chosen = found
    else:
        listed = ports.listed()
        chosen = [info for info in listed if info.path == wanted] or [info for info in listed if info.serial == wanted]
        if not chosen and os.sep in wanted:  # such as a pseudo-terminal, which is in no list
            return PortInfo(wanted, None, "serial port", None)
    if len(chosen) == 1:
        return chosen[0]
    if chosen:
        raise DeviceNotFoundError(
            f"array {model.name} may be at any of {len(chosen)} serial adapters: {', '.join(map(_named, chosen))}. Say "
            "which by its serial number or its port (serial=NAME)"
        )
    who = model.name if wanted is None else f"{model.name} {wanted}"
    otherwise = (
        f"found instead: {there}" if found else "no serial adapter is plugged in; a port can be named (serial=PORT)"
    )
    raise DeviceNotFoundError(f"array {who} was not found: {otherwise}")


def open_port(model: ArrayModel, info: PortInfo, ports: SerialPorts, *, baud: int) -> SerialPort:
    """Open the port of an array; every failure is a `LinkError`, with what to do about it."""
    who = f"{model.name} at {info.path}"
    try:
        return ports.open(info.path, baud=baud)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM):
            raise DevicePermissionError(f"array {who} {no_permission(info.path)}") from error
        if error.errno == errno.ENOENT:
            there = ", ".join(map(_named, likely_ports(ports))) or "none"
            raise DeviceNotFoundError(f"array {who} was not found: there is no such port; found: {there}") from error
        raise link_error(who, errno.EBUSY if error.errno == errno.EAGAIN else error.errno, error) from error


def no_permission(path: str) -> str:
    """What keeps this user from opening a port, and what to do about it."""
    return f"may not be opened by this user: join the group that owns it ({_group(path)}), then log in again"


def _named(info: PortInfo) -> str:
    return f"{info.serial} at {info.path}" if info.serial else info.path


def _group(path: str) -> str:
    try:
        return Path(path).group()
    except (OSError, KeyError, NotImplementedError):
        return "dialout on most systems"
