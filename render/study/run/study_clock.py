"""The clock of a study's run: real time, which tests replace by a time that they make."""

import threading
import time
from collections.abc import Callable


class StudyClock:
    """Time of CLOCK_MONOTONIC, and waiting in it. Tests have subclasses, so that a study takes seconds there."""

    def __repr__(self) -> str:
        """One line."""
        return f"{type(self).__name__}({self.now():.3f} s)"

    def now(self) -> float:
        """The time [s of time.monotonic()]."""
        return time.monotonic()

    def wait(self, changed: threading.Condition, seconds: float, until: Callable[[], bool] | None = None) -> None:
        """Wait on a condition, whose lock the caller holds: until `until` is true, or without it until it is notified.

        seconds: that it takes at most. Without `until` it may return earlier: callers ask again.
        """
        if until is None:
            changed.wait(seconds)
        else:
            changed.wait_for(until, seconds)

    def sleep(self, seconds: float) -> None:
        """Do nothing for a time [s]."""
        time.sleep(seconds)
