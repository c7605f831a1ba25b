"""The emulated array: a bus behind pyusb's backend interface, with boards on it, and faults on request.

pyusb finds, opens, claims and writes as it would through libusb. The bus has no speed of its own: a transfer takes
as long as the board's FIFO makes it wait. What passes through here is bytes; nothing here knows what they mean.
"""

from __future__ import annotations

import errno
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import SimpleNamespace

from .board import Board
from .clock import Clock, MonotonicClock
from .pyusb import Backend, UsbError, UsbTimeoutError

VENDOR, PRODUCT = 0x1209, 0x0001  # pid.codes' shared product id for tests
MANUFACTURER_STRING, PRODUCT_STRING = "palpate", "emulated 256-transducer array"
BULK_OUT = 0x01

_VENDOR_OUT, _VENDOR_IN = 0x40, 0xC0
_STRING = 0x03  # type of a string descriptor
_SLICE_NS = 10_000_000  # a blocked write looks up this often, so that a clear or an unplug from elsewhere ends it

# what happens: (libusb's code, errno, message), as pyusb reports each through libusb
_NOT_FOUND = (-5, errno.ENOENT, "Entity not found")
_NO_DEVICE = (-4, errno.ENODEV, "No such device (it may have been disconnected)")
_BUSY = (-6, errno.EBUSY, "Resource busy")
_ACCESS = (-3, errno.EACCES, "Access denied (insufficient permissions)")
_PIPE = (-9, errno.EPIPE, "Pipe error")
_TIMEOUT = (-7, errno.ETIMEDOUT, "Operation timed out")


class FaultKind(Enum):
    """What can be made to go wrong."""

    UNPLUG = "unplug"
    """ENODEV from then on; the board loses its power, and with it everything queued."""
    STALL = "stall"
    """EPIPE; on the bulk endpoint until its halt is cleared."""
    TIMEOUT = "timeout"
    """NAK until the timeout: a short count if a part was taken, else ETIMEDOUT."""
    SHORT = "short"
    """The write returns at once with what was taken."""
    BUSY = "busy"
    """EBUSY on claiming."""
    DENIED = "denied"
    """EACCES on opening."""


@dataclass(frozen=True)
class Fault:
    """One fault and where it strikes.

    Args:
        kind: what happens. BUSY and DENIED need no place.
        byte: offset in the stream of bulk bytes since power-up, before which everything is taken.
        request: vendor request that it strikes instead.
        count: how many times, from then on if None.
    """

    kind: FaultKind
    byte: int | None = None
    request: int | None = None
    count: int | None = 1

    def __post_init__(self) -> None:
        places = [place for place in (self.byte, self.request) if place is not None]
        if len(places) != (self.kind not in (FaultKind.BUSY, FaultKind.DENIED)):
            raise ValueError(f"fault {self.kind.value} takes a byte or a request, or none if busy or denied: {places}")
        if self.kind is FaultKind.SHORT and self.byte is None:
            raise ValueError("fault short is one of bulk writes: it takes a byte, not a request")


class _Faults:
    """Faults that may still strike."""

    def __init__(self) -> None:
        self._left: list[tuple[Fault, int | None]] = []

    def add(self, fault: Fault) -> None:
        self._left.append((fault, fault.count))

    def on(self, kind: FaultKind) -> bool:
        """Does a fault of this kind strike now?"""
        return self._strike(next((fault for fault, _ in self._left if fault.kind is kind), None))

    def on_request(self, request: int) -> FaultKind | None:
        """The kind of fault that strikes this request now."""
        fault = next((fault for fault, _ in self._left if fault.request == request), None)
        return fault.kind if fault and self._strike(fault) else None

    def before_byte(self, end: int) -> Fault | None:
        """First fault in the stream before byte `end`; it strikes once the bytes before it are taken."""
        ahead = [fault for fault, _ in self._left if fault.byte is not None and fault.byte < end]
        return min(ahead, key=lambda fault: fault.byte or 0, default=None)

    def strike(self, fault: Fault) -> FaultKind:
        """Count one blow."""
        self._strike(fault)
        return fault.kind

    def _strike(self, fault: Fault | None) -> bool:
        for place, (candidate, left) in enumerate(self._left):
            if candidate is fault:
                if left is None:
                    return True
                self._left[place : place + 1] = [(candidate, left - 1)] if left > 1 else []
                return True
        return False


@dataclass
class _Port:
    """A place on the bus, and the board in it."""

    address: int
    serial: str
    board: Board
    plugged: bool = True
    configuration: int = 0
    holder: _Handle | None = None
    halted: bool = False
    faults: _Faults = field(default_factory=_Faults)

    def unplug(self) -> None:
        self.plugged = False
        self.board.power_off()


