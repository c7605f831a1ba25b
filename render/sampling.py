"""Sampling strategies: contours over time -> focal points at the update rate (Frier et al. 2019, Mulot et al. 2021).

The focal point runs along a pose's polylines at constant speed, in their order and direction, round and round. A new
pose does not restart it: it goes on from the point of the new contours nearest to where it is, in the same direction
(restarting makes closed contours as loud as open ones). Sample k is shown at time k / update rate, whatever the poses'
times are, so nothing drifts; along a closed contour every step has the same length, the seam included.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

import numpy as np

from .contours import ContourBatch
from .errors import StrategyError
from .hands import rotated

REST = (0.0, 0.0, 0.2)  # [m] where a focal point of intensity 0 is before there was any
JUMP_LENGTH = 5e-3  # [m] a step this long is a jump at any speed
REVISIT_RADIUS = 5e-3  # [m] on the skin: half a focal point's width 0.2 m above an array of 0.16 m
REVISIT_LIMIT = 1.0  # [s] a place not drawn again by then counts as such
CAUSES = ("polyline", "pose", "re-entry")


@dataclass(frozen=True)
class SamplingStrategy:
    """Spatio-temporal modulation at constant speed.

    Raises StrategyError for a value out of its range.
    """

    speed: float = 7.0
    """Of the focal point along the contours [m/s]."""
    update_rate: float = 10_000.0
    """Focal points a second [Hz]: the array's carrier / n."""
    hold: float = 0.1
    """How long a pose is drawn while the next one is missing [s], but at least twice the poses' median interval."""
    fade: float = 0.02
    """How long the intensity then takes to 0 [s], the focal point still moving."""

    def __post_init__(self) -> None:
        """Refuse what is not a motion of a focal point."""
        for name, low, high in (
            ("speed", 1e-3, 100.0),
            ("update_rate", 1.0, 40_000.0),
            ("hold", 0, 60),
            ("fade", 0, 60),
        ):
            value = getattr(self, name)
            if not (np.isfinite(value) and low <= value <= high):
                raise StrategyError(f"{name} must lie in {low:g}..{high:g}, not {value}")

    @property
    def step(self) -> float:
        """Distance between two samples [m]."""
        return self.speed / self.update_rate

    @property
    def jump_threshold(self) -> float:
        """A longer step is a jump [m]: max(2 v / f_s, 5 mm)."""
        return max(2.0 * self.step, JUMP_LENGTH)

    def draw_frequency(self, length: np.ndarray) -> np.ndarray:
        """Nominal draw frequency v / L of contours of these lengths [Hz]; NaN without contour; not capped."""
        length = np.asarray(length, np.float64)
        return np.divide(self.speed, length, out=np.full(length.shape, np.nan), where=length > 0)

    def samples_a_cycle(self, length: float) -> int:
        """Samples on a contour of that length [m]: N = ceil(f_s L / v)."""
        return int(np.ceil(length / self.step * (1 - 1e-12)))

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))


class FocalPoints(NamedTuple):
    """Consecutive focal points at the update rate."""

    position: np.ndarray  # [m], array frame, float32, shape [sample, 3]
    intensity: np.ndarray  # relative pressure amplitude 0..1, float32, shape [sample]


@dataclass
class SamplingCount:
    """What a sampler has done so far."""

    samples: int = 0
    silent: int = 0
    """Samples of intensity 0: no contour, or a pose missing for too long."""
    held: int = 0
    """Samples drawn from a pose older than `hold`."""
    jumps: dict[str, int] = field(default_factory=lambda: dict.fromkeys(CAUSES, 0))
    """Steps longer than the threshold, by cause."""
    jump_length: float = 0.0
    """Sum of their lengths [m]."""
    step_longest: float = 0.0
    """Longest step between two samples that are not silent [m]."""
    revisits: int = 0
    """Times that a place on the skin, picked one after the other, was drawn again."""
    revisit_time: float = 0.0
    """Time waited for that, in vain included [s]."""

    @property
    def revisit_rate(self) -> float | None:
        """How often a place on the skin is drawn in fact [Hz]; None if no place was ever drawn again."""
        return self.revisits / self.revisit_time if self.revisits else None


