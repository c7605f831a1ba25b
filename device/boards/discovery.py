"""What is plugged in, and opening it."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ..array import ArrayModel
from ..array_kind import Emulation, LinkRequest
from ..clock import Clock
from ..errors import CalibrationError
from ..link import Link, TransportKind
from ..registry import array_kinds, array_model, array_names, emulated_backend, kind_of
from ..transports.lookup import candidates, driver_is_bound, likely_ports, matches, no_permission, strings_of
from ..transports.pyusb import Backend, UsbDevice, UsbError, claim, dispose
from ..transports.serial_line import PortInfo, SerialPorts, SystemPorts

UDEV_FILE = "/etc/udev/rules.d/70-palpate.rules"
"""Where udev looks for rules of ours; its number must be below 73 for `uaccess` to work."""


@dataclass(frozen=True)
class ArrayInfo:
    """An array that is plugged in, or may be.

    >>> from palpate.device import EmulatorBackend, VirtualClock, find_arrays
    >>> (info,) = find_arrays(EmulatorBackend(["left"], clock=VirtualClock()))
    >>> info.array, info.serial, info.where, info.accessible
    ('emulator', 'left', 'bus 1, address 1', True)
    """

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
    """Every array on a bus that a registered kind knows, and everything with a chip that one of them has.

    Neither an autd3 is among them nor what is at a serial port (`find_serial_arrays`). Listing disturbs no one who
    plays.

    Args:
        backend: pyusb's backend of the bus; None is libusb's, real USB.
        calibrations: board files: a chip with the serial number of one is known to be that board, such as a pat16.

    Raises:
        NoBackendError: libusb is missing.
        CalibrationError: a board file is wrong.

    >>> from palpate.device import EmulatorBackend, VirtualClock, find_arrays
    >>> bus = EmulatorBackend(["left", "right"], clock=VirtualClock())
    >>> [(info.array, info.serial) for info in find_arrays(bus)]
    [('emulator', 'left'), ('emulator', 'right')]
    """
    known = [board for path in calibrations for board in _boards_of(path)]
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
    """Every serial adapter on USB, which an array with a UART, such as a sonicsurface, may be behind.

    Which one it is, only opening it would tell, and that can reset what else is there: so none is opened, and one that
    another program has is listed as accessible.

    Args:
        ports: what has the ports; None is the system, through pyserial.

    Raises:
        NoBackendError: pyserial is missing.

    >>> from palpate.device import VirtualClock, find_serial_arrays
    >>> from palpate.device.registry import emulated_backend
    >>> (info,) = find_serial_arrays(emulated_backend("sonicsurface", clock=VirtualClock()))
    >>> info.serial, info.reason
    ('SONEMU01', 'may be a sonicsurface: it is a serial adapter (emulated serial adapter)')
    """
    ports = ports or SystemPorts()
    names = [name for name in array_names() if array_model(name).baud is not None]
    is_real = ports.clock is None
    return tuple(_look_at_port(name, info, is_real=is_real) for name in names for info in likely_ports(ports))


def open_link(
    model: ArrayModel,
    *,
    serial: str | None = None,
    backend: Backend | SerialPorts | Emulation | None = None,
    clock: Clock | None = None,
    transport: TransportKind = "auto",
    uncalibrated: bool = False,
    emulated: bool = False,
) -> Link:
    """Find, open and claim an array.

    Args:
        model: which kind, with the calibration of its board.
        serial: which one; None takes that of the calibration, or the first. For sonicsurface the serial number of its
            adapter or the path of its port; None takes the only adapter. For autd3 the network interface that it hangs
            on, or the address of an emulated one; None asks on each interface.
        backend: pyusb's backend; None is libusb's, or a new emulated bus for an array that is only emulated. For
            an array with a UART the serial ports; None is the system's.
        clock: clock that the board runs by; None takes an emulated bus's own, else the monotonic one.
        transport: "queued", "sync", or "auto": queued where the backend is libusb's. Of arrays on USB.
        uncalibrated: play on a real pat16 without its board file.
        emulated: without a backend, open a new emulated array.

    Raises:
        UnknownArrayError: the model's name is not registered, or there is no emulation of it.
        CalibrationError: a real pat16 needs its board file.
        DeviceNotFoundError, DeviceBusyError, DevicePermissionError, NoBackendError: as their names say.
        LinkError: whatever else happened.

    >>> from palpate.device import VirtualClock, array_model, open_link
    >>> with open_link(array_model("pat16"), emulated=True, clock=VirtualClock()) as link:
    ...     link, link.clock
    (PatLink('pat16', serial='PATEMU01'), VirtualClock(0 s))
    """
    kind = kind_of(model)
    is_new = emulated and backend is None
    request = LinkRequest(
        serial=serial,
        backend=emulated_bus(model, serial, clock) if is_new and not kind.emulates_itself else backend,
        clock=clock,
        transport=transport,
        uncalibrated=uncalibrated,
        emulated=is_new and kind.emulates_itself,
    )
    return kind.open_link(model, request)


def udev_rule(model: ArrayModel) -> str:
    """Rule for `UDEV_FILE` that lets whoever sits at the machine open an array; "" if it is not opened by libusb.

    Afterwards the array has to be unplugged and plugged in.

    >>> from palpate.device import array_model, udev_rule
    >>> print(udev_rule(array_model("pat16")))
    SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="6014", TAG+="uaccess"
    """
    if model.usb is None:
        return ""
    return (
        f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{model.usb.vendor:04x}", '
        f'ATTR{{idProduct}}=="{model.usb.product:04x}", TAG+="uaccess"'
    )


def emulated_bus(model: ArrayModel, serial: str | None, clock: Clock | None, *, record: int = 0) -> Emulation:
    """A new bus with one board, of the serial number and the UART's rate that are asked for."""
    serial = serial or model.serial
    serials = None if serial is None else (serial,)
    return emulated_backend(model.name, clock=clock, serials=serials, baud=model.baud, record=record)


