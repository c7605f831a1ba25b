"""The thread of a playback: the only one that talks to the array while frames are played."""

from __future__ import annotations

import atexit
import weakref
from array import array
from collections import deque
from collections.abc import Callable
from queue import Empty, Full, Queue
from threading import Thread
from typing import NamedTuple, TypeVar

from ..errors import DeviceLostError, DeviceTimeoutError, LinkError, SafetyLimitError
from ..link import BoardStatus, Link
from ..report import LiveStatistics, PlayReport
from ..silence import DRAIN_MARGIN_NS, OFF_ATTEMPTS, wait_silent
from .limits import Dose, Guard
from .timeline import Timeline

T = TypeVar("T")

CHUNK_BYTES = 1 << 16  # measured: the cost of a write no longer shows at 20 MB/s
CHUNK_DURATION = {"sync": 0.02}  # [s]; a blocking write is alone under way, so it is longer
CHUNK_DURATION_QUEUED = 0.0125  # [s]; 4 of them are under way at 10 kHz, more and shorter ones above 10 kHz
PREFILL_DURATION = 0.08  # [s] of frames that are ready before the first is sent
POLL = 0.02  # [s] between looks at the stop request, which a signal handler may set and so cannot notify
CHUNKED_BLOCKS = 4  # blocks whose chunks are kept: a short contour's loop comes again and again
EXIT_TIMEOUT = 3.0  # [s] that the end of the interpreter waits for arrays to be off


class Chunk(NamedTuple):
    """What is submitted at a time."""

    data: array[int]
    dose: Dose


