"""Points put into the segments of polylines; a polyline that gets none stays bit-identical.

Rows are what polylines may become: each old point is a row, and so is each place on the segment that it starts. A row
is left out if rounding to float32 makes its place equal to an old point or to the row before it.
"""

from typing import NamedTuple

import warp as wp

from ..contours import Contours, move_offsets, point_at, segment_length, with_room, write_point
from ..offsets import count_then_fill
from ..one_device import on_one_device
from ..patch import EXACT, to_float32

wp.set_module_options(EXACT)

PARTS_MOST = wp.constant(wp.float64(2.0**31))  # of a segment; more rows than this fit no array, which Warp refuses


class Inserted(NamedTuple):
    """Contours into which points were put."""

    contours: Contours
    place: wp.array  # int64, shape [old point + 1]: where each old point is now, followed by what was put behind it


@wp.func
def float32_spacing(x: wp.vec3):
    """Distance between neighbours in float32 at a point's largest coordinate [m]."""
    most = wp.max(wp.max(wp.abs(x[0]), wp.abs(x[1])), wp.abs(x[2]))
    following = wp.cast(wp.cast(most, wp.int32) + wp.int32(1), wp.float32)
    return wp.float64(following) - wp.float64(most)


@wp.func
def parts_of_segment(points: wp.array[wp.vec3], i: wp.int64, longest: wp.float64):
    """Number of equal parts of the segment at point i that are no longer than asked but for rounding of their ends."""
    length = segment_length(points, i)
    if not wp.isfinite(length):  # refused where contours are checked
        return wp.int64(1)
    rounding = wp.sqrt(wp.float64(3.0)) * wp.max(
        float32_spacing(points[i]), float32_spacing(points[i + wp.int64(1)])
    )  # of a part's length: both ends move by half a spacing along each axis
    parts = wp.ceil((length - wp.float64(2.0) * rounding) / longest)
    return wp.int64(wp.clamp(parts, wp.float64(1.0), PARTS_MOST))


@wp.kernel
def _count_divisions(c: Contours, longest: wp.float64, count: wp.array[wp.int64]):
    """Count the parts of each segment of a polyline that are no longer than asked [m]."""
    line = wp.tid()
    base = c.polyline_start[line]
    size = int(c.polyline_start[line + 1] - base)
    for k in range(size):
        i = base + wp.int64(k)
        count[i] = wp.int64(1)
        if k + 1 < size:
            count[i] = parts_of_segment(c.points, i, longest)


@wp.kernel
def _write_divisions(c: Contours, longest: wp.float64, row_start: wp.array[wp.int64], share: wp.array[wp.float64]):
    """Write where the equal parts of each segment of a polyline begin, 0..1 of it."""
    line = wp.tid()
    for i in range(int(c.polyline_start[line]), int(c.polyline_start[line + 1])):
        first = row_start[i]
        count = int(row_start[i + 1] - first)
        for k in range(count):
            share[first + wp.int64(k)] = wp.float64(k) / wp.float64(count)


@wp.kernel
def _put_points(
    # In:
    c: Contours,
    row_start: wp.array[wp.int64],
    share: wp.array[wp.float64],  # of its segment, ascending within one; the first row of a point is the point
    place: wp.array[wp.int64],  # empty: count the rows of each point that stay
    # Out:
    count: wp.array[wp.int64],  # shape [old point + 1]
    written: Contours,
):
    """Count or write a point and its rows that stay."""
    p = wp.tid()
    i = wp.int64(p)
    at = wp.int64(0)
    if place.shape[0] > 0:
        at = place[p]
        write_point(c, i, wp.float64(0.0), written, at)
    before = c.points[i]
    for k in range(1, int(row_start[p + 1] - row_start[p])):
        part = share[row_start[p] + wp.int64(k)]
        if part > wp.float64(0.0) and part < wp.float64(1.0):  # strictly within its segment
            x = to_float32(point_at(c.points, i, part))
            if not (x == c.points[i] or x == c.points[i + wp.int64(1)] or x == before):
                at += wp.int64(1)
                if place.shape[0] > 0:
                    write_point(c, i, part, written, at)
            before = x
    if place.shape[0] == 0:
        count[p] = at + wp.int64(1)


@on_one_device
def divide_rows(contours: Contours, longest: float, point_limit: int | None = None) -> tuple[wp.array, wp.array]:
    """Rows that divide segments into equal parts no longer than `longest` [m], as `insert_points` takes them.

    Parts are longer by the rounding of their ends to float32 at most, and dividing again changes nothing.
    Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    (share,), (row_start,) = count_then_fill(
        _count_divisions,
        _write_divisions,
        contours.polyline_closed.shape[0],
        [contours, wp.float64(longest)],
        lambda total: [wp.empty(total, dtype=wp.float64, device=contours.points.device)],
        rows=contours.points.shape[0],
        limit=point_limit,
    )
    return row_start, share


@on_one_device
def insert_points(contours: Contours, row_start: wp.array, share: wp.array) -> Inserted:
    """Contours with points put into their segments; at these, intensity is linear along the segment, and the dwell 0.

    row_start: offsets of each point's rows, int64 [point + 1]; share: how far each row lies towards the next
    point, float64 [row], 0 for a point's first row, which is the point itself, and ascending from there. Rows at 0 or 1
    that are not a point's first are left out, as are those that rounding makes equal to a neighbour.
    """
    count = contours.points.shape[0]
    (out,), (place,) = count_then_fill(
        _put_points,
        None,
        count,
        [contours, row_start, share],
        lambda total: [with_room(contours, total)],
        rows=count,
        blank=[Contours()],
    )
    out.polyline_start = move_offsets(contours.polyline_start, place)
    return Inserted(out, place)


def divide_contours(contours: Contours, longest: float, point_limit: int | None = None) -> Contours:
    """Contours whose segments are at most so long [m]; see `divide_rows` and `insert_points`."""
    return insert_points(contours, *divide_rows(contours, longest, point_limit)).contours
