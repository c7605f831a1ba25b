"""Fillings of what contours enclose: parallel lines, and outlines farther in."""

import math
from typing import Any

import warp as wp

from ...kernels.fillings.hatch import draw_hatch
from ...kernels.fillings.inset import draw_inset
from ...kernels.stages.regions import FlatLines, find_filled, find_regions, lift_polylines
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..user_warnings import warn_user
from .registry import Option, transform_stage
from .setting import Setting


def require_planes(stage: str, setting: Setting) -> None:
    """Refuse hands whose skin is no plane."""
    if hasattr(setting.hand, "skin_on"):
        raise StrategyError(
            f"{stage}: fills planes, and the skin of a hand mesh is none: take a Palm or PlaneHand, or the raw stage "
            '"contact", which covers skin'
        )


def find_filled_regions(stage: str, batch: ContourBatch, setting: Setting) -> tuple[Any, wp.array]:
    """Regions of a batch on a device, and which of them enclose an area, uint8; warns of contours that enclose none."""
    require_planes(stage, setting)
    regions = find_regions(batch.struct, setting.patches)
    filled, left_out = find_filled(regions)
    if left_out:
        warn_user(
            f"{stage}: {left_out} of {batch.polyline_count} contours are open, enclose nothing and are left "
            'out: put "close" before it'
        )
    return regions, filled


@transform_stage(
    "hatch",
    on="device",
    needs_closed=True,
    spacing=Option(None, 1e-4, 0.5, "m", widths=1.0),
    angle=Option(0.0, -math.tau, math.tau, "rad"),
    connect=Option("boundary", choices=("boundary", "jump")),
)
def hatch_regions(batch: ContourBatch, setting: Setting, *, spacing: float, angle: float, connect: str) -> ContourBatch:
    """Parallel lines that fill what the contours enclose, holes left out.

    spacing: between lines, a focal width by default [m]; lines pass through the patch's middle, so they stay with the
    hand. angle: of the lines from u towards v [rad]. connect "boundary": from line to line along the region's boundary,
    to and fro; "jump": each line by itself. A region between two lines gets one through its middle. Open contours
    enclose nothing: they are left out with a warning. Not for hand meshes.
    """
    regions, filled = find_filled_regions("hatch", batch, setting)
    options = {"spacing": spacing, "angle": angle, "connected": connect == "boundary"}
    hatch = draw_hatch(regions, filled, **options, point_limit=setting.point_limit)
    return lifted_batch(hatch, regions, setting, batch.pose_count, closed=False)


@transform_stage("inset", on="device", needs_closed=True, distance=Option(None, 1e-6, 0.5, "m", widths=0.5))
def inset_regions(batch: ContourBatch, setting: Setting, *, distance: float) -> ContourBatch:
    """Outlines moved inwards, so that the focal point's width stays inside.

    distance: half a focal width by default [m]. Regions that are narrower vanish, and fall apart at waists; holes grow.
    Loops are counter-clockwise around what is left, of kind "made", and start near where the region's outline did.
    Open contours enclose nothing: they are left out with a warning. Not for hand meshes.
    """
    regions, filled = find_filled_regions("inset", batch, setting)
    inset, failed = draw_inset(regions, filled, distance=distance, point_limit=setting.point_limit)
    if left_out := int(failed.numpy().sum()):
        warn_user(
            f"inset: {left_out} of {failed.shape[0]} regions have outlines that wind around themselves, and are left "
            'out: put "simplify" before it, or take "hatch"'
        )
    return lifted_batch(inset, regions, setting, batch.pose_count, closed=True)


def lifted_batch(flat: FlatLines, regions: Any, setting: Setting, pose_count: int, *, closed: bool) -> ContourBatch:
    """A batch on a device of lines drawn for regions."""
    limit = setting.point_limit
    contours = lift_polylines(flat, regions, setting.patches, pose_count, closed=closed, point_limit=limit)
    return ContourBatch.from_struct(contours)
