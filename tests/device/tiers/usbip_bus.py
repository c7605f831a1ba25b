"""A device of umockdev_chips.py behind USB/IP over loopback TCP: the wire protocol's both ends are by others.

Device side: PyPI `usbip`. Host side: PyPI `pyusb-usbip-backend`, a backend of pyusb.
"""

from __future__ import annotations

import errno
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import usbip
from umockdev_chips import Chip
from usbip.core import SPEED_HIGH, DeviceDescriptor, Setup, Stall, Urb
from usbip.transport import USBIP
from usbip_backend import USBIPBackend

HOST = "127.0.0.1"


class ChipInterface(usbip.Interface):
    """The one interface of a chip; a write blocks while the chip has no room."""

    def __init__(self, chip: Chip) -> None:
        super().__init__()
        self.chip = chip
        self.taken = 0
        self.stall_at: int | None = None  # byte of the stream before which the endpoint halts, once
        self.unplug_at: int | None = None
        self.out_pipe: Any = None
        for address, size in chip.endpoints.items():
            kind = usbip.In if address & 0x80 else usbip.Out
            pipe = self._add_endpoint(kind(address, "bulk", mps=size))
            self.out_pipe = self.out_pipe if address & 0x80 else pipe

    def on_control(self, setup: Setup, data: bytes = b"") -> bytes:
        reply = self.chip.control(setup.bmRequestType, setup.bRequest, setup.wValue, setup.wIndex)
        if reply is None:
            raise Stall
        return reply

    def on_out(self, ep: Any, data: bytes) -> None:
        view = memoryview(data)
        if self.stall_at is not None and self.taken + len(view) > self.stall_at:
            self._pour(view[: self.stall_at - self.taken])
            self.stall_at = None
            ep.stall()
            raise Stall
        if self.unplug_at is not None and self.taken + len(view) > self.unplug_at:
            self._pour(view[: self.unplug_at - self.taken])
            self.chip.power_off()
            raise _UnpluggedError
        self._pour(view)

    def _pour(self, view: memoryview) -> None:
        while view:
            count = self.chip.accept(view)
            self.taken += count
            view = view[count:]
            if view:
                wait = self.chip.room_at_ns(min(len(view), self.chip.step_bytes)) - time.monotonic_ns()
                time.sleep(max(wait * 1e-9, 1e-4))


class _UnpluggedError(Exception):
    pass


class BoardDevice(usbip.USBDevice):
    """What the listener exports; once unplugged, every transfer of the connection ends with ENODEV."""

    plugged = True

    def handle_urb(self, urb: Urb, respond: Any = None) -> Urb | None:
        if self.plugged:
            try:
                return super().handle_urb(urb, respond)
            except _UnpluggedError:
                self.plugged = False
        urb.buffer, urb.actual, urb.status = b"", 0, -errno.ENODEV
        return urb


class LoopbackBackend(USBIPBackend):
    """The published backend, with the device descriptor from the wire: the device list has no strings' numbers."""

    def get_device_descriptor(self, dev: Any) -> SimpleNamespace:
        known = super().get_device_descriptor(dev)
        wire = DeviceDescriptor.parse(self._get_device_descriptor_raw(dev))
        names = ("iManufacturer", "iProduct", "iSerialNumber")
        return SimpleNamespace(**{**vars(known), **{name: getattr(wire, name) for name in names}})

    def hang_up(self) -> None:
        for connection in self._conns.values():
            connection.close()


@contextmanager
def plugged_in(chip: Chip) -> Iterator[tuple[LoopbackBackend, ChipInterface]]:
    """Serve a chip on a port of its own; give a backend that finds it, and the chip's interface for faults."""
    device = BoardDevice(
        chip.vendor, chip.product, manufacturer=chip.strings[0], product=chip.strings[1], serial=chip.strings[2]
    )
    device.set_speed(SPEED_HIGH)
    interface = device.add(ChipInterface(chip))
    bus = USBIP(HOST, port=0)  # the system chooses one
    before = set(threading.enumerate())
    with device.plug(via=bus):
        listener = bus._listener  # where it listens is not public
        backend = LoopbackBackend(HOST, listener.socks[0].getsockname()[1])
        try:
            yield backend, interface
        finally:
            backend.hang_up()
            for socket_ in listener.socks:
                socket_.shutdown(socket.SHUT_RDWR)  # closing alone does not wake the thread that accepts
    for thread in set(threading.enumerate()) - before:
        thread.join(timeout=5)
