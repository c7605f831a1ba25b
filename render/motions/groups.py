"""Groups of whole motions: rendered, sampled and packed together on one device, within a budget of memory.

| of a group | where | made |
|---|---|---|
| poses, contours | on the device | before the group is given |
| focal points, counts | on the device; counts on the host | when they are asked for |
| numbers | on the host | when they are asked for |
| frames of wire bytes | on the device | block by block, when they are asked for |
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import warp as wp

from ...datasets.motions.hand_motion import HandMotion
from ...datasets.motions.last_pose import end_of_motion, usual_interval
from ...kernels.offsets import PointLimitError
from ..contour_batch import ContourBatch
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand
from ..intersection.batch_rendering import POINT_BYTES, is_too_large
from ..intersection.job import MEMORY_DEFAULT, checked_memory
from ..intersection.named_inputs import hand_of, solid_of
from ..intersection.scene import Scene
from ..objects.solid import Solid
from ..playback.drive import Driver, PackedFrames
from ..playback.focal_points import require_increasing
from ..playback.pose_insertion import require_insertion
from ..runtime.span_workers import warp_device
from ..sampling.metrics import FocalPoints, MotionSamples, dwell_maps
from ..sampling.plan import plan_of
from ..sampling.presets import sampling_of
from ..sampling.sampler import ROWS_A_POINT, ROWS_MOST, sample_motions
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy
from ..strategies.user_stage_sources import has_own_stages
from ..validation import value_text
from .denser import denser_motions
from .explorations.explored import ExploredPoses, HostPoses, TimedPoses, joined_rows
from .numbers import dwell_grid, sampling_numbers

GPU_SHARE = 4  # of a GPU's memory, a group takes a quarter unless told another
POINTS_A_POSE = 32  # supposed until a group has more
TRACK_BYTES = 2500  # of a pose's track without its nodes: 1,000, and 15,000 where a run of several polylines begins
NODE_BYTES = 53  # of a track, which has some at each point of the contours
SECTION_BYTES = 100  # of each section of a track
SAMPLE_BYTES, FOCUS_BYTES, MOTION_BYTES = 3, 20, 15_000  # of what samples, their focal points and motions take
FRAMES_SHARE = 16  # of the budget, a block of wire bytes takes a sixteenth


@dataclass(frozen=True, eq=False)
class MotionGroup:
    """Motions that are rendered together; what is made of their contours is made when it is asked for, and kept.

    >>> from palpate.render import Driver, ExploredPoses, render_motions
    >>> motions = [ExploredPoses.of("cube", duration=1.0, seed=seed) for seed in range(3)]
    >>> (group,) = render_motions("cube", "palm", motions, "cc", "stm", device="cpu")
    >>> group
    MotionGroup(motions 0..3, 270 poses, 30000 samples, on cpu)
    >>> [numbers["samples"] for numbers in group.numbers]
    [10000, 10000, 10000]
    >>> sum(len(packed.amplitude) for packed in group.frames(Driver("pat16")))
    30000
    """

    scene: Scene
    motions: Sequence[TimedPoses]
    sampling: SamplingStrategy
    device: str
    first: int = 0
    """Number of its first motion among all."""
    memory: int = MEMORY_DEFAULT
    """Budget [byte]."""
    contours: ContourBatch = field(init=False)
    """Of all poses, one motion after the other; on the host where a stage of your own left them there."""

    def __post_init__(self) -> None:
        limit = None if len(self.motions) == 1 else min(self._points_that_fit(), ROWS_MOST // ROWS_A_POINT)
        contours, _ = self.scene.contours(self.pose, 0, self.device, point_limit=limit)
        object.__setattr__(self, "contours", contours)

    def __repr__(self) -> str:
        """One line."""
        samples = sum(sample_counts(self.motions, self.sampling))
        return (
            f"{type(self).__name__}(motions {self.first}..{self.stop}, {len(self.pose)} poses, {samples} samples, "
            f"on {self.device})"
        )

    def _points_that_fit(self) -> int:
        """Points of contours for which the budget has room beside everything else."""
        counts = np.array([motion.count for motion in self.motions]), sample_counts(self.motions, self.sampling)
        taken = int(motion_bytes(self.scene, *counts, self.sampling, 0.0).sum())
        return max(0, self.memory - taken) // point_bytes(self.sampling)

    @property
    def points_a_pose(self) -> float:
        """Points of contours by pose, on average."""
        return self.contours.point_count / max(1, len(self.pose))

    @property
    def stop(self) -> int:
        """The motion after its last."""
        return self.first + len(self.motions)

    @cached_property
    def pose(self) -> wp.array:
        """Hand frame -> array frame, wp.transform, shape [pose]."""
        rows = joined_rows([(motion, 0, motion.count) for motion in self.motions], self.device)
        return wp.array(rows, dtype=wp.transform, device=self.device) if isinstance(rows, np.ndarray) else rows

    @cached_property
    def samples(self) -> MotionSamples:
        """Focal points of all motions and what each was counted as."""
        clocks = [np.asarray(motion.time) for motion in self.motions]
        ends, intervals = np.array([end_of(time) for time in clocks]).T
        start = np.concatenate([[0], np.cumsum([len(time) for time in clocks])])
        hold = np.maximum(self.sampling.hold, 2.0 * intervals)
        time = np.concatenate(clocks)
        given = (self.contours, self.pose, time, start, ends, self.sampling)
        return sample_motions(*given, hold=hold, device=self.device)

    @cached_property
    def numbers(self) -> list[dict[str, float | int | None]]:
        """Numbers of each motion: jumps, hops, silence, revisits, dwell, as sweeps have them (`sampling` metrics)."""
        rate = self.sampling.update_rate
        maps = dwell_maps(self.samples, rate, **dwell_grid(self.scene.hand))
        return [sampling_numbers(*own, rate) for own in zip(self.samples.counts, maps, strict=True)]

    def frames(self, driver: Driver) -> Iterator[PackedFrames]:
        """Wire bytes of all focal points, one motion after the other, block by block; each motion starts from rest.

        driver: on this device; it is reset, and nobody else may use it until the last block is given. Raises
        DeviceError for an update rate that an array cannot play.
        """
        for array in driver.arrays:
            array.divider(self.sampling.update_rate)
        points, levels, starts = self.samples.position, self.samples.intensity, self.samples.sample_start
        # phases of several focal points, and of a slew limit, follow the frames before
        together = self.sampling.foci == 1 and driver.strategy.slew is None
        block = max(1, self.memory // (FRAMES_SHARE * sum(array.frame_bytes for array in driver.arrays)))
        for begin, end in [(0, int(starts[-1]))] if together else itertools.pairwise(starts.tolist()):
            driver.reset()
            for first in range(begin, end, block):
                stop = min(first + block, end)
                rests = starts[(starts >= first) & (starts < stop)] - first if together else None
                yield driver.pack(FocalPoints(points[first:stop], levels[first:stop]), rest_start=rests)


def render_motions(
    solid: Solid | str | Path,
    hand: Hand | str,
    motions: Sequence[HandMotion | ExploredPoses],
    strategy: IntersectionStrategy | str = "cc",
    sampling: SamplingStrategy | str | Path = "stm",
    *,
    device: str = "cpu",
    memory: int | None = None,
    interpolate: float | None = None,
) -> Iterator[MotionGroup]:
    """Render many motions, as many at once as a budget allows, without going through the host between the steps.

    solid, hand, strategy, sampling: objects, or names and files, as for `render`; the hand has one shape in all poses.
    motions: with times, of two poses at least; explorations are made on the device. memory: of a group,
    what is made of it included, about [byte]; by default 512 MB on a CPU, a quarter of a GPU's. A motion is never
    divided: where one alone takes more, it has a group of its own, and so has each motion with a stage of your own,
    which may look at its batch. interpolate: insert poses until every contour point has one of the next pose's
    within this [m], as `palpate render --interpolate` does. Results do not depend on how motions are grouped. Contours,
    inserted poses, focal points and wire bytes stay on the device; times and counts do not. A GPU is busy with hundreds
    of motions at once, and takes as long for one.
    Raises StrategyError for a hand of many shapes, an unknown device and too small a budget; PoseError, with the number
    of the motion, for one without times; and what rendering and sampling raise.

    >>> from palpate.render import ExploredPoses, render_motions
    >>> motions = [ExploredPoses.of("tube", duration=1.0, explorer=person) for person in (1, 2, 3, 4, 5, 6)]
    >>> groups = render_motions("tube", "palm", motions, "cc", "stm", memory=50_000_000)
    >>> sum(len(group.contours) for group in groups)
    540
    """
    device = warp_device(device)
    scene, chosen = Scene.of(solid_of(solid), hand_of(hand), strategy), sampling_of(sampling)
    if scene.hand.pose_count is not None:
        raise StrategyError(f"{scene.hand!r} has a shape for each pose: render one motion with it, by `render`")
    if isinstance(motions, HandMotion | ExploredPoses):
        raise PoseError("motions must be a list of motions: put the one into brackets")
    timed = [timed_poses(motion, number) for number, motion in enumerate(motions)]
    memory = group_memory(device, memory)
    if interpolate is None:
        return motion_groups(scene, timed, chosen, device, memory=memory)
    require_insertion(scene.hand, interpolate)
    return denser_groups(scene, timed, chosen, device, memory=memory, distance=interpolate)


def denser_groups(
    scene: Scene,
    motions: Sequence[TimedPoses],
    sampling: SamplingStrategy,
    device: str,
    *,
    memory: int,
    distance: float,
) -> Iterator[MotionGroup]:
    """The same with poses inserted, into as many motions at once as would be a group without; see `motion_groups`."""
    alone = has_own_stages(scene.strategy)
    poses, counts = np.array([motion.count for motion in motions]), sample_counts(motions, sampling)
    first = 0
    while first < len(motions):
        sizes = motion_bytes(scene, poses[first:], counts[first:], sampling, float(POINTS_A_POSE))
        stop = first + max(1, 1 if alone else min(_within(sizes, memory), _within(counts[first:], ROWS_MOST)))
        limit = None if alone else memory // POINT_BYTES
        denser = denser_motions(scene, motions[first:stop], distance, device, point_limit=limit)
        yield from motion_groups(scene, denser, sampling, device, memory=memory, number=first)
        first = stop


def motion_groups(
    scene: Scene,
    motions: Sequence[TimedPoses],
    sampling: SamplingStrategy,
    device: str,
    *,
    memory: int,
    number: int = 0,
) -> Iterator[MotionGroup]:
    """Groups of motions that have times and a rigid hand, in order; see `render_motions`. number: of the first one."""
    first, points, pauses = 0, float(POINTS_A_POSE), False
    poses, counts = np.array([motion.count for motion in motions]), sample_counts(motions, sampling)
    alone = has_own_stages(scene.strategy)  # which may go by the rows of a motion, and by what is in a batch
    while first < len(motions):
        most = len(motions) - first
        while True:
            sizes = motion_bytes(scene, poses[first:], counts[first:], sampling, points, pauses=pauses)
            most = max(1, 1 if alone else min(_within(sizes, memory), _within(counts[first:], ROWS_MOST), most))
            try:
                group = MotionGroup(scene, motions[first : first + most], sampling, device, number + first, memory)
                break
            except (PointLimitError, MemoryError, RuntimeError) as error:
                if not is_too_large(error) or most == 1:
                    raise
                if isinstance(error, PointLimitError):
                    points = max(points, error.count / int(poses[first : first + most].sum()))
                most //= 2
        points, pauses = max(points, group.points_a_pose), pauses or group.contours.dwell is not None
        first += most
        yield group
        del group  # before the next takes as much memory


def _within(sizes: np.ndarray | Sequence[int], most: int) -> int:
    """How many sizes have a sum of at most so much."""
    return int(np.searchsorted(np.cumsum(sizes), most, side="right"))


def group_memory(device: str, memory: int | None = None) -> int:
    """Budget of a group of motions [byte]; raises StrategyError for one that is none or too small."""
    place = wp.get_device(device)
    if memory is None:
        return MEMORY_DEFAULT if place.is_cpu else place.total_memory // GPU_SHARE
    return checked_memory(memory, [device])


def motion_bytes(
    scene: Scene,
    pose_count: np.ndarray,
    sample_count: Sequence[int],
    sampling: SamplingStrategy,
    points_a_pose: float,
    *,
    pauses: bool = False,
) -> np.ndarray:
    """What each motion takes on a device, about [byte]; pauses: whether its contours have any."""
    track = TRACK_BYTES + SECTION_BYTES * (0 if sampling.sections is None else sampling.sections.count)
    pose = scene.pose_bytes + track + point_bytes(sampling, pauses=pauses) * points_a_pose
    samples = np.asarray(sample_count, np.int64) * (SAMPLE_BYTES + FOCUS_BYTES * sampling.foci)
    return pose_count * pose + samples + MOTION_BYTES


def point_bytes(sampling: SamplingStrategy, *, pauses: bool = False) -> int:
    """What a point of contours takes, about, and the nodes of a track there [byte]."""
    return POINT_BYTES + NODE_BYTES * int(plan_of(sampling, pauses=pauses).passes)


def sample_counts(motions: Sequence[TimedPoses], sampling: SamplingStrategy) -> list[int]:
    """Samples of each motion."""
    ends = [end_of(motion.time)[0] if motion.time is not None else 0.0 for motion in motions]
    return [int(np.ceil(end * sampling.update_rate - 1e-6)) for end in ends]


def end_of(time: np.ndarray) -> tuple[float, float]:
    """When a motion ends, as `palpate play` has it, and the usual interval between its poses [s]."""
    return end_of_motion(time), usual_interval(time)


def timed_poses(given: HandMotion | ExploredPoses, number: int) -> TimedPoses:
    """A motion's poses; raises PoseError for what is none, or has no times that increase, of two poses at least."""
    if not isinstance(given, HandMotion | ExploredPoses):
        raise PoseError(f"motion {number}: must be a HandMotion or ExploredPoses, not {value_text(given)}")
    motion: TimedPoses = given if isinstance(given, ExploredPoses) else HostPoses(given)
    if motion.time is None:
        raise PoseError(f"motion {number}: its {motion.count} poses have no times")
    if motion.count < 2:
        raise PoseError(f"motion {number}: has {motion.count} pose, and a motion has 2 at least")
    require_increasing(motion.time, Path(f"motion {number}"))
    return motion
