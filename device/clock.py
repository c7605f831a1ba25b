"""Clocks, in whole nanoseconds: a carrier period of 25 us is 25,000 of them, so no rounding moves a frame."""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """What a board model and its player read the time from.

    >>> from palpate.device import Clock, VirtualClock
    >>> clock: Clock = VirtualClock()
    >>> clock.sleep_until_ns(25_000)  # [ns], a period of 40 kHz
    >>> clock.name, clock.now_ns()
    ('virtual', 25000)
    """

    @property
    def name(self) -> str:
        """Name for reports."""
        ...

    def now_ns(self) -> int:
        """Time since an arbitrary start [ns]."""
        ...

    def sleep_until_ns(self, time_ns: int) -> None:
        """Return when the clock shows at least `time_ns` [ns]."""
        ...


class MonotonicClock:
    """Real time: a board runs by it unless another clock is given.

    >>> from palpate.device import array_model, open_link
    >>> with open_link(array_model("emulator")) as link:
    ...     link.clock
    MonotonicClock()
    """

    name = "monotonic"

    def __repr__(self) -> str:
        """One line."""
        return "MonotonicClock()"

    def now_ns(self) -> int:
        """Time since an arbitrary start [ns]."""
        return time.monotonic_ns()

    def sleep_until_ns(self, time_ns: int) -> None:
        """Sleep until the clock shows at least `time_ns` [ns]."""
        while (left := time_ns - time.monotonic_ns()) > 0:
            time.sleep(left * 1e-9)


class VirtualClock:
    """Time that passes only where somebody waits for it: nothing sleeps, and no result depends on the machine.

    >>> from palpate.device import VirtualClock
    >>> clock = VirtualClock()
    >>> clock.advance(3600)  # an hour, at once
    >>> clock
    VirtualClock(3600 s)
    """

    name = "virtual"

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now_ns = 0

    def __repr__(self) -> str:
        """One line."""
        return f"VirtualClock({self.now_ns() / 1e9:g} s)"

    def now_ns(self) -> int:
        """Time since the clock was made [ns]."""
        return self._now_ns

    def sleep_until_ns(self, time_ns: int) -> None:
        """Jump ahead to `time_ns` [ns]; a time in the past changes nothing."""
        with self._lock:
            self._now_ns = max(self._now_ns, time_ns)

    def advance(self, duration: float) -> None:
        """Jump ahead by `duration` [s]."""
        with self._lock:
            self._now_ns += round(duration * 1e9)