def _boards_of(path: Path) -> list[tuple[str, str | None]]:
    """Names and serial numbers of the boards that a calibration file may be of; raises CalibrationError if of none."""
    boards: list[tuple[str, str | None]] = []
    refusals: list[CalibrationError] = []
    for kind in array_kinds():
        if kind.calibration_serial is not None:
            try:
                boards.append((kind.name, kind.calibration_serial(path)))
            except CalibrationError as error:
                refusals.append(error)
    if refusals and not boards:
        raise refusals[0]
    return boards


def _look_at(model: ArrayModel, device: UsbDevice, known: list[tuple[str, str | None]]) -> ArrayInfo | None:
    """What there is to say of a device with an array's ids; None if it is none, or gone by now."""
    try:
        strings = strings_of(device)
    except UsbError as error:
        return None if error.errno in (errno.ENODEV, errno.ENOENT) else _closed(model, device, error)
    if not matches(model, strings):
        return None
    generic = model.usb is not None and model.usb.generic
    certain = not generic or (strings.serial is not None and (model.name, strings.serial) in known)
    accessible, reason = _access(device)
    if not certain:
        chip = " ".join(filter(None, [strings.manufacturer, strings.product]))
        likeness = (
            f"may be a {model.name}: it has the same chip ({chip}), and no board file given has its serial number"
        )
        reason = "; ".join(filter(None, [likeness, reason]))
    return ArrayInfo(model.name, strings.serial, _place(device), accessible, reason, certain)


def _look_at_port(name: str, info: PortInfo, *, is_real: bool) -> ArrayInfo:
    """What there is to say of a serial port that an array of that name may be at."""
    accessible = not is_real or os.access(info.path, os.R_OK | os.W_OK)
    reason = f"may be a {name}: it is a serial adapter ({info.description})"
    if not accessible:
        reason += f"; {no_permission(info.path)}"
    return ArrayInfo(name, info.serial, info.path, accessible, reason, certain=False)


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
