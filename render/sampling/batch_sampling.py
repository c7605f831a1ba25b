"""Focal points of many motions at once, on the device that their contours are on.

One thread a pose lays its track; poses of several polylines in a row share one. Then one thread a motion finds where
drawing goes on along each track, and one thread a pose draws its samples. Focal points and counts are those of the
host's `Sampler`.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from ...datasets.counted import counted
from ...datasets.motions.last_pose import usual_interval
from ...kernels.motions.widening import widen_poses
from ...kernels.sampling.concatenation import concatenate_offsets, concatenate_rows
from ...kernels.sampling.contour_faults import find_faults
from ...kernels.sampling.cursor import PoseSchedule
from ...kernels.sampling.entry import enter_poses
from ...kernels.sampling.finishing import finish_pieces
from ...kernels.sampling.focus import draw_samples
from ...kernels.sampling.skin_boxes import skin_samples
from ...kernels.sampling.sums import sum_counts
from ...kernels.sampling.visits import count_revisits
from ..contour_batch import (
    ContourBatch,
    join_batches,
    require_finite,
    require_seams,
    with_values_of_all,
    without_empty_polylines,
)
from ..errors import StrategyError
from .fading import ticks_of
from .kernel_plan import plan_of
from .metrics import CAUSES, FocalPoints, SamplingCount
from .revisits import PICK_INTERVAL, REVISIT_LIMIT
from .sampler import shown_order
from .strategy import SamplingStrategy

ROWS_MOST = 2**31 - 1  # of an array: kernels number them in an int
ROWS_A_POINT = 25  # nodes of a vertex that is passed four times, with a pause each time


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Focal points of many motions, one motion after the other, and what each was counted as.

    >>> import numpy as np
    >>> from palpate.render import SamplingStrategy, render, sample_motions, static_pose
    >>> batch = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")
    >>> time, start, end = np.zeros(1), np.array([0, 1]), np.array([0.2])  # of one motion, of one pose
    >>> samples = sample_motions(batch, batch.motion.pose, time, start, end, SamplingStrategy())
    >>> len(samples.focus(0).position), samples.counts[0].drawn  # in 0.2 s at 10 kHz
    (2000, 2000)
    """

    position: wp.array
    """[m], array frame, vec3, shape [sample, focus]."""
    intensity: wp.array
    """Relative pressure amplitude 0..1, float32, shape [sample, focus]."""
    sample_start: np.ndarray
    """Offsets of motions into samples, int64, shape [motion + 1]."""
    counts: list[SamplingCount]
    """Of each motion."""
    poses: "DevicePoses"
    """The poses at which they were drawn."""

    def __repr__(self) -> str:
        """One line."""
        samples, motions = counted(int(self.sample_start[-1]), "sample"), counted(len(self.counts), "motion")
        return f"MotionSamples({samples}, {motions})"

    def focus(self, motion: int) -> FocalPoints:
        """Focal points of one motion on the host; raises IndexError for a motion that is not there."""
        count = len(self.counts)
        if not 0 <= motion < count:
            raise IndexError(f"motion {motion} is outside the {counted(count, 'motion')} sampled, numbered from 0")
        first, stop = self.sample_start[motion : motion + 2].tolist()
        foci = self.intensity.shape[1]
        if first == stop:
            position, level = np.zeros((0, foci, 3), np.float32), np.zeros((0, foci), np.float32)
        else:
            position, level = self.position[first:stop].numpy(), self.intensity[first:stop].numpy()
        return FocalPoints(position[:, 0], level[:, 0]) if foci == 1 else FocalPoints(position, level)


@dataclass(frozen=True, eq=False)
class DevicePoses:
    """Poses of many motions on a device."""

    schedule: Any
    """Which samples each has: a PoseSchedule, which type checkers take for no class, as any struct of Warp's."""
    pose: wp.array
    """Hand frame -> array frame, transformd, shape [pose]."""
    motion: wp.array
    """Number of each one's motion, int64, shape [pose]."""


