"""Other curves along the same contours: as they are, smoother, or with fewer or more vertices."""

from dataclasses import replace

import numpy as np

from ...kernels.stages.simplify import gather_rows, simplify_polylines
from ..contour_batch import ContourBatch
from .point_insertion import divide_batch
from .polyline_arrays import without_repeats
from .registry import Option, Setting, transform_stage
from .vertex_spacing import LEVEL, RESAMPLED


@transform_stage("identity", on="device")
def keep_contours(batch: ContourBatch, setting: Setting) -> ContourBatch:
    """Contours as they are."""
    return batch


@transform_stage("simplify", on="device", tolerance=Option(None, 1e-7, 0.1, "m", widths=0.25))
def simplify_contours(batch: ContourBatch, setting: Setting, *, tolerance: float) -> ContourBatch:
    """Fewer vertices: those within a tolerance of the straight way between others are left out.

    Douglas and Peucker (1973). tolerance: a quarter of the focal width, which nobody feels [m]; no vertex left out is
    farther from what replaces it, nor its intensity off by more than 0.05. Vertices where the kind changes or the focal
    point pauses stay, loops keep their start and two more vertices at least.
    """
    index, start = simplify_polylines(
        batch.points,
        batch.kind,
        batch.polyline_start,
        batch.polyline_closed,
        tolerance=tolerance,
        level=LEVEL,
        intensity=batch.intensity,
        dwell=batch.dwell,
    )
    return replace(
        batch,
        points=gather_rows(batch.points, index),
        kind=gather_rows(batch.kind, index),
        polyline_start=start,
        intensity=None if batch.intensity is None else gather_rows(batch.intensity, index),
        dwell=None if batch.dwell is None else gather_rows(batch.dwell, index),
    )


@transform_stage("resample", on="device", spacing=Option(None, 1e-4, 1.0, "m", widths=RESAMPLED))
def resample_contours(batch: ContourBatch, setting: Setting, *, spacing: float) -> ContourBatch:
    """More vertices along the same contours, so that later stages act between the old vertices too.

    Segments longer than `spacing` [m], a quarter of the focal width, fall into equal parts; vertices stay where they
    are, with their pauses. Intensity goes on linearly. Put it before a stage that acts at vertices, such as a function
    of position, and not before "simplify", which leaves the new vertices out again.
    """
    return divide_batch(batch, spacing, setting.point_limit)


@transform_stage(
    "smooth",
    method=Option("chaikin", choices=("chaikin", "laplace")),
    rounds=Option(3, 1, 100),
    reach=Option(None, 1e-5, 1.0, "m", widths=1.0),
    strength=Option(0.5, 0.0, 1.0),
)
def smooth_contours(
    batch: ContourBatch, setting: Setting, *, method: str, rounds: int, reach: float, strength: float
) -> ContourBatch:
    """Corners rounded; ends of open contours stay.

    method "chaikin" cuts every corner at a quarter of its sides, but at most `reach` [m] from it, `rounds` times, 6 at
    most (each doubles the vertices): the curve stays within the hull of the old one. "laplace" moves every vertex
    towards the middle of its neighbours by `strength`, `rounds` times.
    """
    for _ in range(min(rounds, 6) if method == "chaikin" else rounds):
        batch = _chaikin(batch, reach) if method == "chaikin" else _relaxed(batch, strength)
    return without_repeats(batch)


def _chaikin(batch: ContourBatch, reach: float) -> ContourBatch:
    """Every segment without a quarter at each end, at most `reach`; those at ends of open polylines keep that end.

    The cut at a corner is of the kind of the segment before it, a pause there comes behind the cut.
    """
    count = np.diff(batch.polyline_start)
    line = np.repeat(np.arange(batch.polyline_count), count)
    is_segment = np.ones(batch.point_count, bool)
    is_segment[batch.polyline_start[1:] - 1] = False
    here = np.flatnonzero(is_segment)
    closed = batch.polyline_closed.astype(bool)
    first = ~closed[line[here]] & (here == batch.polyline_start[line[here]])
    last = ~closed[line[here]] & (here == batch.polyline_start[line[here] + 1] - 2)
    points = batch.points.astype(np.float64)
    cutoff = np.minimum(0.25, reach / np.maximum(np.linalg.norm(points[here + 1] - points[here], axis=1), 1e-30))
    part = np.stack([np.where(first, 0.0, cutoff), np.where(last, 1.0, 1.0 - cutoff)], axis=1)
    cut = points[here][:, None] + part[..., None] * (points[here + 1] - points[here])[:, None]
    new = np.maximum(2 * (count - 1) + closed, 0)
    start = np.concatenate([[0], np.cumsum(new)]).astype(np.int64)
    seam = start[1:][closed] - 1
    place = np.ones(start[-1], bool)
    place[seam] = False

    def laid(values: np.ndarray) -> np.ndarray:
        """Values of both cuts of each segment, and at each seam those of its loop's first."""
        out = np.empty((start[-1], *values.shape[2:]), values.dtype)
        out[place] = values.reshape(-1, *values.shape[2:])
        out[seam] = out[start[:-1][closed]]
        return out

    kind = laid(np.stack([batch.kind[here], batch.kind[here]], axis=1))
    kind[seam] = kind[seam - 1]
    intensity, dwell = batch.intensity, batch.dwell
    if intensity is not None:
        step = (intensity[here + 1] - intensity[here])[:, None]
        intensity = laid((intensity[here][:, None] + part * step).astype(np.float32))
    if dwell is not None:
        end = np.where(last, dwell[here + 1], 0.0)
        dwell = laid(np.stack([dwell[here], end], axis=1).astype(np.float32))
    return replace(
        batch, points=laid(cut.astype(np.float32)), kind=kind, polyline_start=start, intensity=intensity, dwell=dwell
    )


def _relaxed(batch: ContourBatch, strength: float) -> ContourBatch:
    """Every vertex but open ends moved towards the middle of its neighbours."""
    count = batch.point_count
    before, after = np.arange(count) - 1, np.arange(count) + 1
    first, last = batch.polyline_start[:-1], batch.polyline_start[1:] - 1
    closed = batch.polyline_closed.astype(bool) & (last > first)
    before[first[closed]], after[last[closed]] = last[closed] - 1, first[closed] + 1
    before[first[~closed]], after[first[~closed]] = first[~closed], first[~closed]
    before[last[~closed]], after[last[~closed]] = last[~closed], last[~closed]
    points = batch.points.astype(np.float64)
    moved = points + strength * (0.5 * (points[before] + points[after]) - points)
    return replace(batch, points=moved.astype(np.float32))
