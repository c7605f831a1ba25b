"""An emulated bus behind pyusb's backend interface: ports, claims, configurations, plugs.

pyusb finds, opens, claims and writes as it would through libusb. The bus has no speed of its own: a transfer takes
as long as the board makes it wait. What passes through here is bytes; nothing here knows what they mean.
"""

from __future__ import annotations

import errno
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Generic

from ..clock import Clock, MonotonicClock
from ..transports.pyusb import Backend, UsbError, UsbTimeoutError
from .peripheral import BoardT, EmulatedBoard, Peripheral

ON_FOR_NS = 10_000_000_000
"""How long the boards have been switched on when a bus is made [ns]: past what they do after power-up."""

_VENDOR_OUT, _VENDOR_IN, _STANDARD_IN = 0x40, 0xC0, 0x80
_GET_DESCRIPTOR, _STRING = 0x06, 0x03
_SLICE_NS = 10_000_000  # a blocked write looks up this often, so that a clear or an unplug from elsewhere ends it

# what happens: (libusb's code, errno, message), as pyusb reports each through libusb
_NOT_FOUND = (-5, errno.ENOENT, "Entity not found")
_NO_DEVICE = (-4, errno.ENODEV, "No such device (it may have been disconnected)")
_BUSY = (-6, errno.EBUSY, "Resource busy")
_PIPE = (-9, errno.EPIPE, "Pipe error")
_TIMEOUT = (-7, errno.ETIMEDOUT, "Operation timed out")
_OVERFLOW = (-8, errno.EOVERFLOW, "Overflow")


@dataclass(eq=False)
class Port:
    """A place on the bus, and the device in it."""

    address: int
    device: Peripheral[EmulatedBoard]
    configuration: int
    driver: bool
    driver_known: bool
    plugged: bool = True
    holder: Handle | None = None
    halted: bool = False  # by a stall, as a test may cause one

    def unplug(self) -> None:
        """Pull the plug: the board loses its power."""
        self.plugged = False
        self.device.board.power_off()


@dataclass(eq=False)
class Handle:
    """An opened device."""

    port: Port


