"""What is plugged in, and opening it."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from .array import ArrayModel, array_model, array_names
from .boards.emulator.link import UsbLink
from .boards.pat16.board_file import read_pat
from .boards.pat16.link import PatLink
from .boards.sonicsurface.link import SonicLink
from .clock import Clock
from .link import Link
from .transports.pyserial import SystemPorts
from .transports.pyusb import Backend, UsbDevice, UsbError, claim, dispose
from .transports.serial_line import PortInfo, SerialPorts
from .transports.serial_lookup import likely_ports, no_permission
from .transports.transport import TransportKind
from .transports.usb_lookup import DeviceStrings, candidates, driver_is_bound, matches, strings_of

UDEV_FILE = "/etc/udev/rules.d/70-palpate.rules"
"""Where udev looks for rules of ours; its number must be below 73 for `uaccess` to work."""


@dataclass(frozen=True)
class ArrayInfo:
    """An array that is plugged in, or may be."""

    array: str
    """Name of its model."""
    serial: str | None
    """Serial number; None if it has none, or if this user may not ask."""
    where: str
    """Its place: number of the USB bus and address there, or path of its serial port."""
    accessible: bool
    """Whether this user may open it now."""
    reason: str | None = None
    """Why not, and what to do about it; or what else there is to know: a sentence without its end."""
    certain: bool = True
    """False where all that is known is that its chip is the array's: many other things have one."""


def find_arrays(backend: Backend | None = None, *, calibrations: Iterable[Path] = ()) -> tuple[ArrayInfo, ...]:
    """Every array on a bus that a built-in model knows, and everything with a chip that one of them has.

    Neither an autd3 is among them nor a sonicsurface (`find_serial_arrays`). Listing disturbs no one who plays.

    Args:
        backend: pyusb's backend of the bus; None is libusb's, real USB.
        calibrations: board files: a chip with the serial number of one is known to be a pat16.

    Raises:
        NoBackendError: libusb is missing.
        CalibrationError: a board file is wrong.
    """
    known = {read_pat(path).serial for path in calibrations}
    found: list[ArrayInfo] = []
    for name in array_names():
        model = array_model(name)
        for device in candidates(model, backend):
            info = _look_at(model, device, known)
            if info is not None:
                found.append(info)
            dispose(device)
    return tuple(found)


def find_serial_arrays(ports: SerialPorts | None = None) -> tuple[ArrayInfo, ...]:
    """Every serial adapter on USB, which a sonicsurface may be behind.

    Which one it is, only opening it would tell, and that can reset what else is there: so none is opened, and one that
    another program has is listed as accessible.

    Args:
        ports: what has the ports; None is the system, through pyserial.

    Raises:
        NoBackendError: pyserial is missing.
    """
    ports = ports or SystemPorts()
    return tuple(_look_at_port(info, is_real=ports.clock is None) for info in likely_ports(ports))


def open_link(
    model: ArrayModel,
    *,
    serial: str | None = None,
    backend: Backend | SerialPorts | None = None,
    clock: Clock | None = None,
    transport: TransportKind = "auto",
    uncalibrated: bool = False,
) -> Link:
    """Find, open and claim an array.

    Args:
        model: which kind, with the calibration of its board.
        serial: which one; None takes that of the calibration, or the first. For sonicsurface the serial number of its
            adapter or the path of its port; None takes the only adapter. For autd3 the network interface that it hangs
            on, or the address of an emulated one; None asks on each interface.
        backend: pyusb's backend; None is libusb's, or a new emulated bus for an array that is only emulated. For
            sonicsurface the serial ports; None is the system's.
        clock: clock that the board runs by; None takes an emulated bus's own, else the monotonic one.
        transport: "queued", "sync", or "auto": queued where the backend is libusb's. Of arrays on USB.
        uncalibrated: play on a real pat16 without its board file.

    Raises:
        CalibrationError: a real pat16 needs its board file.
        DeviceNotFoundError, DeviceBusyError, DevicePermissionError, NoBackendError: as their names say.
        LinkError: whatever else happened.
    """
    if model.name == "sonicsurface":
        ports = backend if isinstance(backend, SerialPorts) else None
        return SonicLink.open(model, serial=serial, ports=ports, clock=clock)
    bus = None if isinstance(backend, SerialPorts) else backend
    if model.name == "pat16":
        return PatLink.open(
            model, serial=serial, backend=bus, clock=clock, transport=transport, uncalibrated=uncalibrated
        )
    if model.name == "autd3":
        from .boards.autd3.link import open_autd3  # an optional package stands behind it

        return open_autd3(model, address=serial)
    return UsbLink.open(model, serial=serial, backend=bus, clock=clock, transport=transport)


def udev_rule(model: ArrayModel) -> str:
    """Rule for `UDEV_FILE` that lets whoever sits at the machine open an array; "" if it is not opened by libusb.

    Afterwards the array has to be unplugged and plugged in.
    """
    if model.usb is None:
        return ""
    return (
        f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{model.usb.vendor:04x}", '
        f'ATTR{{idProduct}}=="{model.usb.product:04x}", TAG+="uaccess"'
    )


def _look_at(model: ArrayModel, device: UsbDevice, known: set[str]) -> ArrayInfo | None:
    """What there is to say of a device with an array's ids; None if it is none, or gone by now."""
    try:
        strings = strings_of(device)
    except UsbError as error:
        return None if error.errno in (errno.ENODEV, errno.ENOENT) else _closed(model, device, error)
    if not matches(model, strings):
        return None
    generic = model.usb is not None and model.usb.generic
    certain = not generic or (model.name == "pat16" and strings.serial in known)
    accessible, reason = _access(device)
    if not certain:
        reason = "; ".join(filter(None, [_likeness(model, strings), reason]))
    return ArrayInfo(model.name, strings.serial, _place(device), accessible, reason, certain)


def _look_at_port(info: PortInfo, *, is_real: bool) -> ArrayInfo:
    """What there is to say of a serial port."""
    accessible = not is_real or os.access(info.path, os.R_OK | os.W_OK)
    reason = f"may be a sonicsurface: it is a serial adapter ({info.description})"
    if not accessible:
        reason += f"; {no_permission(info.path)}"
    return ArrayInfo("sonicsurface", info.serial, info.path, accessible, reason, certain=False)


def _place(device: UsbDevice) -> str:
    return f"bus {device.bus}, address {device.address}"


def _closed(model: ArrayModel, device: UsbDevice, error: UsbError) -> ArrayInfo:
    """A device that may not even be asked what it is."""
    if error.errno in (errno.EACCES, errno.EPERM):
        reason = (
            f"may not be opened by this user: put this into {UDEV_FILE}, then unplug it and plug it in: "
            f"{udev_rule(model)}"
        )
    else:
        reason = f"cannot be opened: {error}"
    return ArrayInfo(model.name, None, _place(device), accessible=False, reason=reason, certain=False)


def _access(device: UsbDevice) -> tuple[bool, str | None]:
    """Whether a device could be claimed now, and why not, or what that takes."""
    if driver_is_bound(device):
        return True, "held by the system's serial driver, which is detached while it is played to"
    try:
        claim(device, 0)
    except UsbError as error:
        if error.errno == errno.EBUSY:
            return False, "in use by another program"
    return True, None


def _likeness(model: ArrayModel, strings: DeviceStrings) -> str:
    chip = " ".join(filter(None, [strings.manufacturer, strings.product]))
    return f"may be a {model.name}: it has the same chip ({chip}), and no board file given has its serial number"
