"""A source's clock on this host's: when was a frame's hand there, in CLOCK_MONOTONIC?

A frame arrives some time after it was seen: never earlier, often a little later, sometimes much. So the difference
`arrival - source time` has a lower envelope. This is the offset between the clocks plus the shortest delay of the
tracker's frames, which cannot be known from one side. The envelope is the minimum over a sliding window: it follows
clocks that drift apart, and outlasts delays shorter than the window.
"""

import math
from collections import deque
from typing import NamedTuple

from .hand_frame import MONOTONIC, SourceFault

WINDOW = 4.0
"""[s]; a source's clock that runs slow by 100 ppm makes stamps up to 0.4 ms early: the drift within the window."""
JUMP_AHEAD = 1.0
"""A clock that is ahead by more than this [s] has jumped; one that is ahead by less is followed at once."""
JUMP_BACK = 1.0
"""A frame that is this much [s] before the last one is of a clock that jumped; others came late."""
BEHIND_MOST = 10.0
"""A frame that is older than this [s] at its arrival is not timed by this host's clock, whatever its source says."""
LATE_MOST = 20
"""So many late frames one after the other show that the clock jumped back, or stands still."""
TIME_MOST = 1e11
"""Largest time [s], 3,000 years: float64 counts it in 15 microseconds."""


class Mapped(NamedTuple):
    """A frame's time on this host's clock."""

    stamp_ns: int | None
    """[ns]; None: the frame is late, or its time cannot be used, and it is left out."""
    fault: SourceFault | None = None
    restarted: bool = False
    """Whether the clock jumped: what was measured from the frames before does not go on."""


class ClockMap:
    """Maps times of one source, frame by frame, in the order of their arrival."""

    def __init__(self, clock: str) -> None:
        self.late = 0
        """Frames left out because they are not after the last one."""
        self._is_shared = clock == MONOTONIC
        self._envelope: deque[tuple[float, float]] = deque()  # (arrival, offset): offsets increase from left to right
        self.last = -math.inf
        """The last frame's time on the source's clock [s]."""
        self._stamp_ns = 0
        self._late_in_a_row = 0

    def stamp(self, time: float, arrival_ns: int) -> Mapped:
        """When a frame's hand was there.

        time: on the source's clock [s]. arrival_ns: when it came, CLOCK_MONOTONIC [ns]. Stamps increase strictly, and
        none is after its arrival.
        """
        if not abs(time) <= TIME_MOST:  # a NaN compares false
            problem = f"the time of a frame must be finite and within {TIME_MOST:g} s, not {time!r}"
            return Mapped(None, SourceFault("time", problem))
        arrival = arrival_ns * 1e-9
        fault = None
        if time <= self.last:
            self._late_in_a_row += 1
            if self.last - time < JUMP_BACK and self._late_in_a_row <= LATE_MOST:
                self.late += 1
                return Mapped(None)
            fault = self._restart(
                f"the source's clock stands still at {time:.6f} s"
                if time == self.last
                else f"the source's clock jumped back by {self.last - time:.3f} s, to {time:.3f} s"
            )
        elif (ahead := self._ahead(time, arrival)) > JUMP_AHEAD:
            fault = self._restart(f"the source's clock jumped ahead by {ahead:.3f} s, to {time:.3f} s")
        elif self._is_shared and -ahead > BEHIND_MOST:
            fault = self._restart(
                f"the source's time {time:.3f} s is {-ahead:.3f} s behind this host's CLOCK_MONOTONIC"
            )
        self._late_in_a_row = 0
        self.last = time
        stamp_ns = round(time * 1e9) if self._is_shared else self._mapped_ns(time, arrival)
        self._stamp_ns = max(min(stamp_ns, arrival_ns), self._stamp_ns + 1)
        return Mapped(self._stamp_ns, fault, fault is not None)

    def _ahead(self, time: float, arrival: float) -> float:
        """By how much a time is after the one that is expected at most [s]."""
        if self._is_shared:
            return time - arrival
        return self._envelope[0][1] - (arrival - time) if self._envelope else 0.0

    def _restart(self, what: str) -> SourceFault:
        """Forget the offset; a clock that cannot be this host's is mapped from now on."""
        self._envelope.clear()
        is_shared, self._is_shared = self._is_shared, False
        more = "; its times are no longer taken as this host's" if is_shared else ""
        return SourceFault("clock", f"{what}: its times are mapped anew{more}")

    def _mapped_ns(self, time: float, arrival: float) -> int:
        offset = arrival - time
        envelope = self._envelope
        while envelope and envelope[-1][1] >= offset:
            envelope.pop()
        envelope.append((arrival, offset))
        while envelope[0][0] < arrival - WINDOW:
            envelope.popleft()
        return math.floor((time + envelope[0][1]) * 1e9)
