"""Contours over time -> focal points at the update rate (Frier et al. 2019, Mulot et al. 2021), on any device.

Sample k is shown at time k / update rate, independent of the poses' times, so the two clocks do not drift apart. A new
pose does not restart the drawing: it goes on, one sample further, from the point of the new contours nearest to where
the focal point is, in the same direction. Along contours that stay, every cycle has the same whole number of samples,
so the seam is a step like any other.

What is carried from span to span is in kernels/sampling (`MotionState`): however a motion is cut, its focal points and
counts are the same.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from ...datasets.counted import counted
from ...datasets.motions.last_pose import usual_interval
from ...kernels.motions.widening import widen_poses
from ...kernels.sampling.contour_faults import find_faults
from ...kernels.sampling.spans import SpanRoom
from ..contour_batch import (
    ContourBatch,
    join_batches,
    require_finite,
    require_seams,
    without_empty_polylines,
)
from ..errors import PoseError, StrategyError
from ..runtime.span_workers import warp_device
from ..validation import is_number, value_text
from .metrics import CAUSES, FocalPoints, MotionSamples, SamplingCount, focal_points
from .plan import TICKS, plan_of, shown_order, ticks_of
from .presets import sampling_of
from .revisits import RevisitWatch
from .strategy import SamplingStrategy

CYCLE_LIMIT = 16_384  # samples, 1.6 s at 10 kHz: longer cycles are made as they are played
SPAN_SAMPLES = 1 << 16  # that `sample_contours` draws at once at most
BLOCKS_AHEAD = 8  # blocks of one focus that it draws at once: what a player has waiting, and what it counts too much of
DRAWN_MOST = 1 << 24  # samples that `Sampler.draw` draws at once
ROWS_MOST = 2**31 - 1  # of an array: kernels number them in an int
ROWS_A_POINT = 25  # nodes of a vertex that is passed four times, with a pause each time
NOWHERE = ContourBatch(
    points=np.zeros((0, 3), np.float32),
    kind=np.zeros(0, np.uint8),
    polyline_start=np.zeros(1, np.int64),
    polyline_patch=np.zeros(0, np.int32),
    polyline_closed=np.zeros(0, np.uint8),
    pose_start=np.zeros(2, np.int64),
)
"""One pose without contours."""


class Sampler:
    """Draws motions span by span; keeps where their focal points are, and counts what happens.

    strategy: a sampling strategy, its preset's name or its JSON file. motion_count: how many are drawn side by side.
    device: Warp's. revisits: whether revisits are counted, which takes more time than all else. goes_on: whether each
    motion may have further spans.

    >>> import numpy as np
    >>> from palpate.render import Sampler, render, sample_contours, static_pose
    >>> batch, sampler = render("cube", "palm", static_pose([0, 0, 0.2]), "cc"), Sampler("multi-focus")
    >>> blocks = list(sample_contours([batch], batch.motion.pose, np.zeros(1), 0.2, sampler))
    >>> sampler
    Sampler(SamplingStrategy(speed=7.0, update_rate=10000.0, foci=2), 2000 samples drawn)
    """

    def __init__(
        self,
        strategy: SamplingStrategy | str,
        *,
        motion_count: int = 1,
        device: str = "cpu",
        revisits: bool = True,
        goes_on: bool = True,
    ) -> None:
        self.strategy = strategy = sampling_of(strategy)
        self.device = device = warp_device(device)
        if not (isinstance(motion_count, int | np.integer) and motion_count >= 0):
            raise StrategyError(f"motion_count must be a whole number of 0 or more, not {value_text(motion_count)}")
        points = strategy.pace.points
        shown = np.zeros(0, np.int64) if points is None else shown_order(strategy.order, points)
        self.room = SpanRoom(motion_count, strategy.foci, shown, device, goes_on=goes_on)
        self._plans = {pauses: plan_of(strategy, pauses=pauses) for pauses in (False, True)}
        self._sampled = np.zeros(motion_count, np.int64)  # samples so far
        self._watch = RevisitWatch(motion_count, strategy, device, goes_on=goes_on) if revisits else None
        self._last: _LastPose | None = None  # of `draw`

    def __reduce__(self) -> Any:
        """A sampler is not copied or pickled: two would share the memory of one device."""
        raise TypeError("a Sampler cannot be copied or pickled: make another one, Sampler(sampler.strategy)")

    def __repr__(self) -> str:
        """One line."""
        return f"Sampler({self.strategy!r}, {int(self._sampled.sum())} samples drawn)"

    @property
    def count(self) -> SamplingCount:
        """What the only motion's samples are counted as."""
        (count,) = self.counts
        return count

    @property
    def counts(self) -> list[SamplingCount]:
        """What each motion's samples are counted as."""
        rows = self.room.state.motion.numpy()
        counts = [counted_of(row, self.strategy) for row in rows]
        if self._watch is not None:
            for count, number, wait in zip(counts, *self._watch.totals(), strict=True):
                count.revisits, count.revisit_time = number, wait
        return counts

    def draw(
        self,
        contours: ContourBatch | None,
        pose: np.ndarray,
        sample_count: int,
        *,
        age: float = 0.0,
        hold: float = np.inf,
    ) -> FocalPoints:
        """The next samples, of one pose of the only motion.

        contours: of the pose, a batch of one; None if there are none. The same batch as before is the same pose, which
        goes on. pose: x y z [m] and quaternion, shape [7]. age: how old the pose is at the first of these samples [s],
        `age_at` of it if they are drawn block by block; hold: at what age it starts to fade [s].
        Raises StrategyError for contours that `sample_contours` refuses, for a number of samples that is none, and of
        a sampler of several motions; PoseError for a pose of another shape.
        """
        self._require_motions(1)
        if not (is_number(sample_count) and 0 <= sample_count <= DRAWN_MOST and sample_count == int(sample_count)):
            raise StrategyError(
                f"sample_count must be a whole number of 0..{DRAWN_MOST}, not {value_text(sample_count)}"
            )
        place = np.asarray(pose, np.float64)
        if place.shape != (7,):
            raise PoseError(f"a pose must be seven numbers (x y z, qx qy qz qw), not of shape {place.shape}")
        if not np.isfinite(place).all():
            raise PoseError(f"a pose must be finite, not {place.tolist()}")
        require_times(hold=hold)
        if not math.isfinite(age):  # it may be below 0 by rounding
            raise StrategyError(f"age must be finite, not {value_text(age)}")
        again = self._last is not None and self._last.given is contours
        if not again:
            if not (contours is None or isinstance(contours, ContourBatch)):
                raise StrategyError(f"contours must be a ContourBatch of one pose or None, not {value_text(contours)}")
            if contours is not None and len(contours) != 1:
                raise StrategyError(f"contours must be of one pose, not {len(contours)}: sample_contours draws several")
            batch = drawable_contours((NOWHERE if contours is None else contours).to(self.device))
            self._last = _LastPose(contours, batch.struct, batch.dwell is not None, batch.polyline_count)
        return self._draw_last(place, sample_count, age, hold)

    def draw_struct(
        self, struct: Any, line_count: int, pose: np.ndarray, sample_count: int, *, age: float, hold: float
    ) -> FocalPoints:
        """The next samples of a new pose, whose contours are in a `Contours` that later ones overwrite.

        line_count: of its polylines, each of which has points. `draw_on` draws more of it.
        """
        self._last = _LastPose(struct, struct, struct.dwell is not None, line_count)
        return self._draw_last(pose, sample_count, age, hold)

    def draw_on(self, pose: np.ndarray, sample_count: int, *, age: float, hold: float) -> FocalPoints:
        """More samples of the pose that was drawn last."""
        return self._draw_last(pose, sample_count, age, hold)

    def _draw_last(self, pose: np.ndarray, sample_count: int, age: float, hold: float) -> FocalPoints:
        last, rate, first = self._last, self.strategy.update_rate, int(self._sampled[0])
        if last is None:
            raise ValueError("there is no pose yet to go on with")
        arrays = self.room.draw_pose(
            self._plans[last.pauses],
            last.struct,
            pose,
            line_most=last.line_count,
            first=first,
            number=first,
            count=sample_count,
            time=first * TICKS - ticks_of(age, rate),
            hold=ticks_of(hold, rate),
            goes_on=int(last.drawn),
        )
        last.drawn |= sample_count > 0
        self._sampled[0] += sample_count
        focus = focal_points(*arrays, sample_count)
        if self._watch is not None and sample_count > 0:
            foci = self.strategy.foci
            position, intensity = focus.position.reshape(-1, foci, 3), focus.intensity.reshape(-1, foci)
            self._watch.add(0, position, intensity, np.asarray(pose, np.float64)[None], np.array([sample_count]))
        return focus

    def take(
        self, batch: ContourBatch, struct: Any, pose: np.ndarray | wp.array, span: dict[str, Any]
    ) -> tuple[wp.array, wp.array]:
        """Draw the next span of each motion, from contours on the device that can be drawn (`drawable_contours`).

        struct: `batch.struct`. pose: hand frame -> array frame, float64, shape [pose, 7], or transformd [pose].
        span: `motion_start`, `first`, `count`, `time`, `hold` and `goes_on` of a PoseSchedule. Returns positions [m]
        and intensities, [sample, focus], in arrays that have room for more, and that the next span overwrites.
        """
        start = np.asarray(span["motion_start"], np.int64)
        self._require_motions(len(start) - 1)
        if not self.room.goes_on and self._sampled.any():
            raise StrategyError("this sampler was made for one span of each motion (goes_on=False), and has drawn it")
        self._last = None  # what `draw` has drawn does not go on behind this span
        count = np.asarray(span["count"], np.int64)
        sizes = np.diff(start)
        row = np.cumsum(count) - count
        motion = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
        begin = np.append(row, count.sum())[start]
        number = row + np.repeat(self._sampled - begin[:-1], sizes)
        schedule = span | {"count": count, "motion": motion, "row": row, "number": number}
        line_most = 0
        if self.room.goes_on:
            lines = batch.pose_start.numpy() if batch.on_device else batch.pose_start
            line_most = int(np.diff(lines).max(initial=0))
        plan = self._plans[batch.dwell is not None]
        position, intensity = self.room.draw(plan, struct, schedule, pose, line_most=line_most)
        if self._watch is not None:
            self._watch.take(self.room, position, intensity, start, count, row)
        self._sampled += np.diff(begin)
        return position, intensity

    def _require_motions(self, count: int) -> None:
        """Raise StrategyError unless the sampler has so many motions: kernels would read beyond its arrays."""
        if count != len(self._sampled):
            drawn = counted(len(self._sampled), "motion")
            raise StrategyError(f"motion_count must be {count} for what is drawn, but the sampler has {drawn}")

    def cycle(
        self, contours: ContourBatch, pose: np.ndarray | None = None, *, limit: int = CYCLE_LIMIT
    ) -> FocalPoints | None:
        """One whole period of a pose that stays, overlays included: played again and again it is the pose.

        Starts where a new sampler would; changes nothing. contours: of one pose, which has some. pose: needed for small
        circles only, shape [7]. None where no whole number of samples up to `limit` is a period of everything.
        """
        repeat = int(laid_cycles(contours, self.strategy)["repeat"][0])
        count = period_count(self.strategy, repeat, limit)
        if count is None:
            return None
        own = Sampler(self.strategy, revisits=False, goes_on=False)
        return own.draw(contours, np.array([0, 0, 0, 0, 0, 0, 1.0]) if pose is None else pose, count)


