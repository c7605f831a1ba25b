"""An FT232H over plain pyusb: opening it, and the requests that set it up. Facts of FTDI's application notes.

Requests go to the device with bmRequestType 0x40, wIndex the port, which is 1 for the first one.
"""

from __future__ import annotations

import contextlib
import errno
import warnings
from collections.abc import Mapping
from typing import Final, Self, cast

from ...array import ArrayModel
from ...errors import LinkError, link_error
from ...transports.lookup import DriverDevice, driver_is_bound, find_device
from ...transports.pyusb import Backend, UsbDevice, UsbError, claim, configure, dispose

BULK_OUT: Final = 0x02
"""Endpoint of the bytes to the board."""

_VENDOR_OUT, _VENDOR_IN = 0x40, 0xC0
_RESET, _LATENCY, _BITMODE = 0x00, 0x09, 0x0B
_READ_EEPROM = 0x90  # wIndex is the number of a word of two bytes, low byte first
_RESET_ALL, _PURGE_RX, _PURGE_TX = 0, 1, 2
_PORT = 1
_TIMEOUT_MS = 500

# The lower four bits of an FT232H's first EEPROM byte say what its pins are after a reset.
_FIFO_MODE, _BLANK = 1, 0xFFFF
_MODES: Final[Mapping[int, str]] = {0: "UART", 2: "fast serial (opto)", 4: "CPU FIFO", 8: "FT1248"}


class FtdiPort:
    """An opened FTDI chip. Made by `FtdiPort.open`; every failure is a `LinkError`.

    Args:
        device: pyusb's device, claimed.
        serial: its serial number.
        who: name and serial number of the array, for messages.
        detached: whether a driver of the operating system was detached, and is to be given it back.
    """

    def __init__(self, device: UsbDevice, serial: str | None, *, who: str, detached: bool) -> None:
        self.device = device
        self.serial = serial
        self.who = who
        self.detached = detached

    @classmethod
    def open(cls, model: ArrayModel, *, serial: str | None = None, backend: Backend | None = None) -> Self:
        """Find the chip of an array, take it from the operating system's driver, configure and claim it.

        Raises DeviceNotFoundError, DeviceBusyError, DevicePermissionError, NoBackendError as `find_device` does.
        """
        device, found = find_device(model, serial, backend)
        port = cls(device, found, who=f"{model.name} {found}" if found else model.name, detached=False)
        try:
            if driver_is_bound(device):
                cast("DriverDevice", device).detach_kernel_driver(0)
                port.detached = True
            configure(device)
            claim(device, 0)
        except UsbError as error:
            port.close()
            raise link_error(port.who, error.errno, error) from error
        return port

    def close(self) -> None:
        """Let go of the chip and give it back to the driver that had it; nothing happens if it is gone."""
        dispose(self.device)
        if self.detached:
            self.detached = False
            with contextlib.suppress(UsbError, NotImplementedError, ValueError):  # it is gone, or another has it
                cast("DriverDevice", self.device).attach_kernel_driver(0)
            dispose(self.device)

    def reset(self) -> None:
        """Reset the chip's UART or FIFO engine."""
        self._request(_RESET, _RESET_ALL)

    def purge(self) -> None:
        """Drop what the chip holds in both directions."""
        self._request(_RESET, _PURGE_RX)
        self._request(_RESET, _PURGE_TX)

    def reset_bitmode(self) -> None:
        """Go back to the mode that the chip's EEPROM says, with all pins outputs."""
        self._request(_BITMODE, 0x00FF)  # mode 0 in the high byte, pins in the low one

    def require_fifo_mode(self) -> None:
        """Make sure that the EEPROM of an FT232H sets it to its asynchronous FIFO mode, which a pat16 reads from.

        A chip in another mode takes the same bytes without an error, and none of them reaches the board. A blank
        EEPROM, or none, leaves the chip a UART, so it is refused as well. A chip that does not answer the request may
        still be in FIFO mode, and in another mode the board stays as it is: so that is a warning only.

        Raises:
            LinkError: the EEPROM is blank, or says another mode; the message says how to set it. Or the chip is gone.
        """
        try:
            reply = self.device.ctrl_transfer(_VENDOR_IN, _READ_EEPROM, 0, 0, 2, _TIMEOUT_MS)
        except UsbError as error:
            if error.errno not in (errno.EPIPE, errno.ETIMEDOUT):
                raise link_error(self.who, error.errno, error) from error
            reply = 0
        if isinstance(reply, int) or len(reply) != 2:
            text = f"array {self.who} may be silent: its FT232H does not give its EEPROM, so its mode is not known"
            warnings.warn(text, RuntimeWarning, stacklevel=3)
            return
        word = reply[0] | reply[1] << 8
        mode = word & 0x0F
        if word != _BLANK and mode == _FIFO_MODE:
            return
        said = "is blank or missing, which makes it a UART"
        if word != _BLANK:
            said = f"sets it to {_MODES.get(mode, f'mode {mode}, which is none of its modes')}"
        raise LinkError(
            f"array {self.who} cannot be reached: the EEPROM of its FT232H {said}, but the board reads from it as a "
            "245 FIFO. Set it with FTDI's FT_PROG (hardware: 245 FIFO) or libftdi's ftdi_eeprom (cha_type=FIFO), "
            "then unplug it and plug it in. Line 1 of its board file must have the serial number that it has afterwards"
        )

    def set_latency(self, milliseconds: int) -> None:
        """Time after which the chip sends a packet to the host that is not full, 1..255 ms."""
        self._request(_LATENCY, milliseconds)

    def _request(self, request: int, value: int) -> None:
        try:
            self.device.ctrl_transfer(_VENDOR_OUT, request, value, _PORT, None, _TIMEOUT_MS)
        except UsbError as error:
            raise link_error(self.who, error.errno, error) from error
