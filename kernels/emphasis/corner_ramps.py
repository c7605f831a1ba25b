"""Intensity near corners of polylines, and pauses at them.

Intensity is 1 up to half of a reach from a corner, along the polyline, and falls to a level over the other half. Points
are put in at the ends of these ramps, and midway between corners whose ramps meet.
"""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from ..stages.arc_length import MeasuredLines, arc_on, first_beyond, is_loop, measure_lines, part_at
from ..stages.insertion import Inserted, rows_from
from .corners import PolylineCorners, sort_values

wp.set_module_options(EXACT)

RAMP_ENDS = wp.constant(5)  # of each corner at most: two at each side, and one midway to the next corner


@wp.func
def add_ramp_end(
    lines: MeasuredLines,
    line: int,
    arc: wp.float64,
    ends: wp.array[wp.float64],
    place: wp.int64,
):
    """Write an arc length, brought onto its loop, unless it is beyond an end; returns the place of the next."""
    if is_loop(lines, line) or (arc > wp.float64(0.0) and arc < lines.total[line]):
        ends[place] = arc_on(lines, line, arc)
        return place + wp.int64(1)
    return place


@wp.kernel
def _find_ramp_ends(
    # In:
    lines: MeasuredLines,
    corner_start: wp.array[wp.int64],
    corner_arc: wp.array[wp.float64],
    reach: wp.float64,  # [m]
    # Out:
    ends: wp.array[wp.float64],  # arc lengths [m], those of a polyline from RAMP_ENDS times its first corner on
    end_count: wp.array[wp.int32],  # shape [polyline]
):
    """Find the ends of ramps: half of `reach` from each corner, all of it, and midway between near corners."""
    line = wp.tid()
    first = corner_start[line]
    stop = corner_start[line + 1]
    base = wp.int64(RAMP_ENDS) * first
    place = base
    for k in range(int(stop - first)):
        c = first + wp.int64(k)
        arc = corner_arc[c]
        place = add_ramp_end(lines, line, arc - reach, ends, place)
        place = add_ramp_end(lines, line, arc - wp.float64(0.5) * reach, ends, place)
        place = add_ramp_end(lines, line, arc + wp.float64(0.5) * reach, ends, place)
        place = add_ramp_end(lines, line, arc + reach, ends, place)
        following = corner_arc[first] + lines.total[line]
        if c + wp.int64(1) < stop:
            following = corner_arc[c + wp.int64(1)]
        near = following - arc < wp.float64(2.0) * reach
        if near and (following < lines.total[line] or is_loop(lines, line)):
            place = add_ramp_end(lines, line, wp.float64(0.5) * (arc + following), ends, place)
    count = int(place - base)
    end_count[line] = count
    sort_values(ends, base, count)


@wp.func
def not_below(values: wp.array[wp.float64], first: wp.int64, stop: wp.int64, value: wp.float64):
    """The first of the ascending values first..stop - 1 that is not below one; `stop` if all are."""
    low = first
    high = stop
    while low < high:
        middle = (low + high) / wp.int64(2)
        if values[middle] < value:
            low = middle + wp.int64(1)
        else:
            high = middle
    return low


@wp.func
def ramp_ends_within(
    lines: MeasuredLines,
    corner_start: wp.array[wp.int64],
    ends: wp.array[wp.float64],
    end_count: wp.array[wp.int32],
    i: wp.int64,
):
    """The first ramp end on the segment at point i, and how many there are; at a polyline's last point none."""
    line = lines.line[i]
    start = lines.polyline_start[line]
    last = lines.polyline_start[line + 1] - wp.int64(1)
    low = wp.int64(RAMP_ENDS) * corner_start[line]
    high = low + wp.int64(end_count[line])
    if i == last:
        return high, int(0)
    first = low
    if i > start:
        first = not_below(ends, low, high, lines.arc[i])
    if i + wp.int64(1) < last:
        high = not_below(ends, first, high, lines.arc[i + wp.int64(1)])
    return first, int(high - first)


@wp.kernel
def _count_ramp_ends(
    # In:
    lines: MeasuredLines,
    corner_start: wp.array[wp.int64],
    ends: wp.array[wp.float64],
    end_count: wp.array[wp.int32],
    # Out:
    count: wp.array[wp.int64],  # rows of each point, shape [point + 1], zero-initialised
):
    """Count the rows of a point: itself, and the ends on its segment."""
    i = wp.tid()
    _first, own = ramp_ends_within(lines, corner_start, ends, end_count, wp.int64(i))
    count[i] = wp.int64(1 + own)


@wp.kernel
def _write_ramp_ends(
    # In:
    lines: MeasuredLines,
    corner_start: wp.array[wp.int64],
    ends: wp.array[wp.float64],
    end_count: wp.array[wp.int32],
    row_start: wp.array[wp.int64],
    # Out:
    share: wp.array[wp.float64],
):
    """Write which part of its segment each ramp end is at."""
    p = wp.tid()
    i = wp.int64(p)
    row = row_start[p]
    share[row] = wp.float64(0.0)
    first, own = ramp_ends_within(lines, corner_start, ends, end_count, i)
    for k in range(own):
        share[row + wp.int64(1 + k)] = part_at(lines, i, ends[first + wp.int64(k)])


@wp.func
def gap_between(lines: MeasuredLines, line: int, a: wp.float64, b: wp.float64):
    """Way between two arc lengths of a polyline, on a loop the shorter one [m]."""
    way = wp.abs(a - b)
    if is_loop(lines, line):
        way = wp.min(way, wp.abs(lines.total[line] - way))
    return way


