"""What sampling came to: jumps by cause, draw frequency nominal and in fact, and how evenly the skin is dwelt on."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ...datasets.counted import counted
from ...kernels.sampling.dwelling import cell_row, count_cells
from ...kernels.sampling.layout import PoseSchedule
from ..errors import StrategyError

CAUSES = ("polyline", "order", "pose", "re-entry")
"""Why the focal point jumps: from one polyline to the next; because the order or the number of points a cycle asks for
it; because a new pose has its contours elsewhere; because contours come back elsewhere after a silence."""


class FocalPoints(NamedTuple):
    """Consecutive focal points at the update rate.

    >>> from palpate.render import render, static_pose
    >>> focus = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").sample("stm", duration=0.01).focus
    >>> focus.position.shape, focus.intensity.shape
    ((100, 3), (100,))
    >>> focus.position[0]  # a corner of the palm of 85 mm
    array([-0.0425, -0.0425,  0.2   ], dtype=float32)
    """

    position: np.ndarray  # [m], array frame, float32, shape [sample, 3]; with several foci [sample, focus, 3]
    intensity: np.ndarray  # relative pressure amplitude 0..1, float32, shape [sample] or [sample, focus]

    def __repr__(self) -> str:
        """One line."""
        foci = 1 if self.intensity.ndim == 1 else self.intensity.shape[1]
        each = "1 focus" if foci == 1 else f"{foci} foci"
        return f"FocalPoints({counted(len(self.intensity), 'sample')} of {each})"


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
    hops_longest: dict[str, float] = field(default_factory=lambda: dict.fromkeys(CAUSES, 0.0))
    """Longest of them, by cause [m]."""
    absence_max: float = 0.0
    """Longest time that a polyline which was there from pose to pose was not drawn [s]; silence is left out."""
    drawn: int = 0
    """Samples drawn from contours, faded or not."""
    cycles: float = 0.0
    """Cycles that these were, each by its own contours' number of samples."""
    revisits: int = 0
    """Picked places on the skin that had been drawn before (`revisits`)."""
    revisit_time: float = 0.0
    """How long picked places had waited, in vain included [s]."""

    @property
    def jump_length(self) -> float:
        """Of all jumps together [m]."""
        return sum(self.jump_lengths.values())

    @property
    def hop_longest(self) -> float:
        """Longest hop that can be felt as one [m]: re-entry, which follows a silence, is left out."""
        return max(length for cause, length in self.hops_longest.items() if cause != "re-entry")

    @property
    def revisit_rate(self) -> float | None:
        """How often a place on the skin is drawn in fact [Hz]; None if none was drawn again."""
        return self.revisits / self.revisit_time if self.revisits else None

    def draw_frequency(self, update_rate: float) -> float | None:
        """Mean draw frequency while something was drawn [Hz] (docs/guide/sampling.md); None if nothing was."""
        return self.cycles * update_rate / self.drawn if self.drawn else None


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
    schedule: Any
    """Samples of each pose: a PoseSchedule, which type checkers take for no class, as any struct of Warp's."""
    pose: wp.array
    """Hand frame -> array frame, transformd, shape [pose]."""

    def __repr__(self) -> str:
        """One line."""
        samples, motions = counted(int(self.sample_start[-1]), "sample"), counted(len(self.counts), "motion")
        return f"MotionSamples({samples}, {motions})"

    @property
    def pose_count(self) -> int:
        """Poses of all motions; the arrays of their schedule have room for more."""
        return self.pose.shape[0]

    def focus(self, motion: int) -> FocalPoints:
        """Focal points of one motion on the host; raises IndexError for a motion that is not there."""
        count = len(self.counts)
        if not 0 <= motion < count:
            raise IndexError(f"motion {motion} is outside the {counted(count, 'motion')} sampled, numbered from 0")
        first, stop = self.sample_start[motion : motion + 2].tolist()
        if first == stop:
            return focal_points(self.position, self.intensity, 0)
        return focal_points(self.position[first:stop], self.intensity[first:stop], stop - first)


def focal_points(position: wp.array, intensity: wp.array, count: int) -> FocalPoints:
    """The first focal points of a room on the host, without an axis for foci where there is one."""
    foci = intensity.shape[1]
    if count == 0:
        place, level = np.zeros((0, foci, 3), np.float32), np.zeros((0, foci), np.float32)
    elif wp.get_device(intensity.device).is_cpu:
        place, level = position.numpy()[:count].copy(), intensity.numpy()[:count].copy()
    else:
        place, level = position[:count].numpy(), intensity[:count].numpy()
    return FocalPoints(place[:, 0], level[:, 0]) if foci == 1 else FocalPoints(place, level)


