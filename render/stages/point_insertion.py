"""Contours into whose segments points are put, on the device or on the host as the batch."""

from ...kernels.stages.insertion import divide_contours
from ..contour_batch import ContourBatch


def divide_batch(batch: ContourBatch, longest: float, point_limit: int | None = None) -> ContourBatch:
    """A batch whose segments are at most so long [m]: longer ones fall into equal parts.

    Parts are longer by the rounding of their ends to float32 at most, and dividing again changes nothing. Intensity is
    linear along a segment, new points have no dwell.
    Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    there = batch if batch.on_device else batch.to("cpu")
    out = ContourBatch.from_struct(divide_contours(there.struct, longest, point_limit), batch.raw_error)
    return out if batch.on_device else out.numpy()
