"""Polylines without segments of no length, and without polylines of which one point or none is left."""

from typing import NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT
from .simplify import move_offsets, number_kept

wp.set_module_options(EXACT)


class Distinct(NamedTuple):
    """What is left of polylines, as numbers of what there was; device arrays."""

    point: wp.array  # int64, shape [point]
    polyline: wp.array  # int64, shape [polyline]
    polyline_start: wp.array  # int64, shape [polyline + 1]
    pose_start: wp.array  # int64, shape [pose + 1]


@wp.kernel
def _mark_distinct(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    # Out:
    point_keep: wp.array[wp.int64],  # 1: it stays; shape [point + 1], zero-initialised
    polyline_keep: wp.array[wp.int64],  # shape [polyline + 1], zero-initialised
):
    """Mark the points of a polyline that differ from the one before, unless one is all that is left."""
    line = wp.tid()
    first = polyline_start[line]
    count = int(polyline_start[line + 1] - first)
    stay = int(0)
    for k in range(count):
        i = first + wp.int64(k)
        differs = k == 0
        if not differs:
            differs = not (points[i] == points[i - wp.int64(1)])
        if differs:
            point_keep[i] = wp.int64(1)
            stay += 1
    if stay == 1:
        point_keep[first] = wp.int64(0)
    if stay > 1:
        polyline_keep[line] = wp.int64(1)


@wp.kernel
def _gather_starts(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline: wp.array[wp.int64],
    place: wp.array[wp.int64],
    # Out:
    start: wp.array[wp.int64],
):
    """Write where each polyline that is left starts, and after the last one where all points end."""
    line = wp.tid()
    end = wp.int64(polyline_start.shape[0] - 1)
    old = end
    if line < polyline.shape[0]:
        old = polyline[line]
    start[line] = place[polyline_start[old]]


@wp.kernel
def _match_ends(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    # Out:
    kind: wp.array[wp.uint8],
    intensity: wp.array[wp.float32],  # of length 0 if there is none
    dwell: wp.array[wp.float32],  # [s]; of length 0 if there is none
):
    """Let a last point have the kind of the one before it, and that of a loop the values of its first."""
    line = wp.tid()
    first = polyline_start[line]
    last = polyline_start[line + 1] - wp.int64(1)
    if last > first:
        kind[last] = kind[last - wp.int64(1)]
        if polyline_closed[line] != wp.uint8(0):
            if intensity.shape[0] > 0:
                intensity[last] = intensity[first]
            if dwell.shape[0] > 0:
                dwell[last] = dwell[first]


@on_one_device
def find_distinct(points: wp.array, polyline_start: wp.array, pose_start: wp.array) -> Distinct:
    """Points that differ from the one before on their polyline, and the polylines that have two of them at least."""
    device, line_count = points.device, polyline_start.shape[0] - 1
    point_keep = wp.zeros(points.shape[0] + 1, dtype=wp.int64, device=device)
    polyline_keep = wp.zeros(line_count + 1, dtype=wp.int64, device=device)
    marks = [point_keep, polyline_keep]
    inputs = [points, polyline_start]
    wp.launch(_mark_distinct, line_count, inputs=inputs, outputs=marks, device=device, block_dim=BLOCK)
    point, place = number_kept(point_keep)
    polyline, polyline_place = number_kept(polyline_keep)
    start = wp.empty(polyline.shape[0] + 1, dtype=wp.int64, device=device)
    inputs = [polyline_start, polyline, place]
    wp.launch(_gather_starts, start.shape[0], inputs=inputs, outputs=[start], device=device, block_dim=BLOCK)
    return Distinct(point, polyline, start, move_offsets(pose_start, polyline_place))


@on_one_device
def match_ends(
    polyline_start: wp.array,
    polyline_closed: wp.array,
    kind: wp.array,
    intensity: wp.array | None = None,
    dwell: wp.array | None = None,
) -> None:
    """Set, in place, what a last point shares with others: the kind of the one before it, and that of a loop its start.

    Needed after last points are left out, because the points that then stand last had values of their own.
    """
    device = kind.device
    weights = [wp.empty(0, dtype=wp.float32, device=device) if w is None else w for w in (intensity, dwell)]
    inputs = [polyline_start, polyline_closed]
    outputs = [kind, *weights]
    wp.launch(_match_ends, polyline_closed.shape[0], inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
