"""Opening an array at a bulk endpoint: found, configured, claimed, with a transport to it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Final, cast, get_args

from ..array import ArrayModel
from ..array_kind import EmulationRequest, LinkRequest
from ..clock import Clock, MonotonicClock
from ..errors import LinkError, link_error
from ..link import TransportKind
from ..registry import kind_of
from .libusb import hidden_name, is_libusb
from .lookup import emulated_clock, find_device
from .pyusb import Backend, UsbDevice, UsbError, claim, configure, dispose
from .queued import QueuedTransport
from .serial_line import SerialPorts
from .transport import SyncTransport, Transport

PYUSB_TRIED: Final = "==1.3.1"
"""Version of pyusb whose handle queued transfers are known to find."""


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
        configure(device)
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


def open_transport(
    device: UsbDevice, endpoint: int, *, kind: TransportKind = "auto", who: str = "", clock: Clock | None = None
) -> Transport:
    """A transport to an endpoint of an opened, claimed device.

    Where "auto" cannot queue although the backend is libusb's, a RuntimeWarning says why, and what to do.

    Args:
        device: pyusb's device.
        endpoint: address of the bulk OUT endpoint.
        kind: "queued" submits transfers on pyusb's own libusb handle, so that the kernel has the next bytes while
            Python does something else; "sync" works with any backend of pyusb, one blocking write at a time; "auto"
            is queued where the backend is libusb's, else sync.
        who: name and serial number of the array, for messages.
        clock: clock of time limits, by which the device runs; None is real time. Queued is always in real time.

    Raises:
        LinkError: there is no such kind; or queued was asked for, and the backend is not libusb's, or this pyusb
            hides what is needed.
    """
    if kind not in get_args(TransportKind):
        raise LinkError(f"unknown transport {kind!r}; known: {', '.join(get_args(TransportKind))}")
    hidden = hidden_name(device)
    if kind == "queued" or (kind == "auto" and hidden is None):
        return QueuedTransport(device, endpoint, who=who)
    if kind == "auto" and is_libusb(device):  # an emulated bus is meant to be written to
        warnings.warn(
            f"array {who} is played by blocking writes, between which it may run dry: {hidden}. Install a version that "
            f"queued transfers were tried with: pip install 'pyusb{PYUSB_TRIED}'",
            RuntimeWarning,
            stacklevel=2,
        )
    return SyncTransport(device, endpoint, who=who, clock=clock)