def sample_motions(
    batches: ContourBatch | Sequence[ContourBatch],
    pose: np.ndarray | wp.array,
    time: np.ndarray,
    motion_start: np.ndarray,
    duration: np.ndarray,
    strategy: SamplingStrategy,
    *,
    hold: np.ndarray | None = None,
    device: str = "cpu",
) -> MotionSamples:
    """Focal points of whole motions, and what each is counted as.

    batches: contours of all poses; motions may be cut anywhere between two. Those on a device are drawn there, those
    on the host on `device`. pose: hand frame -> array frame, shape [pose, 7], or wp.transform or transformd [pose] on
    the device. time: of the poses, increasing within a motion [s], shape [pose]. motion_start: offsets into poses,
    shape [motion + 1]. duration: when the last pose of each motion ends [s]. hold: age at which a pose starts to fade
    [s], shape [motion]; None: as for `sample_contours`.
    A sample takes 16 B of memory for each focal point; meanwhile 3 B more, 0.1 KB a pose and as much for each of its
    sections, and 15 KB a motion.
    Raises StrategyError for a closed polyline with another intensity or pause at its last point than at its first, for
    points and intensities that are not finite, and for more samples than a call can number (2**31).

    >>> import numpy as np
    >>> from palpate.render import SamplingStrategy, render, sample_motions, static_pose
    >>> batch = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")
    >>> sample_motions(batch, batch.motion.pose, np.zeros(1), np.array([0, 1]), np.array([0.2]), SamplingStrategy())
    MotionSamples(2000 samples, 1 motion)
    """
    batch = batches if isinstance(batches, ContourBatch) else joined_batches(batches)
    schedule = MotionSchedule.of(time, motion_start, duration, strategy, hold)
    require_motions(batch, pose, schedule, strategy)
    device = str(batch.points.device) if batch.on_device else device
    shape = int(schedule.row[-1]), strategy.foci
    poses = DevicePoses(
        schedule.on(device, strategy),
        widen_poses(pose, device),
        wp.array(schedule.motion, dtype=wp.int64, device=device),
    )
    out = MotionSamples(
        wp.empty(shape, dtype=wp.vec3, device=device),
        wp.empty(shape, dtype=wp.float32, device=device),
        schedule.sample_start,
        [SamplingCount() for _ in schedule.duration],
        poses,
    )
    batch = drawable_contours(batch.to(device))
    if len(out.counts) > 0:
        _draw(batch, schedule, strategy, out)
    return out


def drawable_contours(batch: ContourBatch) -> ContourBatch:
    """A batch on a device without polylines that have no point; raises StrategyError for faults that remain."""
    faults = find_faults(batch.as_struct())
    if not faults:
        return batch
    host, title = batch.numpy(), "contours to be drawn"
    require_finite(host, title)
    require_seams(host, title)
    return without_empty_polylines(host).to(str(batch.points.device))


def joined_batches(batches: Sequence[ContourBatch]) -> ContourBatch:
    """Join batches of consecutive poses, all on the host or all on one device."""
    if len(batches) == 1 or not batches[0].on_device:
        return join_batches(batches)
    if len({frozenset(batch.by_name()) for batch in batches}) > 1:  # as a stage leaves an empty batch as it is
        device = str(batches[0].points.device)
        batches = [batch.to(device) for batch in with_values_of_all([batch.numpy() for batch in batches])]
    named = {name: [getattr(batch, name) for batch in batches] for name in batches[0].by_name()}
    rows = {"polyline_start": [b.point_count for b in batches], "pose_start": [b.polyline_count for b in batches]}
    arrays = {
        name: concatenate_offsets(parts, rows[name]) if name in rows else concatenate_rows(parts)
        for name, parts in named.items()
    }
    return ContourBatch(**arrays)


@dataclass(frozen=True, eq=False)
class MotionSchedule:
    """Which samples the poses of motions have."""

    motion_start: np.ndarray  # offsets into poses, int64, shape [motion + 1]
    time: np.ndarray  # of poses [s]
    duration: np.ndarray  # when the last pose of each motion ends [s]
    hold: np.ndarray  # age at which a pose starts to fade [s], shape [motion]
    first: np.ndarray  # first sample of each pose, counted from time 0 of its motion, int64
    count: np.ndarray  # samples of each pose, int64
    row: np.ndarray  # of a pose's first sample among those of all motions, int64, shape [pose + 1]

    @classmethod
    def of(
        cls,
        time: np.ndarray,
        motion_start: np.ndarray,
        duration: np.ndarray,
        strategy: SamplingStrategy,
        hold: np.ndarray | None,
    ) -> "MotionSchedule":
        """The samples of all poses, as `sample_bounds` gives them for each motion."""
        time, start = np.asarray(time, np.float64), np.asarray(motion_start, np.int64)
        duration = np.asarray(duration, np.float64)
        first = np.ceil(time * strategy.update_rate - 1e-6).astype(np.int64)
        last = np.flatnonzero(np.diff(start) > 0)
        stop = np.append(first[1:], 0)[: len(first)]
        stop[start[last + 1] - 1] = np.ceil(duration[last] * strategy.update_rate - 1e-6).astype(np.int64)
        count = np.maximum(stop - first, 0)
        row = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
        if hold is None:
            hold = np.array([_hold_of(time[a:b], strategy) for a, b in itertools.pairwise(start.tolist())])
        return cls(start, time, duration, np.asarray(hold, np.float64), first, count, row)

    @property
    def sample_start(self) -> np.ndarray:
        """Offsets of motions into samples, int64, shape [motion + 1]."""
        return self.row[self.motion_start]

    @cached_property
    def motion(self) -> np.ndarray:
        """Motion of each pose, int64."""
        return np.repeat(np.arange(len(self.duration)), np.diff(self.motion_start))

    def on(self, device: str, strategy: SamplingStrategy) -> Any:
        """The same on a device."""
        out = PoseSchedule()
        number = self.row[:-1] - self.sample_start[self.motion]
        shown = (
            np.zeros(0, np.int64) if strategy.pace.points is None else shown_order(strategy.order, strategy.pace.points)
        )
        values = {
            "motion_start": self.motion_start,
            "first": self.first,
            "number": number,
            "count": self.count,
            "row": self.row[:-1],
            "shown": shown.astype(np.int64),
        }
        for name, value in values.items():
            setattr(out, name, wp.array(np.ascontiguousarray(value), dtype=wp.int64, device=device))
        out.time, out.hold = (
            wp.array(ticks_of(seconds, strategy.update_rate), dtype=wp.float64, device=device)
            for seconds in (self.time, self.hold)
        )
        return out


