"""Frames to arrays, each at its time: what is late is skipped, and an array that gets nothing new fades and is off."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from ..link import Link
from ..playing.limits import Dose, Guard, Limits
from ..registry import kind_of
from .ring import Content, Slice

LATE, HELD, FADED = 1, 2, 3
"""Why a frame was not played: it came too late, or its array is behind; nothing came, and the array held the one
before; nothing came for longer, and the writer faded or was silent."""

_SLICES_A_STEP: Final = 2
_FADE_STEPS: Final = 16
_UNKNOWN_NS: Final = 1_000_000_000  # after which a frame that no board has played is given up
_BEHIND_NS: Final = 2_000_000  # of frames under way beyond the lead: the array's clock is slower than the host's
_OFF_NS: Final = 1_000_000  # [ns] of off frames at a time, while nothing comes
_IDLE_NS: Final = 200_000  # between looks at an array that is dry and holds
_KEEP_ALIVE_NS: Final = 200_000_000  # a pat16 forgets in 0.8 s
_SILENCE: Final = Dose(1, None, None, 0.0, 0.0)
_EARLY_NS: Final = 400_000  # before the array is dry, the writer fills


@dataclass(frozen=True)
class WriterPace:
    """How far ahead frames are written, and what happens when none come. Times in [s].

    An array holds its last frame while nothing comes, for `hold`; then the writer plays it at falling levels for
    `fade`; then the array is off.
    """

    lead: float = 6e-3
    hold: float = 20e-3
    fade: float = 30e-3


@dataclass
class Tally:
    """What a writer has counted since it was made."""

    frames: int = 0
    """Frames of content that arrays took."""
    late: int = 0
    """Frames left out because they came too late, or not at all, while the array held the one before."""
    faded: int = 0
    """Frames in whose place the writer faded or was silent."""
    stalls: int = 0
    """How often nothing came for longer than the hold."""


class PacedWriter:
    """Writes contents to started links, from one thread, one content at a time; silent while there is none.

    Frame k of a content is due at its start + k / update rate. The writer knows which frame is due when an array has
    played all that it has, `head`. Frames before it cannot be in time any more and are left out. So an array lags by
    less than a period, however often the machine stalls.

    Args:
        links: started at `divider`.
        divider: of the update rate.
        pace: how far ahead, and what happens when nothing comes.
        limits: of each array.
        began_ns: when a frame that the first array took began to play, by its number since `start` [ns]; None before.
            None instead of a function: the time when it is due counts.
        emitted: called with whether a pose is of the content that was played last, its number, its stamp and when its
            first frame was played, [ns] each.
        skipped: called with first frame, count, and why they were not played.
    """

    def __init__(
        self,
        links: Sequence[Link],
        divider: int,
        *,
        pace: WriterPace,
        limits: Limits,
        began_ns: Callable[[int], int | None] | None = None,
        emitted: Callable[[bool, int, int, int], object] = lambda is_current, number, stamp_ns, began_ns: None,
        skipped: Callable[[int, int, int], object] = lambda first, count, why: None,
    ) -> None:
        self.tally = Tally()
        self.guards = [Guard(limits, link.array) for link in links]
        self._links, self._pace = links, pace
        self._clock = links[0].clock
        self._period_ns = round(1e9 / links[0].array.update_rate(divider))
        self._lead_ns = round(pace.lead * 1e9)
        self._hold_ns, self._fade_ns = round(pace.hold * 1e9), round(pace.fade * 1e9)
        self._began_ns, self._emitted, self._skipped = began_ns, emitted, skipped
        self._off = [link.off_bytes[: link.array.frame_bytes] for link in links]
        self._content: Content | None = None
        self._newest: Content | None = None  # the content that plays, or that played last
        self._start_ns: int = 0
        self._head: int = 0
        self._end: int = 0  # behind the last frame of content
        self._written = 0  # frames that the first link took since it was started
        self._last = list(self._off)  # frame that each array plays when nothing new comes
        self._fading: list[list[bytes]] = []
        self._is_on = False  # whether the last frame emits
        self._is_stalled = False
        self._wrote_ns = self._clock.now_ns()
        self.dry_ns = self._wrote_ns
        """When the arrays will have played all that was written [ns], if they were dry before the last stop."""
        self._pose: tuple[int, int] | None = None  # number and stamp of one none of whose frames has been written
        self._marks: deque[tuple[Content | None, int, int, int, int]] = deque()  # pose number, stamp, frame number, due

    @property
    def is_idle(self) -> bool:
        """Whether there is no content, and all that was written has been played."""
        return self._content is None and self._clock.now_ns() >= self.dry_ns

    def play(self, content: Content) -> None:
        """Begin a content, in place of the one before."""
        for guard in self.guards:
            guard.start()
        self._content = self._newest = content
        self._start_ns, self._is_stalled, self._pose = 0, False, None

    def stop(self) -> None:
        """End the content: off frames follow what has been written."""
        self._content = None
        if self._is_on:
            self._write_off(1)

    def report_emission(self) -> None:
        """Tell when first frames of poses were played, as far as that is known."""
        while self._marks:
            content, number, stamp_ns, frame, due_ns = self._marks[0]
            began_ns = due_ns if self._began_ns is None else self._began_ns(frame)
            if began_ns is None:
                if self._clock.now_ns() - due_ns < _UNKNOWN_NS:
                    return
                self._marks.popleft()  # a board that plays nothing, or has forgotten when
                continue
            self._marks.popleft()
            self._emitted(content is self._newest, number, stamp_ns, began_ns)

    def step(self) -> int:
        """Write what is due by now; returns when to be called again at the latest [ns], by the links' clock.

        Raises `SafetyLimitError` beyond a limit, `LinkError` where an array fails.
        """
        now_ns = self._clock.now_ns()
        self.report_emission()
        content = self._content
        if content is None or not content.start_ns:
            return self._rest(now_ns)
        if content.start_ns != self._start_ns:
            self._start_ns = content.start_ns
            self._head = self._end = self._due(max(now_ns, self.dry_ns))
        until = self._due(now_ns + self._lead_ns)
        for _ in range(_SLICES_A_STEP):
            piece = content.take(max(self._head, self._due(self._clock.now_ns())), until)
            if piece is None:
                break
            self._write(piece)
            content.done()
        else:  # an array that makes its writer wait must not keep it from orders
            return now_ns
        if content.end is not None and self._head >= content.end:
            self.stop()
            return now_ns
        self._fill(self._clock.now_ns())
        self.dry_ns = dry_ns = self._start_ns + self._head * self._period_ns
        wanted_ns = dry_ns - (_EARLY_NS if content.end is None else max(self._lead_ns // 2, _EARLY_NS))
        return max(wanted_ns, now_ns + _IDLE_NS)

    def _due(self, time_ns: int) -> int:
        """The first frame that is not due before a time [ns]."""
        return -((self._start_ns - time_ns) // self._period_ns)

    def _write(self, piece: Slice) -> None:
        """Write a slice, but for what is late; hold the last frame until its time if it comes early."""
        now_ns = self._clock.now_ns()
        self._pass_by(self._due(now_ns), now_ns, LATE)
        skip = self._head - piece.first
        if piece.pose_number is not None:
            self._pose = piece.pose_number, piece.stamp_ns
        if skip >= piece.frame_count:
            return
        if skip < 0:
            self._repeat(self._last, -skip)
            skip = 0
        self._is_stalled = False
        if self._pose is not None:
            self._marks.append(
                (self._newest, *self._pose, self._written, self._start_ns + self._head * self._period_ns)
            )
            self._pose = None
        count = piece.frame_count - skip
        if (behind := min(self._behind(), count - 1)) > 0:
            self._skip(behind, LATE)
            skip, count = skip + behind, count - behind
        for place, link in enumerate(self._links):
            size = link.array.frame_bytes
            dose = piece.doses[place] if piece.blocks else _SILENCE._replace(frames=piece.frame_count)
            self.guards[place].admit(dose, self._start_ns + piece.first * self._period_ns, self._period_ns)
            if piece.blocks is None:
                data = array("B", self._off[place] * count)
            else:
                data = array("B")
                data.frombytes(piece.blocks[place][skip * size :])
            self._last[place] = data[-size:].tobytes()
            link.write(data)
        self._is_on = piece.blocks is not None and any(dose.last_on == dose.frames - 1 for dose in piece.doses)
        self._advance(count)
        self._end = self._head
        self.tally.frames += count

    def _behind(self) -> int:
        """Frames that wait on their way to an array beyond the lead: to be left out, or they would add up to a lag."""
        most, lead = 0, self._lead_ns // self._period_ns
        for link in self._links:
            waiting = link.bytes_under_way // link.array.frame_bytes - max(lead - link.array.fifo_frames, 0)
            if (queued := link.queue_frames) is not None:
                waiting = max(waiting, queued - lead)
            most = max(most, waiting - _BEHIND_NS // self._period_ns)
        return most

    def _pass_by(self, due: int, now_ns: int, why: int) -> None:
        """The arrays are dry: what was due in the meantime is not played any more."""
        if due <= self._head:
            return
        if self._is_on:
            for guard in self.guards:
                guard.hold(now_ns)
        if self.tally.frames:
            self._skip(due - self._head, why)
        else:
            self._head = due

    def _skip(self, count: int, why: int) -> None:
        """Leave so many frames out."""
        self.tally.late += count
        self._skipped(self._head, count, why)
        self._head += count

    def _fill(self, now_ns: int) -> None:
        """Where nothing has come for the hold: fade, then off frames, as far ahead as little as it takes."""
        dry_ns = self._start_ns + self._head * self._period_ns
        stalled_ns = now_ns - (self._start_ns + self._end * self._period_ns)
        if stalled_ns < self._hold_ns or dry_ns - now_ns > _EARLY_NS:
            return
        self._pass_by(self._due(now_ns), now_ns, HELD)
        count = max(1, _OFF_NS // self._period_ns)
        if not self._is_stalled:
            self._is_stalled = True
            self.tally.stalls += self._is_on
            self._fading = [
                kind_of(link.array).layout.faded(frame, link.array.transducer_count, _FADE_STEPS)
                if self._is_on
                else [frame]
                for frame, link in zip(self._last, self._links, strict=True)
            ]
        step = (stalled_ns - self._hold_ns) * _FADE_STEPS // max(self._fade_ns, 1)
        frames = [steps[min(max(step, 0), len(steps) - 1)] for steps in self._fading]
        if step >= _FADE_STEPS - 1:
            frames, self._is_on = self._off, False
        self.tally.faded += count
        self._skipped(self._head, count, FADED)
        self._repeat(frames, count)

    def _repeat(self, frames: Sequence[bytes], count: int) -> None:
        """Write a frame several times; the guards see it as the last one held."""
        for place, link in enumerate(self._links):
            if self._is_on:
                self.guards[place].hold(self._clock.now_ns())
            elif frames[place] is self._off[place]:
                self.guards[place].silence(self._clock.now_ns())
            self._last[place] = frames[place]
            link.write(array("B", frames[place] * count))
        self._advance(count)

    def _advance(self, count: int) -> None:
        """So many frames were written."""
        self._head += count
        self._written += count
        self._wrote_ns = self._clock.now_ns()
        self.dry_ns = max(self.dry_ns, self._wrote_ns) + count * self._period_ns

    def _rest(self, now_ns: int) -> int:
        """Nothing to play: an off frame now and then, since some boards forget how they are aligned in a pause."""
        if self._is_on or now_ns - self._wrote_ns >= _KEEP_ALIVE_NS:
            self._write_off(1)
        alive_ns = self._wrote_ns + _KEEP_ALIVE_NS
        return min(self.dry_ns, alive_ns) if now_ns < self.dry_ns else alive_ns

    def _write_off(self, count: int) -> None:
        self._is_on = False
        self._repeat(self._off, count)
