"""Units cut from what is missing, each some seconds long by the speeds measured so far."""

from __future__ import annotations

from collections.abc import Iterator

from .missing import PendingChunk

SECONDS = {"cpu": 2.0, "cuda": 3.0}  # of a unit: long beside handing it over, short beside what a kill may lose
RATE_FIRST = {"cpu": 1e4, "cuda": 2e6}  # [pose/s] supposed until any unit was made
FIRST_SHARE = 0.25  # of a unit's length, that of the first unit of a family, whose speed is not known
CHUNKS_FIRST, CHUNKS_MOST = 8, 1000  # of a unit of a family whose speed is not known, and of any
BLEND = 0.5  # weight of the last unit in a family's speed


class UnitCutter:
    """Cuts chunks of one family into units; chunks of one place stay together.

    places: as `Missing.places` gives them. poses: to be made of each family.
    """

    def __init__(self, places: Iterator[list[PendingChunk]], poses: dict[str, int]) -> None:
        self._places, self._poses = places, dict(poses)
        self._next: list[PendingChunk] = next(places, [])
        self._rates: dict[str, float] = {}
        self._done_poses, self._done_seconds = 0, 0.0
        self._kind = "cpu"

    @property
    def is_empty(self) -> bool:
        """Whether all was given."""
        return not self._next

    def rate(self, family: str) -> float:
        """Poses a second of one worker: of the family, else of all that was made, else supposed."""
        mean = self._done_poses / self._done_seconds if self._done_seconds else RATE_FIRST[self._kind]
        return self._rates.get(family, mean)

    def seconds_left(self) -> float:
        """For one worker, of what was not given yet."""
        return sum(poses / self.rate(family) for family, poses in self._poses.items())

    def take(self, device: str, worker_count: int = 1) -> list[PendingChunk]:
        """Chunks for one of some workers with a device; none if all was given."""
        self._kind = "cuda" if device.startswith("cuda") else "cpu"
        if not self._next:
            return []
        family = self._next[0].family
        seconds = SECONDS[self._kind] * (1.0 if family in self._rates else FIRST_SHARE)
        room = min(seconds * self.rate(family), self._poses[family] / worker_count)
        most = CHUNKS_MOST if family in self._rates else CHUNKS_FIRST
        chunks: list[PendingChunk] = []
        while self._next and self._next[0].family == family and (not chunks or self._next[0].pose_count <= room):
            if len(chunks) >= most:
                break
            room -= self._next[0].pose_count
            self._poses[family] = max(0, self._poses[family] - self._next[0].pose_count)
            chunks += self._next
            self._next = next(self._places, [])
        return chunks

    def learn(self, family: str, poses: int, seconds: float) -> None:
        """Take note of the time that a unit took."""
        if not poses or seconds <= 0.0:
            return
        known = self._rates.get(family, poses / seconds)
        self._rates[family] = 1.0 / ((1.0 - BLEND) / known + BLEND * seconds / poses)
        self._done_poses += poses
        self._done_seconds += seconds
