"""Points put into the segments of polylines; a polyline that gets none stays bit-identical.

Rows are what polylines may become: each old point is a row, and so is each place on the segment that it starts. A row
is left out if rounding to float32 makes its place equal to an old point or to the row before it.
"""

from typing import NamedTuple

import warp as wp

from ..offsets import BLOCK, PointLimitError, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT, to_float32
from .cut import point_at, segment_length
from .simplify import move_offsets

wp.set_module_options(EXACT)

PARTS_MOST = wp.constant(wp.float64(2.0**31))  # of a segment; more rows than this fit no array, which Warp refuses


class Inserted(NamedTuple):
    """Device arrays of polylines into which points were put."""

    points: wp.array  # vec3 [m], shape [point]
    kind: wp.array  # uint8, shape [point]
    polyline_start: wp.array  # int64, shape [polyline + 1]
    intensity: wp.array | None  # float32, shape [point]; linear along a segment
    dwell: wp.array | None  # float32 [s], shape [point]; 0 at new points
    place: wp.array  # int64, shape [old point + 1]: where each old point is now, followed by what was put behind it


@wp.struct
class Vertices:
    """Points of polylines with what they have; arrays of length 0 stand for what a batch does not have."""

    points: wp.array[wp.vec3]  # [m]
    kind: wp.array[wp.uint8]
    intensity: wp.array[wp.float32]
    dwell: wp.array[wp.float32]  # [s]


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
def _count_divisions(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    longest: wp.float64,  # [m]
    # Out:
    count: wp.array[wp.int64],  # rows of each point, shape [point + 1], zero-initialised
):
    """Count the parts of each segment of a polyline."""
    line = wp.tid()
    base = polyline_start[line]
    size = int(polyline_start[line + 1] - base)
    for k in range(size):
        i = base + wp.int64(k)
        count[i] = wp.int64(1)
        if k + 1 < size:
            count[i] = parts_of_segment(points, i, longest)


@wp.kernel
def _write_divisions(
    # In:
    row_start: wp.array[wp.int64],
    # Out:
    share: wp.array[wp.float64],
):
    """Write where the equal parts of each segment begin, 0..1 of it."""
    i = wp.tid()
    first = row_start[i]
    count = int(row_start[i + 1] - first)
    for k in range(count):
        share[first + wp.int64(k)] = wp.float64(k) / wp.float64(count)


@wp.func
def is_inner(share: wp.float64):
    """Whether a place is strictly within its segment."""
    return share > wp.float64(0.0) and share < wp.float64(1.0)


@wp.func
def is_apart(points: wp.array[wp.vec3], i: wp.int64, x: wp.vec3, before: wp.vec3):
    """Whether a place on the segment at point i differs from the segment's ends and from the place before it."""
    return not (x == points[i] or x == points[i + wp.int64(1)] or x == before)


@wp.kernel
def _count_rows(
    # In:
    points: wp.array[wp.vec3],
    row_start: wp.array[wp.int64],
    share: wp.array[wp.float64],  # of its segment, ascending within one; the first row of a point is the point
    # Out:
    count: wp.array[wp.int64],  # shape [old point + 1], zero-initialised
):
    """Count the rows of each point that stay."""
    p = wp.tid()
    i = wp.int64(p)
    stay = int(1)
    before = points[i]
    for k in range(1, int(row_start[p + 1] - row_start[p])):
        part = share[row_start[p] + wp.int64(k)]
        if is_inner(part):
            x = to_float32(point_at(points, i, part))
            if is_apart(points, i, x, before):
                stay += 1
            before = x
    count[p] = wp.int64(stay)


@wp.func
def write_row(old: Vertices, written: Vertices, i: wp.int64, part: wp.float64, x: wp.vec3, at: wp.int64):
    """Write what lies at a place behind point i, or point i itself where `part` is 0."""
    written.points[at] = x
    written.kind[at] = old.kind[i]
    following = wp.min(i + wp.int64(1), wp.int64(old.points.shape[0] - 1))
    if old.intensity.shape[0] > 0:
        step = old.intensity[following] - old.intensity[i]
        written.intensity[at] = wp.float32(wp.float64(old.intensity[i]) + part * wp.float64(step))
    if old.dwell.shape[0] > 0:
        written.dwell[at] = wp.where(part > wp.float64(0.0), wp.float32(0.0), old.dwell[i])


