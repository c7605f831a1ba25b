"""Poses inserted between those of a tracker, until contours move by no more than a distance from pose to pose.

A tracker gives a pose every 11 ms; a hand at 0.3 m/s has gone 3 mm by then, and a contour on a slope more. At each new
pose the focal point goes over to where the contour is now, in one step: a hop. Between two poses the hand is taken to
move evenly (positions linear, rotations along the shorter arc), and what is rendered there is the object's own contour.

| intervals | what is done |
|---|---|
| contours move by more than the distance | a pose in the middle, and both halves are looked at again |
| longer than HOLD, so that a player would take the next pose for missing | the same |
| longer than `hold`: a gap in tracking | left as they are: nobody knows where the hand was |
| shorter than twice INTERVAL_LEAST | left as they are: contours appear or disappear there, which is no motion |
"""

from dataclasses import replace

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ...kernels.metrics.contour_shift import find_shifts
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand
from ..intersection.scene import Scene
from ..objects.moving_object import between, object_poses
from ..objects.solid import Solid
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy
from ..validation import require_number

INTERVAL_LEAST = 25e-6  # [s] a period of 40 kHz: no array is updated more often
HOLD = SamplingStrategy().hold  # [s]
SPACINGS = 4  # points that are judged within the distance along a contour
POSES_AT_ONCE = 3 * 1024

Poses = tuple[np.ndarray, np.ndarray]
"""Times [s], float64, shape [pose], and poses, float32, shape [pose, 7]."""


def insert_poses(
    solid: Solid,
    hand: Hand,
    motion: HandMotion,
    strategy: IntersectionStrategy,
    *,
    distance: float,
    object_pose: HandMotion | None = None,
    hold: float = HOLD,
    device: str = "cpu",
) -> HandMotion:
    """The motion with poses inserted where contours would move by more than `distance` [m]; no pose is changed.

    solid, hand, strategy: as in `render`; the hand must be rigid. Where a pose changes, one focal point that follows
    contours without pauses or sections steps by about 4 v / f_s at most if `distance` is 3 v / f_s (measured: 4.03);
    with v / f_s no hop at a new pose was found. With pauses, sections, several focal points or continuity
    "finish" it goes on where these want it, which may be farther: only the contours keep the distance.
    object_pose: motion of an object that moves. hold: an interval longer than this [s] and than twice the median one is
    a gap.
    Raises StrategyError for a hand with poses of its own and a distance below 10 um or above 0.1 m, PoseError for poses
    without times, and what `render` raises.
    """
    require_number("interpolate", distance, 1e-5, 0.1, unit="m")
    if hand.pose_count is not None:
        raise StrategyError(
            f"the hand has {hand.pose_count} poses of its own, between which it is not known: poses are inserted for a "
            "rigid one"
        )
    if motion.time is None:
        raise PoseError("poses are inserted between two times, but this motion has none")
    if object_pose is not None and object_pose.time is None and len(object_pose) > 1:
        raise PoseError("poses are inserted between two times, but the object's motion has none")
    if len(motion) == 1:
        return motion
    places = None if object_pose is None else object_poses(object_pose, motion)
    shift_test = _ShiftTest(Scene.of(solid, hand, strategy, object_pose=places), motion, object_pose, distance, device)
    gap = max(hold, 2.0 * float(np.median(np.diff(motion.time))))
    return _with(motion, _inserted(motion, gap, shift_test))


def _with(motion: HandMotion, inserted: list[Poses]) -> HandMotion:
    """A motion with more poses, in the order of time."""
    time = np.concatenate([motion.time if motion.time is not None else [], *(part[0] for part in inserted)])
    pose = np.concatenate([motion.pose, *(part[1] for part in inserted)])
    order = np.argsort(time, kind="stable")
    count = motion.inserted + len(time) - len(motion)
    return HandMotion(time[order], pose[order], motion.offset, motion.seed, count, motion.provenance)


def _inserted(motion: HandMotion, gap: float, shift_test: "_ShiftTest") -> list[Poses]:
    """Poses to be inserted, level by level of halving; gap: no interval longer than this is halved [s]."""
    time, pose = np.asarray(motion.time), motion.pose
    wanted = shift_test.moves_far(time, pose, np.diff(time) <= gap)
    ends, out = [(a[:-1][wanted], a[1:][wanted]) for a in (time, pose)], []
    while True:
        (t0, t1), (p0, p1) = ends
        long = (t1 - t0) / 2 >= INTERVAL_LEAST
        if not long.any():
            return out
        t0, t1, p0, p1 = t0[long], t1[long], p0[long], p1[long]
        middle = 0.5 * (t0 + t1)
        both = np.stack([p0, p1], axis=1).astype(np.float64).reshape(-1, 7)
        half = between(np.arange(len(both), dtype=np.float64), both, 2.0 * np.arange(len(middle)) + 0.5)
        out.append((middle, half))
        time, pose = np.stack([t0, middle, t1], axis=1).ravel(), np.stack([p0, half, p1], axis=1).reshape(-1, 7)
        compared = np.tile([True, True, False], len(middle))[:-1]
        wanted = np.flatnonzero(shift_test.moves_far(time, pose, compared))
        ends = [(a[wanted], a[wanted + 1]) for a in (time, pose)]


class _ShiftTest:
    """Tells between which poses contours move too far."""

    def __init__(
        self, scene: Scene, motion: HandMotion, object_pose: HandMotion | None, distance: float, device: str
    ) -> None:
        self._scene, self._distance, self._device = scene, distance, device
        self._object_pose, self._offset = object_pose, motion.offset

    def moves_far(self, time: np.ndarray, pose: np.ndarray, compared: np.ndarray) -> np.ndarray:
        """For which of the intervals that are compared another pose is wanted, bool, shape [pose - 1]."""
        wanted = np.zeros(len(compared), bool)
        for first in range(0, len(compared), POSES_AT_ONCE):
            stop = min(first + POSES_AT_ONCE, len(compared))  # one pose more than intervals
            rows = slice(first, stop + 1)
            far = self._far(time[rows], pose[rows], np.append(compared[first:stop], False))
            wanted[first:stop] = far[:-1]
        return wanted | (compared & (np.diff(time) > HOLD))

    def _far(self, time: np.ndarray, pose: np.ndarray, compared: np.ndarray) -> np.ndarray:
        scene = self._scene
        if self._object_pose is not None:
            scene = replace(scene, object_pose=self._places(self._object_pose, time))
        batch = scene.contours(np.ascontiguousarray(pose), 0, self._device)[0].to(self._device)
        spacing = self._distance / SPACINGS
        lines = (batch.points, batch.polyline_start, batch.pose_start)
        return find_shifts(*lines, compared, limit=self._distance - spacing / 2, spacing=spacing)

    def _places(self, object_pose: HandMotion, time: np.ndarray) -> np.ndarray:
        """Where the object is at other times of the hand."""
        if object_pose.time is None or len(object_pose) == 1:
            return np.repeat(object_pose.pose[:1], len(time), axis=0)
        own = object_pose.time + (object_pose.offset - self._offset)
        return between(own, object_pose.pose.astype(np.float64), np.clip(time, own[0], own[-1]))
