"""Models of the FTDI chips in front of real boards: vendor requests, the bytes in the chip, status packets.

Written from what is published about the chips (docs/emulator.md lists it); they share no code with the drivers.
"""

from __future__ import annotations

import struct

from .clock import Clock
from .pat_board import PatBoard
from .peripheral import BoardT, Descriptors, Peripheral
from .sonic_board import SonicBoard

VENDOR = 0x0403
FT232H_PRODUCT, FT232R_PRODUCT = 0x6014, 0x6001
BULK_IN, BULK_OUT = 0x81, 0x02

FT232H_CHIP_BYTES = 1024
"""Bytes to the board that the chip holds."""
FT232H_BYTE_RATE = 8e6
"""Bytes a second that the chip passes on as an asynchronous FIFO [B/s]: some 15,600 frames of a PAT board."""
FT232R_CHIP_BYTES = 128
"""Bytes to the UART that the chip holds."""
FT232R_CLOCK = 3e6
"""Bits a second that the divisor divides [Bd]."""

EEPROM_BYTES = 256
"""Size of an FT232H's EEPROM, as far as it is used."""
EEPROM_FIFO = struct.pack("<HHHH", 0x0001, VENDOR, FT232H_PRODUCT, 0x0900).ljust(EEPROM_BYTES, b"\0")
"""An EEPROM that sets an FT232H to its asynchronous FIFO mode: mode, ids and release; the strings are left out."""
EEPROM_BLANK = b"\xff" * EEPROM_BYTES
"""An erased EEPROM, and what is read where there is none."""

_INTERFACE_CLASS = (0xFF, 0xFF, 0xFF)
_OUT, _IN = 0x40, 0xC0
_RESET, _MODEM, _FLOW, _BAUD, _LINE = 0x00, 0x01, 0x02, 0x03, 0x04
_MODEM_STATUS, _SET_LATENCY, _GET_LATENCY, _BIT_MODE = 0x05, 0x09, 0x0A, 0x0B
_READ_EEPROM = 0x90
_FIFO_MODE = 1  # in the lower four bits of the EEPROM's first byte
_PURGE_RX, _PURGE_TX = 1, 2
_STATUS = b"\x01\x60"  # no modem signal is high; the transmitter is empty
_LATENCY_MS = 16  # after power-up
_EIGHTHS = (0, 4, 2, 1, 3, 5, 6, 7)  # of the divisor, by its three bits above the lower 14
_LOOK_AGAIN_NS = 1_000_000


class _FtdiChip(Peripheral[BoardT]):
    """What both chips have. A request for another port than the only one stalls, and so does an unknown one."""

    def __init__(self, descriptors: Descriptors, board: BoardT, clock: Clock) -> None:
        super().__init__(descriptors, board)
        self.bit_mode = 0
        """Mode that was set last; 0 is the chip's own."""
        self.latency_ms = _LATENCY_MS
        """After which time a status packet is sent without data [ms]."""
        self._clock = clock
        self._purged = 0

    def packet_in(self) -> tuple[int, bytes] | None:
        """Two status bytes, each time the latency timer is over: the boards send nothing."""
        return self._clock.now_ns() + self.latency_ms * 1_000_000, _STATUS

    def request(self, kind: int, request: int, value: int, index: int) -> bytes | None:
        """Answer a vendor request; None is a stall."""
        if request != _BAUD and index & 0xFF > 1:
            return None
        if kind == _IN:
            return {_MODEM_STATUS: _STATUS, _GET_LATENCY: bytes((self.latency_ms,))}.get(request)
        if kind != _OUT:
            return None
        return b"" if self._command(request, value, index) else None

    def _command(self, request: int, value: int, index: int) -> bool:
        """Obey a request out; False is a stall."""
        if request == _RESET and value in (0, _PURGE_RX, _PURGE_TX):
            self._reset(value)
        elif request == _SET_LATENCY and 1 <= value <= 255:
            self.latency_ms = value
        elif request == _BIT_MODE:
            self._set_bit_mode(value >> 8)
        elif request == _FLOW:
            self._set_flow(index >> 8)
        elif request == _BAUD:
            self._set_baud(value, index)
        elif request == _LINE:
            self._set_line(value)
        else:
            return request == _MODEM
        return True

    def _reset(self, value: int) -> None:
        # Drivers differ in which of the two purges empties which way: only both are sure to, and so it is here.
        self._purged = (self._purged | value) if value else 0
        if self._purged == _PURGE_RX | _PURGE_TX:
            self._purged = 0
            self._purge()

    def _purge(self) -> None: ...

    def _set_bit_mode(self, mode: int) -> None:
        self.bit_mode = mode

    def _set_flow(self, flow: int) -> None: ...

    def _set_baud(self, value: int, index: int) -> None: ...

    def _set_line(self, value: int) -> None: ...


