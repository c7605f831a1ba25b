"""The silence that a trial needs before it, so that the array's limits hold at each of its moments."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ....device.playing.limits import Limits
from ...errors import StudyError

BUCKET_SLACK = 1.1  # [s]; the guard counts in whole seconds, and a slice of frames as soon as it begins
SILENCE_SLACK = 0.1  # [s]; a pause is planned longer by this much, and a gap that is no pause counts so much longer


@dataclass(frozen=True, kw_only=True)
class EmissionInterval:
    """An interval of a trial as the array's limits see it: emission from its first moment to its last."""

    stimulus: str
    """Name, for messages."""
    seconds: float
    duty: float
    """Mean over the interval, 0..1; at any moment of it the duty may be anything up to 1."""
    gap: float = 0.0
    """Silence before it within its trial [s]."""


@dataclass(frozen=True)
class _Driven:
    """Emission of the past, or of the trial that is judged."""

    start: float
    seconds: float
    driven: float
    """Seconds at full drive that it amounts to."""

    def within(self, first: float, last: float) -> float:
        """The most seconds at full drive that may lie between two times, wherever in the interval its drive is."""
        overlap = min(self.start + self.seconds, last) - max(self.start, first)
        return max(min(overlap, self.driven), 0.0)


class DutyAccount:
    """What an array was driven with, and how long it must rest before the next trial.

    Its answers are on the safe side of what `Guard` (device/playing/limits.py) refuses: it takes the worst distribution
    of each interval's drive, a window longer by the guard's bucket, and pauses longer by what times of onsets may be
    wrong by. Before an interval that came later than planned, ask again for the intervals that are left.

    >>> from palpate.device import Limits
    >>> from palpate.render.study.plan.duty_account import DutyAccount, EmissionInterval
    >>> account = DutyAccount(Limits(on_time_max=10.0))
    >>> account.note(start=0.0, seconds=7.0, duty=1.0)
    >>> account.pause_before(7.0, [EmissionInterval(stimulus="tube", seconds=2.0, duty=1.0)])
    0.0
    >>> round(account.pause_before(7.0, [EmissionInterval(stimulus="tube", seconds=4.0, duty=1.0)]), 3)  # 11 s in all
    1.1
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._window = limits.duty_window + BUCKET_SLACK
        self._past: deque[_Driven] = deque()
        self._on_since: float | None = None  # start of the last emission without a pause
        self._end = float("-inf")  # of what was emitted last

    def __repr__(self) -> str:
        """One line."""
        return f"DutyAccount({len(self._past)} intervals in the last {self._limits.duty_window:g} s, {self._limits})"

    def note(self, start: float, seconds: float, duty: float) -> None:
        """Take emission into account that was, or is about to be: from `start` [s] on, no earlier than any before."""
        if seconds <= 0.0:
            return
        if self._on_since is None or self._is_pause(start - self._end):
            self._on_since = start
        self._end = max(start + seconds, self._end)
        self._past.append(_Driven(start, seconds, duty * seconds))
        while self._past[0].start + self._past[0].seconds <= self._end - self._window:
            self._past.popleft()

    def pause_before(self, now: float, intervals: Sequence[EmissionInterval]) -> float:
        """The least silence [s] from `now` on after which a trial may begin, its first gap not included.

        Raises StudyError where the trial exceeds a limit by itself, after any silence.
        """
        planned, start = [], 0.0  # start: from the trial's beginning on
        for own in intervals:
            start += own.gap
            planned.append(_Driven(start, own.seconds, own.duty * own.seconds))
            start += own.seconds
        self._require_on_time(intervals)
        pause = max(self._pause_for_duty(now, intervals, planned), 0.0)
        if not intervals or self._limits.on_time_max is None or self._on_since is None:
            return pause
        first = now + planned[0].start
        needed = self._end + self._limits.pause_min + SILENCE_SLACK - first
        lengths = _joined(intervals, self._is_pause, self._limits.pause_min)
        # The first intervals go on with what was before, until a gap within the trial is a pause; and a hand may come
        # so late that the silence before them is only just no pause.
        joined_end = max(first + pause, self._end + self._limits.pause_min) + SILENCE_SLACK + lengths[0]
        return pause if joined_end - self._on_since <= self._limits.on_time_max else max(pause, needed)

    def mean_duty(self, now: float) -> float:
        """The highest mean duty that the window which ends now can have, 0..1."""
        first = now - self._limits.duty_window
        return sum(own.within(first, now) for own in self._past) / self._limits.duty_window

    def on_time(self) -> float:
        """Length of the last emission without a pause [s]."""
        return 0.0 if self._on_since is None else self._end - self._on_since

    def _is_pause(self, silence: float) -> bool:
        return silence >= self._limits.pause_min + SILENCE_SLACK / 2

    def _require_on_time(self, intervals: Sequence[EmissionInterval]) -> None:
        limits = self._limits
        longest = max(_joined(intervals, self._is_pause, self._limits.pause_min), default=0.0)
        if limits.on_time_max is not None and longest > limits.on_time_max:
            raise StudyError(
                f"on_time_max: {_names(intervals)} in one trial emit for {longest:.4g} s without a pause of "
                f"{limits.pause_min:g} s, but the bound is {limits.on_time_max:g} s: a gap of "
                f"{limits.pause_min + SILENCE_SLACK:g} s is a pause"
            )

    def _pause_for_duty(self, now: float, intervals: Sequence[EmissionInterval], planned: list[_Driven]) -> float:
        """Silence after which no window that ends within the trial has more than the limit; below 0: none is needed."""
        limits = self._limits
        if limits.duty_max is None:
            return 0.0
        bound, pause = limits.duty_max * limits.duty_window, 0.0
        if sum(own.driven for own in self._past) + sum(own.driven for own in planned) <= bound:
            return 0.0  # all of it may be in one window
        for number, own in enumerate(planned):
            # The sum of a window rises as long as an interval is driven, which at worst is from its beginning on, and
            # falls afterwards: it is highest at these moments.
            moment = own.start + own.driven
            in_trial = sum(other.within(moment - self._window, moment) for other in planned)
            if in_trial > bound * (1 + 1e-12):
                raise StudyError(
                    f"duty_max: {_names(intervals[: number + 1])} in one trial have a mean duty of "
                    f"{in_trial / limits.duty_window:.4g} over {limits.duty_window:g} s (duty_window), but the bound "
                    f"is {limits.duty_max:g}"
                )
            room = bound - in_trial
            for past in reversed(self._past):
                if past.driven > room:
                    # Only `room` of this interval may still be in the window, and nothing older.
                    oldest = past.start + past.seconds - max(room, 0.0)
                    pause = max(pause, oldest + self._window - now - moment)
                    break
                room -= past.driven
        return pause


def _joined(intervals: Sequence[EmissionInterval], is_pause: Callable[[float], bool], pause_min: float) -> list[float]:
    """Lengths [s] of emission without a pause within a trial.

    A gap counts as almost a pause, as a hand may come late, so that it is longer than planned.
    """
    lengths = []
    for number, own in enumerate(intervals):
        if number == 0 or is_pause(own.gap):
            lengths.append(own.seconds)
        else:
            lengths[-1] += max(own.gap, pause_min) + SILENCE_SLACK + own.seconds
    return lengths


def _names(intervals: Sequence[EmissionInterval]) -> str:
    return ", ".join(sorted({own.stimulus for own in intervals}))