@dataclass
class _LastPose:
    """The pose that a sampler of one motion has drawn last."""

    given: Any
    """The batch, None without contours, or the struct that was drawn instead."""
    struct: Any
    pauses: bool
    """Whether its contours have some of their own."""
    line_count: int
    drawn: bool = False
    """Whether a sample of it has been drawn."""


def sample_bounds(time: np.ndarray, duration: float, update_rate: float) -> np.ndarray:
    """First sample of each pose, and the end of the last pose's samples, int64, shape [pose + 1].

    time: of each pose [s]; duration: how long the samples go on [s]; update_rate [Hz].
    Sample k lies on the contours of the latest pose at time k / update rate.

    >>> from palpate.render import exploration, sample_bounds
    >>> motion = exploration("tube", duration=1.0, rate=90.0)
    >>> sample_bounds(motion.time[:3], motion.duration, 10_000.0)  # 111 or 112 samples a pose
    array([    0,   112,   223, 10000])
    """
    return np.ceil(np.append(time, duration) * update_rate - 1e-6).astype(np.int64)


def age_at(sample: int, time: float, update_rate: float) -> float:
    """Age of a pose at a sample [s]: a whole number of ticks, which `Sampler.draw` finds again.

    sample: counted from time 0. time: of the pose [s]. update_rate: [Hz].
    """
    return float(sample * TICKS - ticks_of(time, update_rate)) / (TICKS * update_rate)