@dataclass(frozen=True)
class DwellMap:
    """How long focal points were on each cell of the palm's plane."""

    time: np.ndarray
    """[s], shape [cell across, cell along]."""
    across: np.ndarray
    """Edges of the cells along u = X of the hand frame [m], shape [cell across + 1]. A place on an edge is in the cell
    above it, on the last edge in the last cell."""
    along: np.ndarray
    """The same along v = -Z, towards the finger tips [m]."""
    outside: float
    """Time beyond the cells [s]."""
    silent: float
    """Time without a focal point, or at intensity 0 [s]."""

    def __repr__(self) -> str:
        """One line."""
        return f"DwellMap({self.area * 1e6:.4g} mm^2 drawn, {self.time.sum():.4g} s there, {self.silent:.4g} s silent)"

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
    width, length: of the grid around the palm's middle, its border included [m]. cell: longest side of a cell [m]; they
    are equal and fill the grid. With several foci each has its share of the time.
    Raises StrategyError for a grid of no size and for more samples than `bounds` has.

    >>> import numpy as np
    >>> from palpate.render import dwell_map, render, static_pose
    >>> batch = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")
    >>> sampled = batch.sample("stm", duration=0.1)
    >>> skin = dwell_map([sampled.focus], batch.motion.pose, np.array([0, 1000]), 10_000.0)
    >>> skin.time.shape, int(np.count_nonzero(skin.time))  # cells of 1 mm: the palm's, those of its border
    ((85, 85), 336)
    """
    if not (0 < cell <= min(width, length) and np.isfinite(width) and np.isfinite(length)):
        raise StrategyError(f"cell must lie between 0 and the grid's {width:g} x {length:g} m, not {cell}")
    across, along = (cell_edges(extent, cell) for extent in (width, length))
    rows = [cell_row(float(edges[0]), float(edges[-1]), len(edges) - 1) for edges in (across, along)]
    cells, samples, foci = np.zeros((len(across) - 1) * (len(along) - 1) + 1, np.int64), 0, 1  # blocks change no bit
    for block, first, count in poses_of_samples(blocks, bounds):
        number = len(block.intensity)
        foci, samples = int(np.prod(block.intensity.shape[1:])), samples + number
        given = (
            wp.array(np.asarray(pose[first : first + len(count)], np.float64), dtype=wp.transformd, device="cpu"),
            wp.array(block.position.reshape(number, foci, 3), dtype=wp.vec3, device="cpu"),
            wp.array(block.intensity.reshape(number, foci), dtype=wp.float32, device="cpu"),
        )
        if number:
            cells += count_cells(schedule_of(count, "cpu"), *given, *rows, motions=1, poses=len(count)).numpy()[0]
    return dwell_of(cells, across, along, samples, foci, update_rate)


def dwell_of(
    cells: np.ndarray, across: np.ndarray, along: np.ndarray, samples: int, foci: int, update_rate: float
) -> DwellMap:
    """The map of so many samples, of which `count_cells` has counted the drawn focal points; each has its share."""
    shared = foci * update_rate
    time = cells[:-1].reshape(len(across) - 1, len(along) - 1) / shared
    return DwellMap(time, across, along, float(cells[-1]) / shared, samples / update_rate - float(cells.sum()) / shared)


def dwell_maps(
    samples: MotionSamples, update_rate: float, *, width: float = 0.085, length: float = 0.085, cell: float = 1e-3
) -> list[DwellMap]:
    """The dwell map of each of many motions; the numbers have the meanings that they have for `dwell_map`."""
    across, along = cell_edges(width, cell), cell_edges(length, cell)
    rows = (cell_row(float(edges[0]), float(edges[-1]), len(edges) - 1) for edges in (across, along))
    totals = np.diff(samples.sample_start).tolist()
    given = samples.schedule, samples.pose, samples.position, samples.intensity, *rows
    cells = count_cells(*given, motions=len(totals), poses=samples.pose_count).numpy()
    foci = samples.intensity.shape[1]
    return [dwell_of(own, across, along, total, foci, update_rate) for own, total in zip(cells, totals, strict=True)]


def poses_of_samples(
    blocks: Iterable[FocalPoints], bounds: np.ndarray
) -> Iterator[tuple[FocalPoints, int, np.ndarray]]:
    """Blocks of consecutive focal points, the first pose of each, and how many samples of it that and later ones have.

    bounds: first sample of each pose and the end of the last (`sample_bounds`), shape [pose + 1].
    Raises StrategyError for more samples than `bounds` has.
    """
    first = int(bounds[0])
    for block in blocks:
        stop = first + len(block.intensity)
        if stop > bounds[-1]:
            raise StrategyError(f"focal points end at sample {stop}, the poses at sample {bounds[-1]}")
        pose = int(np.searchsorted(bounds, first, side="right")) - 1
        last = max(int(np.searchsorted(bounds, stop)), pose + 1)
        yield block, pose, np.diff(np.clip(bounds[pose : last + 1], first, stop))
        first = stop


def schedule_of(count: np.ndarray, device: str) -> Any:
    """The schedule of one motion whose poses have so many samples each, as far as their places are concerned."""
    schedule = PoseSchedule()
    for name, values in (
        ("motion_start", [0, len(count)]),
        ("motion", np.zeros(len(count))),
        ("count", count),
        ("row", np.cumsum(count) - count),
    ):
        setattr(schedule, name, wp.array(np.asarray(values, np.int32), dtype=wp.int32, device=device))
    return schedule


def cell_edges(extent: float, cell: float) -> np.ndarray:
    """Edges of the fewest equal cells, none longer than `cell`, that fill an extent around 0 [m]."""
    count = math.ceil(extent / cell - 1e-6)
    return (np.arange(count + 1) / count - 0.5) * extent
