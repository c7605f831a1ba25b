"""Segments taken out of a batch of contours, counted by pose: what every prune stage ends with."""

from typing import Any

import numpy as np
import warp as wp

from ...kernels.stages.cut import cut_contours, divide_segments, gather_values, measure_removed, spread_keep
from ..contour_batch import ContourBatch
from ..errors import StrategyError


def cut_batch(batch: ContourBatch, keep: Any, *, parts: Any = None) -> tuple[ContourBatch, np.ndarray]:
    """A batch without the segments whose `keep` is 0, and the length removed of each pose [m], float32, shape [pose].

    keep: of the segment that starts at each point, bool or uint8, shape [point], where the batch is; what it says of a
    polyline's last point means nothing. parts: for a batch on a device, `Parts` that segments are divided into; `keep`
    then has one entry a part. Rules of cutting: see `kernels.cut`. Raises StrategyError for a `keep` of another length.
    """
    on_host = not batch.on_device
    if on_host:
        keep = np.ascontiguousarray(np.asarray(keep) != 0).astype(np.uint8)
        batch, keep = batch.to("cpu"), wp.array(keep, dtype=wp.uint8, device="cpu")
    wanted = batch.point_count if parts is None else parts.segment.shape[0]
    if keep.shape != (wanted,):
        raise StrategyError(f"keep must have shape [{wanted}], one entry a segment, not {list(keep.shape)}")
    if parts is None:
        parts = divide_segments(batch.points, batch.polyline_start)
        keep = spread_keep(parts, keep)
    lines = (batch.points, batch.kind, batch.polyline_start, batch.polyline_patch, batch.polyline_closed)
    cut = cut_contours(*lines, batch.pose_start, batch.intensity, keep, parts)
    removed = measure_removed(batch.points, batch.polyline_start, batch.pose_start, parts, keep).numpy()
    out = ContourBatch(
        points=cut.points,
        kind=cut.kind,
        polyline_start=cut.polyline_start,
        polyline_patch=cut.polyline_patch,
        polyline_closed=cut.polyline_closed,
        pose_start=cut.pose_start,
        intensity=cut.intensity,
        dwell=None if batch.dwell is None else gather_values(batch.dwell, cut, between=False),
    )
    return (out.numpy() if on_host else out), removed
