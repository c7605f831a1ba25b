"""Faults of emulated buses and serial ports, put in from outside: `inject(bus, Fault(...))`."""

from __future__ import annotations

import errno
import os
from array import array
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import usb.core

from palpate.device.emulation.serial_bus import EmulatedPorts
from palpate.device.emulation.usb_bus import EmulatedBus

VENDOR_REQUESTS = (0x40, 0xC0)
LIBUSB_CODE = {errno.ENODEV: -4, errno.EBUSY: -6, errno.EACCES: -3, errno.EPIPE: -9, errno.ETIMEDOUT: -7}


class FaultKind(Enum):
    """What goes wrong."""

    UNPLUG = "unplug"
    """ENODEV (EIO at a serial port) from then on; the board loses its power, and with it everything queued."""
    STALL = "stall"
    """EPIPE; on the bulk endpoint until its halt is cleared."""
    TIMEOUT = "timeout"
    """NAK until the timeout: a short count if a part was taken, else ETIMEDOUT."""
    SHORT = "short"
    """The write returns at once with what was taken."""
    BUSY = "busy"
    """EBUSY on claiming (EAGAIN on opening a serial port)."""
    DENIED = "denied"
    """EACCES on opening."""


@dataclass(frozen=True)
class Fault:
    """One fault and where it strikes; BUSY and DENIED need no place."""

    kind: FaultKind
    byte: int | None = None
    """Offset in the stream of bulk bytes since power-up, before which everything is taken."""
    request: int | None = None
    """Vendor request that it strikes instead."""
    count: int | None = 1
    """How many times; None: from then on."""


class FaultList:
    """Faults of one device that may still strike."""

    def __init__(self) -> None:
        self.left: list[list[Any]] = []  # fault, how many times more

    def take(self, strikes: Callable[[Fault], bool]) -> Fault | None:
        """The first fault that strikes, counted."""
        return next((self.strike(fault) for fault, _ in self.left if strikes(fault)), None)

    def strike(self, fault: Fault) -> Fault:
        """Count one blow."""
        entry = next(entry for entry in self.left if entry[0] is fault)
        if entry[1] is not None:
            entry[1] -= 1
            if entry[1] == 0:
                self.left.remove(entry)
        return fault

    def before_byte(self, end: int) -> Fault | None:
        """The first fault in the stream before byte `end`, not counted."""
        ahead = [fault for fault, _ in self.left if fault.byte is not None and fault.byte < end]
        return min(ahead, key=lambda fault: fault.byte or 0, default=None)


def inject(bus: Any, fault: Fault, *, index: int = 0) -> None:
    """Let a fault happen at the device in a place on an emulated bus, until that is plugged in again."""
    if isinstance(bus, EmulatedPorts):
        adapter = bus._adapters[index]
        if not hasattr(adapter, "injected"):
            adapter.injected = FaultList()
            _put_into_ports(bus, index)
        adapter.injected.left.append([fault, fault.count])
        return
    if not hasattr(bus, "injected"):
        bus.injected = defaultdict(FaultList)  # by port: one that is plugged in again is another
        _put_into_bus(bus)
    bus.injected[bus._ports[index]].left.append([fault, fault.count])


def _error(code: int) -> usb.core.USBError:
    kind = usb.core.USBTimeoutError if code == errno.ETIMEDOUT else usb.core.USBError
    return kind(os.strerror(code), LIBUSB_CODE[code], code)


def _put_into_bus(bus: EmulatedBus) -> None:
    """Stand before the methods that pyusb calls."""
    open_device, claim, control, write = bus.open_device, bus.claim_interface, bus.ctrl_transfer, bus.bulk_write

    def open_faulty(dev: Any) -> Any:
        if dev.plugged and bus.injected[dev].take(lambda fault: fault.kind is FaultKind.DENIED):
            raise _error(errno.EACCES)
        return open_device(dev)

    def claim_faulty(handle: Any, intf: int) -> None:
        if handle.port.plugged and bus.injected[handle.port].take(lambda fault: fault.kind is FaultKind.BUSY):
            raise _error(errno.EBUSY)
        claim(handle, intf)

    def control_faulty(handle: Any, kind: int, request: int, value: int, index: int, data: Any, timeout: int) -> int:
        is_struck = handle.port.plugged and kind in VENDOR_REQUESTS
        fault = bus.injected[handle.port].take(lambda fault: fault.request == request) if is_struck else None
        if fault is None:
            return control(handle, kind, request, value, index, data, timeout)
        if fault.kind is FaultKind.TIMEOUT:
            bus.clock.sleep_until_ns(bus.clock.now_ns() + timeout * 1_000_000)
            raise _error(errno.ETIMEDOUT)
        if fault.kind is FaultKind.UNPLUG:
            handle.port.unplug()
            raise _error(errno.ENODEV)
        raise _error(errno.EPIPE)

    def write_faulty(handle: Any, ep: int, intf: int, data: array, timeout: int) -> int:
        port = handle.port
        start, deadline_ns = port.device.board.bytes_received, bus.clock.now_ns() + timeout * 1_000_000
        fault = bus.injected[port].before_byte(start + len(data))
        if fault is None:
            return write(handle, ep, intf, data, timeout)
        limit = max((fault.byte or 0) - start, 0)
        sent = write(handle, ep, intf, data[:limit], timeout)
        if sent < limit:
            return sent
        kind = bus.injected[port].strike(fault).kind
        if kind is FaultKind.TIMEOUT:
            bus.clock.sleep_until_ns(deadline_ns)
        if kind is FaultKind.TIMEOUT and not sent:
            raise _error(errno.ETIMEDOUT)
        if kind is FaultKind.STALL:
            port.halted = True
            raise _error(errno.EPIPE)
        if kind is FaultKind.UNPLUG:
            port.unplug()
            raise _error(errno.ENODEV)
        return sent

    bus.open_device, bus.claim_interface = open_faulty, claim_faulty
    bus.ctrl_transfer, bus.bulk_write = control_faulty, write_faulty


def _put_into_ports(ports: EmulatedPorts, index: int) -> None:
    """Stand before the opening of a port, and before what the board behind it takes."""
    adapter, open_port = ports._adapters[index], ports.open
    accept, faults = adapter.board.accept, adapter.injected

    def open_faulty(path: str, *, baud: int) -> Any:
        if path == adapter.info.path and adapter.plugged:
            for kind, code in ((FaultKind.DENIED, errno.EACCES), (FaultKind.BUSY, errno.EAGAIN)):
                if faults.take(lambda fault, kind=kind: fault.kind is kind):
                    raise OSError(code, os.strerror(code))
        return open_port(path, baud=baud)

    def accept_faulty(data: memoryview) -> int:
        start = adapter.board.bytes_received
        fault = faults.before_byte(start + len(data))
        limit = len(data) if fault is None else min(max((fault.byte or 0) - start, 0), len(data))
        count = accept(data[:limit])
        if fault is not None and count == limit and faults.strike(fault).kind is FaultKind.UNPLUG:
            ports.unplug(index=index)
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return count

    ports.open, adapter.board.accept = open_faulty, accept_faulty