@dataclass(eq=False)
class _Handle:
    port: _Port


class EmulatorBackend(Backend):
    """A bus with emulated arrays: give it to pyusb, or to `find_arrays` and `UsbLink.open`, as the backend.

    Args:
        serials: serial number of each array on the bus.
        clock: clock of all boards; None takes the monotonic one.
        record: how many of its last played frames each board keeps, for tests.
    """

    def __init__(self, serials: Sequence[str] = ("EMU0001",), *, clock: Clock | None = None, record: int = 0) -> None:
        super().__init__()
        self.clock: Clock = clock or MonotonicClock()
        self._record = record
        self._ports = [
            _Port(number + 1, serial, Board(self.clock, record=record)) for number, serial in enumerate(serials)
        ]

    def board(self, index: int = 0) -> Board:
        """The board in a place on the bus."""
        return self._ports[index].board

    def inject(self, fault: Fault, *, index: int = 0) -> None:
        """Let a fault happen at a place on the bus."""
        self._ports[index].faults.add(fault)

    def unplug(self, *, index: int = 0) -> None:
        """Pull the plug: the array falls silent and is gone from the bus."""
        self._ports[index].unplug()

    def replug(self, *, index: int = 0) -> None:
        """Plug the array in again: a board fresh from power-up, its faults gone."""
        old = self._ports[index]
        self._ports[index] = _Port(old.address, old.serial, Board(self.clock, record=self._record))

    # What follows is usb.backend.IBackend; the names of its parameters are pyusb's.

    def enumerate_devices(self) -> Iterator[_Port]:
        """Every array that is plugged in."""
        return iter([port for port in self._ports if port.plugged])

    def get_parent(self, dev: _Port) -> None:
        """No hub is modelled."""

    def get_device_descriptor(self, dev: _Port) -> SimpleNamespace:
        """Device descriptor: high speed, one configuration."""
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0200, bDeviceClass=0xFF, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=64, idVendor=VENDOR, idProduct=PRODUCT, bcdDevice=0x0100, iManufacturer=1, iProduct=2,
            iSerialNumber=3, bNumConfigurations=1, address=dev.address, bus=1, port_number=dev.address,
            port_numbers=(dev.address,), speed=3,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: _Port, config: int) -> SimpleNamespace:
        """The one configuration: self-powered, one interface."""
        _require_only(config)
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=25, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0xC0, bMaxPower=50, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: _Port, intf: int, alt: int, config: int) -> SimpleNamespace:
        """The one interface: vendor class, one endpoint."""
        _require_only(intf, alt, config)
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=1,
            bInterfaceClass=0xFF, bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: _Port, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """The one endpoint: bulk OUT, 512 bytes a packet."""
        _require_only(ep, intf, alt, config)
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=BULK_OUT, bmAttributes=0x02, wMaxPacketSize=512,
            bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: _Port) -> _Handle:
        """Open an array."""
        _require_plugged(dev)
        if dev.faults.on(FaultKind.DENIED):
            raise _error(_ACCESS)
        return _Handle(dev)

    def close_device(self, dev_handle: _Handle) -> None:
        """Close it; what it had claimed is free again."""
        if dev_handle.port.holder is dev_handle:
            dev_handle.port.holder = None

    def set_configuration(self, dev_handle: _Handle, config_value: int) -> None:
        """Configure the array; EBUSY while an interface is claimed, as Linux has it."""
        port = _require_plugged(dev_handle.port)
        if port.holder is not None:
            raise _error(_BUSY)
        port.configuration = config_value

    def get_configuration(self, dev_handle: _Handle) -> int:
        """Value of the active configuration, 0 before there is one."""
        return _require_plugged(dev_handle.port).configuration

    def claim_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Claim the interface; EBUSY while another handle holds it."""
        port = _require_plugged(dev_handle.port)
        if port.configuration == 0 or intf != 0:
            raise _error(_NOT_FOUND)
        if port.faults.on(FaultKind.BUSY) or port.holder not in (None, dev_handle):
            raise _error(_BUSY)
        port.holder = dev_handle

    def release_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Release the interface."""
        if _require_plugged(dev_handle.port).holder is not dev_handle:
            raise _error(_NOT_FOUND)
        dev_handle.port.holder = None

    def clear_halt(self, dev_handle: _Handle, ep: int) -> None:
        """End the halt of the bulk endpoint."""
        _require_plugged(dev_handle.port).halted = False

    def ctrl_transfer(
        self,
        dev_handle: _Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: array[int],
        timeout: int,
    ) -> int:
        """Vendor requests and string descriptors; anything else stalls."""
        port = _require_plugged(dev_handle.port)
        if bmRequestType in (_VENDOR_OUT, _VENDOR_IN) and (kind := port.faults.on_request(bRequest)):
            self._fail_control(port, kind, timeout)
        match bmRequestType, bRequest:
            case 0x40, 0x01 if port.board.set_divider(wValue):
                return 0
            case 0x40, 0x03:
                port.board.clear()
                return 0
            case 0xC0, 0x02:
                return _fill(data, port.board.status())
            case 0x80, 0x06 if wValue >> 8 == _STRING and wValue & 0xFF <= 3:
                return _fill(data, _string_descriptor(port, wValue & 0xFF))
            case _:
                raise _error(_PIPE)

    def bulk_write(self, dev_handle: _Handle, ep: int, intf: int, data: array[int], timeout: int) -> int:
        """Bulk OUT: blocks while the FIFO is full; at the timeout [ms, 0 never] the count so far, ETIMEDOUT if 0."""
        port = _require_plugged(dev_handle.port)
        if port.holder is not dev_handle or port.halted:
            raise _error(_PIPE if port.halted else _BUSY)
        deadline_ns = self.clock.now_ns() + timeout * 1_000_000 if timeout else None
        start = port.board.bytes_received
        fault = port.faults.before_byte(start + len(data))
        limit = len(data) if fault is None else max((fault.byte or 0) - start, 0)
        sent = self._pour(port, memoryview(data)[:limit], deadline_ns)
        if fault is not None and sent == limit:
            self._fail_bulk(port, port.faults.strike(fault), deadline_ns, sent)
        elif sent == 0 < len(data):
            raise _timeout()
        return sent

    def _pour(self, port: _Port, data: memoryview, deadline_ns: int | None) -> int:
        """Bytes taken until all are, or until the deadline."""
        sent = 0
        while True:
            sent += port.board.accept(data[sent:])
            now_ns = self.clock.now_ns()
            if sent == len(data) or (deadline_ns is not None and now_ns >= deadline_ns):
                return sent
            wake_ns = min(port.board.room_at_ns(len(data) - sent), now_ns + _SLICE_NS)
            self.clock.sleep_until_ns(wake_ns if deadline_ns is None else min(wake_ns, deadline_ns))
            _require_plugged(port)

    def _fail_bulk(self, port: _Port, kind: FaultKind, deadline_ns: int | None, sent: int) -> None:
        """Raise what the fault raises, or return for a short count."""
        if kind is FaultKind.TIMEOUT:
            if deadline_ns is not None:
                self.clock.sleep_until_ns(deadline_ns)
            if not sent:
                raise _timeout()
        elif kind is FaultKind.STALL:
            port.halted = True
            raise _error(_PIPE)
        elif kind is FaultKind.UNPLUG:
            port.unplug()
            raise _error(_NO_DEVICE)

    def _fail_control(self, port: _Port, kind: FaultKind, timeout: int) -> None:
        if kind is FaultKind.TIMEOUT:
            self.clock.sleep_until_ns(self.clock.now_ns() + timeout * 1_000_000)
            raise _timeout()
        if kind is FaultKind.UNPLUG:
            port.unplug()
            raise _error(_NO_DEVICE)
        raise _error(_PIPE)


def _require_plugged(port: _Port) -> _Port:
    if not port.plugged:
        raise _error(_NO_DEVICE)
    return port


def _require_only(*index: int) -> None:
    """One of each descriptor: pyusb counts up until IndexError."""
    if any(index):
        raise IndexError(f"descriptor {index}: there is only number 0")


def _string_descriptor(port: _Port, index: int) -> bytes:
    if index == 0:
        return bytes((4, _STRING, 0x09, 0x04))  # language: English (United States)
    text = (MANUFACTURER_STRING, PRODUCT_STRING, port.serial)[index - 1].encode("utf-16-le")
    return bytes((2 + len(text), _STRING)) + text


def _fill(data: array[int], reply: bytes) -> int:
    count = min(len(data), len(reply))
    data[:count] = array("B", reply[:count])
    return count


def _error(what: tuple[int, int, str]) -> UsbError:
    return UsbError(what[2], what[0], what[1])


def _timeout() -> UsbTimeoutError:
    return UsbTimeoutError(_TIMEOUT[2], _TIMEOUT[0], _TIMEOUT[1])
