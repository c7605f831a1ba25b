"""The player's estimate of what the array plays when: deadlines, underruns, lateness, queue depth."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right

from ..report import UNDERRUN_EVENTS_MAX, Lateness, QueueDepth, Underrun

CLOCK_TOLERANCE = 200e-6  # crystals differ by at most 100 ppm or so each


class Timeline:
    """Keeps account of submits. Times are those of the link's clock [ns].

    An array plays a frame a period from the first submit on, or from the end of its hold; when it has played all that
    was submitted it is dry, and a submit after that is an underrun. Two facts keep the estimate from drifting away from
    the array's own clock, which is another crystal: an array that makes the host wait is not dry, believed as far as
    crystals differ (a slow bus makes the host wait, too); and an array holds no more than fits it.

    Args:
        period_ns: of a frame.
        fifo_frames: most that the array may hold beyond what is under way; 0: unknown.
        hold_ns: how long the first frame waits in the array until it plays.
    """

    def __init__(self, period_ns: int, fifo_frames: int, *, hold_ns: int = 0) -> None:
        self.start_ns: int | None = None
        self.dry_ns = 0
        """When the array will have played all that was submitted."""
        self.underruns = 0
        self.starved_ns = 0
        self.silent_ns = 0
        """Time in which a board was made to begin anew amid the content, silent."""
        self.frames = 0
        """Frames submitted."""
        self.queue_bytes = 0
        """Bytes under way at the last submit."""
        self._period_ns = period_ns
        self._fifo_frames = fifo_frames
        self._hold_ns = hold_ns
        self._begin_ns = 0  # when the first frame plays
        self._drift_ns = 0
        self._filled = False
        self._late_frame = array("q")  # first frame of each that was late, and by how much all are from there on
        self._late_ns = array("q")
        self._events: list[Underrun] = []
        self._taken_ns: list[int | None] = []
        self._events_open = 0  # events before this one have been taken
        self._depth_min: int | None = None
        self._depth_sum = self._depth_count = 0

    def submit(self, now_ns: int, frames: int, *, queue_bytes: int, queue_frames: int) -> None:
        """Frames are about to be submitted, behind what is under way: that many bytes, and frames."""
        if self.start_ns is None:
            self.start_ns = now_ns
            self._begin_ns = self.dry_ns = now_ns + self._hold_ns
        self._bound(now_ns, queue_frames)
        self._sample(queue_bytes)
        late_ns = now_ns - self.dry_ns
        if late_ns > 0:
            self._starve(now_ns, late_ns)
        self.dry_ns += frames * self._period_ns
        self.frames += frames

    def pause(self, begin_ns: int, end_ns: int) -> None:
        """Between these times the array was made to begin anew, silent; before them it may have starved."""
        if self.start_ns is None:
            return
        if begin_ns > self.dry_ns:
            self._starve(begin_ns, begin_ns - self.dry_ns)
        self.silent_ns += end_ns - begin_ns
        self.dry_ns = end_ns
        self._note_lateness()

    def waited(self, now_ns: int) -> None:
        """The array has made the host wait for room until now: it is full, so at least half of what fits is there."""
        self._filled = True
        self._correct(now_ns, now_ns + self._fifo_frames // 2 * self._period_ns)

    def taken(self, now_ns: int, frames: int) -> None:
        """The array is known to have taken that many frames in all."""
        while self._events_open < len(self._events) and self._events[self._events_open].frame < frames:
            self._taken_ns[self._events_open] = now_ns
            self._events_open += 1

    def underrun_events(self) -> tuple[Underrun, ...]:
        """The first underruns, one by one."""
        return tuple(
            Underrun(event.time, event.frame, event.duration, event.submitted_ns, taken_ns)
            for event, taken_ns in zip(self._events, self._taken_ns, strict=True)
        )

    def queue_depth(self) -> QueueDepth | None:
        """Bytes under way at submits, or None if there was none after the first wait for room."""
        if self._depth_min is None:
            return None
        return QueueDepth(self._depth_min, self._depth_sum / self._depth_count)

    def lateness(self) -> Lateness:
        """Percentiles (nearest rank) over all frames, which are late in ascending order."""

        def at(fraction: float) -> float:
            late = bisect_right(self._late_frame, math.ceil(fraction * self.frames) - 1)
            return self._late_ns[late - 1] * 1e-9 if late else 0.0

        return Lateness(at(0.5), at(0.99), at(0.999), at(1.0))

    def _bound(self, now_ns: int, queue_frames: int) -> None:
        if self._fifo_frames:
            playing_ns = max(now_ns, self._begin_ns)
            self.dry_ns = min(self.dry_ns, playing_ns + (self._fifo_frames + queue_frames) * self._period_ns)
        if queue_frames:
            self._correct(now_ns, now_ns + queue_frames * self._period_ns)

    def _correct(self, now_ns: int, dry_ns: int) -> None:
        """The array is not dry before `dry_ns`: its clock is slower than the host's."""
        elapsed_ns = 0 if self.start_ns is None else now_ns - self.start_ns
        credible_ns = round(elapsed_ns * CLOCK_TOLERANCE) - self._drift_ns
        drift_ns = min(dry_ns - self.dry_ns, credible_ns)
        if drift_ns > 0:
            self._drift_ns += drift_ns
            self.dry_ns += drift_ns

    def _note_lateness(self) -> None:
        """All frames from here on are late by as much."""
        self._late_frame.append(self.frames)
        self._late_ns.append(self.starved_ns + self.silent_ns)

    def _sample(self, queue_bytes: int) -> None:
        self.queue_bytes = queue_bytes
        if self._filled:
            self._depth_min = queue_bytes if self._depth_min is None else min(self._depth_min, queue_bytes)
            self._depth_sum += queue_bytes
            self._depth_count += 1

    def _starve(self, now_ns: int, late_ns: int) -> None:
        self.underruns += 1
        self.starved_ns += late_ns
        self.dry_ns = now_ns
        self._note_lateness()
        if len(self._events) < UNDERRUN_EVENTS_MAX and self.start_ns is not None:
            time = (now_ns - self.start_ns) * 1e-9
            self._events.append(Underrun(time, self.frames, late_ns * 1e-9, now_ns, None))
            self._taken_ns.append(None)