def sample_contours(
    batches: Iterable[ContourBatch],
    pose: np.ndarray,
    time: np.ndarray,
    duration: float,
    sampler: Sampler,
    *,
    block: int = 1024,
    hold: float | None = None,
) -> Iterator[FocalPoints]:
    """Focal points of a motion's contours, in blocks of `block` samples; the last of a batch may be shorter.

    batches: contours of consecutive poses. pose: shape [pose, 7]. time: of the poses, from 0 [s], shape [pose].
    duration: when the last pose ends [s]. hold: age at which a pose starts to fade [s]; None: the strategy's value, or
    twice their usual interval if that is longer.
    Raises StrategyError for a closed polyline with another intensity or pause at its last point than at its first, and
    for points, intensities and pauses that are not finite, and a duration or hold that is no time; PoseError for poses
    and times that are not as many as the contours, and times that do not increase.

    >>> import numpy as np
    >>> from palpate.render import Sampler, render, sample_contours, static_pose
    >>> batch = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")
    >>> blocks = sample_contours([batch], batch.motion.pose, np.zeros(1), 0.2, Sampler("stm"))
    >>> [len(focus.position) for focus in blocks]  # 0.2 s at 10 kHz
    [1024, 976]
    """
    if not isinstance(sampler, Sampler):
        raise StrategyError(f"sampler must be a Sampler, such as Sampler('stm'), not {value_text(sampler)}")
    if isinstance(batches, ContourBatch):
        raise StrategyError("batches must be a list of batches: put the one into brackets")
    if not (is_number(block) and block >= 1 and block == int(block)):
        raise StrategyError(f"block must be a whole number of 1 or more, not {value_text(block)}")
    rate, time, pose = sampler.strategy.update_rate, np.asarray(time, np.float64), np.asarray(pose, np.float64)
    hold = hold_of(time, sampler.strategy) if hold is None else hold
    require_times(duration=duration, hold=hold)
    if pose.shape != (len(time), 7):
        raise PoseError(
            f"poses must have shape [{len(time)}, 7], as there are {len(time)} times, not {list(pose.shape)}"
        )
    if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        raise PoseError("times of poses must be finite and increase")
    bounds, clock, index = sample_bounds(time, duration, rate), ticks_of(time, rate), 0
    for given in batches:
        if index + len(given) > len(time):
            raise PoseError(f"there are contours of more than {len(time)} poses, the number of times and poses")
        batch = drawable_contours(given.to(sampler.device))
        most = min(max(block, BLOCKS_AHEAD * block // sampler.strategy.foci), SPAN_SAMPLES)
        for first, stop, begin, end in spans_of(bounds[index : index + len(batch) + 1], most):
            part = batch if stop - first == len(batch) else drawn_part(batch, first, stop)
            rows = slice(index + first, index + stop)
            starts = np.maximum(bounds[rows], begin)
            span = {
                "motion_start": [0, stop - first],
                "first": starts,
                "count": np.minimum(np.append(starts[1:], end), end) - starts,
                "time": clock[rows],
                "hold": [ticks_of(hold, rate)],
                "goes_on": [int(begin > bounds[index + first])],
            }
            arrays = sampler.take(part, part.struct, pose[rows], span)
            focus = focal_points(*arrays, end - begin)
            for k in range(0, end - begin, block):
                yield FocalPoints(focus.position[k : k + block], focus.intensity[k : k + block])
        index += len(batch)
    if index < len(time):
        raise PoseError(f"there are contours of {index} poses, fewer than the {len(time)} times and poses")


def spans_of(bounds: np.ndarray, most: int) -> Iterator[tuple[int, int, int, int]]:
    """Poses first..stop and samples begin..end of spans of at most so many samples; a long pose is in several of them.

    bounds: first sample of each pose, and the end of the last one's.
    """
    first, begin, last = 0, int(bounds[0]), int(bounds[-1])
    while begin < last:
        end = min(begin + most, last)
        stop = int(np.searchsorted(bounds, end))
        if stop - 1 > first and end < bounds[stop]:  # it is cut between two poses if it can be
            stop -= 1
            end = int(bounds[stop])
        yield first, stop, begin, end
        first, begin = (stop - 1 if end < bounds[stop] else stop), end


def drawn_part(batch: ContourBatch, first: int, stop: int) -> ContourBatch:
    """Poses first..stop of a batch on a device."""
    part, device = batch.numpy().select(first, stop), batch.points.device
    if not wp.get_device(device).is_cpu:
        return part.to(str(device))
    given = {name: wp.array(rows, device="cpu", copy=False) for name, rows in part.by_name().items() if rows.ndim == 1}
    return replace(part, points=wp.array(part.points, dtype=wp.vec3, device="cpu", copy=False), **given)


def joined(parts: list[FocalPoints]) -> FocalPoints:
    """Join consecutive focal points."""
    return parts[0] if len(parts) == 1 else FocalPoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def require_times(**seconds: float) -> None:
    """Raise StrategyError for a negative time, or one that is no number [s]; infinite only as `hold`."""
    for name, value in seconds.items():
        if not (is_number(value) and value >= 0 and (name == "hold" or np.isfinite(value))):
            raise StrategyError(f"{name} must be 0 s or more, not {value_text(value)}")


def hold_of(time: np.ndarray, strategy: SamplingStrategy) -> float:
    """Age at which the poses of a motion start to fade [s]: after a single one no next one is missing."""
    return max(strategy.hold, 2.0 * usual_interval(time)) if len(time) > 1 else np.inf


def drawable_contours(batch: ContourBatch) -> ContourBatch:
    """A batch on a device without polylines that have no point; raises StrategyError for faults that remain."""
    if batch.polyline_count == 0:
        return batch
    faults = find_faults(batch.struct)
    if not faults:
        return batch
    host, title = batch.numpy(), "contours to be drawn"
    require_finite(host, title)
    require_seams(host, title)
    return without_empty_polylines(host).to(str(batch.points.device))


def has_contours(batch: ContourBatch) -> bool:
    """Whether a batch has anything that can be drawn: a polyline that has a length."""
    return bool((batch.length() > 0).any())


def laid_cycles(batch: ContourBatch, strategy: SamplingStrategy) -> np.ndarray:
    """The cycles of poses as each is drawn first, PoseCycle, shape [pose]; `count` is 0 for one without contours.

    `samples`: of a cycle; `repeat`: samples after which they lie where they lay before.
    """
    return lay_each(batch, strategy).cycles.numpy()[: len(batch)]


def laid_jumps(contours: ContourBatch, strategy: SamplingStrategy) -> np.ndarray:
    """Jumps of a focal point in a cycle of one pose [m], from and to, shape [jump, 2, 3]."""
    room = lay_each(contours, strategy)
    count = int(room.cycles.numpy()[0]["count"])
    parameter, point = (array.numpy()[:count] for array in room.nodes)
    at = np.flatnonzero((np.diff(parameter) <= 0) & (np.diff(point, axis=0) != 0).any(axis=1))
    jumps = np.stack([point[at], point[at + 1]], axis=1)
    return np.concatenate([jumps, point[None, [-1, 0]]]) if count else jumps


def lay_each(batch: ContourBatch, strategy: SamplingStrategy, device: str = "cpu") -> SpanRoom:
    """A room with the cycles of poses, each as it is drawn first."""
    device = str(batch.points.device) if batch.on_device else device
    batch = drawable_contours(batch.to(device))
    poses = np.arange(len(batch))
    room = SpanRoom(len(batch), strategy.foci, np.zeros(0, np.int64), device, goes_on=False)
    schedule = {
        "motion_start": np.append(poses, len(batch)),
        "motion": poses,
        "count": np.ones(len(batch), np.int64),
        "goes_on": np.zeros(len(batch), np.int32),
    }
    room.lay(plan_of(strategy, pauses=batch.dwell is not None), batch.struct, schedule)
    return room


def period_count(strategy: SamplingStrategy, cycle_count: int, limit: int) -> int | None:
    """Samples after which everything repeats: cycle and overlays; None if that takes more than `limit`."""
    total = cycle_count
    for overlay in (strategy.am, strategy.lm):
        if overlay is not None:
            turns = Fraction(overlay.frequency) / Fraction(strategy.update_rate)  # a sample
            near = turns.limit_denominator(limit)
            if abs(float(turns - near)) * limit > 1e-6:
                return None
            total = math.lcm(total, near.denominator)
    return total if total <= limit else None


def counted_of(row: np.void, strategy: SamplingStrategy) -> SamplingCount:
    """The counts of a motion from a row of MotionState."""
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


# Many whole motions at once.


def sample_motions(
    batches: ContourBatch | Sequence[ContourBatch],
    pose: np.ndarray | wp.array,
    time: np.ndarray,
    motion_start: np.ndarray,
    duration: np.ndarray,
    strategy: SamplingStrategy | str,
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
    given = [batches] if isinstance(batches, ContourBatch) else batches
    device = str(given[0].points.device) if given[0].on_device else warp_device(device)
    batch = given[0] if len(given) == 1 else join_batches([own.numpy() for own in given])
    strategy = sampling_of(strategy)
    schedule = MotionSchedule.of(time, motion_start, duration, strategy, hold)
    require_motions(batch, pose, schedule, strategy)
    sampler = Sampler(strategy, motion_count=len(schedule.duration), device=device, goes_on=False)
    batch = drawable_contours(batch.to(device))
    arrays = sampler.take(batch, batch.struct, widen_poses(pose, device), schedule.span(strategy))
    return MotionSamples(*arrays, schedule.sample_start, sampler.counts, sampler.room.schedule, sampler.room.pose)


@dataclass(frozen=True, eq=False)
class MotionSchedule:
    """Samples of the poses of motions."""

    motion_start: np.ndarray  # offsets into poses, int64, shape [motion + 1]
    time: np.ndarray  # of poses [s]
    duration: np.ndarray  # when the last pose of each motion ends [s]
    hold: np.ndarray  # age at which a pose starts to fade [s], shape [motion]
    first: np.ndarray  # first sample of each pose, counted from time 0 of its motion, int64
    count: np.ndarray  # samples of each pose, int64

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
        if hold is None:
            hold = np.array([hold_of(time[a:b], strategy) for a, b in itertools.pairwise(start.tolist())])
        return cls(start, time, duration, np.asarray(hold, np.float64), first, np.maximum(stop - first, 0))

    @cached_property
    def sample_start(self) -> np.ndarray:
        """Offsets of motions into samples, int64, shape [motion + 1]."""
        return np.concatenate([[0], np.cumsum(self.count)]).astype(np.int64)[self.motion_start]

    def span(self, strategy: SamplingStrategy) -> dict[str, np.ndarray]:
        """The same as `Sampler.take` has it: whole motions."""
        return {
            "motion_start": self.motion_start,
            "first": self.first,
            "count": self.count,
            "time": ticks_of(self.time, strategy.update_rate),
            "hold": ticks_of(self.hold, strategy.update_rate),
            "goes_on": np.zeros(len(self.duration), np.int32),
        }


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
    rows = ROWS_A_POINT * batch.point_count + sections * len(pose), int(schedule.sample_start[-1])
    if max(rows) > ROWS_MOST:
        raise StrategyError(f"{rows[1]} samples of {len(pose)} poses are too many for one call; divide the motions")