def _hold_of(time: np.ndarray, strategy: SamplingStrategy) -> float:
    """Age at which the poses of a motion start to fade [s]."""
    return max(strategy.hold, 2.0 * usual_interval(time)) if len(time) > 1 else np.inf


def require_motions(
    batch: ContourBatch, pose: np.ndarray | wp.array, schedule: MotionSchedule, strategy: SamplingStrategy
) -> None:
    """Raise StrategyError unless contours, poses, times and motions are as many as each other, and not too many."""
    counts = batch.pose_count, len(pose), len(schedule.time), int(schedule.motion_start[-1])
    if len(set(counts)) > 1 or len(schedule.motion_start) != len(schedule.duration) + 1:
        raise StrategyError(
            "contours, poses, times and motions must be of the same poses, not {}, {}, {}, {}".format(*counts)
        )
    sections = 0 if strategy.sections is None else strategy.sections.count
    rows = ROWS_A_POINT * batch.point_count + sections * len(pose), int(schedule.row[-1])
    if max(rows) > ROWS_MOST:
        raise StrategyError(f"{rows[1]} samples of {len(pose)} poses are too many for one call; divide the motions")


def _draw(batch: ContourBatch, schedule: MotionSchedule, strategy: SamplingStrategy, out: MotionSamples) -> None:
    """Draw all motions of a batch on its device."""
    plan, when, pose = plan_of(strategy, pauses=batch.dwell is not None), out.poses.schedule, out.poses.pose
    enter = finish_pieces if strategy.continuity == "finish" else enter_poses
    tracks = enter(batch.as_struct(), plan, when, pose)
    counts, passages = draw_samples(plan, when, tracks, out.poses.motion, out.position, out.intensity)
    sums = sum_counts(plan, when, tracks, counts, passages).numpy()
    skin = skin_samples(when, pose, out.position, out.intensity)
    revisits, waits = _revisits(schedule, strategy, when, skin)
    out.counts[:] = [counted_of(row, strategy) for row in sums]
    for count, number, wait in zip(out.counts, revisits.tolist(), waits.tolist(), strict=True):
        count.revisits, count.revisit_time = number, wait


def _revisits(
    schedule: MotionSchedule, strategy: SamplingStrategy, when: Any, skin: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Picked places that had been visited before, and how long all had waited [s], of each motion."""
    device, rate = skin.position.device, strategy.update_rate
    interval = max(1, round(PICK_INTERVAL * rate))
    start = schedule.sample_start
    picks = np.concatenate([[0], np.cumsum(-(-np.diff(start) // interval))])
    revisits, waits = count_revisits(
        when,
        skin,
        wp.array(start, dtype=wp.int64, device=device),
        wp.array(picks, dtype=wp.int64, device=device),
        interval=interval,
        limit=math.floor(REVISIT_LIMIT * rate),
        rate=rate,
    )
    return revisits.numpy(), waits.numpy()


def counted_of(row: np.void, strategy: SamplingStrategy) -> SamplingCount:
    """The counts of a motion from a row of MotionCount."""
    steps = row["steps"]

    def by_cause(name: str) -> dict:
        return dict(zip(CAUSES, steps[name].tolist(), strict=True))

    return SamplingCount(
        samples=int(row["samples"]),
        silent=int(steps["silent"]),
        held=int(steps["held"]),
        jumps=by_cause("jumps"),
        jump_lengths=by_cause("jump_lengths"),
        step_longest=float(steps["step_longest"]),
        hops=by_cause("hops"),
        hops_longest=by_cause("hops_longest"),
        absence_max=max(int(row["absence"]) - 1, 0) * (1.0 / strategy.update_rate),
        drawn=int(row["drawn"]),
        cycles=float(row["cycles"]),
    )
