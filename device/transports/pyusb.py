"""The one place that imports pyusb: it ships no types, so what is used of it is typed here."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, Protocol, cast

import usb.backend.libusb1  # pyright: ignore[reportMissingTypeStubs]  # pyusb ships no types
import usb.core  # pyright: ignore[reportMissingTypeStubs]  # pyusb ships no types
import usb.util  # pyright: ignore[reportMissingTypeStubs]  # the same

from ..errors import NoBackendError

if TYPE_CHECKING:

    class Backend:
        """`usb.backend.IBackend`; its methods are bare stubs that pyright would read as returning None."""

    class UsbError(OSError):
        """`usb.core.USBError`: `errno` says what happened."""

        def __init__(self, strerror: str, error_code: int | None = None, errno: int | None = None) -> None: ...

    class UsbTimeoutError(UsbError):
        """`usb.core.USBTimeoutError`: nothing was transferred in time."""

else:
    from usb.backend import IBackend as Backend
    from usb.core import USBError as UsbError
    from usb.core import USBTimeoutError as UsbTimeoutError

__all__ = [
    "Backend",
    "UsbDevice",
    "UsbError",
    "UsbTimeoutError",
    "claim",
    "configure",
    "devices",
    "dispose",
    "libusb_backend",
]

_NO_LIBUSB = "libusb is not installed, so no array can be looked for: install libusb-1.0 (Debian: libusb-1.0-0)"


class UsbDevice(Protocol):
    """`usb.core.Device`, as far as it is used. Timeouts in milliseconds, as pyusb has them."""

    bus: int
    address: int

    @property
    def manufacturer(self) -> str | None:
        """String of the maker, asked of the device."""
        ...

    @property
    def product(self) -> str | None:
        """String of the product, asked of the device."""
        ...

    @property
    def serial_number(self) -> str | None:
        """Serial number, asked of the device; ValueError where this user may not ask."""
        ...

    def get_active_configuration(self) -> object:
        """The active configuration; `UsbError` if there is none."""
        ...

    def set_configuration(self, configuration: int | None = None) -> None:
        """Configure the device; None takes its first configuration."""
        ...

    def write(self, endpoint: int, data: array[int], timeout: int | None = None) -> int:
        """Write to an endpoint; the count may be short, also when the time ran out."""
        ...

    def ctrl_transfer(
        self,
        bmRequestType: int,
        bRequest: int,
        wValue: int = 0,
        wIndex: int = 0,
        data_or_wLength: int | None = None,
        timeout: int | None = None,
    ) -> int | array[int]:
        """Control request: the count of bytes out, or the bytes in."""
        ...

    def clear_halt(self, ep: int) -> None:
        """End the halt of an endpoint."""
        ...


def devices(*, vendor: int, product: int, backend: Backend | None) -> list[UsbDevice]:
    """Every device with these ids on the bus of `backend`; None is libusb's.

    Raises `NoBackendError` where libusb is missing.
    """
    try:
        found = usb.core.find(find_all=True, backend=backend, idVendor=vendor, idProduct=product)  # pyright: ignore[reportUnknownMemberType]  # untyped parameters
        return cast("list[UsbDevice]", list(found))  # pyright: ignore[reportArgumentType]  # find_all=True gives an iterator
    except usb.core.NoBackendError as error:
        raise NoBackendError(_NO_LIBUSB) from error


def libusb_backend() -> Backend:
    """pyusb's backend of libusb: real USB. Raises `NoBackendError` where libusb is missing."""
    backend = usb.backend.libusb1.get_backend()  # pyright: ignore[reportUnknownMemberType]  # untyped parameters
    if backend is None:
        raise NoBackendError(_NO_LIBUSB)
    return cast("Backend", backend)


def claim(device: UsbDevice, interface: int) -> None:
    """Claim an interface of an opened device."""
    usb.util.claim_interface(device, interface)  # pyright: ignore[reportUnknownMemberType]  # untyped parameters


def dispose(device: UsbDevice) -> None:
    """Release the interfaces of a device and close it."""
    usb.util.dispose_resources(device)  # pyright: ignore[reportUnknownMemberType]  # untyped parameters


def configure(device: UsbDevice) -> None:
    """Configure the device unless it is: doing it again would fail while another player has claimed it."""
    try:
        device.get_active_configuration()
    except UsbError as error:
        if error.errno is not None:  # pyusb's own "not set" has no errno
            raise
        device.set_configuration()