class Writer:
    """Sends blocks from a bounded queue, then sees to it that the array is off, whatever ended the playback.

    Args:
        link: the array, started at `divider`: silent, and no byte of a frame in it.
        divider: that divider.
        guard: watches the limits.
        queue_blocks: how many blocks wait at most.
    """

    def __init__(self, link: Link, divider: int, guard: Guard, *, queue_blocks: int) -> None:
        self.error: BaseException | None = None
        self.stopped_by: str | None = None  # plain attribute: a signal handler may not take a lock
        self._link = link
        self._divider = divider
        self._guard = guard
        self._queue: Queue[list[Chunk] | None] = Queue(queue_blocks)
        self._prefilled = 0  # frames
        self._thread = Thread(target=self._run, name="palpate-writer", daemon=True)  # the end of Python ends it: below
        self._frame_bytes = link.array.frame_bytes
        self._update_rate = link.array.update_rate(divider)
        self._period_ns = round(1e9 / self._update_rate)
        duration = CHUNK_DURATION.get(link.transport, CHUNK_DURATION_QUEUED)
        frames = min(int(duration * self._update_rate), CHUNK_BYTES // self._frame_bytes)
        self._chunk_bytes = max(1, frames) * self._frame_bytes
        self._chunked: deque[tuple[array[int], list[Chunk]]] = deque(maxlen=CHUNKED_BLOCKS)
        self._timeline = Timeline(self._period_ns, link.array.fifo_frames, hold_ns=link.hold_ns)
        self._base = link.status()
        self._bytes_base, self._short_base = link.bytes_sent, link.short_writes
        self._content_bytes = 0  # handed to the link
        self._bytes = 0  # taken
        self._duty_sum = 0.0
        self._elapsed_ns = 0
        self._stop_status: BoardStatus | None = None  # at the end of the content
        self._cleared: int | None = None
        self._finishing = self._off_sent = False
        self._stop_ns = 0  # when a stop was asked for
        self._off_after_ns: int | None = None
        self._exact = True
        self._off: bool | None = False

    @property
    def frames(self) -> int:
        """Whole frames taken by the array so far."""
        return self._bytes // self._frame_bytes

    def live(self) -> LiveStatistics:
        """Statistics so far."""
        timeline = self._timeline
        elapsed_ns = 0 if timeline.start_ns is None else self._link.clock.now_ns() - timeline.start_ns
        return LiveStatistics(
            frames=self.frames,
            elapsed=elapsed_ns * 1e-9,
            queue_bytes=timeline.queue_bytes,
            underruns=timeline.underruns,
            starved=timeline.starved_ns * 1e-9,
            lateness=(timeline.starved_ns + timeline.silent_ns) * 1e-9,
        )

    def request_stop(self, reason: str) -> None:
        """Stop as soon as possible, dropping what is queued; the first reason counts. Safe in a signal handler."""
        if self.stopped_by is None:
            self._stop_ns = self._link.clock.now_ns()
            self.stopped_by = reason

    def put(self, block: array[int] | None, *, tick: Callable[[], object] = lambda: None) -> bool:
        """Queue a block, or None for the end, calling `tick` while there is no room; False if playing stopped instead.

        Playing starts when 80 ms of frames are queued, or the queue is full, or at the end.
        """
        chunks = None if block is None else self._chunks(block)
        while self.stopped_by is None:
            try:
                self._queue.put(chunks, timeout=POLL if self._started else 0)
            except Full:
                self._start()
                tick()
                continue
            self._prefilled += 0 if block is None else len(block) // self._frame_bytes
            if block is None or self._prefilled >= PREFILL_DURATION * self._update_rate:
                self._start()
            return True
        return False

    def join(self, *, tick: Callable[[], object] = lambda: None) -> None:
        """Wait for the end of the thread, calling `tick` meanwhile; starts it if nothing did, so the array is off."""
        self._start()
        while self._thread.is_alive():
            self._thread.join(POLL)
            tick()

    def wait(self, timeout: float) -> None:
        """Wait for the end of the thread, if it was started, for `timeout` [s] at most."""
        if self._started:
            self._thread.join(timeout)

    def report(self) -> PlayReport:
        """Statistics, once the thread has ended."""
        now, base, timeline = self._stop_status, self._base, self._timeline
        frames = self.frames
        duration = (frames - (self._cleared or 0)) / self._update_rate
        board = (
            None
            if now is None or base is None
            else (now.underruns - base.underruns, now.starved_periods - base.starved_periods)
        )
        return PlayReport(
            array=self._link.array.name,
            serial=self._link.serial,
            clock=self._link.clock.name,
            transport=self._link.transport,
            stopped_by=self.stopped_by or "end",
            frames=frames,
            frames_exact=self._exact,
            frames_cleared=self._cleared,
            bytes=self._bytes,
            update_rate=self._update_rate,
            duration=duration if self._cleared is not None else min(duration, self._elapsed_ns * 1e-9),
            elapsed=self._elapsed_ns * 1e-9,
            underruns=timeline.underruns,
            starved=timeline.starved_ns * 1e-9,
            silenced=timeline.silent_ns * 1e-9,
            underrun_events=timeline.underrun_events(),
            lateness=timeline.lateness(),
            queue_depth=timeline.queue_depth(),
            on_time=self._guard.on_time_ns * 1e-9,
            duty=self._duty_sum / max(self._content_bytes // self._frame_bytes, 1),
            board_underruns=board and board[0],
            board_starved=board and board[1] / self._update_rate,
            short_writes=self._link.short_writes - self._short_base,
            off_sent=self._off_sent,
            off_after=None if self._off_after_ns is None else self._off_after_ns * 1e-9,
            off_confirmed=self._off,
        )

    @property
    def _started(self) -> bool:
        return self._thread.ident is not None

    def _start(self) -> None:
        if not self._started:
            self._guard.start()
            _running.add(self)
            self._thread.start()

    def _run(self) -> None:
        try:
            self._stream()
            if self.stopped_by is None:
                self._finish()
        except BaseException as error:  # whatever it is, the array is switched off, and the caller's thread raises it
            self.error = error
            self.request_stop("limit" if isinstance(error, SafetyLimitError) else "device")
        try:
            if not self._off_sent:
                self._stop()
        except BaseException as error:  # as above
            self.error = self.error or error
        now_ns = self._link.clock.now_ns()
        self._guard.silence(now_ns)
        if self._timeline.start_ns is not None:
            self._elapsed_ns = now_ns - self._timeline.start_ns

    def _is_stopped(self) -> bool:
        return self.stopped_by is not None

    def _stream(self) -> None:
        while (chunks := self._next()) is not None:
            for chunk in chunks:
                if self._is_stopped():
                    return
                self._submit(chunk)

    def _next(self) -> list[Chunk] | None:
        while not self._is_stopped():
            try:
                return self._queue.get(timeout=POLL)
            except Empty:
                self._look()
                self._guard.hold(self._link.clock.now_ns())
        return None

    def _chunks(self, block: array[int]) -> list[Chunk]:
        """A block in chunks, which are kept for when the same array comes again.

        On the caller's thread: NumPy gives up the interpreter's lock, and whoever wants it back while others compute
        waits, which the writer must not.
        """
        for known, chunks in self._chunked:
            if known is block:
                return chunks
        size = self._chunk_bytes
        doses = self._guard.measure(block, size // self._frame_bytes)
        whole = len(block) <= size
        chunks = [
            Chunk(block if whole else block[number * size : (number + 1) * size], dose)
            for number, dose in enumerate(doses)
        ]
        self._chunked.append((block, chunks))
        return chunks

    def _submit(self, chunk: Chunk) -> None:
        self._refresh()
        if self._is_stopped():
            return
        before_ns = self._meet_deadline(chunk.dose.frames)
        self._guard.admit(chunk.dose, self._timeline.dry_ns - chunk.dose.frames * self._period_ns, self._period_ns)
        self._duty_sum += chunk.dose.duty_sum
        self._content_bytes += len(chunk.data)
        try:
            self._link.write(chunk.data, abandon=self._is_stopped)
        finally:
            self._look()
        now_ns = self._link.clock.now_ns()
        if now_ns - before_ns > chunk.dose.frames * self._period_ns // 2:
            self._timeline.waited(now_ns)

    def _refresh(self) -> None:
        """Have a board that forgets in a pause begin anew, which it does silently; others need nothing."""
        begin_ns = self._link.clock.now_ns()
        if self._link.refresh():
            self._guard.silence(begin_ns)
            self._timeline.pause(begin_ns, self._link.clock.now_ns())

    def _meet_deadline(self, frames: int) -> int:
        """Submit in time? Returns the time [ns]."""
        under_way = self._look()
        now_ns = self._link.clock.now_ns()
        self._timeline.submit(now_ns, frames, queue_bytes=under_way, queue_frames=under_way // self._frame_bytes)
        return now_ns

    def _look(self) -> int:
        """Learn what has arrived; returns what is under way still [bytes]."""
        under_way = self._link.bytes_under_way
        self._bytes = min(self._link.bytes_sent - self._bytes_base, self._content_bytes)
        self._timeline.taken(self._link.clock.now_ns(), self.frames)
        return under_way

    def _finish(self) -> None:
        """The end of the content: the off frames behind it, then wait until they play."""
        self._refresh()
        if self._timeline.start_ns is not None:
            self._meet_deadline(1)
        self._finishing = True
        begin_ns = self._link.clock.now_ns()
        self._link.write(array("B", self._link.off_bytes), abandon=self._is_stopped)
        drained = self._link.drain(abandon=self._is_stopped)
        self._look()
        after_ns = self._link.clock.now_ns() - begin_ns
        if drained and not self._is_stopped() and self._await_off():
            self._off_sent, self._off_after_ns = True, after_ns
            self._cleared = 0

    def _await_off(self) -> bool:
        """Wait until the off frames play; False if stopped meanwhile, so that what is queued is still to be cleared."""
        clock, status, off_frames = self._link.clock, self._link.status(), self._link.off_frames
        wait_frames = self._link.array.fifo_frames + off_frames if status is None else status.fifo_frames
        deadline_ns = clock.now_ns() + wait_frames * self._period_ns
        target = self.frames + off_frames + (self._base.frames_played if self._base else 0)
        while status is None or status.frames_played < target or status.level:
            now_ns = clock.now_ns()
            if self._is_stopped():
                return False
            if status is None and now_ns >= deadline_ns:
                self._off = None
                return True
            if now_ns > deadline_ns + DRAIN_MARGIN_NS:
                raise DeviceTimeoutError(
                    f"array {self._link.array.name} did not play {self.frames} frames and its off frame in the time "
                    "for all"
                )
            clock.sleep_until_ns(now_ns + min(self._wait_ns(status, target, deadline_ns - now_ns), int(POLL * 1e9)))
            status = self._link.status()
        self._stop_status, self._off = status, None if status.level is None else True
        return True

    def _wait_ns(self, status: BoardStatus | None, target: int, left_ns: int) -> int:
        return left_ns if status is None else max(target - status.frames_played, 1) * self._period_ns

    def _stop(self) -> None:
        """Off now: drop what is queued, complete a torn frame, send the off frame. Each step tried, whatever failed."""
        self._attempt(self._link.cancel)
        self._exact = not self._look() and (self._link.is_exact or self._bytes == self._content_bytes)
        before = self._attempt(self._link.status)
        is_clear = self._attempt(self._link.clear)
        after = self._attempt(self._link.status)
        if before is not None:
            self._stop_status = before
            if not self._finishing and self._base is not None:
                self._bytes, self._exact = self._taken_bytes(before, self._base), True
            if after is not None and after.fifo_frames == 0 and self._base is not None:
                self._cleared = max(self.frames - (after.frames_played - self._base.frames_played), 0)
        for _ in range(OFF_ATTEMPTS):
            self._attempt(self._send_off)
            if self._off_sent:
                self._off_after_ns = self._link.clock.now_ns() - self._stop_ns
                break
        self._attempt(self._confirm_off)
        if self._cleared is None and self._exact and self._off is not False and not is_clear:  # all of it was played
            self._cleared = 0

    def _send_off(self) -> None:
        self._link.send_off()
        self._off_sent = True

    def _confirm_off(self) -> None:
        self._off = wait_silent(self._link, self._divider)

    def _taken_bytes(self, status: BoardStatus, base: BoardStatus) -> int:
        """Bytes of content the board has taken by its own count: after a failed write the host may not know."""
        frames = status.frames_played - base.frames_played + status.fifo_frames
        return frames * self._frame_bytes + status.torn_bytes

    def _attempt(self, step: Callable[[], T]) -> T | None:
        if isinstance(self.error, DeviceLostError):
            return None
        try:
            return step()
        except LinkError as error:
            if self.error is None or isinstance(error, DeviceLostError):
                self.error = error
            return None


_running: weakref.WeakSet[Writer] = weakref.WeakSet()


def _switch_off_at_exit() -> None:
    """The interpreter ends while something plays, in a thread that does not keep it alive: off, within bounds."""
    for writer in list(_running):
        writer.request_stop("exit")
    for writer in list(_running):
        writer.wait(EXIT_TIMEOUT)


atexit.register(_switch_off_at_exit)
