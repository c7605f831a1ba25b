"""Model of a SonicSurface board: UART bytes in, half-period pulses on 256 transducers.

Written from the board's published VHDL (docs/formats/emulator.md lists it), with which
tests/device/boards/test_sonic_gateware.py compares it. It shares no code with codec or the array model, so that a
mistake in one of them shows.
"""

from __future__ import annotations

import random
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...clock import Clock
from ...emulation.serial_bus import EmulatedPorts

TRANSDUCER_COUNT = 256
BAUD = 10.24e6 / 45
"""Bits a second that the board samples at, as its firmware is published [Bd]."""
BAUD_SLOWEST, BAUD_FASTEST = 0.967, 1.047
"""Slowest and fastest sender that is read without error, relative to `BAUD`: -4.5 and +3.4 % of 230400 Bd."""
COUNTS = 32
"""Steps of a carrier period: unit of delay; this value itself is off."""

_START, _SWAP = 0xFE, 0xFD
_CLOCKS_OFF, _CLOCKS_ON = 0x96, 0x97
_PRIMARY, _SECONDARY = 0xC0, 0xC1
_OFF = bytes((COUNTS,)) * TRANSDUCER_COUNT
_BITS_PER_BYTE = 10

T = TypeVar("T")


class SonicBoard:
    """The board and the UART line to it: a double buffer, swapped on command. It never answers.

    At power-up both buffers hold delay 0, so all transducers emit in phase until two off frames have come. Nothing runs
    in the background: every call first does what is due by the clock. Calls may come from several threads.

    Args:
        clock: what the bits are timed by.
        record: how many of the last played patterns to keep, for tests.
        baud: bits a second that the board samples at [Bd].
        chip_bytes: bytes that what sends them on the line holds: adapter and driver.
        secondary: whether it has the firmware of the secondary board of two on one line, which 0xC1 selects.
    """

    def __init__(
        self, clock: Clock, *, record: int = 0, baud: float = BAUD, chip_bytes: int = 128, secondary: bool = False
    ) -> None:
        self.clock = clock
        self.baud = baud
        self._lock = threading.Lock()
        self._room = chip_bytes
        self._powered = True
        # the line: bytes leave back to back from the start of a run
        self._queue = bytearray()
        self._received = 0
        self._byte_ns = _BITS_PER_BYTE * 1e9 / baud
        self._readable = True
        self._run_ns = float(clock.now_ns())
        self._run_bytes = 0
        self._noise = random.Random(0)
        # the board
        self._own = _SECONDARY if secondary else _PRIMARY
        self._front = bytearray(TRANSDUCER_COUNT)
        self._back = bytearray(TRANSDUCER_COUNT)
        self._count = 0  # data since the last start or swap: the next one's place
        self._started = False  # whether a start came since the last swap
        self._selected = True  # of two boards on a line both, until a byte selects one
        self._clocks_on = True
        self._swaps = 0
        self._bytes_ignored = 0
        self._bytes_stray = 0
        self._bytes_strange = 0
        self._bytes_garbled = 0
        self._record: deque[tuple[bytes, int]] = deque(maxlen=record)

    def set_line(self, baud: float) -> None:
        """Bits a second that the sender sends [Bd]: eight data bits, no parity, one stop bit."""
        with self._lock:
            self._run_until(self.clock.now_ns())
            self._byte_ns = _BITS_PER_BYTE * 1e9 / baud
            self._readable = BAUD_SLOWEST <= baud / self.baud <= BAUD_FASTEST
            self._begin_run(self.clock.now_ns())

    def accept(self, data: memoryview) -> int:
        """Take as many of the bytes as there is room for; returns their count."""
        with self._lock:
            now_ns = self.clock.now_ns()
            self._run_until(now_ns)
            if not self._powered:
                return 0
            if not self._queue:
                self._begin_run(max(now_ns, self._sent_at_ns(self._run_bytes)))
            count = min(len(data), self._room - len(self._queue))
            self._queue += data[:count]
            self._received += count
            return count

    @property
    def queued(self) -> int:
        """Bytes taken that have not been sent on the line."""
        return self._look(lambda: len(self._queue))

    def drop_queued(self, keep: int) -> None:
        """Drop the bytes that have not been sent on the line yet, all but the first `keep`."""
        with self._lock:
            self._run_until(self.clock.now_ns())
            self._received -= max(len(self._queue) - keep, 0)
            del self._queue[keep:]

    def power_off(self) -> None:
        """Lose the power: silent at once, everything queued is gone."""
        with self._lock:
            self._run_until(self.clock.now_ns())
            self._powered = False
            self._queue.clear()
            self._front[:] = self._back[:] = _OFF

    @property
    def bytes_received(self) -> int:
        """Bytes taken since power-up, those that have not been sent on the line too; without those dropped."""
        return self._received

    @property
    def bytes_ignored(self) -> int:
        """Starts and data that came while the other board of the line was selected."""
        return self._look(lambda: self._bytes_ignored)

    @property
    def bytes_stray(self) -> int:
        """Data bytes that no start preceded, or after the 256th: they overwrite places from place 0 on."""
        return self._look(lambda: self._bytes_stray)

    @property
    def bytes_strange(self) -> int:
        """Data bytes above 32, each of which is played as its value modulo 32."""
        return self._look(lambda: self._bytes_strange)

    @property
    def bytes_garbled(self) -> int:
        """Bytes that were misread because the line was not as the board has it."""
        return self._look(lambda: self._bytes_garbled)

    @property
    def frames_played(self) -> int:
        """Swaps since power-up."""
        return self._look(lambda: self._swaps)

    @property
    def emitting(self) -> bool:
        """Whether any transducer is driven now."""
        return self._look(lambda: self._clocks_on and min(self._front) < COUNTS)

    @property
    def playing(self) -> NDArray[np.uint8]:
        """The pattern that is playing now, shape [256]."""
        return self._look(lambda: np.frombuffer(bytes(self._front), np.uint8))

    @property
    def played(self) -> NDArray[np.uint8]:
        """The patterns swapped in so far, the last `record` of them, oldest first, shape [pattern, 256]."""
        patterns = self._look(lambda: b"".join(pattern for pattern, _ in self._record))
        return np.frombuffer(patterns, np.uint8).reshape(-1, TRANSDUCER_COUNT)

    @property
    def played_ns(self) -> NDArray[np.int64]:
        """When each of `played` was swapped in, by the board's clock [ns], shape [pattern]."""
        return self._look(lambda: np.array([swapped for _, swapped in self._record], np.int64))

    def _look(self, what: Callable[[], T]) -> T:
        with self._lock:
            self._run_until(self.clock.now_ns())
            return what()

    def _begin_run(self, time_ns: float) -> None:
        self._run_ns = time_ns  # not rounded: a run that follows at once goes on bit by bit
        self._run_bytes = 0

    def _sent_at_ns(self, count: int) -> float:
        """When the last bit of so many bytes of this run is over [ns]."""
        return self._run_ns + count * self._byte_ns

    def _run_until(self, now_ns: int) -> None:
        """Receive the bytes whose last bit was over by then."""
        count = 0
        while count < len(self._queue) and self._sent_at_ns(self._run_bytes + 1) <= now_ns:
            self._run_bytes += 1
            self._receive(self._queue[count], round(self._sent_at_ns(self._run_bytes)))
            count += 1
        if count:
            del self._queue[:count]

    def _receive(self, byte: int, time_ns: int) -> None:
        if not self._readable:
            byte = self._noise.randrange(256)
            self._bytes_garbled += 1
        if byte == _START and self._selected:
            self._count, self._started = 0, True
        elif byte == _SWAP:  # whichever board is selected
            self._count, self._started = 0, False
            self._front, self._back = self._back, self._front
            self._swaps += 1
            self._record.append((bytes(self._front), time_ns))
        elif byte in (_CLOCKS_OFF, _CLOCKS_ON):
            self._clocks_on = byte == _CLOCKS_ON
        elif byte in (_PRIMARY, _SECONDARY):
            self._selected = byte == self._own
        elif self._selected:
            self._put(byte)
        else:
            self._bytes_ignored += 1

    def _put(self, datum: int) -> None:
        """One transducer's value into the buffer that is not playing."""
        self._bytes_stray += not self._started or self._count >= TRANSDUCER_COUNT
        self._bytes_strange += datum > COUNTS
        self._back[self._count % TRANSDUCER_COUNT] = datum if datum == COUNTS else datum % COUNTS
        self._count += 1


class SonicPorts(EmulatedPorts[SonicBoard]):
    """Serial ports with a SonicSurface at each: give them to `open_link` and `find_serial_arrays` as the backend.

    Args:
        serials: serial number of each adapter.
        clock: clock of all boards; None takes the monotonic one.
        record: how many of its last played patterns each board keeps, for tests.
        baud: bits a second that the boards sample at [Bd].
    """

    def __init__(
        self, serials: Sequence[str] = ("SONEMU01",), *, clock: Clock | None = None, record: int = 0, baud: float = BAUD
    ) -> None:
        def switch_on(clock: Clock, chip_bytes: int) -> SonicBoard:
            return SonicBoard(clock, record=record, baud=baud, chip_bytes=chip_bytes)

        super().__init__(switch_on, serials, clock=clock)
