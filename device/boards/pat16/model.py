"""Model of the board of a UCL/OpenMPD PAT array (FPGA firmware 3.4.2): bytes in, pulses on 256 pins.

Written from the board's published gateware (RMResearch/OpenMPD_Hardware, FPGA_3.4.2/src: ParallelReceiver,
FrameBufferController, CommandReader); each branch below names the state of that gateware that it stands for. It shares
no code with the codec, the link or the array model, so that a mistake in one of them shows. Which transducer hangs on
which pin differs from board to board and is no part of this model. docs/formats/emulator.md states the rule in words.
"""

from __future__ import annotations

import math
import re
import threading
from collections import deque
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...clock import Clock

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


BLOCK_BYTES = 512
"""The board takes bytes from its FIFO in blocks of exactly as many, whatever they hold."""
PIN_COUNT = 256
FIFO_BYTES = 16_384
"""Size of the FIFO: 32 frames."""
FIFO_STOP_BYTES = 14_336
"""The board reads no further byte once its FIFO holds as many: 28 frames."""
CARRIER_PERIOD_NS = 25_000
"""One period of 40 kHz [ns]."""
COUNTS = 128
"""Steps of a carrier period: unit of delay and of duty."""
READ_NS = 10_240
"""Time in which a block is read: one byte a clock of 50 MHz [ns]."""
POWER_UP_NS = 1_000_000_000
"""Time after power-up until the all-off frame is loaded [ns]; blocks are taken from then on."""
STALE_NS = 1_000_000_000
"""Time with fewer than 512 bytes in the FIFO after which it is cleared [ns], again after each further one."""

