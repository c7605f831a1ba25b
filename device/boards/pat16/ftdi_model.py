"""Model of the FTDI chip in front of a PAT board: vendor requests, the bytes in the chip, status packets.

Written from what is published about the chip (docs/formats/emulator.md lists it); it shares no code with the driver.
"""

from __future__ import annotations

import struct

from ...clock import Clock
from ...emulation.peripheral import Descriptors, Peripheral
from .model import PatBoard

VENDOR = 0x0403
FT232H_PRODUCT = 0x6014
BULK_IN, BULK_OUT = 0x81, 0x02

FT232H_CHIP_BYTES = 1024
"""Bytes to the board that the chip holds."""
FT232H_BYTE_RATE = 8e6
"""Bytes a second that the chip passes on as an asynchronous FIFO [B/s]: some 15,600 frames of a PAT board."""
EEPROM_BYTES = 256
"""Size of an FT232H's EEPROM, as far as it is used."""
EEPROM_FIFO = struct.pack("<HHHH", 0x0001, VENDOR, FT232H_PRODUCT, 0x0900).ljust(EEPROM_BYTES, b"\0")
"""An EEPROM that sets an FT232H to its asynchronous FIFO mode: mode, ids and release; the strings are left out."""
EEPROM_BLANK = b"\xff" * EEPROM_BYTES
"""An erased EEPROM, and what is read where there is none."""

_INTERFACE_CLASS = (0xFF, 0xFF, 0xFF)
_OUT, _IN = 0x40, 0xC0
_RESET, _MODEM, _FLOW, _BAUD, _LINE = 0x00, 0x01, 0x02, 0x03, 0x04
_OF_A_UART = (_MODEM, _FLOW, _BAUD, _LINE)  # without effect on a FIFO
_MODEM_STATUS, _SET_LATENCY, _GET_LATENCY, _BIT_MODE = 0x05, 0x09, 0x0A, 0x0B
_READ_EEPROM = 0x90
_FIFO_MODE = 1  # in the lower four bits of the EEPROM's first byte
_PURGE_RX, _PURGE_TX = 1, 2
_STATUS = b"\x01\x60"  # no modem signal is high; the transmitter is empty
_LATENCY_MS = 16  # after power-up
_LOOK_AGAIN_NS = 1_000_000


class Ft232h(Peripheral[PatBoard]):
    """An FT232H in front of a PAT board, which reads from it while it is a FIFO of 8 bits.

    In another bit mode it takes nothing. As a UART, which a blank EEPROM makes of it, it takes all and the board reads
    nothing. A request for another port than the only one stalls, and so does an unknown one.
    """

    def __init__(self, clock: Clock, serial: str, board: PatBoard, *, eeprom: bytes = EEPROM_FIFO) -> None:
        descriptors = Descriptors(
            VENDOR, FT232H_PRODUCT, "FTDI", "Single RS232-HS", serial, (BULK_IN, BULK_OUT), 512,
            release=0x0900, configuration=1, kernel_driver=True, interface_class=_INTERFACE_CLASS,
        )  # fmt: skip
        super().__init__(descriptors, board)
        self.eeprom = eeprom
        """Content of its EEPROM, 256 bytes."""
        self.bit_mode = 0
        """Mode that was set last; 0 is the chip's own."""
        self.latency_ms = _LATENCY_MS
        """After which time a status packet is sent without data [ms]."""
        self._clock = clock
        self._purged = 0

    def accept(self, data: memoryview, *, since_ns: int | None = None) -> int:
        """Bulk OUT; takes nothing in a bit mode that the board cannot read in, and all of it as a UART."""
        if self.bit_mode:
            return 0
        if self.eeprom[0] & 0x0F != _FIFO_MODE:
            return len(data)
        return super().accept(data, since_ns=since_ns)

    def room_at_ns(self, byte_count: int) -> int:
        """When bulk OUT has room; in another bit mode, when to look again."""
        return self._clock.now_ns() + _LOOK_AGAIN_NS if self.bit_mode else super().room_at_ns(byte_count)

    def packet_in(self) -> tuple[int, bytes] | None:
        """Two status bytes, each time the latency timer is over: the board sends nothing."""
        return self._clock.now_ns() + self.latency_ms * 1_000_000, _STATUS

    def request(self, kind: int, request: int, value: int, index: int) -> bytes | None:
        """Answer a vendor request; None is a stall. A word of the EEPROM is asked for by its number."""
        if (kind, request) == (_IN, _READ_EEPROM):
            return self.eeprom[2 * index : 2 * index + 2] or None
        if request != _BAUD and index & 0xFF > 1:
            return None
        if kind == _IN:
            return {_MODEM_STATUS: _STATUS, _GET_LATENCY: bytes((self.latency_ms,))}.get(request)
        if kind != _OUT:
            return None
        return b"" if self._command(request, value) else None

    def _command(self, request: int, value: int) -> bool:
        """Obey a request out; False is a stall."""
        if request == _RESET and value in (0, _PURGE_RX, _PURGE_TX):
            self._reset(value)
        elif request == _SET_LATENCY and 1 <= value <= 255:
            self.latency_ms = value
        elif request == _BIT_MODE:
            self.bit_mode = value >> 8
        else:
            return request in _OF_A_UART
        return True

    def _reset(self, value: int) -> None:
        # Drivers differ in which of the two purges empties which way: only both are sure to, and so it is here.
        self._purged = (self._purged | value) if value else 0
        if self._purged == _PURGE_RX | _PURGE_TX:
            self._purged = 0
            self.board.purge_chip()
