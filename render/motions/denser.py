"""Motions with poses inserted between those given, made on the device that their contours are on: many at once."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..intersection.scene import Scene
from ..playback.pose_insertion import ShiftTest, insert_into_all
from .explorations.explored import TimedPoses, joined_rows


@dataclass(frozen=True, eq=False)
class DenserPoses:
    """A motion's poses on a device, those that were inserted among them."""

    time: np.ndarray
    """Of each pose [s]."""
    pose: wp.array
    """Hand frame -> array frame, wp.transform, shape [pose]."""
    inserted: int
    """Number of poses that were inserted."""

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.time)

    def rows(self, first: int, stop: int, device: str) -> Any:
        """Poses first..stop, wp.transform on the device, shape [pose]."""
        return self.pose[first:stop].to(device)


def denser_motions(
    scene: Scene, motions: Sequence[TimedPoses], distance: float, device: str, *, point_limit: int | None = None
) -> list[DenserPoses]:
    """Motions with poses inserted where contours would move by more than a distance [m]; see `insert_poses`.

    point_limit: contours of no more points are rendered at once, if a pose and the next have no more.
    """
    clocks = [np.asarray(motion.time) for motion in motions]
    start = np.concatenate([[0], np.cumsum([len(time) for time in clocks])])
    pose = joined_rows([(motion, 0, motion.count) for motion in motions], device)
    shift_test = ShiftTest(scene, distance, device, point_limit=point_limit)
    made = insert_into_all(shift_test, np.concatenate(clocks), pose, start)
    time, added = made.time.numpy(), (np.diff(made.motion_start) - np.diff(start)).tolist()
    spans = itertools.pairwise(made.motion_start.tolist())
    return [DenserPoses(time[a:b], made.pose[a:b], count) for (a, b), count in zip(spans, added, strict=True)]
