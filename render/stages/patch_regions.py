"""Regions of a contour batch, and the batch that stages make of polylines drawn in the planes of patches."""

import warp as wp

from ...kernels.stages.lift import Lifted
from ...kernels.stages.regions import Regions, find_regions
from ..contour_batch import MADE, ContourBatch
from .registry import Setting


def regions_of(batch: ContourBatch, setting: Setting, per: str) -> Regions:
    """Regions of a batch on the setting's device; per: "region" or "patch", see `find_regions`."""
    lines = (batch.polyline_start, batch.polyline_patch, batch.polyline_closed, batch.pose_start)
    return find_regions(batch.points, *lines, setting.patches, per=per)


def batch_of_lifted(lifted: Lifted) -> ContourBatch:
    """A batch on a device of polylines that a stage made."""
    kind = wp.full(lifted.points.shape[0], MADE, dtype=wp.uint8, device=lifted.points.device)
    return ContourBatch(lifted.points, kind, *lifted[1:5])
