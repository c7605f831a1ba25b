"""Polylines of a whole batch on the host: lengths of segments, intensities, and batches of polylines made anew."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..contour_batch import MADE, ContourBatch


def segment_lengths(batch: ContourBatch) -> tuple[np.ndarray, np.ndarray]:
    """Whether a segment starts at each point, and its length [m], 0 where none does; for a batch on the host."""
    points = batch.points.astype(np.float64)
    is_segment = np.ones(len(points), bool)
    is_segment[batch.polyline_start[1:][np.diff(batch.polyline_start) > 0] - 1] = False
    length = np.zeros(len(points))
    here = np.flatnonzero(is_segment)
    length[here] = np.linalg.norm(points[here + 1] - points[here], axis=1)
    return is_segment, length


def times(batch: ContourBatch, value: np.ndarray) -> ContourBatch:
    """A batch with its intensity multiplied by 0..1 at each point."""
    before = 1.0 if batch.intensity is None else batch.intensity
    return replace(batch, intensity=np.clip(value * before, 0.0, 1.0).astype(np.float32))


@dataclass(frozen=True, eq=False, slots=True)
class Drawn:
    """A polyline that a stage made."""

    pose: int
    patch: int
    points: np.ndarray
    """[m], array frame, shape [point, 3]; a closed one does not repeat its first point here."""
    closed: bool


def batch_of(drawn: Sequence[Drawn], pose_count: int) -> ContourBatch:
    """A batch of polylines that stages made, in their order within a pose and patch; those of no length are left out.

    Points that float32 makes equal to the one before are left out.
    """
    lines: list[tuple[np.ndarray, Drawn]] = []
    for one in sorted(drawn, key=lambda d: (d.pose, d.patch)):
        points = np.asarray(one.points, np.float32)
        if one.closed:
            points = np.concatenate([points, points[:1]])
        points = points[np.concatenate([[True], (points[1:] != points[:-1]).any(axis=1)])] if len(points) else points
        if len(points) > 1:
            lines.append((points, one))
    count = np.array([len(points) for points, _ in lines], np.int64)
    pose = np.array([one.pose for _, one in lines], np.int64)
    return ContourBatch(
        points=np.concatenate([points for points, _ in lines]) if lines else np.zeros((0, 3), np.float32),
        kind=np.full(int(count.sum()), MADE, np.uint8),
        polyline_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        polyline_patch=np.array([one.patch for _, one in lines], np.int32),
        polyline_closed=np.array([one.closed for _, one in lines], np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(np.bincount(pose, minlength=pose_count))]).astype(np.int64),
    )