@dataclass(frozen=True)
class Path:
    """All polylines of a pose, one after the other: segments and the arc length at which each starts."""

    start: np.ndarray  # [m], float64, shape [segment, 3]
    step: np.ndarray  # end - start [m], shape [segment, 3]
    arc: np.ndarray  # arc length at the segments' starts and the total [m], shape [segment + 1]
    intensity: np.ndarray  # at start and end, shape [segment, 2]

    @property
    def length(self) -> float:
        """Of all polylines [m]."""
        return float(self.arc[-1])

    @classmethod
    def of(cls, batch: ContourBatch, pose: int) -> "Path | None":
        """The path of one pose of a batch on the host; None without contours."""
        line = np.arange(batch.pose_start[pose], batch.pose_start[pose + 1])
        if len(line) == 0:
            return None
        first, stop = batch.polyline_start[line[0]], batch.polyline_start[line[-1] + 1]
        points = batch.points[first:stop].astype(np.float64)
        count = np.diff(batch.polyline_start[line[0] : line[-1] + 2])
        inner = np.ones(len(points), bool)
        inner[np.cumsum(count) - 1] = False  # a polyline's last point starts no segment
        index = np.flatnonzero(inner)
        step = points[index + 1] - points[index]
        intensity = np.ones(len(points)) if batch.intensity is None else batch.intensity[first:stop].astype(np.float64)
        length = np.linalg.norm(step, axis=1)
        if length.sum() <= 0:
            return None
        return cls(
            start=points[index],
            step=step,
            arc=np.concatenate([[0.0], np.cumsum(length)]),
            intensity=np.stack([intensity[index], intensity[index + 1]], axis=1),
        )

    def at(self, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points [m], intensities and segments at arc lengths, which wrap around."""
        arc = np.mod(arc, self.length)
        segment = np.clip(np.searchsorted(self.arc, arc, side="right") - 1, 0, len(self.step) - 1)
        t = (arc - self.arc[segment]) / np.diff(self.arc)[segment]
        t = np.clip(t, 0.0, 1.0)[:, None]
        point = self.start[segment] + t * self.step[segment]
        intensity = self.intensity[segment, 0] + t[:, 0] * np.diff(self.intensity[segment], axis=1)[:, 0]
        return point, intensity, segment

    def nearest(self, point: np.ndarray, direction: np.ndarray | None, slack: float) -> float:
        """Arc length of the nearest point that is passed in the given direction.

        A point passed the other way is taken only if it is nearer by more than `slack` [m].
        """
        square = np.einsum("ij,ij->i", self.step, self.step)
        t = np.clip(np.einsum("ij,ij->i", point - self.start, self.step) / np.maximum(square, 1e-30), 0.0, 1.0)
        distance = np.linalg.norm(self.start + t[:, None] * self.step - point, axis=1)
        if direction is not None:
            against = self.step @ direction < -1e-9 * np.sqrt(square)
            distance = distance + slack * against
        best = int(np.argmin(distance))
        return float(self.arc[best] + t[best] * np.sqrt(square[best]))


class Probe:
    """A place on the skin that is watched until the focal point has left it and passed it again.

    It is left and passed where the focal point is farther and nearer than REVISIT_RADIUS; the moment of passing is that
    of the smallest distance, so that a still contour gives v / L.
    """

    def __init__(self, place: np.ndarray) -> None:
        self.age = 0.0  # [s]
        self.passed_at = 0.0  # age at the smallest distance of the pass [s]
        self.passed = False
        self.over = False
        self._place = place
        self._left = False
        self._nearest = np.inf  # smallest distance of the pass under way [m]

    def watch(self, skin: np.ndarray, period: float) -> int:
        """Look at the next points [m], shape [sample, 3]; returns at how many, fewer than all once it is over."""
        distance = np.linalg.norm(skin - self._place, axis=1)
        near = distance < REVISIT_RADIUS
        i = 0 if self._left else first_true(~near)
        self._left = self._left or i < len(near)
        if self._nearest == np.inf:
            i += first_true(near[i:])
        if i < len(near):
            stop = i + first_true(~near[i:])
            best = i + int(np.argmin(np.append(distance[i:stop], np.inf)))
            if stop > i and distance[best] < self._nearest:
                self._nearest, self.passed_at = float(distance[best]), self.age + best * period
            self.passed = self.over = stop < len(near)
            i = stop
        self.age += i * period
        self.over = self.over or self.age > REVISIT_LIMIT
        return max(i, 1)


def first_true(flags: np.ndarray) -> int:
    """Place of the first that holds, their number if none does."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


class Sampler:
    """Draws one pose after another; keeps where the focal point is and counts what happens."""

    def __init__(self, strategy: SamplingStrategy) -> None:
        self.strategy = strategy
        self.count = SamplingCount()
        self._point = np.array(REST)
        self._direction: np.ndarray | None = None
        self._path: Path | None = None  # of the last sample
        self._arc = 0.0  # its arc length there [m]
        self._drawn = False  # something has been drawn
        self._silent = True  # the last sample was
        self._probe: Probe | None = None

    def draw(
        self, path: Path | None, pose: np.ndarray, sample_count: int, *, age: float = 0.0, hold: float = np.inf
    ) -> FocalPoints:
        """The next samples, of one pose.

        path: contours of the pose, None if there are none. pose: x y z [m] and quaternion, shape [7].
        age: how old the pose is at the first of these samples [s]; hold: at what age it starts to fade [s].
        """
        self.count.samples += sample_count
        ages = age + np.arange(sample_count) / self.strategy.update_rate
        gain = np.clip(1.0 - (ages - hold) / max(self.strategy.fade, 1e-9), 0.0, 1.0)
        self.count.held += int(np.count_nonzero(ages > hold))
        if path is None or sample_count == 0:
            self._rest(sample_count)
            return FocalPoints(np.tile(self._point, (sample_count, 1)).astype(np.float32), np.zeros(sample_count, "f4"))
        arc = self._start_on(path) + self.strategy.step * np.arange(sample_count)
        point, intensity, segment = path.at(arc)
        intensity = intensity * gain
        self._count_jumps(point, intensity > 0, "polyline" if path is self._path else "pose")
        self._count_revisits(point, intensity > 0, pose)
        self.count.silent += int(np.count_nonzero(intensity <= 0))
        self._path, self._arc, self._point = path, float(arc[-1]) % path.length, point[-1]
        self._direction = path.step[segment[-1]] / np.linalg.norm(path.step[segment[-1]])
        self._silent, self._drawn = bool(intensity[-1] <= 0), True
        return FocalPoints(point.astype(np.float32), intensity.astype(np.float32))

    def _start_on(self, path: Path) -> float:
        """Arc length of the first sample: one step on from the nearest point, or that point after a silence."""
        if not self._drawn:
            return 0.0
        if path is self._path:
            return self._arc + self.strategy.step
        arc = path.nearest(self._point, self._direction, self.strategy.jump_threshold)
        return arc if self._silent else arc + self.strategy.step

    def _rest(self, sample_count: int) -> None:
        self.count.silent += sample_count
        if sample_count > 0:
            self._silent, self._path, self._probe = True, None, None

    def _count_jumps(self, point: np.ndarray, drawn: np.ndarray, cause_first: str) -> None:
        """Count steps that are too long; `cause_first` is what a jump to the first of the points is due to."""
        steps = np.linalg.norm(np.diff(np.vstack([self._point, point]), axis=0), axis=1)
        from_drawn = drawn & np.concatenate([[not self._silent], drawn[:-1]])
        self.count.step_longest = max(self.count.step_longest, float(steps[from_drawn].max(initial=0.0)))
        jump = from_drawn & (steps > self.strategy.jump_threshold)
        if self._silent and self._drawn and drawn[0] and steps[0] > self.strategy.jump_threshold:
            jump[0], cause_first = True, "re-entry"
        self.count.jumps[cause_first] += int(jump[0])
        self.count.jumps["polyline"] += int(jump[1:].sum())
        self.count.jump_length += float(steps[jump].sum())

    def _count_revisits(self, point: np.ndarray, drawn: np.ndarray, pose: np.ndarray) -> None:
        """Wait, on the skin, until the focal point has left a place and passed it again; then pick the next place."""
        if not drawn.all():
            self._probe = None
            return
        inverse = np.array([-1.0, -1.0, -1.0, 1.0]) * pose[3:]
        skin = rotated(inverse, point - pose[:3])
        first = 0
        while first < len(skin):
            if self._probe is None:
                self._probe = Probe(skin[first])
            first += self._probe.watch(skin[first:], 1.0 / self.strategy.update_rate)
            if self._probe.over:
                self.count.revisits += int(self._probe.passed)
                self.count.revisit_time += self._probe.passed_at if self._probe.passed else self._probe.age
                self._probe = None


def sample_bounds(time: np.ndarray, duration: float, update_rate: float) -> np.ndarray:
    """First sample of each pose and the end of the last, int64, shape [pose + 1].

    Sample k is drawn from the pose that is the latest at time k / update rate.
    """
    return np.ceil(np.append(time, duration) * update_rate - 1e-6).astype(np.int64)


def sample_contours(
    batches: Iterable[ContourBatch],
    pose: np.ndarray,
    time: np.ndarray,
    duration: float,
    sampler: Sampler,
    *,
    block: int = 1024,
) -> Iterator[FocalPoints]:
    """Focal points of a motion's contours, in blocks of at least `block` samples.

    batches: contours of consecutive poses on the host. pose: shape [pose, 7]. time: of the poses, from 0 [s], shape
    [pose]. duration: when the last pose ends [s].
    """
    bounds = sample_bounds(time, duration, sampler.strategy.update_rate)
    # One pose alone is not a motion with a pose missing.
    hold = max(sampler.strategy.hold, 2.0 * float(np.median(np.diff(time)))) if len(time) > 1 else np.inf
    waiting: list[FocalPoints] = []
    index = 0
    for batch in batches:
        for i in range(batch.pose_count):
            first, stop = int(bounds[index]), int(bounds[index + 1])
            path = Path.of(batch, i)
            while first < stop:  # a pose that lasts long is no reason for a long block
                count = min(stop - first, 16 * block)
                age = first / sampler.strategy.update_rate - time[index]
                waiting.append(sampler.draw(path, pose[index].astype(np.float64), count, age=age, hold=hold))
                first += count
                if sum(len(w.intensity) for w in waiting) >= block:
                    yield FocalPoints(*(np.concatenate(parts) for parts in zip(*waiting, strict=True)))
                    waiting = []
            index += 1
    if waiting:
        yield FocalPoints(*(np.concatenate(parts) for parts in zip(*waiting, strict=True)))
