"""Poses inserted between those of a tracker, until contours lie within a distance of the next pose's.

A tracker gives a pose every 11 ms; a hand at 0.3 m/s has gone 3 mm by then, and a contour on a slope more. At each new
pose the focal point goes over to where the contour is now, in one step: a hop. Between two poses the hand is taken to
move evenly (positions linear, rotations along the shorter arc), and what is rendered there is the object's own contour.

Every point of a pose's contours then has one of the next pose's within the distance, for that is where the focal point
goes on. Nothing is promised the other way: a part that appears may be farther from the contours before, and a motion
played backwards gets other poses.

| intervals | what is done |
|---|---|
| a point has none of the next contours within the distance | a pose in the middle, and both halves are tested again |
| longer than HOLD, so that a player would take the next pose for missing | the same |
| longer than `hold`: a gap in tracking | left as they are: nobody knows where the hand was |
| shorter than twice INTERVAL_LEAST | left as they are: contours appear or disappear there, which is no motion |
"""

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from ...datasets.motions.hand_motion import HandMotion
from ...datasets.motions.suspicious_values import likely_time_unit
from ...kernels.metrics.contour_shift import find_shifts
from ...kernels.motions.halving import given_rows, halve_intervals, ordered_rows
from ...kernels.offsets import PointLimitError
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand
from ..intersection.batch_rendering import is_too_large
from ..intersection.scene import Scene
from ..objects.moving_object import between, object_poses
from ..objects.solid import Solid
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy
from ..strategies.user_stage_sources import has_own_stages
from ..validation import require_number

INTERVAL_LEAST = 25e-6  # [s] a period of 40 kHz: no array is updated more often
HOLD = SamplingStrategy().hold  # [s]
SPACINGS = 4  # points that are judged within the distance along a contour
POSES_MOST = 4_000_000  # of a motion, inserted ones included; they take about 0.5 GB
POSES_AT_ONCE = 3 * 1024  # on a CPU, and where a user's stage sees them
POSES_ON_GPU = 1 << 16


