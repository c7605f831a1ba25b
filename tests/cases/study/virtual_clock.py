"""Clocks for simulated studies: one whose time is made of events, and one that skips what a run would wait for."""

import heapq
import itertools
import threading
import time
from collections.abc import Callable

from palpate.render.study.run.desk import StudyClock

SECONDS_MOST = 6 * 3600.0  # after which a run counts as one that never ends
EMPTY_WAITS_MOST = 100  # in a row, with nothing that could end them


class EndlessWaitError(AssertionError):
    """A simulated run waits for something that never happens."""


class VirtualClock(StudyClock):
    """Time of discrete events, for one thread: a wait runs what is planned until its end, in the order of time."""

    def __init__(self, start: float = 1000.0, most: float = SECONDS_MOST) -> None:
        self._now, self._last = start, start + most
        self._events: list[tuple[float, int, Callable[[], object]]] = []
        self._numbers = itertools.count()
        self._empty_waits = 0

    def now(self) -> float:
        """The virtual time [s]."""
        return self._now

    def call_at(self, when: float, action: Callable[[], object]) -> None:
        """Plan an action; those of the same time run in the order in which they were planned."""
        heapq.heappush(self._events, (when, next(self._numbers), action))

    def wait(self, changed: threading.Condition, seconds: float, until: Callable[[], bool] | None = None) -> None:
        """Run what is planned until `until` is true or the time has come; without `until`, the next event alone."""
        end = self._now + seconds
        while until is None or not until():
            if not self._run_next(end) or until is None:
                return

    def sleep(self, seconds: float) -> None:
        """Run what is planned in this time [s]."""
        end = self._now + seconds
        while self._run_next(end):
            pass

    def _run_next(self, end: float) -> bool:
        """Run the next event, if it comes before `end`; otherwise it is `end` now."""
        if not self._events:
            self._empty_waits += 1
            if end == float("inf") or self._empty_waits > EMPTY_WAITS_MOST:
                raise EndlessWaitError(f"nothing is planned at {self._now:.3f} s, and the run waits on")
        if end > self._last:
            raise EndlessWaitError(f"the run has not ended at {self._now:.0f} s")
        if not self._events or self._events[0][0] > end:
            self._now = max(self._now, end)
            return False
        when, _, action = heapq.heappop(self._events)
        self._now = max(self._now, when)
        self._empty_waits = 0
        action()
        return True


class SkippingClock(StudyClock):
    """Real time, to which each wait and each sleep adds at once what it would have lasted."""

    def __init__(self) -> None:
        self.skipped = 0.0
        """Sum of what was not waited for [s]."""

    def now(self) -> float:
        """Real time, and what was skipped [s]."""
        return time.monotonic() + self.skipped

    def wait(self, changed: threading.Condition, seconds: float, until: Callable[[], bool] | None = None) -> None:
        """Return at once, later; what other threads do for `until` takes real time."""
        if until is None:
            self.skipped += seconds
        else:
            super().wait(changed, seconds, until)

    def sleep(self, seconds: float) -> None:
        """Return at once, later."""
        self.skipped += seconds
