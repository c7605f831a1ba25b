"""Opening an array at a bulk endpoint: found, configured, claimed, with a transport to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from ..array import ArrayModel
from ..array_kind import EmulationRequest, LinkRequest
from ..clock import Clock, MonotonicClock
from ..errors import LinkError, link_error
from ..registry import kind_of
from .pyusb import Backend, UsbDevice, UsbError, claim, dispose
from .serial_line import SerialPorts
from .transport import Transport, open_transport
from .usb_lookup import emulated_clock, find_device


@dataclass(frozen=True)
class BulkDevice:
    """An opened device: what a `StreamLink` is made of."""

    device: UsbDevice
    transport: Transport
    serial: str | None
    """Its serial number."""
    who: str
    """Name and serial number of the array, for messages."""
    clock: Clock
    """Clock that it runs by."""


def open_bulk(model: ArrayModel, request: LinkRequest, *, endpoint: int) -> BulkDevice:
    """Find, configure and claim an array on USB; without a backend, a model that is `embedded` is emulated.

    Args:
        model: which kind.
        request: how its link is asked for.
        endpoint: address of its bulk OUT endpoint.

    Raises:
        DeviceNotFoundError, DeviceBusyError, DevicePermissionError, NoBackendError: as their names say.
        LinkError: queued was asked for, and cannot be had.

    >>> from palpate.device import EmulatorBackend, LinkRequest, VirtualClock, array_model, open_bulk
    >>> request = LinkRequest(serial="right", backend=EmulatorBackend(["left", "right"], clock=VirtualClock()))
    >>> usb = open_bulk(array_model("emulator"), request, endpoint=0x01)
    >>> usb.who, usb.clock
    ('emulator right', VirtualClock(0 s))
    """
    backend = usb_backend(request.backend)
    emulate = kind_of(model).emulate
    if backend is None and model.embedded and emulate is not None:
        backend = usb_backend(emulate(EmulationRequest(clock=request.clock)))
    clock = request.clock or emulated_clock(backend) or MonotonicClock()
    device, serial = find_device(model, request.serial, backend)
    who = f"{model.name} {serial}" if serial else model.name
    try:
        _configure(device)
        claim(device, 0)
        transport = open_transport(device, endpoint, kind=request.transport, who=who, clock=clock)
    except UsbError as error:
        dispose(device)
        raise link_error(who, error.errno, error) from error
    except LinkError:
        dispose(device)
        raise
    return BulkDevice(device, transport, serial, who, clock)


def usb_backend(backend: object) -> Backend | None:
    """pyusb's backend out of a `LinkRequest`; None if it is none, or serial ports."""
    return None if isinstance(backend, SerialPorts) else cast("Backend | None", backend)


def _configure(device: UsbDevice) -> None:
    """Configure the device unless it is: doing it again would fail while another player has claimed it."""
    try:
        device.get_active_configuration()
    except UsbError as error:
        if error.errno is not None:  # pyusb's own "not set" has no errno
            raise
        device.set_configuration()
