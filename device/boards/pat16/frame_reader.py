"""Model of the part of the PAT board's gateware that makes frames of bytes.

Written from the published source (RMResearch/OpenMPD_Hardware, FPGA_3.4.2/src/CommandReader.vhd), whose states the
comments name. It shares no code with the codec, the link or the array model.
"""

from __future__ import annotations

import re

FRAME_BYTES = 512

_START = re.compile(rb"[\x80-\xff]")
_DIVIDER = slice(26, 34)  # the divider's bits are the MSBs of these bytes, lowest first
_DIVIDER_LOAD = 34
_LED = slice(1, 25)
_LED_LOAD = 25


class CommandReader:
    """The part of the gateware that makes frames of bytes: it sees blocks, and knows nothing of time.

    A frame may straddle blocks. Frames that fill blocks exactly lose nothing; a frame that ends inside a block costs
    the byte behind it, since the gateware does not look at its input while it swaps the frame in.
    """

    def __init__(self) -> None:
        self.divider = 4
        """Carrier periods of a block, 1..256."""
        self.led: int | None = None
        """The 24 bits that were last loaded into the LED, bit n from byte 1 + n; None before any were."""
        self.bytes_skipped = 0
        """Bytes without MSB that were skipped in search of a frame's start."""
        self.bytes_lost = 0
        """Bytes that were not looked at, because they came while a frame was swapped in."""
        self._frame = bytearray()  # what has been read of the frame under way; empty in state GSPATIdle

    @property
    def torn_bytes(self) -> int:
        """Bytes that have been read of a frame that is not complete."""
        return len(self._frame)

    def read(self, block: bytes) -> bytes | None:
        """Read a block; returns the frame that is complete with it, if one is: 512 bytes cannot complete two."""
        complete = None
        place = 0
        while place < len(block):
            if not self._frame:  # GSPATIdle
                start = _START.search(block, place)
                begin = start.start() if start else len(block)
                self.bytes_skipped += begin - place
                place = begin
            held = len(self._frame)  # GSPATReadPhases, GSPATReadAmplitudes
            self._frame += block[place : place + FRAME_BYTES - held]
            place += len(self._frame) - held
            if held <= _DIVIDER_LOAD < len(self._frame) and self._frame[_DIVIDER_LOAD] & 0x80:
                # The gateware compares a counter of 8 bits with the divider less 1, so 0 is 256.
                self.divider = _most_significant_bits(self._frame[_DIVIDER]) or 256
            if len(self._frame) == FRAME_BYTES:  # GSPATDataSwap: one clock, at which a byte of the same block is lost
                complete = self._swap()
                self.bytes_lost += place < len(block)
                place += 1
        return complete

    def _swap(self) -> bytes:
        frame = bytes(self._frame)
        self._frame.clear()
        if frame[_LED_LOAD] & 0x80:
            self.led = _most_significant_bits(frame[_LED])
        return frame


def _most_significant_bits(data: bytes | bytearray) -> int:
    return sum((byte >> 7) << place for place, byte in enumerate(data))
