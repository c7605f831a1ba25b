"""Other curves along the same contours: as they are, smoother, or with fewer or more vertices."""

from ...kernels.stages.curves import cut_corners, drop_repeats, simplify_polylines
from ...kernels.stages.insertion import divide_contours
from ..contour_batch import ContourBatch
from .point_function import LEVEL, RESAMPLED
from .registry import Option, transform_stage
from .setting import Setting


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
    return ContourBatch.from_struct(simplify_polylines(batch.struct, tolerance=tolerance, level=LEVEL))


@transform_stage("resample", on="device", spacing=Option(None, 1e-4, 1.0, "m", widths=RESAMPLED))
def resample_contours(batch: ContourBatch, setting: Setting, *, spacing: float) -> ContourBatch:
    """More vertices along the same contours, so that later stages act between the old vertices too.

    Segments longer than `spacing` [m], a quarter of the focal width, fall into equal parts; vertices stay where they
    are, with their pauses. Intensity goes on linearly. Put it before a stage that acts at vertices, such as a function
    of position, and not before "simplify", which leaves the new vertices out again.
    """
    return divide_batch(batch, spacing, setting.point_limit)


@transform_stage("smooth", on="device", rounds=Option(3, 1, 6), reach=Option(None, 1e-5, 1.0, "m", widths=1.0))
def smooth_contours(batch: ContourBatch, setting: Setting, *, rounds: int, reach: float) -> ContourBatch:
    """Corners rounded; ends of open contours stay.

    Every corner is cut at a quarter of its sides, but at most `reach` [m] from it, `rounds` times (Chaikin 1974): each
    round doubles the vertices, and the curve stays within the hull of the old one.
    """
    contours = cut_corners(batch.struct, reach=reach, rounds=rounds, point_limit=setting.point_limit)
    return ContourBatch.from_struct(drop_repeats(contours))


def divide_batch(batch: ContourBatch, longest: float, point_limit: int | None = None) -> ContourBatch:
    """A batch whose segments are at most so long [m]: longer ones fall into equal parts.

    Parts are longer by the rounding of their ends to float32 at most, and dividing again changes nothing. Intensity is
    linear along a segment, new points have no dwell.
    Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    there = batch if batch.on_device else batch.to("cpu")
    out = ContourBatch.from_struct(divide_contours(there.struct, longest, point_limit), batch.raw_error)
    return out if batch.on_device else out.numpy()
