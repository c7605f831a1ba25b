"""Fillings of what contours enclose: parallel lines, and outlines farther in."""

import math
from typing import Any

import numpy as np
import warp as wp

from ...kernels.fillings.hatch import draw_hatch
from ...kernels.fillings.inset import draw_inset
from ...kernels.stages.regions import FlatLines, find_filled, find_regions, lift_polylines
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..user_warnings import warn_user
from .registry import Option, transform_stage
from .setting import Setting

UNIT = 1e-3  # [m] that polygons are handed to manifold3d in: it works to 1e-8 of its unit
ROUND = 64  # segments of a full turn around a corner


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
    loops = with_missing_loops(inset, failed, regions, distance)
    return lifted_batch(loops, regions, setting, batch.pose_count, closed=True)


def lifted_batch(flat: FlatLines, regions: Any, setting: Setting, pose_count: int, *, closed: bool) -> ContourBatch:
    """A batch on a device of lines drawn for regions."""
    limit = setting.point_limit
    contours = lift_polylines(flat, regions, setting.patches, pose_count, closed=closed, point_limit=limit)
    return ContourBatch.from_struct(contours)


def with_missing_loops(inset: FlatLines, failed_regions: wp.array, regions: Any, distance: float) -> FlatLines:
    """All loops: those of regions that failed on the device are found on the host."""
    failed = np.flatnonzero(failed_regions.numpy())
    if len(failed) == 0:
        return inset
    local, start = regions.local.numpy(), regions.polyline_start.numpy()
    entry, line = regions.region_start.numpy(), regions.region_line.numpy()
    points, at = inset.points.numpy(), inset.line_start.numpy()
    found = [(int(k), points[at[i] : at[i + 1]]) for i, k in enumerate(inset.line_region.numpy())]
    for k in failed.tolist():
        loops = [local[start[i] : start[i + 1] - 1, :2] for i in line[entry[k] : entry[k + 1]]]
        found += [(k, loop) for loop in inset_loops(loops, distance)]
    found.sort(key=lambda one: one[0])
    device, counts = regions.local.device, [len(loop) for _, loop in found]
    return FlatLines(
        wp.array(np.concatenate([np.zeros((0, 2)), *[loop for _, loop in found]]), dtype=wp.vec2d, device=device),
        wp.array(np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), dtype=wp.int64, device=device),
        wp.array(np.array([k for k, _ in found], np.int32), dtype=wp.int32, device=device),
    )


def inset_loops(loops: list[np.ndarray], distance: float) -> list[np.ndarray]:
    """Loops around what is at least so far inside a region [m]; outer ones by area, the largest first, then holes.

    loops: counter-clockwise around the region, clockwise around holes; [m], each of shape [point, 2].
    """
    from manifold3d import CrossSection, FillRule, JoinType  # a compiled library that most strategies do without

    region = CrossSection([loop / UNIT for loop in loops], FillRule.Positive)
    left = region.offset(-distance / UNIT, JoinType.Round, 2.0, ROUND)
    origin = loops[0][0]
    out = [UNIT * np.asarray(loop, np.float64) for loop in left.to_polygons()]
    out = [np.roll(loop, -int(np.argmin(np.linalg.norm(loop - origin, axis=1))), axis=0) for loop in out]
    return sorted(out, key=lambda loop: (-signed_area(loop), *loop[0].tolist()))


def signed_area(loop: np.ndarray) -> float:
    """Area inside a loop, negative if it runs clockwise [m2]."""
    following = np.roll(loop, -1, axis=0)
    return 0.5 * float((loop[:, 0] * following[:, 1] - following[:, 0] * loop[:, 1]).sum())