@wp.kernel
def _weigh_points(
    # In:
    lines: MeasuredLines,  # with the points put in
    corner_start: wp.array[wp.int64],  # offsets of polylines' corners
    corner_arc: wp.array[wp.float64],
    reach: wp.float64,  # [m]
    level: wp.float64,  # 0..1
    # Out:
    intensity: wp.array[wp.float32],  # is multiplied
):
    """Weigh a point by the arc to the nearest corner of its polyline."""
    i = wp.tid()
    line = lines.line[i]
    first = corner_start[line]
    stop = corner_start[line + 1]
    value = level
    if first < stop:
        arc = lines.arc[i]
        at = first_beyond(corner_arc, first, stop, arc)  # the nearest is one beside it, or across the seam
        nearest = gap_between(lines, line, arc, corner_arc[wp.max(at - wp.int64(1), first)])
        nearest = wp.min(nearest, gap_between(lines, line, arc, corner_arc[wp.min(at, stop - wp.int64(1))]))
        nearest = wp.min(nearest, gap_between(lines, line, arc, corner_arc[first]))
        nearest = wp.min(nearest, gap_between(lines, line, arc, corner_arc[stop - wp.int64(1)]))
        falls = wp.float64(2.0) * (wp.float64(1.0) - nearest / reach)
        value = level + (wp.float64(1.0) - level) * wp.clamp(falls, wp.float64(0.0), wp.float64(1.0))
    value = value * wp.float64(intensity[i])
    intensity[i] = wp.float32(wp.clamp(value, wp.float64(0.0), wp.float64(1.0)))


@wp.kernel
def _pause_at_corners(
    # In:
    polyline_start: wp.array[wp.int64],  # with the points put in
    polyline_closed: wp.array[wp.uint8],
    corner_start: wp.array[wp.int64],
    corner: wp.array[wp.int64],  # the points that were corners
    place: wp.array[wp.int64],  # where each old point is now
    pause: wp.float32,  # [s]
    # Out:
    dwell: wp.array[wp.float32],  # [s]; is added to
):
    """Add a pause at each corner of a polyline, at the seam of a loop to both of its points."""
    line = wp.tid()
    first = corner_start[line]
    for k in range(int(corner_start[line + 1] - first)):
        i = place[corner[first + wp.int64(k)]]
        dwell[i] = dwell[i] + pause
    start = polyline_start[line]
    last = polyline_start[line + 1] - wp.int64(1)
    if polyline_closed[line] != wp.uint8(0) and last > start:
        dwell[last] = dwell[start]


def ramp_rows(corners: PolylineCorners, reach: float, point_limit: int | None = None) -> tuple[wp.array, wp.array]:
    """Rows that put points at the ends of ramps, as `insert_points` takes them.

    reach: along a polyline from a corner to where intensity has fallen [m]. Raises PointLimitError before memory is
    taken for more points than `point_limit`.
    """
    lines, device = corners.lines, corners.point.device
    count, line_count = lines.points.shape[0], lines.polyline_closed.shape[0]
    ends = wp.empty(RAMP_ENDS * corners.point.shape[0], dtype=wp.float64, device=device)
    end_count = wp.empty(line_count, dtype=wp.int32, device=device)
    inputs = [lines, corners.start, corners.arc, wp.float64(reach)]
    outputs = [ends, end_count]
    wp.launch(_find_ramp_ends, line_count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    rows = wp.zeros(count + 1, dtype=wp.int64, device=device)
    inputs = [lines, corners.start, ends, end_count]
    wp.launch(_count_ramp_ends, count, inputs=inputs, outputs=[rows], device=device, block_dim=BLOCK)
    row_start, share = rows_from(rows, point_limit)
    inputs = [*inputs, row_start]
    wp.launch(_write_ramp_ends, count, inputs=inputs, outputs=[share], device=device, block_dim=BLOCK)
    return row_start, share


def weigh_corners(new: Inserted, corners: PolylineCorners, *, reach: float, level: float) -> wp.array:
    """Intensity of polylines with points put in, times 1 at their corners and `level` from `reach` [m] on, float32."""
    lines = measure_lines(new.points, new.polyline_start, corners.lines.polyline_closed)
    count, device = new.points.shape[0], new.points.device
    if new.intensity is None:
        intensity = wp.full(count, 1.0, dtype=wp.float32, device=device)
    else:
        intensity = wp.clone(new.intensity)
    inputs = [lines, corners.start, corners.arc, wp.float64(reach), wp.float64(level)]
    wp.launch(_weigh_points, count, inputs=inputs, outputs=[intensity], device=device, block_dim=BLOCK)
    return intensity


def pause_at_corners(new: Inserted, corners: PolylineCorners, pause: float) -> wp.array:
    """Dwell of polylines with points put in, and at each corner a pause more [s], float32."""
    device, closed = new.points.device, corners.lines.polyline_closed
    dwell = wp.zeros(new.points.shape[0], dtype=wp.float32, device=device) if new.dwell is None else wp.clone(new.dwell)
    inputs = [new.polyline_start, closed, corners.start, corners.point, new.place, wp.float32(pause)]
    wp.launch(_pause_at_corners, closed.shape[0], inputs=inputs, outputs=[dwell], device=device, block_dim=BLOCK)
    return dwell
