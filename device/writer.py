"""The thread of a playback: the only one that talks to the array while frames are played."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from queue import Empty, Full, Queue
from threading import Thread
from typing import TypeVar

from .errors import DeviceLostError, DeviceTimeoutError, LinkError
from .link import BoardStatus, Link
from .report import UNDERRUN_EVENTS_MAX, PlayReport, Underrun

T = TypeVar("T")

TRANSFER_BYTES = 1 << 16  # measured: the cost of a write no longer shows at 20 MB/s
TRANSFER_DURATION = 0.02  # [s]; a stop waits for the transfer under way
POLL = 0.02  # [s] between looks at the stop request, which a signal handler may set and so cannot notify
DRAIN_MARGIN_NS = 500_000_000  # beyond the playing time of what is queued, before the array counts as hung


class Writer:
    """Sends blocks from a bounded queue, then sees to it that the array is off, whatever ended the playback.

    Args:
        link: the array, its divider set, silent, and no byte of a frame in it.
        divider: that divider.
        queue_blocks: how many blocks wait at most; playing starts when as many do.
    """

    def __init__(self, link: Link, divider: int, *, queue_blocks: int) -> None:
        self.error: BaseException | None = None
        self.stopped_by: str | None = None  # plain attribute: a signal handler may not take a lock
        self._link = link
        self._queue: Queue[array[int] | None] = Queue(queue_blocks)
        self._thread = Thread(target=self._run, name="palpate-writer")
        self._frame_bytes = link.array.frame_bytes
        self._period_ns = round(divider / link.array.carrier * 1e9)
        per_transfer = int(TRANSFER_DURATION * 1e9) // self._period_ns
        self._transfer_bytes = max(1, min(per_transfer, TRANSFER_BYTES // self._frame_bytes)) * self._frame_bytes
        self._base = link.status()
        self._bytes_base, self._short_base = link.bytes_sent, link.short_writes
        self._bytes = 0
        self._start_ns: int | None = None
        self._dry_ns = 0  # when the array will have played all that was submitted
        self._starved_ns = 0
        self._underruns = 0
        self._underrun_events: list[Underrun] = []
        self._elapsed_ns = 0
        self._stop_status: BoardStatus | None = None  # at the end of the content
        self._cleared: int | None = None
        self._finishing = False
        self._off = False
        self._update_rate = link.array.update_rate(divider)

    @property
    def frames(self) -> int:
        """Whole frames taken by the array so far."""
        return self._bytes // self._frame_bytes

    @property
    def finished(self) -> bool:
        """The thread has ended, and the array is off if that could be done."""
        return self._thread.ident is not None and not self._thread.is_alive()

    def request_stop(self, reason: str) -> None:
        """Stop as soon as possible, dropping what is queued; the first reason counts. Safe in a signal handler."""
        if self.stopped_by is None:
            self.stopped_by = reason

    def put(self, block: array[int] | None) -> bool:
        """Queue a block, or None for the end; False if playing stopped instead."""
        while self.stopped_by is None:
            try:
                self._queue.put(block, timeout=POLL if self._thread.ident else 0)
                return True
            except Full:
                if self._thread.ident is None:
                    self._thread.start()
        return False

    def join(self, *, tick: Callable[[], object] = lambda: None) -> None:
        """Wait for the end of the thread, calling `tick` meanwhile; starts it if nothing did, so the array is off."""
        if self._thread.ident is None:
            self._thread.start()
        while self._thread.is_alive():
            self._thread.join(POLL)
            tick()

    def report(self) -> PlayReport:
        """Statistics, once the thread has ended."""
        now, base = self._stop_status, self._base
        frames = self.frames
        played = frames - (self._cleared or 0)
        duration = played / self._update_rate
        period = self._period_ns * 1e-9
        return PlayReport(
            array=self._link.array.name,
            serial=self._link.serial,
            clock=self._link.clock.name,
            stopped_by=self.stopped_by or "end",
            frames=frames,
            frames_cleared=self._cleared,
            bytes=self._bytes,
            update_rate=self._update_rate,
            duration=duration if self._cleared is not None else min(duration, self._elapsed_ns * 1e-9),
            elapsed=self._elapsed_ns * 1e-9,
            underruns=self._underruns,
            starved=self._starved_ns * 1e-9,
            underrun_events=tuple(self._underrun_events),
            board_underruns=None if now is None else now.underruns - base.underruns,
            board_starved=None if now is None else (now.starved_periods - base.starved_periods) * period,
            short_writes=self._link.short_writes - self._short_base,
            off_confirmed=self._off,
        )

    def _run(self) -> None:
        try:
            self._stream()
            if self.stopped_by is None:
                self._finish()
        except BaseException as error:  # whatever it is, the array is switched off, and the caller's thread raises it
            self.error = error
            self.request_stop("device")
        try:
            if not self._off:
                self._stop()
        except BaseException as error:  # as above
            self.error = self.error or error
        if self._start_ns is not None:
            self._elapsed_ns = self._link.clock.now_ns() - self._start_ns

    def _stream(self) -> None:
        while (block := self._next()) is not None:
            for start in range(0, len(block), self._transfer_bytes):
                if self.stopped_by is not None:
                    return
                self._submit(block[start : start + self._transfer_bytes])

    def _next(self) -> array[int] | None:
        while self.stopped_by is None:
            try:
                return self._queue.get(timeout=POLL)
            except Empty:
                continue
        return None

    def _submit(self, data: array[int]) -> None:
        self._meet_deadline(len(data) // self._frame_bytes)
        try:
            self._link.write(data, abandon=lambda: self.stopped_by is not None)
        finally:
            self._bytes = self._link.bytes_sent - self._bytes_base

    def _meet_deadline(self, frames: int) -> None:
        """Submit in time? The array runs dry when all that was submitted is played; after that it starts anew."""
        now_ns = self._link.clock.now_ns()
        if self._start_ns is None:
            self._start_ns = self._dry_ns = now_ns
        late_ns = now_ns - self._dry_ns
        if late_ns > 0:
            self._underruns += 1
            self._starved_ns += late_ns
            self._dry_ns = now_ns
            if len(self._underrun_events) < UNDERRUN_EVENTS_MAX:
                time = (now_ns - self._start_ns) * 1e-9
                self._underrun_events.append(Underrun(time, self.frames, late_ns * 1e-9))
        self._dry_ns += frames * self._period_ns

    def _finish(self) -> None:
        """The end of the content: the off frame behind it, then wait until that plays."""
        if self._start_ns is not None:
            self._meet_deadline(1)
        self._finishing = True
        self._link.send_off()
        target = self._base.frames_played + self.frames + 1
        status = self._link.status()
        deadline_ns = self._link.clock.now_ns() + status.fifo_frames * self._period_ns + DRAIN_MARGIN_NS
        while status.frames_played < target or status.level:
            now_ns = self._link.clock.now_ns()
            if self.stopped_by is not None:
                return
            if now_ns > deadline_ns:
                raise DeviceTimeoutError(
                    f"array {self._link.array.name} played {status.frames_played - self._base.frames_played} frames of "
                    f"{self.frames} and its off frame in the time for all: it may still be emitting, switch it off"
                )
            wait_ns = max(target - status.frames_played, 1) * self._period_ns
            self._link.clock.sleep_until_ns(now_ns + min(wait_ns, int(POLL * 1e9)))
            status = self._link.status()
        self._stop_status, self._cleared, self._off = status, 0, True

    def _stop(self) -> None:
        """Off now: drop what is queued, complete a torn frame, send the off frame. Each step tried, whatever failed."""
        before = self._attempt(self._link.status)
        self._attempt(self._link.clear)
        after = self._attempt(self._link.status)
        if before is not None:
            self._stop_status = before
            if not self._finishing:
                self._bytes = self._taken_bytes(before)
        if after is not None and after.fifo_frames == 0:
            self._cleared = max(self.frames - (after.frames_played - self._base.frames_played), 0)
        self._attempt(self._link.send_off)
        self._off = bool(self._attempt(lambda: wait_silent(self._link, self._period_ns)))
        if self._off and self._cleared is None:  # nothing could be cleared, so all of it was played
            self._cleared = 0

    def _taken_bytes(self, status: BoardStatus) -> int:
        """Bytes of content the board has taken by its own count: after a failed write the host does not know."""
        frames = status.frames_played - self._base.frames_played + status.fifo_frames
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


def wait_silent(link: Link, period_ns: int) -> bool:
    """Wait until the board has played all that is queued and says it is silent; False if it does not come to that."""
    status = link.status()
    deadline_ns = link.clock.now_ns() + (status.fifo_frames + 1) * period_ns + DRAIN_MARGIN_NS
    while status.level or status.fifo_frames:
        now_ns = link.clock.now_ns()
        if now_ns > deadline_ns:
            return False
        link.clock.sleep_until_ns(now_ns + period_ns)
        status = link.status()
    return True
