"""A batch of contours in memory, read as a contour file is."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..datasets.motions.hand_motion import HandMotion
from .contour_batch import ContourBatch


@dataclass(frozen=True, eq=False)
class BatchRows:
    """A batch read as a contour file is, pose range by pose range."""

    batch: ContourBatch
    motion_of_batch: HandMotion
    path: Path
    """The object's name, for messages."""

    @property
    def pose_count(self) -> int:
        """Number of poses."""
        return len(self.batch)

    def motion(self, first: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
        """Poses first..stop, and their times if there are any."""
        motion = self.motion_of_batch
        poses = {"pose": motion.pose[first:stop]}
        return poses if motion.time is None else poses | {"time": motion.time[first:stop]}

    def blocks(self, *, point_limit: int) -> Iterator[tuple[int, int]]:
        """Pose ranges in order, of up to about so many points."""
        point = self.batch.polyline_start[self.batch.pose_start]
        first = 0
        while first < self.pose_count:
            stop = int(np.searchsorted(point, point[first] + point_limit, side="right")) - 1
            stop = min(max(stop, first + 1), first + point_limit, self.pose_count)
            yield first, stop
            first = stop

    def contours(self, first: int, stop: int) -> dict[str, np.ndarray]:
        """Contours of a range."""
        return ContourBatch.select(self.batch, first, stop).arrays()