class Ft232h(_FtdiChip[PatBoard]):
    """An FT232H in front of a PAT board, which reads from it while it is a FIFO of 8 bits.

    In another bit mode it takes nothing. As a UART, which a blank EEPROM makes of it, it takes all and the board reads
    nothing.
    """

    def __init__(self, clock: Clock, serial: str, board: PatBoard, *, eeprom: bytes = EEPROM_FIFO) -> None:
        descriptors = Descriptors(
            VENDOR, FT232H_PRODUCT, "FTDI", "Single RS232-HS", serial, (BULK_IN, BULK_OUT), 512,
            release=0x0900, configuration=1, kernel_driver=True, interface_class=_INTERFACE_CLASS,
        )  # fmt: skip
        super().__init__(descriptors, board, clock)
        self.eeprom = eeprom
        """Content of its EEPROM, 256 bytes."""

    def request(self, kind: int, request: int, value: int, index: int) -> bytes | None:
        """Answer a vendor request; None is a stall. A word of the EEPROM is asked for by its number."""
        if (kind, request) == (_IN, _READ_EEPROM):
            return self.eeprom[2 * index : 2 * index + 2] or None
        return super().request(kind, request, value, index)

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

    def _purge(self) -> None:
        self.board.purge_chip()


class Ft232r(_FtdiChip[SonicBoard]):
    """An FT232R as a UART in front of a SonicSurface. In another bit mode nothing is sent on its line."""

    def __init__(self, clock: Clock, serial: str, board: SonicBoard) -> None:
        descriptors = Descriptors(
            VENDOR, FT232R_PRODUCT, "FTDI", "FT232R USB UART", serial, (BULK_IN, BULK_OUT), 64,
            release=0x0600, speed=2, configuration=1, kernel_driver=True, interface_class=_INTERFACE_CLASS,
        )  # fmt: skip
        super().__init__(descriptors, board, clock)
        self.baud = 9600.0
        """Bits a second on the line [Bd]."""
        self._line = 0x0008  # eight data bits, no parity, one stop bit
        self._flow = 0
        self._update_line()

    def _purge(self) -> None:
        self.board.purge_chip()

    def _set_bit_mode(self, mode: int) -> None:
        super()._set_bit_mode(mode)
        self._update_line()

    def _set_flow(self, flow: int) -> None:
        self._flow = flow
        self._update_line()

    def _set_baud(self, value: int, index: int) -> None:
        self.baud = divided_baud(value, index)
        self._update_line()

    def _set_line(self, value: int) -> None:
        self._line = value
        self._update_line()

    def _update_line(self) -> None:
        data_bits, parity, stop, is_break = (
            self._line & 0xFF,
            self._line >> 8 & 7,
            self._line >> 11 & 3,
            self._line >> 14,
        )
        bit_count = 1 + data_bits + (parity > 0) + (1.0, 1.5, 2.0, 2.0)[stop]
        self.board.set_line(self.baud, bit_count=bit_count, eight_bits=(data_bits, parity, is_break) == (8, 0, 0))
        # The board drives neither CTS nor DSR; XON/XOFF (4) waits for nothing until an XOFF comes.
        self.board.hold_line(bool(self._flow & 3) or self.bit_mode != 0)


def divided_baud(value: int, index: int) -> float:
    """Bits a second [Bd] that an FT232R makes of the request's wValue and wIndex.

    The lower 14 bits are the divisor's whole part, the two above and bit 0 of wIndex its eighths. Whole parts 0 and 1
    are 3 MBd and 2 MBd, whatever the eighths.
    """
    whole = value & 0x3FFF
    if whole < 2:
        return (FT232R_CLOCK, FT232R_CLOCK / 1.5)[whole]
    return FT232R_CLOCK / (whole + _EIGHTHS[value >> 14 | (index & 1) << 2] / 8)
