"""How fast a sweep's work goes, learnt from what has come: how much of it makes a task of a few seconds.

A *family* is work of one cost a pose: an object, a hand, a strategy, and what is made of the contours. What is known
of one: poses a second, and the most poses that came back in one task. Until something has come back of a family, its
work is taken for as fast as all others on average, and a task holds only so much of it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

TARGET = {"cpu": 2.0, "cuda": 3.0}  # of a task [s]: long beside handing it over, short beside what a kill may lose
POSES_FIRST = {"cpu": 1 << 14, "cuda": 1 << 22}  # of a family in a task, before anything of it has come back
RATE_FIRST = {"cpu": 1e4, "cuda": 2e6}  # [pose/s] until anything has come back: a small mesh, with its loading
GROWTH = 4  # of a family in a task over what has come back of it
SHORTEST = 0.2  # [s] of a task, however little is left: what is shared among workers
PATIENCE = 4.0  # times as long as a task that did not come back in time, its work is supposed to take
BLEND = 0.5  # weight of the last task in a family's rate


@dataclass
class _Known:
    """What has come back of a family."""

    rate: float
    """Poses a second."""
    largest: int
    """Most poses in one task."""


class Pace:
    """Rates by family. kind: of the workers' devices, "cpu" or "cuda"; with both at work, tasks are cut for the CPU."""

    def __init__(self, kind: str) -> None:
        self.target = TARGET[kind]
        self._first = POSES_FIRST[kind]
        self._rate_first = RATE_FIRST[kind]
        self._known: dict[str, _Known] = {}
        self._poses, self._seconds = 0.0, 0.0

    def rate(self, family: str) -> float:
        """Poses a second of one worker, known or supposed."""
        known = self._known.get(family)
        if known is not None:
            return known.rate
        return self._poses / self._seconds if self._seconds > 0.0 else self._rate_first

    def seconds(self, poses: Mapping[str, int]) -> float:
        """What a task with so many poses of each family takes."""
        return sum(count / self.rate(family) for family, count in poses.items())

    def room(self, family: str, taken: Mapping[str, int]) -> int:
        """Poses of a family that a task may still take, whatever its time allows. taken: what it has, by family."""
        known = self._known.get(family)
        if known is not None:
            return GROWTH * known.largest - taken.get(family, 0)
        return self._first - sum(count for other, count in taken.items() if other not in self._known)

    def learn(self, poses: Mapping[str, int], seconds: float) -> None:
        """Take note of a task that came back; its time is shared among families as expected."""
        expected = self.seconds(poses)
        if not (seconds > 0.0 and expected > 0.0):
            return
        factor = expected / seconds
        for family, count in poses.items():
            rate = self.rate(family) * factor
            known = self._known.get(family)
            if known is None:
                self._known[family] = _Known(rate, count)
            else:
                known.rate = 1.0 / ((1.0 - BLEND) / known.rate + BLEND / rate)
                known.largest = max(known.largest, count)
        self._poses += sum(poses.values())
        self._seconds += seconds

    def slow_down(self, poses: Mapping[str, int], seconds: float) -> None:
        """Take note of a task that took so long and had not come back: it would take a multiple."""
        factor = self.seconds(poses) / (PATIENCE * seconds)
        for family, count in poses.items():
            known = self._known.setdefault(family, _Known(self.rate(family), count))
            known.rate *= min(1.0, factor)

    def share(self, left: float, worker_count: int) -> float:
        """Length of the next task [s] when work of `left` seconds is all there is: so that workers end together.

        One worker has nobody to wait for it."""
        if worker_count == 1:
            return self.target
        return min(self.target, max(SHORTEST, left / (2 * worker_count)))


def device_kind(devices: Iterable[str]) -> str:
    """What tasks are cut for: "cuda" if every worker has a GPU, else "cpu"."""
    return "cuda" if all(device.startswith("cuda") for device in devices) else "cpu"
