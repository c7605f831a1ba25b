"""Points with their places -> contours: steps of no length dropped, what is left counted and written."""

from typing import NamedTuple

import warp as wp

from ..contours import Contours, room_for
from ..offsets import launch, scan_counts
from ..patch import EXACT
from .sample import NO_POINT
from .walk import Trails

wp.set_module_options(EXACT)

LINE = wp.constant(wp.int64(1 << 32))  # counts of points and of polylines in one number


class PointCounts(NamedTuple):
    """Numbers of the points and polylines that are written of a chunk."""

    start: wp.array  # of each slot: points before it + LINE x polylines before it, int64, shape [slot + 1]
    point_count: int
    polyline_count: int


@wp.func
def first_of(after: wp.array[wp.int32], slot: int):
    """The first point of the polyline that ends at a slot."""
    if after[slot] < 0:
        return ~after[slot]
    return after[slot]


@wp.func
def ends_line(after: wp.array[wp.int32], slot: int):
    """Whether a polyline ends with this point."""
    return after[slot] <= slot


@wp.func
def has_step(after: wp.array[wp.int32], point: wp.array[wp.vec3], slot: int):
    """Whether a step of non-zero length starts at this point."""
    return after[slot] >= 0 and not (point[slot] == point[after[slot]])


@wp.func
def has_tip(after: wp.array[wp.int32], point: wp.array[wp.vec3], tip: wp.array[wp.vec3], slot: int):
    """Whether a tip parts the step that starts at this point."""
    return not (tip[slot] == point[slot]) and not (tip[slot] == point[after[slot]])


@wp.func
def last_step(after: wp.array[wp.int32], point: wp.array[wp.vec3], slot: int):
    """The last step of non-zero length of the polyline that ends at a slot, or NO_POINT."""
    first = first_of(after, slot)
    k = int(slot)
    while k >= first:
        if has_step(after, point, k):
            return k
        k -= 1
    return NO_POINT


@wp.kernel
def _count_points(
    # In:
    code: wp.array[wp.int32],
    after: wp.array[wp.int32],
    point: wp.array[wp.vec3],
    tip: wp.array[wp.vec3],
    # Out:
    count: wp.array[wp.int64],  # see PointCounts.start
):
    """Count a point where a step of non-zero length starts, its tip, and a line and its last point where one ends."""
    slot = wp.tid()
    n = wp.int64(0)
    if slot < code.shape[0]:
        if code[slot] != NO_POINT:
            if has_step(after, point, slot):
                n += wp.int64(1)
                if has_tip(after, point, tip, slot):
                    n += wp.int64(1)
            if ends_line(after, slot):
                if last_step(after, point, slot) != NO_POINT:
                    n += LINE + wp.int64(1)
    count[slot] = n


@wp.kernel
def _write_lines(
    # In:
    trail: wp.array[wp.int32],  # codes
    after: wp.array[wp.int32],
    section: wp.array[wp.int32],
    point: wp.array[wp.vec3],
    tip: wp.array[wp.vec3],
    start: wp.array[wp.int64],  # see PointCounts
    patch_count: int,
    point_base: wp.int64,  # points of the chunks before
    # Out:
    lines: Contours,
):
    """Write a slot's point, and where a polyline ends what there is to say of it."""
    slot = wp.tid()
    if trail[slot] == NO_POINT:
        return
    place = start[slot] % LINE
    if has_step(after, point, slot):
        lines.points[place] = point[slot]
        lines.kind[place] = wp.uint8(trail[slot] & 1)
        place += wp.int64(1)
        if has_tip(after, point, tip, slot):
            lines.points[place] = tip[slot]
            lines.kind[place] = wp.uint8(trail[slot] & 1)
            place += wp.int64(1)
    if ends_line(after, slot):
        last = last_step(after, point, slot)
        if last != NO_POINT:
            first = first_of(after, slot)
            line = start[slot] // LINE
            lines.kind[place] = wp.uint8(trail[last] & 1)
            lines.points[place] = point[first]
            lines.polyline_closed[line] = wp.uint8(1)
            if after[slot] < 0:
                lines.points[place] = point[slot]
                lines.polyline_closed[line] = wp.uint8(0)
            lines.polyline_start[line] = point_base + start[first] % LINE
            lines.polyline_patch[line] = section[slot] % patch_count


@wp.kernel
def _write_starts(
    # In:
    start: wp.array[wp.int64],  # see PointCounts
    cut_start: wp.array[wp.int32],
    polyline_base: wp.int64,  # polylines of the chunks before
    # Out:
    pose_start: wp.array[wp.int64],
):
    """Write where each section's polylines start; after the last section, where they end."""
    row = wp.tid()
    pose_start[row] = polyline_base + start[cut_start[row]] // LINE


def count_points(trails: Trails, point: wp.array, tip: wp.array) -> PointCounts:
    """Count what is left without steps of no length; waits for the device. tip: see Found."""
    count = wp.empty(point.shape[0] + 1, dtype=wp.int64, device=point.device)
    launch(_count_points, count.shape[0], [trails.code, trails.after, point, tip], [count])
    (start,), (total,) = scan_counts(count)
    return PointCounts(start, total % (1 << 32), total >> 32)


def write_lines(
    trails: Trails,
    point: wp.array,
    tip: wp.array,
    counts: PointCounts,
    cut_start: wp.array,
    *,
    patch_count: int,
    point_base: int,
    polyline_base: int,
) -> Contours:
    """Write a chunk's contours; offsets go on from the points and polylines of those before, and end with their end."""
    device = point.device
    lines = room_for(counts.point_count, counts.polyline_count, device, end=point_base + counts.point_count)
    inputs = [*trails, point, tip, counts.start, patch_count, wp.int64(point_base)]
    launch(_write_lines, point.shape[0], inputs, [lines])
    lines.pose_start = wp.empty(cut_start.shape[0], dtype=wp.int64, device=device)
    launch(_write_starts, cut_start.shape[0], [counts.start, cut_start, wp.int64(polyline_base)], [lines.pose_start])
    return lines
