"""Polylines drawn in the planes of patches, in the array's frame: the contours that stages make."""

from typing import Any, NamedTuple

import warp as wp

from ..offsets import PointLimitError, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT, to_float32
from .cut import launch
from .prune import Patches

wp.set_module_options(EXACT)


class Lifted(NamedTuple):
    """Device arrays of contours made of polylines in planes; names as in a contour batch."""

    points: wp.array  # vec3 [m], array frame, shape [point]
    polyline_start: wp.array  # int64, shape [polyline + 1]
    polyline_patch: wp.array  # int32, shape [polyline]
    polyline_closed: wp.array  # uint8, shape [polyline]
    pose_start: wp.array  # int64, shape [pose + 1]
    source: wp.array  # int32, shape [polyline]: which of the polylines in planes it was


@wp.func
def lift_point(patches: Patches, pose: int, patch: int, height: wp.float64, x: wp.vec2d):
    """A point of a patch's plane, so high above it [m], in the array's frame."""
    middle = patches.origin[pose, patch] + height * patches.n[pose, patch]
    return to_float32(middle + x[0] * patches.u[pose, patch] + x[1] * patches.v[pose, patch])


@wp.func
def differs(a: wp.vec3, b: wp.vec3):
    """Whether two points are not the same place."""
    return a[0] != b[0] or a[1] != b[1] or a[2] != b[2]


@wp.kernel
def _lift_polylines(
    # In:
    flat: wp.array[wp.vec2d],  # [m]
    start: wp.array[wp.int64],
    line_pose: wp.array[wp.int32],
    line_patch: wp.array[wp.int32],
    height: wp.array[wp.float64],  # [m]; empty: 0
    closed: wp.array[wp.uint8],
    patches: Patches,
    point_start: wp.array[wp.int64],  # offsets of each polyline's points and its own place; empty: count them
    line_start: wp.array[wp.int64],
    # Out:
    point_count: wp.array[wp.int64],
    line_count: wp.array[wp.int64],
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    source: wp.array[wp.int32],
):
    """Count or write the points of a polyline that differ from the one before."""
    line = wp.tid()
    writes = point_start.shape[0] > 0
    count = int(start[line + 1] - start[line])
    h = wp.float64(0.0)
    if height.shape[0] > 0:
        h = height[line]
    at = wp.int64(0)
    if writes:
        at = point_start[line]
        count = wp.where(point_start[line + 1] > at, count, 0)
    kept = wp.int64(0)
    before = wp.vec3()
    total = wp.where(count > 0, count + int(closed[line]), 0)
    for k in range(total):
        x = lift_point(patches, line_pose[line], line_patch[line], h, flat[start[line] + wp.int64(k % count)])
        if k == 0 or differs(x, before):
            if writes:
                points[at + kept] = x
            kept += wp.int64(1)
        before = x
    if not writes and kept > wp.int64(1):
        point_count[line] = kept
        line_count[line] = wp.int64(1)
    elif writes and kept > wp.int64(0):
        polyline_start[line_start[line]] = at
        source[line_start[line]] = line


@wp.kernel
def _describe_polylines(
    # In:
    source: wp.array[wp.int32],
    line_patch: wp.array[wp.int32],
    closed: wp.array[wp.uint8],
    # Out:
    polyline_patch: wp.array[wp.int32],
    polyline_closed: wp.array[wp.uint8],
):
    """Write patch and kind of each polyline that is left."""
    i = wp.tid()
    polyline_patch[i] = line_patch[source[i]]
    polyline_closed[i] = closed[source[i]]


@wp.kernel
def _start_lifted_poses(
    # In:
    line_pose: wp.array[wp.int32],  # rising
    line_start: wp.array[wp.int64],
    # Out:
    pose_start: wp.array[wp.int64],
):
    """Write the first polyline of each pose."""
    pose = wp.tid()
    low = int(0)
    high = line_pose.shape[0]
    while low < high:
        middle = (low + high) // 2
        if line_pose[middle] < pose:
            low = middle + 1
        else:
            high = middle
    pose_start[pose] = line_start[low]


@on_one_device
def lift_polylines(
    flat: wp.array,
    start: wp.array,
    line_pose: wp.array,
    line_patch: wp.array,
    closed: wp.array,
    patches: Any,
    pose_count: int,
    *,
    height: wp.array | None = None,
    point_limit: int | None = None,
) -> Lifted:
    """Polylines of patches' planes in the array's frame, without points that float32 makes equal to the one before.

    flat: [m], vec2d, shape [point], without the first point of a closed one repeated; start: offsets, int64, shape
    [polyline + 1]; height: above the plane [m], float64, shape [polyline], None: 0. Polylines must come ordered by pose
    and patch, as `Regions` gives them; those of fewer than two points that differ are left out.
    Raises PointLimitError before memory is taken for more points than `point_limit`.
    """
    device, count = flat.device, line_pose.shape[0]
    none = wp.empty(0, dtype=wp.int64, device=device)
    height = wp.empty(0, dtype=wp.float64, device=device) if height is None else height
    lines = [flat, start, line_pose, line_patch, height, closed, patches]
    point_count, line_count = (wp.zeros(count + 1, dtype=wp.int64, device=device) for _ in range(2))
    launch(_lift_polylines, count, [*lines, none, none], [point_count, line_count, None, None, None])
    point_start, line_start = offsets_of(point_count), offsets_of(line_count)
    total, left = last_of(point_start), last_of(line_start)
    if point_limit is not None and total > point_limit:
        raise PointLimitError(total, point_limit)
    points = wp.empty(total, dtype=wp.vec3, device=device)
    polyline_start = wp.full(left + 1, total, dtype=wp.int64, device=device)
    source, patch = (wp.empty(left, dtype=wp.int32, device=device) for _ in range(2))
    is_closed = wp.empty(left, dtype=wp.uint8, device=device)
    launch(_lift_polylines, count, [*lines, point_start, line_start], [none, none, points, polyline_start, source])
    launch(_describe_polylines, left, [source, line_patch, closed], [patch, is_closed])
    pose_start = wp.empty(pose_count + 1, dtype=wp.int64, device=device)
    launch(_start_lifted_poses, pose_count + 1, [line_pose, line_start], [pose_start])
    return Lifted(points, polyline_start, patch, is_closed, pose_start, source)