@dataclass(frozen=True)
class InsertedPoses:
    """Poses of many motions, one motion after the other, with those that were inserted."""

    time: wp.array
    """[s], float64, shape [pose]."""
    pose: wp.array
    """wp.transform, shape [pose]."""
    motion_start: np.ndarray
    """Offsets of motions into poses, int64, shape [motion + 1]."""


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

    Contours move by more where a point of them has none of the next pose's within it; not where parts appear.

    solid, hand, strategy: as in `render`; the hand must be rigid. Where a pose changes, one focal point that follows
    contours without pauses or sections steps by about 4 v / f_s at most if `distance` is 3 v / f_s (measured: 4.03);
    with v / f_s no hop at a new pose was found. With pauses, sections or several focal points it goes
    on where these want it, which may be farther: only the contours keep the distance.
    object_pose: motion of an object that moves. hold: an interval longer than this [s] and than twice the median one is
    a gap.
    Raises StrategyError for a hand with poses of its own and a distance below 10 um or above 0.1 m, PoseError for poses
    without times and for more than POSES_MOST poses, and what `render` raises.
    """
    require_insertion(hand, distance)
    if motion.time is None:
        raise PoseError("poses are inserted between two times, but this motion has none")
    if object_pose is not None and object_pose.time is None and len(object_pose) > 1:
        raise PoseError("poses are inserted between two times, but the object's motion has none")
    if len(motion) == 1:
        return motion
    places = None if object_pose is None else object_poses(object_pose, motion)
    scene = Scene.of(solid, hand, strategy, object_pose=places)
    shift_test = ShiftTest(scene, distance, device, object_pose, motion.offset)
    start = np.array([0, len(motion)])
    denser = insert_into_all(shift_test, motion.time, motion.pose, start, hold=hold)
    time, pose = denser.time.numpy(), denser.pose.numpy()
    count = motion.inserted + len(time) - len(motion)
    return HandMotion(time, pose, motion.offset, motion.seed, count, motion.provenance)


def require_insertion(hand: Hand, distance: float) -> None:
    """Raise StrategyError for a distance out of bounds, and a hand between whose poses nothing is known."""
    require_number("interpolate", distance, 1e-5, 0.1, unit="m")
    if hand.pose_count is not None:
        raise StrategyError(
            f"the hand has {hand.pose_count} poses of its own, between which it is not known: poses are inserted for a "
            "rigid one"
        )


@dataclass(frozen=True)
class ShiftTest:
    """Tells between which poses contours move too far."""

    scene: Scene
    distance: float
    """[m]."""
    device: str
    object_pose: HandMotion | None = None
    """Motion of an object that moves."""
    offset: float = 0.0
    """Of the hand's times [s]."""
    point_limit: int | None = None
    """Contours of no more points are rendered at once, unless two poses have more."""

    def far(self, rows: Any) -> wp.array:
        """Whether contours move too far between each of the rows (IntervalRows) and the next, uint8, shape [row]."""
        count = len(rows.time)
        far = wp.zeros(count, dtype=wp.uint8, device=self.device)
        is_small = wp.get_device(self.device).is_cpu or has_own_stages(self.scene.strategy)
        at_once = POSES_AT_ONCE if is_small else POSES_ON_GPU
        first = 0
        while first < count - 1:
            stop = min(first + at_once, count - 1)
            own = slice(first, stop + 1)  # one pose more than intervals
            limit = self.point_limit if at_once > 1 else None
            try:
                self._test(rows.time[own], rows.pose[own], rows.compared[own], far[own], limit)
            except (PointLimitError, MemoryError, RuntimeError) as error:
                if not is_too_large(error) or at_once == 1:
                    raise
                at_once = max(1, min(at_once, stop - first) // 2)
            else:
                first = stop
        return far

    def _test(self, time: wp.array, pose: wp.array, compared: wp.array, far: wp.array, point_limit: int | None) -> None:
        scene = self.scene
        if self.object_pose is not None:
            scene = replace(scene, object_pose=self._places(self.object_pose, time.numpy()))
        batch = scene.contours(pose, 0, self.device, point_limit=point_limit)[0].to(self.device)
        spacing = self.distance / SPACINGS
        find_shifts(batch.struct, compared, far, limit=self.distance - spacing / 2, spacing=spacing)

    def _places(self, object_pose: HandMotion, time: np.ndarray) -> np.ndarray:
        """Where the object is at other times of the hand."""
        if object_pose.time is None or len(object_pose) == 1:
            return np.repeat(object_pose.pose[:1], len(time), axis=0)
        own = object_pose.time + (object_pose.offset - self.offset)
        return between(own, object_pose.pose.astype(np.float64), np.clip(time, own[0], own[-1]))


def insert_into_all(
    shift_test: ShiftTest,
    time: np.ndarray,
    pose: np.ndarray | wp.array,
    motion_start: np.ndarray,
    *,
    hold: float = HOLD,
) -> InsertedPoses:
    """Insert poses into many motions at once, level by level of halving; the poses of each do not depend on the others.

    time: of all poses, increasing within a motion [s], shape [pose]; pose: float32, shape [pose, 7], or wp.transform
    [pose] on the device; motion_start: offsets of motions into poses. hold: see `insert_poses`. Nothing but counts
    leaves the device, unless the object moves.
    """
    compared = _compared(time, motion_start, hold)
    for first, stop in itertools.pairwise(motion_start.tolist()):
        _require_few(time[first:stop], compared[first:stop], shift_test.distance)
    rows = given_rows(time, pose, compared, shift_test.device)
    parts, count = [rows], len(time)
    for level in itertools.count():
        far = shift_test.far(rows)
        halved = halve_intervals(rows, far, level, hold=HOLD, least=INTERVAL_LEAST)
        if halved is None:
            break
        parts.append(halved.middle)
        count += len(halved.middle.time)
        if count > POSES_MOST * (len(motion_start) - 1):
            reason = "contours move far between poses; a larger distance makes fewer"
            raise PoseError(_too_many(shift_test.distance, count, reason))
        rows = halved.rows
    return InsertedPoses(*ordered_rows(parts, motion_start))


def _require_few(time: np.ndarray, compared: np.ndarray, distance: float) -> None:
    """Raise PoseError for a motion whose intervals, halved until none is longer than HOLD, make too many poses."""
    if len(time) < 2:
        return
    lasting = np.diff(time)
    with np.errstate(over="ignore"):
        halvings = np.ceil(np.log2(np.maximum(np.where(compared[:-1], lasting, 0.0) / HOLD, 1.0)))
        count = 1.0 + float(np.exp2(halvings).sum())
    if count > POSES_MOST:
        unit = likely_time_unit(float(np.median(lasting)), len(time))
        found = "; its times are like a file in " + unit if unit else ""
        raise PoseError(_too_many(distance, count, f"it lasts {time[-1] - time[0]:g} s{found}"))


def _too_many(distance: float, count: float, reason: str) -> str:
    return f"interpolate={distance:g} makes {count:.4g} poses of a motion, at most {POSES_MOST} can be: {reason}"


def _compared(time: np.ndarray, motion_start: np.ndarray, hold: float) -> np.ndarray:
    """Whether contours are compared with those of the next pose: of the same motion, and no gap between them."""
    out = np.zeros(len(time), bool)
    for first, stop in itertools.pairwise(motion_start.tolist()):
        lasting = np.diff(time[first:stop])
        if len(lasting):
            out[first : stop - 1] = lasting <= max(hold, 2.0 * float(np.median(lasting)))
    return out