@wp.kernel
def _insert_points(
    # In:
    old: Vertices,
    row_start: wp.array[wp.int64],
    share: wp.array[wp.float64],
    place: wp.array[wp.int64],
    # Out:
    written: Vertices,
):
    """Write each point, then its rows that stay."""
    p = wp.tid()
    i = wp.int64(p)
    at = place[p]
    before = old.points[i]
    write_row(old, written, i, wp.float64(0.0), before, at)
    for k in range(1, int(row_start[p + 1] - row_start[p])):
        part = share[row_start[p] + wp.int64(k)]
        if is_inner(part):
            x = to_float32(point_at(old.points, i, part))
            if is_apart(old.points, i, x, before):
                at += wp.int64(1)
                write_row(old, written, i, part, x, at)
            before = x


def rows_from(count: wp.array, point_limit: int | None = None) -> tuple[wp.array, wp.array]:
    """Offsets of points' rows from their counts, int64 [point + 1], and room for the rows' shares, float64 [row].

    The last count must be 0. Raises PointLimitError before memory is taken for more rows than `point_limit`.
    """
    row_start = offsets_of(count)
    total = last_of(row_start)
    if point_limit is not None and total > point_limit:
        raise PointLimitError(total, point_limit)
    return row_start, wp.empty(total, dtype=wp.float64, device=count.device)


@on_one_device
def divide_rows(
    points: wp.array, polyline_start: wp.array, longest: float, point_limit: int | None = None
) -> tuple[wp.array, wp.array]:
    """Rows that divide segments into equal parts no longer than `longest` [m], as `insert_points` takes them.

    Parts are longer by the rounding of their ends to float32 at most, and dividing again changes nothing.
    Raises PointLimitError before memory is taken for more points than `point_limit`.
    """
    device, line_count = points.device, polyline_start.shape[0] - 1
    count = wp.zeros(points.shape[0] + 1, dtype=wp.int64, device=device)
    inputs = [points, polyline_start, wp.float64(longest)]
    wp.launch(_count_divisions, line_count, inputs=inputs, outputs=[count], device=device, block_dim=BLOCK)
    row_start, share = rows_from(count, point_limit)
    wp.launch(_write_divisions, points.shape[0], inputs=[row_start], outputs=[share], device=device, block_dim=BLOCK)
    return row_start, share


@on_one_device
def insert_points(
    points: wp.array,
    kind: wp.array,
    polyline_start: wp.array,
    row_start: wp.array,
    share: wp.array,
    *,
    intensity: wp.array | None = None,
    dwell: wp.array | None = None,
) -> Inserted:
    """Polylines with points put into their segments.

    row_start: offsets of each point's rows, int64 [point + 1]; share: how far each row lies on the way to the next
    point, float64 [row], 0 for a point's first row, which is the point itself, and ascending from there. Rows at 0 or 1
    that are not a point's first are left out, as are those that rounding makes equal to a neighbour.
    """
    device, count = points.device, points.shape[0]
    stay = wp.zeros(count + 1, dtype=wp.int64, device=device)
    rows = [row_start, share]
    wp.launch(_count_rows, count, inputs=[points, *rows], outputs=[stay], device=device, block_dim=BLOCK)
    place = offsets_of(stay)
    total = last_of(place)
    old = vertices_of(points, kind, intensity, dwell)
    written = empty_vertices(total, device, intensity is not None, dwell is not None)
    wp.launch(_insert_points, count, inputs=[old, *rows, place], outputs=[written], device=device, block_dim=BLOCK)
    weights = (None if intensity is None else written.intensity, None if dwell is None else written.dwell)
    return Inserted(written.points, written.kind, move_offsets(polyline_start, place), *weights, place)


@on_one_device
def vertices_of(points: wp.array, kind: wp.array, intensity: wp.array | None, dwell: wp.array | None) -> Vertices:
    """Arrays of points as kernels take them."""
    out = Vertices()
    out.points, out.kind = points, kind
    out.intensity = wp.empty(0, dtype=wp.float32, device=points.device) if intensity is None else intensity
    out.dwell = wp.empty(0, dtype=wp.float32, device=points.device) if dwell is None else dwell
    return out


def empty_vertices(count: int, device: wp.Device, has_intensity: bool, has_dwell: bool) -> Vertices:
    """Room for points, with what they have."""
    out = Vertices()
    out.points = wp.empty(count, dtype=wp.vec3, device=device)
    out.kind = wp.empty(count, dtype=wp.uint8, device=device)
    out.intensity = wp.empty(count if has_intensity else 0, dtype=wp.float32, device=device)
    out.dwell = wp.empty(count if has_dwell else 0, dtype=wp.float32, device=device)
    return out
