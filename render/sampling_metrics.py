"""What sampling came to: jumps by cause, draw frequency nominal and in fact, and how evenly the skin is dwelt on."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..datasets.rigid import rotated
from .errors import StrategyError

REVISIT_RADIUS = 5e-3  # [m] on the skin: half a focal point's width 0.2 m above an array of 0.16 m
REVISIT_LIMIT = 1.0  # [s] a place not drawn again by then counts as such
LOOK = 512  # samples whose distances from a place are computed at once: those behind its revisit are for nothing
CAUSES = ("polyline", "order", "pose", "re-entry")
"""Why the focal point jumps: from one polyline to the next; because the order or the number of points a cycle asks for
it; because a new pose has its contours elsewhere; because contours come back elsewhere after a silence."""


class FocalPoints(NamedTuple):
    """Consecutive focal points at the update rate."""

    position: np.ndarray  # [m], array frame, float32, shape [sample, 3]; with several foci [sample, focus, 3]
    intensity: np.ndarray  # relative pressure amplitude 0..1, float32, shape [sample] or [sample, focus]


@dataclass
class SamplingCount:
    """What a sampler has done so far."""

    samples: int = 0
    silent: int = 0
    """Samples without contour, of contours of intensity 0, or of a pose missing for too long; a modulated intensity
    that passes 0 is no silence."""
    held: int = 0
    """Samples drawn from a pose older than `hold`."""
    jumps: dict[str, int] = field(default_factory=lambda: dict.fromkeys(CAUSES, 0))
    """Steps longer than the threshold, by cause, of all focal points."""
    jump_lengths: dict[str, float] = field(default_factory=lambda: dict.fromkeys(CAUSES, 0.0))
    """Sums of their lengths [m]."""
    step_longest: float = 0.0
    """Longest step between two samples that are not silent [m]."""
    hops: dict[str, int] = field(default_factory=lambda: dict.fromkeys(CAUSES, 0))
    """Steps that are no jumps, but longer than twice the longest that the focal point makes along these contours, by
    cause, of all focal points."""
    hop_longest: float = 0.0
    """Longest of them [m]."""
    absence_max: float = 0.0
    """Longest time that a polyline which was there from pose to pose was not drawn [s]; silence is left out."""
    drawn: int = 0
    """Samples drawn from contours, faded or not."""
    cycles: float = 0.0
    """Cycles that these were, each by its own contours' number of samples."""
    revisits: int = 0
    """Times that a place on the skin, picked one after the other, was drawn again."""
    revisit_time: float = 0.0
    """Time waited for that, in vain included [s]."""

    @property
    def jump_length(self) -> float:
        """Of all jumps together [m]."""
        return sum(self.jump_lengths.values())

    @property
    def revisit_rate(self) -> float | None:
        """How often a place on the skin is drawn in fact [Hz]; None if no place was ever drawn again."""
        return self.revisits / self.revisit_time if self.revisits else None

    def draw_frequency(self, update_rate: float) -> float | None:
        """Mean nominal draw frequency while something was drawn [Hz]; None if nothing was."""
        return self.cycles * update_rate / self.drawn if self.drawn else None


class Probe:
    """A place on the skin that is watched until a focal point has left it and passed it again.

    It is left and passed where the nearest focal point is farther and nearer than REVISIT_RADIUS; the moment of passing
    is that of the smallest distance, so that a still contour gives v / L.
    """

    def __init__(self, place: np.ndarray) -> None:
        self.place = place  # hand frame [m]
        self.age = 0  # samples looked at
        self.passed_at = 0  # age at the smallest distance of the pass
        self.over = False  # left and passed
        self._left = False
        self._nearest = np.inf  # smallest distance of the pass under way [m]

    def watch(self, distance: np.ndarray) -> int:
        """Look at the next distances [m], shape [sample]; returns at how many, fewer than all once it is over."""
        near = distance < REVISIT_RADIUS
        i = 0 if self._left else first_true(~near)
        self._left = self._left or i < len(near)
        if self._nearest == np.inf:
            i += first_true(near[i:])
        if i < len(near):
            stop = i + first_true(~near[i:])
            best = i + int(np.argmin(np.append(distance[i:stop], np.inf)))
            if stop > i and distance[best] < self._nearest:
                self._nearest, self.passed_at = float(distance[best]), self.age + best
            self.over = stop < len(near)
            i = stop
        self.age += i
        return i


def first_true(flags: np.ndarray) -> int:
    """Place of the first that holds, their number if none does."""
    i = int(flags.argmax()) if len(flags) else 0
    return i if len(flags) and flags[i] else len(flags)


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """Of a unit quaternion xyzw, shape [3, 3]."""
    x, y, z, w = quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


