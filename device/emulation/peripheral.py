"""What an emulated bus needs to know of a device: its descriptors, its requests, and the board behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray


class EmulatedBoard(Protocol):
    """A model of a board. Every call first does what is due by its clock; calls may come from several threads."""

    @property
    def bytes_received(self) -> int:
        """Bytes taken from the bus since power-up, those in the USB chip too."""
        ...

    @property
    def frames_played(self) -> int:
        """Frames played since power-up."""
        ...

    @property
    def underruns(self) -> int:
        """How often an emitting board had no next frame when one was due; 0 for a board without a frame clock."""
        ...

    @property
    def emitting(self) -> bool:
        """Whether any transducer is driven now."""
        ...

    @property
    def played(self) -> NDArray[np.uint8]:
        """The last `record` frames played, oldest first, shape [frame, byte]."""
        ...

    @property
    def played_ns(self) -> NDArray[np.int64]:
        """When each of `played` began, by the board's clock [ns], shape [frame]."""
        ...

    def accept(self, data: memoryview, *, since_ns: int | None = None) -> int:
        """Take as many bytes as there is room for; returns their count.

        Args:
            data: bytes on the bus.
            since_ns: time [ns] since which they have been on the bus, now if None. A USB controller hands bytes over
                as soon as there is room, without the host; so a caller that looks up late loses no time.
        """
        ...

    def room_at_ns(self, byte_count: int) -> int:
        """Time [ns] at which there will be room for that many bytes; if they are too many, when to look again."""
        ...

    def power_off(self) -> None:
        """Lose the power: silent at once, everything queued is gone."""
        ...


BoardT = TypeVar("BoardT", bound=EmulatedBoard, covariant=True)


@dataclass(frozen=True)
class Descriptors:
    """What a device says of itself: one configuration (value 1), one interface (0), bulk endpoints.

    >>> import usb.core
    >>> from palpate.device import Descriptors, EmulatedBus, Peripheral, VirtualClock
    >>> from palpate.device.boards.emulator.model import Board
    >>> own = Descriptors(0x1209, 0x0002, "tiny makers", "tiny array", "T1", endpoints=(0x01,), packet_bytes=512)
    >>> bus = EmulatedBus(lambda clock, *_: Peripheral(own, Board(clock)), ["T1"], clock=VirtualClock())
    >>> usb.core.find(idVendor=0x1209, backend=bus).product  # as pyusb reads it
    'tiny array'
    """

    vendor: int
    product: int
    manufacturer_string: str
    product_string: str
    serial: str
    endpoints: tuple[int, ...]
    """Addresses in their order; bit 7 set is IN."""
    packet_bytes: int
    """Largest packet of each endpoint."""
    device_class: int = 0
    """bDeviceClass: 0 where the interface says, 0xFF for a device of its maker's own."""
    interface_class: tuple[int, int, int] = (0xFF, 0, 0)
    """Class, subclass and protocol of the interface."""
    release: int = 0x0100
    """bcdDevice; an FTDI chip tells its kind by it."""
    speed: int = 3
    """As libusb numbers it: 2 full, 3 high."""
    configuration: int = 0
    """Value that is active when it has just been plugged in: 1 where an operating system's driver configures it."""
    kernel_driver: bool = False
    """Whether a driver of the operating system binds its interface when it is plugged in."""


class Peripheral(Generic[BoardT]):
    """A device on the bus, and the board behind it. Imports nothing of USB libraries.

    >>> from palpate.device import Descriptors, Peripheral, VirtualClock
    >>> from palpate.device.boards.emulator.model import Board
    >>> own = Descriptors(0x1209, 0x0002, "tiny makers", "tiny array", "T1", endpoints=(0x01,), packet_bytes=512)
    >>> device = Peripheral(own, Board(VirtualClock()))
    >>> device, device.accept(memoryview(bytes(700))), device.board.bytes_received
    (Peripheral(1209:0002, serial='T1'), 700, 700)
    """

    def __init__(self, descriptors: Descriptors, board: BoardT) -> None:
        self.descriptors = descriptors
        self.board = board

    def __repr__(self) -> str:
        """One line."""
        own = self.descriptors
        return f"{type(self).__name__}({own.vendor:04x}:{own.product:04x}, serial={own.serial!r})"

    def accept(self, data: memoryview, *, since_ns: int | None = None) -> int:
        """Bulk OUT: take as many bytes as there is room for, as `EmulatedBoard.accept`."""
        return self.board.accept(data, since_ns=since_ns)

    def room_at_ns(self, byte_count: int) -> int:
        """When bulk OUT has room, as `EmulatedBoard.room_at_ns`."""
        return self.board.room_at_ns(byte_count)

    def packet_in(self) -> tuple[int, bytes] | None:
        """The next packet of bulk IN and when it is there [ns]; None: never."""
        return None

    def request(self, kind: int, request: int, value: int, index: int) -> bytes | None:
        """Answer a vendor request.

        Args:
            kind: bmRequestType, 0x40 out or 0xC0 in.
            request: bRequest.
            value: wValue.
            index: wIndex.

        Returns:
            The bytes in, none for a request out; None is a stall.
        """
        return None
