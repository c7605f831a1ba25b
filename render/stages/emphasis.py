"""Emphasis: what of contours is strong and what is weak, by corners and by kind; and pauses at corners."""

import math

from ...kernels.emphasis.corners import find_corners, pause_at_corners, ramp_rows, weigh_corners
from ...kernels.emphasis.edges import KindLevels, level_by_kind, ramp_between_levels
from ...kernels.stages.insertion import insert_points
from ..contour_batch import ContourBatch
from .registry import Option, transform_stage
from .setting import Setting

RAMP = 1e-3  # [m] over which intensity changes between segments


@transform_stage(
    "corners",
    on="device",
    angle=Option(math.pi / 6, 0.0, math.pi, "rad"),
    window=Option(None, 1e-5, 0.1, "m", widths=0.5),
    reach=Option(None, 1e-5, 0.1, "m", widths=1.0),
    level=Option(0.4, 0.0, 1.0),
    dwell=Option(0.0, 0.0, 10.0, "s"),
)
def emphasise_corners(
    batch: ContourBatch, setting: Setting, *, angle: float, window: float, reach: float, level: float, dwell: float
) -> ContourBatch:
    """Corners at full intensity, the rest weaker; with an option the focal point pauses there.

    A corner is a vertex where the way within `window` [m] behind it turns by more than `angle` [rad] from that within
    `window` before it; of several within a window the sharpest. Rounded corners count, finely drawn arcs do not. From a
    corner the intensity stays at 1 for half of `reach` [m] and falls to `level` over the other half. dwell: pause at
    each corner [s].
    """
    lines, corners = find_corners(batch.struct, angle=angle, window=window)
    new = insert_points(batch.struct, *ramp_rows(lines, corners, reach, setting.point_limit))
    contours = new.contours if dwell == 0 else pause_at_corners(new, corners, dwell)
    return ContourBatch.from_struct(weigh_corners(contours, corners, reach=reach, level=level))


@transform_stage(
    "edges",
    on="device",
    on_object=Option(1.0, 0.0, 1.0),
    on_hand=Option(0.4, 0.0, 1.0),
    on_made=Option(1.0, 0.0, 1.0),
)
def emphasise_edges(
    batch: ContourBatch, setting: Setting, *, on_object: float, on_hand: float, on_made: float
) -> ContourBatch:
    """Edges of the object at full intensity, those of the hand weaker, or as options say by kind.

    Between kinds the intensity changes within 1 mm of the weaker one.
    """
    level = level_by_kind(batch.struct, KindLevels(on_object, on_hand, on_made))
    contours = ramp_between_levels(batch.struct, level, ramp=RAMP, point_limit=setting.point_limit)
    return ContourBatch.from_struct(contours)