class EmulatedBus(Backend, Generic[BoardT]):
    """A bus with emulated devices of one kind: give it to pyusb, or to `find_arrays` and `open_link`, as the backend.

    Args:
        plug: makes a device with a serial number, whose board has been switched on for a time [ns].
        serials: serial number of each device on the bus.
        clock: clock of all boards; None takes the monotonic one.

    >>> from palpate.device import EmulatedBus, VirtualClock, find_arrays
    >>> from palpate.device.boards.emulator.model import Board
    >>> from palpate.device.boards.emulator.model import EmulatorUsb
    >>> plug = lambda clock, serial, on_for_ns: EmulatorUsb(serial, Board(clock))
    >>> bus = EmulatedBus(plug, ["left", "right"], clock=VirtualClock())
    >>> bus, [info.serial for info in find_arrays(bus)]
    (EmulatedBus(2 devices, virtual clock), ['left', 'right'])
    """

    def __init__(
        self,
        plug: Callable[[Clock, str, int], Peripheral[BoardT]],
        serials: Sequence[str],
        *,
        clock: Clock | None = None,
    ) -> None:
        super().__init__()
        self.clock: Clock = clock or MonotonicClock()
        self._plug = plug
        self._devices = [plug(self.clock, serial, ON_FOR_NS) for serial in serials]
        self._ports = [_port(number + 1, device) for number, device in enumerate(self._devices)]

    def __repr__(self) -> str:
        """One line."""
        return f"{type(self).__name__}({len(self._devices)} devices, {self.clock.name} clock)"

    def board(self, index: int = 0) -> BoardT:
        """The board in a place on the bus."""
        return self._devices[index].board

    def bind_kernel_driver(self, *, index: int = 0) -> None:
        """Let the operating system's driver hold the interface, as it does with a chip that it knows."""
        self._ports[index].driver = self._ports[index].driver_known = True

    def unplug(self, *, index: int = 0) -> None:
        """Pull the plug: the array falls silent and is gone from the bus."""
        self._ports[index].unplug()

    def replug(self, *, index: int = 0) -> None:
        """Plug the array in again: a board fresh from power-up."""
        old = self._ports[index]
        self._devices[index] = self._plug(self.clock, old.device.descriptors.serial, 0)
        self._ports[index] = _port(old.address, self._devices[index])

    # What follows is usb.backend.IBackend; the names of its parameters are pyusb's.

    def enumerate_devices(self) -> Iterator[Port]:
        """Every array that is plugged in."""
        return iter([port for port in self._ports if port.plugged])

    def get_parent(self, dev: Port) -> None:
        """No hub is modelled."""

    def get_device_descriptor(self, dev: Port) -> SimpleNamespace:
        """Device descriptor: one configuration."""
        own = dev.device.descriptors
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0200, bDeviceClass=own.device_class, bDeviceSubClass=0,
            bDeviceProtocol=0, bMaxPacketSize0=64, idVendor=own.vendor, idProduct=own.product, bcdDevice=own.release,
            iManufacturer=1, iProduct=2, iSerialNumber=3, bNumConfigurations=1, address=dev.address, bus=1,
            port_number=dev.address, port_numbers=(dev.address,), speed=own.speed,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: Port, config: int) -> SimpleNamespace:
        """The one configuration: self-powered, one interface."""
        _require_below(1, config)
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=18 + 7 * len(dev.device.descriptors.endpoints),
            bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0, bmAttributes=0xC0, bMaxPower=50,
            extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: Port, intf: int, alt: int, config: int) -> SimpleNamespace:
        """The one interface."""
        _require_below(1, intf, alt, config)
        own = dev.device.descriptors
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=len(own.endpoints),
            bInterfaceClass=own.interface_class[0], bInterfaceSubClass=own.interface_class[1],
            bInterfaceProtocol=own.interface_class[2], iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: Port, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """A bulk endpoint."""
        _require_below(1, intf, alt, config)
        _require_below(len(dev.device.descriptors.endpoints), ep)
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=dev.device.descriptors.endpoints[ep], bmAttributes=0x02,
            wMaxPacketSize=dev.device.descriptors.packet_bytes, bInterval=0, bRefresh=0, bSynchAddress=0,
            extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: Port) -> Handle:
        """Open an array."""
        _require_plugged(dev)
        return Handle(dev)

    def close_device(self, dev_handle: Handle) -> None:
        """Close it; what it had claimed is free again."""
        if dev_handle.port.holder is dev_handle:
            dev_handle.port.holder = None

    def set_configuration(self, dev_handle: Handle, config_value: int) -> None:
        """Configure the array; EBUSY while an interface is claimed or bound to a driver, as Linux has it."""
        port = _require_plugged(dev_handle.port)
        if port.holder is not None or port.driver:
            raise _error(_BUSY)
        port.configuration = config_value

    def get_configuration(self, dev_handle: Handle) -> int:
        """Value of the active configuration, 0 before there is one."""
        return _require_plugged(dev_handle.port).configuration

    def claim_interface(self, dev_handle: Handle, intf: int) -> None:
        """Claim the interface; EBUSY while another handle, or the operating system's driver, holds it."""
        port = _require_plugged(dev_handle.port)
        if port.configuration == 0 or intf != 0:
            raise _error(_NOT_FOUND)
        if port.driver or port.holder not in (None, dev_handle):
            raise _error(_BUSY)
        port.holder = dev_handle

    def release_interface(self, dev_handle: Handle, intf: int) -> None:
        """Release the interface."""
        if _require_plugged(dev_handle.port).holder is not dev_handle:
            raise _error(_NOT_FOUND)
        dev_handle.port.holder = None

    def is_kernel_driver_active(self, dev_handle: Handle, intf: int) -> bool:
        """Whether the operating system's driver holds the interface."""
        return _require_plugged(dev_handle.port).driver

    def detach_kernel_driver(self, dev_handle: Handle, intf: int) -> None:
        """Take the interface from the operating system's driver; ENOENT if it has none."""
        if not _require_plugged(dev_handle.port).driver:
            raise _error(_NOT_FOUND)
        dev_handle.port.driver = False

    def attach_kernel_driver(self, dev_handle: Handle, intf: int) -> None:
        """Give the interface back; EBUSY while it is claimed or bound, ENOENT where no driver knows the device."""
        port = _require_plugged(dev_handle.port)
        if not port.driver_known:
            raise _error(_NOT_FOUND)
        if port.holder is not None or port.driver:
            raise _error(_BUSY)
        port.driver = True

    def clear_halt(self, dev_handle: Handle, ep: int) -> None:
        """End the halt of the bulk endpoint."""
        _require_plugged(dev_handle.port).halted = False

    def reset_device(self, dev_handle: Handle) -> None:
        """Reset the port: ends a halt; the board behind it plays on."""
        _require_plugged(dev_handle.port).halted = False

    def ctrl_transfer(
        self,
        dev_handle: Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: array[int],
        timeout: int,
    ) -> int:
        """Vendor requests and string descriptors; anything else stalls."""
        port = _require_plugged(dev_handle.port)
        if bmRequestType in (_VENDOR_OUT, _VENDOR_IN):
            reply = port.device.request(bmRequestType, bRequest, wValue, wIndex)
        elif (bmRequestType, bRequest, wValue >> 8) == (_STANDARD_IN, _GET_DESCRIPTOR, _STRING):
            reply = _string_descriptor(port, wValue & 0xFF)
        else:
            reply = None
        if reply is None:
            raise _error(_PIPE)
        return _fill(data, reply)

    def bulk_write(self, dev_handle: Handle, ep: int, intf: int, data: array[int], timeout: int) -> int:
        """Bulk OUT: blocks while the board has no room; at the timeout [ms, 0 never] the count, ETIMEDOUT if 0."""
        port = self._require_endpoint(dev_handle, ep)
        deadline_ns = self.clock.now_ns() + timeout * 1_000_000 if timeout else None
        sent = self._pour(port, memoryview(data), deadline_ns)
        if sent == 0 < len(data):
            raise _timeout()
        return sent

    def bulk_read(self, dev_handle: Handle, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        """Bulk IN: one packet; ETIMEDOUT if none comes in time [ms, 0 never]."""
        port = self._require_endpoint(dev_handle, ep)
        deadline_ns = self.clock.now_ns() + timeout * 1_000_000 if timeout else None
        packet = port.device.packet_in()
        if packet is None or (deadline_ns is not None and packet[0] > deadline_ns):
            if deadline_ns is not None:
                self.clock.sleep_until_ns(deadline_ns)
            raise _timeout()
        self.clock.sleep_until_ns(packet[0])
        _require_plugged(port)
        if len(packet[1]) > len(buff):
            raise _error(_OVERFLOW)
        return _fill(buff, packet[1])

    def _require_endpoint(self, handle: Handle, address: int) -> Port:
        port = _require_plugged(handle.port)
        if address not in port.device.descriptors.endpoints:
            raise _error(_NOT_FOUND)
        if port.holder is not handle or port.halted:
            raise _error(_PIPE if port.halted else _BUSY)
        return port

    def _pour(self, port: Port, data: memoryview, deadline_ns: int | None) -> int:
        """Bytes taken until all are, or until the deadline."""
        since_ns = now_ns = self.clock.now_ns()
        sent = 0
        while True:
            sent += port.device.accept(data[sent:], since_ns=since_ns)
            if sent == len(data) or (deadline_ns is not None and now_ns >= deadline_ns):
                return sent
            wake_ns = min(port.device.room_at_ns(len(data) - sent), now_ns + _SLICE_NS)
            self.clock.sleep_until_ns(wake_ns if deadline_ns is None else min(wake_ns, deadline_ns))
            now_ns = self.clock.now_ns()
            _require_plugged(port)


def _port(address: int, device: Peripheral[EmulatedBoard]) -> Port:
    own = device.descriptors
    return Port(address, device, own.configuration, own.kernel_driver, own.kernel_driver)


def _require_plugged(port: Port) -> Port:
    if not port.plugged:
        raise _error(_NO_DEVICE)
    return port


def _require_below(count: int, *index: int) -> None:
    """Pyusb counts descriptors up until IndexError."""
    if max(index) >= count:
        raise IndexError(f"descriptor {index}: there are {count}")


def _string_descriptor(port: Port, index: int) -> bytes | None:
    own = port.device.descriptors
    if index == 0:
        return bytes((4, _STRING, 0x09, 0x04))  # language: English (United States)
    if index > 3:
        return None
    text = (own.manufacturer_string, own.product_string, own.serial)[index - 1].encode("utf-16-le")
    return bytes((2 + len(text), _STRING)) + text


def _fill(data: array[int], reply: bytes) -> int:
    count = min(len(data), len(reply))
    data[:count] = array("B", reply[:count])
    return count


def _error(what: tuple[int, int, str]) -> UsbError:
    return UsbError(what[2], what[0], what[1])


def _timeout() -> UsbTimeoutError:
    return UsbTimeoutError(_TIMEOUT[2], _TIMEOUT[0], _TIMEOUT[1])