_OFF = bytes(FRAME_BYTES)
_POWER_UP = bytes(PIN_COUNT) + bytes((COUNTS // 2,)) * PIN_COUNT
"""What plays until the off frame is loaded: the published amplituderam.mif has 64 for every pin, the phases are 0."""
_SILENT = bytes(PIN_COUNT)

T = TypeVar("T")


class PatBoard:
    """The board: a FIFO, its clock of blocks, and the frame that is playing. It never answers.

    Nothing runs in the background: every call first does what is due by the clock, so idle time costs nothing. Calls
    may come from several threads.

    A block is taken when its 512 bytes are in the FIFO, and not before `divider` carrier periods have passed since the
    one before it; the last frame plays on until then. The FIFO is cleared once it has held fewer than 512 bytes for a
    second. So blocks are counted from the last clear, and a frame must fill one exactly.

    From power-up until the off frame is loaded, all pins emit in phase at full drive, as the published initial content
    of the amplitudes' memory has it.

    Times are those of the gateware to within READ_NS, in which it reads a block; here a block is read at once.

    Args:
        clock: what the carrier is derived from.
        record: how many of the last played frames to keep, for tests.
        chip_bytes: bytes that the USB chip in front of the board holds beyond what the board has read.
        byte_rate: bytes a second that the chip passes on to the board [B/s]; None is as many as there are.
        on_for_ns: how long ago the power was switched on [ns].
    """

    def __init__(
        self,
        clock: Clock,
        *,
        record: int = 0,
        chip_bytes: int = 0,
        byte_rate: float | None = None,
        on_for_ns: int = 0,
    ) -> None:
        if byte_rate and not chip_bytes:
            raise ValueError(f"byte_rate {byte_rate:g} B/s takes a chip that bytes can be in: chip_bytes is 0")
        self.clock = clock
        self._lock = threading.Lock()
        self._room = FIFO_STOP_BYTES + chip_bytes
        self._queue = bytearray()  # the FIFO's content, then the chip's
        self._gone = 0  # bytes that have left the queue; byte n since power-up is queue[n - gone]
        self._received = 0
        self._byte_ns = 1e9 / byte_rate if byte_rate else 0.0
        self._flow_ns = -math.inf  # until when the chip is busy passing on what is in the queue
        self._runs: deque[tuple[int, float]] = deque()  # byte n and when it began to be passed on, those after it next
        self._powered = True
        self._power_up_ns = clock.now_ns() - on_for_ns
        self._due_ns = self._power_up_ns + POWER_UP_NS + READ_NS  # when the next block may be taken
        self._short_ns: int | None = (
            self._power_up_ns
        )  # since when it has held fewer bytes, or when it was cleared since
        self._reader = CommandReader()
        self._playing = _OFF  # GSPATIdle after power-up; at the end of state Start the gateware loads the off frame
        self._emitting = False
        self._follow_ns = 0  # when the frame that plays was due to be followed
        self._frames_played = 0
        self._blocks_taken = 0
        self._underruns = 0
        self._starved_ns = 0
        self._bytes_cleared = 0
        self._record: deque[tuple[bytes, int, int]] = deque(maxlen=record)  # frame, began, late [ns]

    def accept(self, data: memoryview, *, since_ns: int | None = None) -> int:
        """Take as many of the bytes as the FIFO and the chip have room for; returns their count.

        Args:
            data: bytes on the bus.
            since_ns: time [ns] since which they have been on the bus, now if None: what the board had room for in the
                meantime counts as taken then, and what was due was played then.
        """
        with self._lock:
            now_ns = self.clock.now_ns()
            arrival_ns = now_ns if since_ns is None else min(since_ns, now_ns)
            self._play_until(arrival_ns)
            if not self._powered:
                return 0
            # As if the FIFO had no end: the order of frames and the time of each are the same, and what is
            # left over beyond its end has not been read. More than a frame a period cannot have been played.
            before = len(self._queue)
            start_ns = max(self._flow_ns, arrival_ns)
            reach = self._room + ((now_ns - arrival_ns) // CARRIER_PERIOD_NS + 2) * FRAME_BYTES - before
            if self._byte_ns:
                passed = int((now_ns - start_ns) / self._byte_ns) if start_ns <= now_ns else -self._in_chip(now_ns)
                reach = min(reach, passed + self._room - FIFO_STOP_BYTES)
            offered = data[: max(reach, 0)]
            self._runs.append((self._gone + before, start_ns))
            self._queue += offered
            self._play_until(now_ns)
            taken = len(offered) - max(len(self._queue) - self._room, 0)
            self._cut_queue(self._room)
            self._received += taken
            self._flow_ns = start_ns + taken * self._byte_ns
            self._hold_back()
            return taken

    def room_at_ns(self, byte_count: int) -> int:
        """Time [ns] at which there will be room for that many bytes, or for as many as there can be."""
        with self._lock:
            now_ns = self.clock.now_ns()
            self._play_until(now_ns)
            missing = byte_count + len(self._queue) - self._room
            frames = min(-(-missing // FRAME_BYTES), len(self._queue) // FRAME_BYTES)
            if frames > 0:
                now_ns = self._next_take_ns() + (frames - 1) * self._reader.divider * CARRIER_PERIOD_NS
            if not self._byte_ns:
                return now_ns
            # The chip has room for them when it has passed on all that is in front of the last 1 KiB of them.
            in_front = len(self._queue) + min(byte_count, FIFO_STOP_BYTES) - (self._room - FIFO_STOP_BYTES)
            passed_ns = self._passed_ns(in_front - 1) if in_front > 0 and self._runs else 0.0
            return max(now_ns, math.ceil(passed_ns) + 1)

    def purge_chip(self) -> None:
        """Drop the bytes that are still in the USB chip: those that the FIFO has no room for, or no time was for."""
        with self._lock:
            now_ns = self.clock.now_ns()
            self._play_until(now_ns)
            self._cut_queue(len(self._queue) - self._in_chip(now_ns))
            self._flow_ns = now_ns

    def power_off(self) -> None:
        """Lose the power: silent at once, everything queued is gone."""
        with self._lock:
            self._play_until(self.clock.now_ns())
            self._powered = self._emitting = False
            self._cut_queue(0)
            self._playing = _OFF

    @property
    def bytes_received(self) -> int:
        """Bytes taken from the bus since power-up, those in the chip too."""
        return self._received

    @property
    def bytes_skipped(self) -> int:
        """Bytes without MSB that were skipped in search of a frame's start."""
        return self._look(lambda: self._reader.bytes_skipped)

    @property
    def bytes_lost(self) -> int:
        """Bytes that came while a frame that ended inside a block was swapped in, so that nothing looked at them."""
        return self._look(lambda: self._reader.bytes_lost)

    @property
    def bytes_cleared(self) -> int:
        """Bytes that were cleared out of the FIFO, since it held fewer than 512 for a second."""
        return self._look(lambda: self._bytes_cleared)

    @property
    def next_clear_ns(self) -> float:
        """When the FIFO will be cleared if no byte comes [ns]; infinite while it holds 512 or more."""
        return self._look(lambda: math.inf if self._short_ns is None else self._short_ns + STALE_NS)

    @property
    def torn_bytes(self) -> int:
        """Bytes that have been read of a frame that is not complete."""
        return self._look(lambda: self._reader.torn_bytes)

    @property
    def blocks_taken(self) -> int:
        """Blocks of 512 bytes taken from the FIFO since power-up, whatever they held."""
        return self._look(lambda: self._blocks_taken)

    @property
    def fifo_bytes(self) -> int:
        """Bytes in the FIFO."""
        return self._look(lambda: min(len(self._queue), FIFO_STOP_BYTES))

    @property
    def divider(self) -> int:
        """Carrier periods of a block."""
        return self._look(lambda: self._reader.divider)

    @property
    def led(self) -> int | None:
        """The 24 bits that were last loaded into the LED, bit n from byte 1 + n; None before any were."""
        return self._look(lambda: self._reader.led)

    @property
    def frames_played(self) -> int:
        """Frames played since power-up."""
        return self._look(lambda: self._frames_played)

    @property
    def underruns(self) -> int:
        """How often a frame that emits was due to be followed and was not. The real board cannot tell."""
        return self._look(lambda: self._underruns + (self._starving_ns() > 0))

    @property
    def starved_ns(self) -> int:
        """How long frames that emit have played beyond their time [ns]."""
        return self._look(lambda: self._starved_ns + self._starving_ns())

    @property
    def emitting(self) -> bool:
        """Whether any pin has pulses now."""
        return self._look(lambda: self._emitting or self._is_starting())

    @property
    def playing(self) -> NDArray[np.uint8]:
        """The frame that is playing now, shape [512]."""
        return self._look(lambda: np.frombuffer(_POWER_UP if self._is_starting() else self._playing, np.uint8))

    @property
    def played(self) -> NDArray[np.uint8]:
        """The frames played so far, the last `record` of them, oldest first, shape [frame, 512]."""
        frames = self._look(lambda: b"".join(frame for frame, _, _ in self._record))
        return np.frombuffer(frames, np.uint8).reshape(-1, FRAME_BYTES)

    @property
    def played_ns(self) -> NDArray[np.int64]:
        """When each of `played` began, by the board's clock [ns], shape [frame]."""
        return self._look(lambda: np.array([began for _, began, _ in self._record], np.int64))

    def began_ns(self, number: int) -> int | None:
        """When a frame began, by the board's clock [ns]; `number` counts from power-up, 0 for the first one played.

        None before it is played, and for one that is no longer recorded.
        """
        with self._lock:
            self._play_until(self.clock.now_ns())
            place = number - self._frames_played
            return self._record[place][1] if -len(self._record) <= place < 0 else None

    @property
    def lateness_ns(self) -> NDArray[np.int64]:
        """How much later than due each of `played` began [ns], shape [frame]; 0 for a frame that follows silence."""
        return self._look(lambda: np.array([late for _, _, late in self._record], np.int64))

    def output(self, pin: int) -> NDArray[np.bool_]:
        """Level of a pin over one period of the carrier, shape [128]."""
        frame = self.playing
        since_edge = (np.arange(COUNTS) - int(frame[pin])) % COUNTS
        return since_edge < (int(frame[PIN_COUNT + pin]) & 0x7F)

    def _look(self, what: Callable[[], T]) -> T:
        with self._lock:
            self._play_until(self.clock.now_ns())
            return what()

    def _is_starting(self) -> bool:
        """Whether the off frame of the power-up is still to be loaded."""
        return self._powered and self.clock.now_ns() < self._power_up_ns + POWER_UP_NS + READ_NS

    def _next_period_ns(self, time_ns: int) -> int:
        """The first start of a carrier period at or after a time [ns]."""
        return time_ns + (self._power_up_ns - time_ns) % CARRIER_PERIOD_NS

    def _starving_ns(self) -> int:
        return max(self.clock.now_ns() - self._follow_ns, 0) if self._emitting else 0

    def _passed_ns(self, place: int) -> float:
        """When queue[place] has been passed on by the chip [ns], or would be if it were to follow what is there."""
        byte = self._gone + place
        first, start_ns = self._runs[0]
        if len(self._runs) > 1:
            first, start_ns = next(run for run in reversed(self._runs) if run[0] <= byte)
        return start_ns + (byte + 1 - first) * self._byte_ns

    def _in_chip(self, now_ns: int) -> int:
        """Bytes that the chip has not passed on."""
        if not self._byte_ns:
            return max(len(self._queue) - FIFO_STOP_BYTES, 0)
        count, end = 0, self._gone + len(self._queue)
        for first, start_ns in reversed(self._runs):
            passed = min(max(int((now_ns - start_ns) / self._byte_ns), 0), end - first)
            count, end = count + end - first - passed, first
            if passed:
                break
        return count

    def _hold_back(self) -> None:
        """What the FIFO has no room for stays in the chip until the next frame leaves."""
        in_chip = len(self._queue) - FIFO_STOP_BYTES
        if self._byte_ns and in_chip > 0:
            start_ns = max(self._passed_ns(FIFO_STOP_BYTES - 1), self._next_take_ns())
            while self._runs[-1][0] >= self._gone + FIFO_STOP_BYTES:
                self._runs.pop()
            self._runs.append((self._gone + FIFO_STOP_BYTES, start_ns))
            self._flow_ns = start_ns + in_chip * self._byte_ns

    def _next_take_ns(self) -> int:
        """When the block in front of the queue, all of it there, is taken (states Idle and WaitFrame)."""
        return max(self._due_ns, math.ceil(self._passed_ns(BLOCK_BYTES - 1)))

    def _drop(self, count: int) -> None:
        """Let the first bytes leave the queue."""
        del self._queue[:count]
        self._gone += count
        while len(self._runs) > 1 and self._runs[1][0] <= self._gone:
            self._runs.popleft()

    def _cut_queue(self, length: int) -> None:
        """Keep the first bytes of the queue."""
        del self._queue[length:]
        while self._runs and self._runs[-1][0] >= self._gone + len(self._queue):
            self._runs.pop()

    def _play_until(self, now_ns: int) -> None:
        """Take the blocks, and clear the FIFO, as was due until then, in the order of time."""
        while True:
            is_block = len(self._queue) >= BLOCK_BYTES
            short_ns, block_ns = self._short_ns, self._passed_ns(BLOCK_BYTES - 1) if is_block else math.inf
            if short_ns is not None and short_ns + STALE_NS <= min(block_ns, now_ns):
                self._clear(short_ns + STALE_NS, now_ns)
            elif is_block and self._next_take_ns() <= now_ns:
                self._take(self._next_take_ns())
            else:
                return

    def _take(self, take_ns: int) -> None:
        """State ReadFIFO: a block goes to the command reader, whatever it holds."""
        frame = self._reader.read(bytes(self._queue[:BLOCK_BYTES]))
        self._drop(BLOCK_BYTES)
        self._blocks_taken += 1
        # State WaitFrame counts the ends of carrier periods from when the block has been read.
        periods = self._reader.divider - 1
        self._due_ns = self._next_period_ns(take_ns + READ_NS) + periods * CARRIER_PERIOD_NS
        self._short_ns = take_ns if len(self._queue) - self._in_chip(take_ns) < BLOCK_BYTES else None
        if frame is not None:
            self._play(frame, take_ns)

    def _play(self, frame: bytes, take_ns: int) -> None:
        late_ns = max(take_ns - self._follow_ns, 0) if self._emitting else 0
        self._underruns += late_ns > 0
        self._starved_ns += late_ns
        self._playing = frame
        self._emitting = frame[PIN_COUNT:] != _SILENT
        self._follow_ns = self._due_ns
        self._frames_played += 1
        if self._record.maxlen:
            self._record.append((frame, take_ns, late_ns))

    def _clear(self, clear_ns: int, now_ns: int) -> None:
        """The FIFO's synchronous clear, each second with fewer than 512 bytes in it; the reader keeps its state."""
        seconds = 0 if self._queue else (now_ns - clear_ns) // STALE_NS  # those of which nothing can be seen
        passed = len(self._queue) - self._in_chip(clear_ns)
        self._bytes_cleared += passed
        self._drop(passed)
        self._short_ns = clear_ns + seconds * STALE_NS
