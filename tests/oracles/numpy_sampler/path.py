"""Path: the polylines of one pose, as arrays for sampling."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.render.contour_batch import ContourBatch, require_seams, without_empty_polylines


@dataclass(frozen=True, eq=False, slots=True)
class Path:
    """The polylines of a pose one after the other; between two of them the arc length stands still."""

    points: np.ndarray
    """Vertices [m], array frame, float64, shape [point, 3]; a closed polyline repeats its first at its end."""
    arc: np.ndarray
    """Arc length of each vertex [m], shape [point]; the same on both sides of a gap."""
    step: np.ndarray
    """From each vertex to the next [m], gaps too, shape [point - 1, 3]."""
    first: np.ndarray
    """First vertex of each polyline, shape [polyline]."""
    closed: np.ndarray
    """Whether each polyline is closed, bool, shape [polyline]."""
    intensity: np.ndarray | None
    """0..1 at each vertex, linear in between, shape [point]; None means 1."""
    dwell: np.ndarray | None = None
    """Pause at each vertex [s], shape [point]; None means none."""

    @property
    def length(self) -> float:
        """Of all polylines [m]."""
        return float(self.arc[-1])

    @classmethod
    def of(cls, batch: ContourBatch, pose: int) -> "Path | None":
        """The path of one pose of a batch on the host; None without contours."""
        return next(paths_of(batch.select(pose, pose + 1)))

    def at(self, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points [m], shape [..., 3], and intensities at arc lengths [m], which wrap around."""
        return interpolated(self, np.mod(arc, self.length))


def interpolated(path: "Path", arc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and intensities at arc lengths within 0..length."""
    point = np.stack([np.interp(arc, path.arc, path.points[:, axis]) for axis in range(3)], axis=-1)
    if path.intensity is None:
        return point, np.ones(np.shape(arc))
    return point, np.interp(arc, path.arc, path.intensity)


def paths_of(batch: ContourBatch) -> Iterator[Path | None]:
    """The path of each pose of a batch on the host, None for poses without contours; polylines without points are none.

    Raises StrategyError for a closed polyline with another intensity or pause at its last point than at its first.
    """
    require_seams(batch, "contours to be drawn")
    batch = without_empty_polylines(batch)
    points = batch.points.astype(np.float64)
    step = np.diff(points, axis=0)
    length = np.sqrt(np.einsum("ij,ij->i", step, step))
    length[batch.polyline_start[1:-1] - 1] = 0.0  # between polylines
    closed = batch.polyline_closed.astype(bool)
    intensity = None if batch.intensity is None else batch.intensity.astype(np.float64)
    dwell = None if batch.dwell is None else batch.dwell.astype(np.float64)
    start, line = batch.polyline_start, batch.pose_start.tolist()
    for a, b in pairwise(line):
        if a == b:
            yield None
            continue
        begin, end = int(start[a]), int(start[b])
        arc = np.zeros(end - begin)  # summed within the pose, so that it does not depend on how poses are blocked
        np.cumsum(length[begin : end - 1], out=arc[1:])
        yield (
            Path(
                points[begin:end],
                arc,
                step[begin : end - 1],
                start[a:b] - begin,
                closed[a:b],
                None if intensity is None else intensity[begin:end],
                None if dwell is None else dwell[begin:end],
            )
            if arc[-1] > 0
            else None
        )
