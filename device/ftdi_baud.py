"""Baud rates of FTDI's UARTs: which divisor a chip takes, and what rate it then has. Facts of FTDI's data sheets.

A chip divides its clock by n + k / 8. Eight codes tell k; the 17 bits of n and code travel in wValue and wIndex.

| chip | clock | wIndex |
|---|---|---|
| FT232R | 3 MHz | bit 16 of the code |
| FT230X | 3 MHz | bits 16.. in the high byte, port 1 in the low byte |
| FT232H | 12 MHz, told by bit 17; 3 MHz below 1200 Bd | as FT230X |
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from .errors import UpdateRateError

BAUD_TOLERANCE = 0.03
"""Largest error of a rate: a byte of 10 bits is read right up to about 5 %, and the board has an error of its own."""

_EIGHTH_CODE = (0, 3, 2, 4, 1, 5, 6, 7)  # of k = 0..7
_CLOCK, _CLOCK_HIGH = 3_000_000, 12_000_000
_CLOCK_HIGH_BIT = 1 << 17
_HIGH_FROM = 1200
_PORT_A = 1
_DIVISOR_BITS = 14


class FtdiChip(Enum):
    """Chips with one port, by the release number that their device descriptor has."""

    FT232R = 0x0600
    FT232H = 0x0900
    FT230X = 0x1000


@dataclass(frozen=True)
class BaudSetting:
    """What sets a baud rate."""

    value: int
    """wValue of the request."""
    index: int
    """wIndex of the request."""
    baud: float
    """The rate that the chip then has [Bd]."""


def baud_setting(baud: int, chip: FtdiChip) -> BaudSetting:
    """The nearest rate to `baud` [Bd] that the chip has; raises `UpdateRateError` if that is over 3 % off."""
    high = chip is FtdiChip.FT232H and baud >= _HIGH_FROM
    clock = _CLOCK_HIGH if high else _CLOCK
    if not clock >> _DIVISOR_BITS < baud <= clock:
        raise UpdateRateError(f"{baud} Bd is outside {(clock >> _DIVISOR_BITS) + 1}..{clock} Bd of an {chip.name}")
    eighths = round(8 * clock / baud)
    if eighths < 16:  # below 2 there are only 1 and 1.5, with codes of their own
        eighths = 8 if eighths < 10 else 12 if eighths < 14 else 16
    actual = 8 * clock / eighths
    if abs(actual - baud) > BAUD_TOLERANCE * baud:
        raise UpdateRateError(f"{baud} Bd cannot be had of an {chip.name}: the nearest is {actual:.0f} Bd")
    code = {8: 0, 12: 1}.get(eighths, eighths >> 3 | _EIGHTH_CODE[eighths & 7] << _DIVISOR_BITS)
    if high:
        code |= _CLOCK_HIGH_BIT
    index = code >> 16
    if chip is not FtdiChip.FT232R:
        index = index << 8 | _PORT_A
    return BaudSetting(code & 0xFFFF, index, actual)
