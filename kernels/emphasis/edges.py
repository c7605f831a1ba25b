"""Intensity of whole segments of polylines, by kind."""

from typing import NamedTuple

import warp as wp

from ..contours import Contours, full_intensity, segment_length, with_columns
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT
from ..section.draw import HAND, MADE, OBJECT
from ..stages.insertion import insert_points
from .corners import SHORTEST

wp.set_module_options(EXACT)


class KindLevels(NamedTuple):
    """Intensity of segments by kind, 0..1."""

    on_object: float
    on_hand: float
    on_made: float


@wp.kernel
def _level_segments(c: Contours, level_of: wp.vec3d, level: wp.array[wp.float64]):
    """Choose the intensity of the segment that starts at a point; level_of: object, hand, made."""
    i = wp.tid()
    own = int(c.kind[i])
    level[i] = wp.float64(0.0)
    if own == OBJECT or own == HAND or own == MADE:
        level[i] = level_of[own]


@wp.kernel
def _count_ramps(
    c: Contours, level: wp.array[wp.float64], ramp: wp.float64, peak: wp.array[wp.float64], count: wp.array[wp.int64]
):
    """Write the larger level beside each point as its peak, and count the ramps that segments need below it."""
    line = wp.tid()
    first = c.polyline_start[line]
    last = c.polyline_start[line + 1] - wp.int64(1)
    for k in range(int(last - first) + 1):
        i = first + wp.int64(k)
        value = wp.float64(0.0)
        if i < last:
            value = wp.max(value, level[i])
        if i > first:
            value = wp.max(value, level[i - wp.int64(1)])
        peak[i] = value
        count[i] = wp.int64(1)
    if c.polyline_closed[line] != wp.uint8(0) and last > first:
        peak[first] = wp.max(peak[first], peak[last])
        peak[last] = peak[first]
    for k in range(int(last - first)):
        i = first + wp.int64(k)
        if peak[i] > level[i]:
            count[i] = count[i] + wp.int64(1)
        if peak[i + wp.int64(1)] > level[i]:
            count[i] = count[i] + wp.int64(1)


@wp.kernel
def _write_ramps(
    # In:
    c: Contours,
    level: wp.array[wp.float64],
    ramp: wp.float64,  # [m]
    peak: wp.array[wp.float64],
    row_start: wp.array[wp.int64],
    # Out:
    share: wp.array[wp.float64],
):
    """Write where on its segment a ramp ends that falls from its first point, and where one begins to its last."""
    line = wp.tid()
    for p in range(int(c.polyline_start[line]), int(c.polyline_start[line + 1])):
        i = wp.int64(p)
        row = row_start[p]
        count = int(row_start[p + 1] - row)
        share[row] = wp.float64(0.0)
        if count > 1:
            part = wp.min(ramp / wp.max(segment_length(c.points, i), SHORTEST), wp.float64(0.5))
            if peak[i] > level[i]:
                row += wp.int64(1)
                share[row] = part
            if peak[i + wp.int64(1)] > level[i]:
                share[row + wp.int64(1)] = wp.float64(1.0) - part


@wp.kernel
def _weigh_ramps(c: Contours, level: wp.array[wp.float64], peak: wp.array[wp.float64], place: wp.array[wp.int64]):
    """Weigh a point by the larger level beside it, and those put in behind it by the level of its segment.

    c: with points put in; place: where each old point is now.
    """
    p = wp.tid()
    first = place[p]
    for k in range(int(place[p + 1] - first)):
        i = first + wp.int64(k)
        value = wp.where(k == 0, peak[p], level[p]) * wp.float64(c.intensity[i])
        c.intensity[i] = wp.float32(wp.clamp(value, wp.float64(0.0), wp.float64(1.0)))


def level_by_kind(contours: Contours, levels: KindLevels) -> wp.array:
    """Intensity of each segment, float64, shape [point]."""
    level = wp.empty(contours.kind.shape[0], dtype=wp.float64, device=contours.kind.device)
    launch(_level_segments, level.shape[0], [contours, wp.vec3d(*levels)], [level])
    return level


@on_one_device
def ramp_between_levels(
    contours: Contours, level: wp.array, *, ramp: float, point_limit: int | None = None
) -> Contours:
    """Contours whose segments have these intensities, times those they had.

    Where two segments of different intensity meet, the point between them has the higher one, and the weaker segment
    reaches its own within `ramp` [m], or in its middle if it is short. level: 0..1, float64, shape [point], by segment.
    Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    device, count = contours.points.device, contours.points.shape[0]
    contours, peak = with_columns(contours, intensity=full_intensity(contours)), wp.empty_like(level)
    (share,), (row_start,) = count_then_fill(
        _count_ramps,
        _write_ramps,
        contours.polyline_closed.shape[0],
        [contours, level, wp.float64(ramp), peak],
        lambda total: [wp.empty(total, dtype=wp.float64, device=device)],
        rows=count,
        limit=point_limit,
    )
    out = insert_points(contours, row_start, share)
    launch(_weigh_ramps, count, [out.contours, level, peak, out.place], [])
    return out.contours
