"""Model of the fictional board `emulator`, written from docs/formats/emulator.md alone: bytes in, frames played.

It shares no code with the codec or the array model, so that a mistake in one of them shows.
"""

from __future__ import annotations

import struct
import threading
from collections import deque
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...clock import Clock
from ...emulation.peripheral import Descriptors, Peripheral

FRAME_BYTES = 512
FIFO_FRAMES = 2048
CARRIER_PERIOD_NS = 25_000
"""One period of 40 kHz [ns]."""
DIVIDER_MAX = 255

_FIFO_BYTES = FIFO_FRAMES * FRAME_BYTES
_STATUS = struct.Struct("<QQQIHBB")
_OFF = bytes(FRAME_BYTES)

T = TypeVar("T")


class Board:
    """The board: a FIFO, a frame clock, and the frame that is playing.

    Nothing runs in the background. Every call first plays the frames that are due by the clock, so the level of the
    FIFO is exact at each call, and idle time costs nothing. Calls may come from several threads.

    Args:
        clock: what the frame clock is derived from.
        record: how many of the last played frames to keep, for tests; each is kept once, however long it held.
    """

    def __init__(self, clock: Clock, *, record: int = 0) -> None:
        self.clock = clock
        self._lock = threading.Lock()
        self._fifo = bytearray(_FIFO_BYTES)
        self._received = 0  # bytes since power-up; FIFO slot of a byte is its number modulo the FIFO's size
        self._taken = 0  # bytes that left the FIFO, played or cleared: always whole frames
        self._playing = _OFF
        self._divider = 4
        self._ticks_from_ns = clock.now_ns()
        self._ticks = 0
        self._frames_played = 0
        self._underruns = 0
        self._starved_periods = 0
        self._starving = False
        self._record: deque[tuple[bytes, int]] = deque(maxlen=record)

    def accept(self, data: memoryview, *, since_ns: int | None = None) -> int:
        """Take as many of the bytes as the FIFO has room for; returns their count.

        How long they have been on the bus makes no difference: the FIFO is deep enough for a host that looks up late.
        """
        with self._lock:
            self._play_due()
            count = min(len(data), _FIFO_BYTES - (self._received - self._taken))
            slot = self._received % _FIFO_BYTES
            first = min(count, _FIFO_BYTES - slot)
            self._fifo[slot : slot + first] = data[:first]
            self._fifo[: count - first] = data[first:count]
            self._received += count
            return count

    def room_at_ns(self, byte_count: int) -> int:
        """Time [ns] at which the FIFO will have room for that many bytes; if they are too many, will be half empty."""
        with self._lock:
            self._play_due()
            missing = byte_count - (_FIFO_BYTES - (self._received - self._taken))
            frames = min(-(-missing // FRAME_BYTES), -(-self._queued_frames() // 2))
            return self._ticks_from_ns + (self._ticks + max(frames, 0)) * self._period_ns()

    def set_divider(self, divider: int) -> bool:
        """Set the divider of the carrier; False (a stall) outside 1..255. The frame clock starts anew."""
        if not 1 <= divider <= DIVIDER_MAX:
            return False
        with self._lock:
            self._play_due()
            self._divider = divider
            self._ticks_from_ns = self.clock.now_ns()
            self._ticks = 0
        return True

    def clear(self) -> None:
        """Drop the whole frames that are queued; a torn one stays and waits for its rest."""
        with self._lock:
            self._play_due()
            self._taken += self._queued_frames() * FRAME_BYTES

    def power_off(self) -> None:
        """Lose the power: silent at once, everything queued is gone."""
        with self._lock:
            self._play_due()
            self._taken = self._received
            self._playing = _OFF

    def status(self) -> bytes:
        """The 32 bytes of the status request."""
        with self._lock:
            self._play_due()
            return _STATUS.pack(
                self._frames_played,
                self._underruns,
                self._starved_periods,
                self._queued_frames(),
                (self._received - self._taken) % FRAME_BYTES,
                max(self._playing[1::2]),
                self._divider,
            )

    @property
    def bytes_received(self) -> int:
        """Bytes taken from the bus since power-up."""
        return self._received

    @property
    def frames_played(self) -> int:
        """Frames played since power-up."""
        return self._look(lambda: self._frames_played)

    @property
    def underruns(self) -> int:
        """Underruns since power-up."""
        return self._look(lambda: self._underruns)

    @property
    def emitting(self) -> bool:
        """Whether the frame that is playing drives any transducer."""
        return self._look(lambda: any(self._playing[1::2]))

    @property
    def playing(self) -> NDArray[np.uint8]:
        """The frame that is playing now, shape [512]."""
        with self._lock:
            self._play_due()
            return np.frombuffer(self._playing, np.uint8)

    @property
    def played(self) -> NDArray[np.uint8]:
        """The frames played so far, the last `record` of them, oldest first, shape [frame, 512]."""
        with self._lock:
            self._play_due()
            return np.frombuffer(b"".join(frame for frame, _ in self._record), np.uint8).reshape(-1, FRAME_BYTES)

    @property
    def played_ns(self) -> NDArray[np.int64]:
        """When each of `played` began, by the board's clock [ns], shape [frame]."""
        return self._look(lambda: np.array([began for _, began in self._record], np.int64))

    def began_ns(self, number: int) -> int | None:
        """When a frame began, by the board's clock [ns]; `number` counts from power-up, 0 for the first one played.

        None before it is played, and for one that is no longer recorded.
        """
        with self._lock:
            self._play_due()
            place = number - self._frames_played
            return self._record[place][1] if -len(self._record) <= place < 0 else None

    def _look(self, what: Callable[[], T]) -> T:
        with self._lock:
            self._play_due()
            return what()

    def _period_ns(self) -> int:
        return self._divider * CARRIER_PERIOD_NS

    def _queued_frames(self) -> int:
        return (self._received - self._taken) // FRAME_BYTES

    def _play_due(self) -> None:
        """Catch up with the clock: at each tick the next frame, or the last one again."""
        ticks = (self.clock.now_ns() - self._ticks_from_ns) // self._period_ns()
        due = ticks - self._ticks
        frames = min(due, self._queued_frames())
        if frames:
            self._play(frames)
        self._ticks = ticks
        # Frames only arrive between calls, so the periods without one are the last of those due.
        held = due - frames
        if held and any(self._playing[1::2]):
            self._starved_periods += held
            self._underruns += not self._starving
            self._starving = True

    def _play(self, frames: int) -> None:
        keep = min(frames, self._record.maxlen or 0)
        for number in range(frames - max(keep, 1), frames):
            slot = (self._taken + number * FRAME_BYTES) % _FIFO_BYTES
            self._playing = bytes(self._fifo[slot : slot + FRAME_BYTES])
            self._record.append((self._playing, self._ticks_from_ns + (self._ticks + number + 1) * self._period_ns()))
        self._taken += frames * FRAME_BYTES
        self._frames_played += frames
        self._starving = False


VENDOR, PRODUCT = 0x1209, 0x0001  # pid.codes' shared product id for tests
MANUFACTURER_STRING, PRODUCT_STRING = "palpate", "emulated 256-transducer array"
BULK_OUT = 0x01

_OUT, _IN = 0x40, 0xC0
_SET_DIVIDER, _GET_STATUS, _CLEAR = 0x01, 0x02, 0x03


class EmulatorUsb(Peripheral[Board]):
    """The USB side of the board `emulator`, as docs/formats/emulator.md has it."""

    def __init__(self, serial: str, board: Board) -> None:
        descriptors = Descriptors(
            VENDOR, PRODUCT, MANUFACTURER_STRING, PRODUCT_STRING, serial, (BULK_OUT,), 512, device_class=0xFF
        )
        super().__init__(descriptors, board)

    def request(self, kind: int, request: int, value: int, index: int) -> bytes | None:
        """Answer a vendor request; None is a stall."""
        if (kind, request) == (_OUT, _SET_DIVIDER):
            return b"" if self.board.set_divider(value) else None
        if (kind, request) == (_OUT, _CLEAR):
            self.board.clear()
            return b""
        return self.board.status() if (kind, request) == (_IN, _GET_STATUS) else None
