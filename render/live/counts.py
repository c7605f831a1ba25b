"""What a live run is judged by: time from a hand's place to the first focal point, frames dropped, ages of poses."""

import re
import threading
from array import array
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

AGAIN = re.compile(r" \(([\d,]+) times since it was reported last\)$")
FAULTS_MOST = 100  # that are told apart


@dataclass(frozen=True)
class Durations:
    """Of some durations [s]: the middle, the 99 % quantile, the longest; NaN of none."""

    p50: float
    p99: float
    longest: float

    @classmethod
    def of(cls, seconds: Any) -> "Durations":
        """Of durations [s]."""
        if not len(seconds):
            return cls(np.nan, np.nan, np.nan)
        p50, p99 = np.quantile(seconds, (0.5, 0.99))
        return cls(float(p50), float(p99), float(np.max(seconds)))

    def __repr__(self) -> str:
        return f"Durations({self.p50 * 1e3:.1f}, {self.p99 * 1e3:.1f}, {self.longest * 1e3:.1f} ms)"


@dataclass(frozen=True)
class RunStatistics:
    """Of a live run, so far or at its end: `Live.statistics` and `Session.statistics` give it.

    >>> from palpate.render import Session
    >>> with Session("emulator") as session:
    ...     statistics = session.statistics()
    >>> statistics.poses  # no live stimulus was played
    0
    """

    seconds: float
    """Since the first focal point [s]."""
    latency: Durations
    """From the time stamp of a pose to its first focal point [s]."""
    latency_recent: Durations
    """The same of the last 200 poses."""
    age: Durations
    """How old the pose is that is played when the next one takes over [s]."""
    poses: int
    """Poses whose focal points were played."""
    superseded: int
    """Poses that a newer one overtook before they were drawn."""
    refused: int
    """Poses that could not be drawn: `faults` says why."""
    skipped: int
    """Frames of the tracker that its source left out: late, too many, or wrong."""
    frames: int
    """Frames that the array took."""
    dropped: int
    """Frames that were not played as drawn: those that came late, and those in whose place the writer faded."""
    dropped_seconds: int
    """Seconds of the run in which at least one was."""
    stalls: int
    """How often nothing came for longer than the writer's hold."""
    emission: str
    """Where the times of focal points come from: "board" (a model of the board says) or "estimate"."""
    realtime: bool
    """Whether writer and renderer have real-time scheduling."""
    pose_seconds: float
    """What a pose takes from its arrival to its frames, the middle of those tried at the start [s]."""
    frames_on: int = 0
    """Frames in which something is drawn: the hand met the object."""
    faults: dict[str, int] = field(default_factory=dict)
    """What went wrong, and how often."""

    def __repr__(self) -> str:
        return (
            f"RunStatistics({self.seconds:.3g} s, {self.poses} poses, latency {self.latency!r}, {self.dropped} of "
            f"{self.frames} frames dropped)"
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


class LiveCounts:
    """Gathers statistics from what processes tell; may be asked from another thread.

    Of many poses the last 400,000 count: over an hour.
    """

    MOST = 400_000

    def __init__(self, *, period: float, emission: str) -> None:
        self._period, self._emission = period, emission
        self._lock = threading.Lock()
        self._latency, self._age = array("d"), array("d")
        self._stamp_ns: int | None = None  # of the pose that is played
        self._first_ns = self._last_ns = 0
        self._seconds: set[int] = set()
        self._counts: Counter[str] = Counter()
        self._faults: Counter[str] = Counter()
        self.realtime = True
        self.pose_seconds = np.nan

    def begin(self) -> None:
        """Poses of another run follow: the last one of the run before has no age when the first one comes."""
        with self._lock:
            self._stamp_ns = None

    def add_poses(self, rows: list[list[int]]) -> None:
        """Numbers, stamps and times of the first focal points [ns]."""
        with self._lock:
            for _, stamp_ns, began_ns in rows:
                self._first_ns = self._first_ns or began_ns
                self._last_ns = began_ns
                self._latency.append((began_ns - stamp_ns) * 1e-9)
                if self._stamp_ns is not None:
                    self._age.append((began_ns - self._stamp_ns) * 1e-9)
                self._stamp_ns = stamp_ns
            if len(self._latency) > 2 * self.MOST:
                del self._latency[: self.MOST], self._age[: self.MOST]

    def add_skipped(self, rows: list[list[int]]) -> None:
        """First sample and count of frames that were not played."""
        with self._lock:
            for first, count, _ in rows:
                last = first + count - 1
                self._seconds.update(range(int(first * self._period), int(last * self._period) + 1))

    def set_counts(self, counts: dict[str, int]) -> None:
        """Counts so far, by their names."""
        with self._lock:
            dict.update(self._counts, counts)  # a Counter's own `update` would add

    def add_fault(self, text: str) -> None:
        """Something that went wrong; a source reports one again with how often it was since."""
        again = AGAIN.search(text)
        count = int(again[1].replace(",", "")) if again else 1
        text = text[: again.start()] if again else text
        with self._lock:
            if text in self._faults or len(self._faults) < FAULTS_MOST:
                self._faults[text] += count

    def latencies(self) -> np.ndarray:
        """From the time stamp of each pose to its first focal point [s], in their order."""
        with self._lock:
            return np.array(self._latency)

    def recent(self) -> dict[str, Any]:
        """What a viewer shows 30 times a second: latency of the last 200 poses, and counts so far, by their names."""
        with self._lock:
            latency, counts, poses = np.array(self._latency[-200:]), self._counts, len(self._latency)
            frames, dropped = counts["frames"], counts["late"] + counts["faded"]
        return {"latency": Durations.of(latency), "poses": poses, "frames": frames, "dropped": dropped}

    def statistics(self) -> RunStatistics:
        """So far."""
        with self._lock:
            counts, latency = self._counts, np.array(self._latency)
            return RunStatistics(
                seconds=(self._last_ns - self._first_ns) * 1e-9,
                latency=Durations.of(latency),
                latency_recent=Durations.of(latency[-200:]),
                age=Durations.of(np.array(self._age)),
                poses=len(latency),
                superseded=counts["superseded"],
                refused=counts["refused"],
                skipped=counts["skipped"],
                frames=counts["frames"],
                dropped=counts["late"] + counts["faded"],
                dropped_seconds=len(self._seconds),
                stalls=counts["stalls"],
                emission=self._emission,
                realtime=self.realtime,
                frames_on=counts["frames_on"],
                pose_seconds=self.pose_seconds,
                faults=dict(self._faults),
            )