class RevisitWatch:
    """Waits, on the skin, until a place is drawn again; then picks the next place."""

    def __init__(self, count: SamplingCount, update_rate: float) -> None:
        self._count, self._period = count, 1.0 / update_rate
        self._age_most = math.floor(REVISIT_LIMIT * update_rate) + 1
        self._probe: Probe | None = None

    def lose(self) -> None:
        """Forget the place under watch: something was not drawn."""
        self._probe = None

    def watch(self, position: np.ndarray, pose: np.ndarray) -> None:
        """Look at the next focal points [m], array frame, shape [sample, focus, 3], at one pose, shape [7]."""
        first, turn = 0, rotation_matrix(pose[3:])
        while first < len(position):
            if self._probe is None:
                self._probe = Probe((position[first, 0] - pose[:3]) @ turn)
            part = position[first : first + min(LOOK, self._age_most - self._probe.age)]
            off = part - (turn @ self._probe.place + pose[:3])
            distance = np.sqrt(np.einsum("ijk,ijk->ij", off, off))
            distance = distance[:, 0] if distance.shape[1] == 1 else distance.min(axis=1)
            first += self._probe.watch(distance)  # a new probe looks at one at least: it is near its own place
            if self._probe.over or self._probe.age >= self._age_most:
                self._count.revisits += int(self._probe.over)
                waited = self._probe.passed_at if self._probe.over else self._probe.age
                self._count.revisit_time += waited * self._period
                self._probe = None


@dataclass(frozen=True)
class DwellMap:
    """How long focal points were on each cell of the palm's plane."""

    time: np.ndarray
    """[s], shape [cell across, cell along]."""
    across: np.ndarray
    """Edges of the cells along u = X of the hand frame [m], shape [cell across + 1]."""
    along: np.ndarray
    """The same along v = -Z, towards the finger tips [m]."""
    outside: float
    """Time beyond the cells [s]."""
    silent: float
    """Time without a focal point, or at intensity 0 [s]."""

    @property
    def area(self) -> float:
        """Of the cells that were drawn on [m^2]."""
        cell = float(np.diff(self.across)[0] * np.diff(self.along)[0])
        return cell * int(np.count_nonzero(self.time))

    @property
    def mean(self) -> float:
        """Time per area over the cells that were drawn on [s/m^2]; 0 if there is none."""
        return float(self.time.sum() / self.area) if self.area else 0.0

    @property
    def spread(self) -> float:
        """Standard deviation over mean of the times of the cells that were drawn on; 0 where all are alike."""
        drawn = self.time[self.time > 0]
        return float(drawn.std() / drawn.mean()) if len(drawn) else 0.0


def dwell_map(
    blocks: Iterable[FocalPoints],
    pose: np.ndarray,
    bounds: np.ndarray,
    update_rate: float,
    *,
    width: float = 0.085,
    length: float = 0.085,
    cell: float = 1e-3,
) -> DwellMap:
    """Time on the skin per cell of a grid in the hand frame.

    blocks: consecutive focal points from the first sample on. pose: hand frame -> array frame, shape [pose, 7].
    bounds: first sample of each pose and the end of the last (`sample_bounds`), shape [pose + 1].
    width, length, cell: of the grid around the palm's middle [m]. With several foci each has its share of the time.
    Raises StrategyError for a grid of no size and for more samples than `bounds` has.
    """
    if not (0 < cell <= min(width, length) and np.isfinite(width) and np.isfinite(length)):
        raise StrategyError(f"cell must lie between 0 and the grid's {width:g} x {length:g} m, not {cell}")
    shape = round(width / cell), round(length / cell)
    time, first, drawn_count, silent = np.zeros(shape), 0, 0.0, 0.0
    for block in blocks:
        count, foci = len(block.intensity), int(np.prod(block.intensity.shape[1:]))
        if first + count > bounds[-1]:
            raise StrategyError(f"focal points end at sample {first + count}, the poses at sample {bounds[-1]}")
        index = np.searchsorted(bounds, np.arange(first, first + count), side="right") - 1
        position = block.position.reshape(count, foci, 3).astype(np.float64)
        at = pose[index].astype(np.float64)[:, None]
        skin = rotated(at[..., 3:] * np.array([-1.0, -1.0, -1.0, 1.0]), position - at[..., :3])
        drawn = block.intensity.reshape(count, foci) > 0
        u = np.floor((skin[..., 0] + width / 2) / cell).astype(np.int64)[drawn]
        v = np.floor((length / 2 - skin[..., 2]) / cell).astype(np.int64)[drawn]
        inside = (u >= 0) & (u < shape[0]) & (v >= 0) & (v < shape[1])
        flat = u[inside] * shape[1] + v[inside]
        time += np.bincount(flat, minlength=time.size).reshape(shape) / (foci * update_rate)
        drawn_count += len(u) / foci
        silent += (count - len(u) / foci) / update_rate
        first += count
    across = (np.arange(shape[0] + 1) * cell) - width / 2
    along = (np.arange(shape[1] + 1) * cell) - length / 2
    return DwellMap(time, across, along, drawn_count / update_rate - float(time.sum()), silent)
