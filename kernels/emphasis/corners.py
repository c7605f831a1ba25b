"""Corners of polylines, intensity near them, and pauses at them.

A corner is a vertex where the line within a window behind it turns by more than an angle from that within a window
before it; of several within a window the sharpest, the first of equals. Rounded corners count, finely drawn arcs do
not.

Intensity is 1 up to half of a reach from a corner, along the polyline, and falls to a level over the other half. Points
are put in at the ends of these ramps, and midway between corners whose ramps meet.
"""

from typing import Any

import warp as wp

from ..contours import Contours, full_intensity, move_offsets, number_selected, point_at, segment_length, with_columns
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float64
from ..stages.insertion import Inserted

wp.set_module_options(EXACT)

SHORTEST = wp.constant(wp.float64(1e-30))  # [m]; lengths are divided by this much at least
TURN_UNITS = wp.constant(wp.float64(1e6))  # a radian; turns that are equal in these are equally sharp
TURN_MOST = wp.constant(wp.int64(2**22))  # above half a turn
POINTS_MOST = wp.constant(wp.int64(2**32))  # of a polyline
RAMP_ENDS = wp.constant(5)  # of each corner at most: two at each side, and one midway to the next corner


@wp.struct
class MeasuredLines:
    """Contours with the arc lengths of their points."""

    c: Contours
    line: wp.array[wp.int32]  # which polyline each point is of
    arc: wp.array[wp.float64]  # of each point from its polyline's first [m]
    total: wp.array[wp.float64]  # of each polyline [m]


@wp.struct
class LineCorners:
    """Corners of polylines, in order."""

    point: wp.array[wp.int64]  # the points that are corners; a loop's seam is its first point; shape [corner]
    start: wp.array[wp.int64]  # offsets of polylines' corners, shape [polyline + 1]
    arc: wp.array[wp.float64]  # of each from its polyline's first point [m], shape [corner]


@wp.kernel
def _measure_lines(lines: MeasuredLines):
    """Sum the segments of a polyline from its first point on."""
    own = wp.tid()
    first = lines.c.polyline_start[own]
    length = wp.float64(0.0)
    for k in range(int(lines.c.polyline_start[own + 1] - first)):
        i = first + wp.int64(k)
        if k > 0:
            length += segment_length(lines.c.points, i - wp.int64(1))
        lines.line[i] = own
        lines.arc[i] = length
    lines.total[own] = length


@wp.func
def is_loop(lines: MeasuredLines, line: int):
    """Whether a polyline is closed."""
    return lines.c.polyline_closed[line] != wp.uint8(0)


@wp.func
def arc_on(lines: MeasuredLines, line: int, arc: wp.float64):
    """An arc length on a polyline [m]: closed ones go round, open ones end."""
    total = lines.total[line]
    if not is_loop(lines, line):
        return wp.clamp(arc, wp.float64(0.0), total)
    around = wp.max(total, SHORTEST)
    out = wp.mod(arc, around)
    if out < wp.float64(0.0):
        out += around
    return out


@wp.func
def first_beyond(values: wp.array[wp.float64], first: wp.int64, stop: wp.int64, value: wp.float64):
    """The first of the ascending values first..stop - 1 that is above one; `stop` if none is."""
    low = first
    high = stop
    while low < high:
        middle = (low + high) / wp.int64(2)
        if values[middle] > value:
            high = middle
        else:
            low = middle + wp.int64(1)
    return low


@wp.func
def part_at(lines: MeasuredLines, i: wp.int64, arc: wp.float64):
    """Part 0..1 of the segment at point i where an arc length lies."""
    length = wp.max(segment_length(lines.c.points, i), SHORTEST)
    return wp.clamp((arc - lines.arc[i]) / length, wp.float64(0.0), wp.float64(1.0))


@wp.func
def point_along(lines: MeasuredLines, line: int, arc: wp.float64):
    """Point of a polyline that has a segment, at an arc length [m]."""
    a = arc_on(lines, line, arc)
    first = lines.c.polyline_start[line]
    stop = lines.c.polyline_start[line + 1]
    i = first_beyond(lines.arc, first, stop, a) - wp.int64(1)
    i = wp.clamp(i, first, stop - wp.int64(2))
    return point_at(lines.c.points, i, part_at(lines, i, a))


@wp.kernel
def _measure_turns(lines: MeasuredLines, angle: wp.float64, window: wp.float64, turn: wp.array[wp.int64]):
    """Measure by how much a polyline turns at a point, in TURN_UNITS, if that is more than an angle [rad]; else -1."""
    p = wp.tid()
    i = wp.int64(p)
    line = lines.line[p]
    turn[p] = wp.int64(-1)
    seam = i == lines.c.polyline_start[line]
    if i == lines.c.polyline_start[line + 1] - wp.int64(1) or (seam and not is_loop(lines, line)):
        return  # an end, or a loop's first point again
    reach = window_on(lines, line, window)
    x = to_float64(lines.c.points[p])
    behind = x - point_along(lines, line, lines.arc[p] - reach)
    ahead = point_along(lines, line, lines.arc[p] + reach) - x
    size = wp.length(behind) * wp.length(ahead)
    if size > wp.float64(0.0):
        cosine = wp.dot(behind, ahead) / wp.max(size, SHORTEST)
        turned = wp.acos(wp.clamp(cosine, wp.float64(-1.0), wp.float64(1.0)))
        if turned > angle:
            turn[p] = wp.int64(wp.rint(turned * TURN_UNITS))


@wp.func
def window_on(lines: MeasuredLines, line: int, window: wp.float64):
    """The window on a polyline [m]: on a loop a sixth of it at most."""
    if is_loop(lines, line):
        return wp.min(window, lines.total[line] / wp.float64(6.0))
    return window


@wp.func
def sort_values(values: wp.array[Any], first: wp.int64, count: int):
    """Shell sort of the values first..first + count - 1, ascending."""
    gap = int(1)
    while gap < count // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for k in range(gap, count):
            value = values[first + wp.int64(k)]
            place = int(k)
            while place >= gap:
                other = values[first + wp.int64(place - gap)]
                if other <= value:
                    break
                values[first + wp.int64(place)] = other
                place -= gap
            values[first + wp.int64(place)] = value
        gap = gap // 3


@wp.func
def drop_near(lines: MeasuredLines, line: int, i: wp.int64, reach: wp.float64, turn: wp.array[wp.int64]):
    """Let no point within `reach` of point i along its polyline be a corner any more."""
    one = wp.int64(1)
    first = lines.c.polyline_start[line]
    last = lines.c.polyline_start[line + 1] - one
    arc = lines.arc[i]
    j = i
    while j <= last:
        if lines.arc[j] - arc > reach:
            break
        turn[j] = wp.int64(-1)
        j += one
    j = i
    while j >= first:
        if arc - lines.arc[j] > reach:
            break
        turn[j] = wp.int64(-1)
        j -= one
    if is_loop(lines, line):  # across the seam
        total = lines.total[line]
        j = first
        while j < i:
            if total - (arc - lines.arc[j]) > reach:
                break
            turn[j] = wp.int64(-1)
            j += one
        j = last
        while j > i:
            if total - (lines.arc[j] - arc) > reach:
                break
            turn[j] = wp.int64(-1)
            j -= one


@wp.kernel
def _choose_corners(
    # In:
    lines: MeasuredLines,
    window: wp.float64,  # [m]
    turn: wp.array[wp.int64],  # is overwritten
    order: wp.array[wp.int64],  # room to sort, shape [point]
    # Out:
    chosen: wp.array[wp.int64],  # 1: a corner; shape [point + 1], zero-initialised
):
    """Choose the sharpest points of a polyline, the first of equals, each farther than a window from the others."""
    line = wp.tid()
    first = lines.c.polyline_start[line]
    count = int(0)
    for k in range(int(lines.c.polyline_start[line + 1] - first)):
        i = first + wp.int64(k)
        if turn[i] >= wp.int64(0):
            order[first + wp.int64(count)] = (TURN_MOST - turn[i]) * POINTS_MOST + wp.int64(k)
            count += 1
    sort_values(order, first, count)
    reach = window_on(lines, line, window)
    for k in range(count):
        i = first + order[first + wp.int64(k)] % POINTS_MOST
        if turn[i] >= wp.int64(0):
            chosen[i] = wp.int64(1)
            drop_near(lines, line, i, reach, turn)


@wp.kernel
def _gather_arcs(lines: MeasuredLines, corners: LineCorners):
    """Arc length of each corner."""
    k = wp.tid()
    corners.arc[k] = lines.arc[corners.point[k]]


@wp.func
def add_ramp_end(lines: MeasuredLines, line: int, arc: wp.float64, ends: wp.array[wp.float64], place: wp.int64):
    """Write an arc length, brought onto its loop, unless it is beyond an end; returns the place of the next."""
    if is_loop(lines, line) or (arc > wp.float64(0.0) and arc < lines.total[line]):
        ends[place] = arc_on(lines, line, arc)
        return place + wp.int64(1)
    return place


@wp.kernel
def _find_ramp_ends(
    # In:
    lines: MeasuredLines,
    corners: LineCorners,
    reach: wp.float64,  # [m]
    # Out:
    ends: wp.array[wp.float64],  # arc lengths [m], those of a polyline from RAMP_ENDS times its first corner on
    end_count: wp.array[wp.int32],  # shape [polyline]
):
    """Find the ends of ramps: half of `reach` from each corner, all of it, and midway between near corners."""
    line = wp.tid()
    first = corners.start[line]
    stop = corners.start[line + 1]
    base = wp.int64(RAMP_ENDS) * first
    place = base
    for k in range(int(stop - first)):
        c = first + wp.int64(k)
        arc = corners.arc[c]
        place = add_ramp_end(lines, line, arc - reach, ends, place)
        place = add_ramp_end(lines, line, arc - wp.float64(0.5) * reach, ends, place)
        place = add_ramp_end(lines, line, arc + wp.float64(0.5) * reach, ends, place)
        place = add_ramp_end(lines, line, arc + reach, ends, place)
        following = corners.arc[first] + lines.total[line]
        if c + wp.int64(1) < stop:
            following = corners.arc[c + wp.int64(1)]
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
    lines: MeasuredLines, corners: LineCorners, ends: wp.array[wp.float64], end_count: wp.array[wp.int32], i: wp.int64
):
    """The first ramp end on the segment at point i, and how many there are; at a polyline's last point none."""
    line = lines.line[i]
    start = lines.c.polyline_start[line]
    last = lines.c.polyline_start[line + 1] - wp.int64(1)
    low = wp.int64(RAMP_ENDS) * corners.start[line]
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
    corners: LineCorners,
    ends: wp.array[wp.float64],
    end_count: wp.array[wp.int32],
    # Out:
    count: wp.array[wp.int64],  # rows of each point, shape [point + 1], zero-initialised
):
    """Count the rows of a point: itself, and the ends on its segment."""
    i = wp.tid()
    _first, own = ramp_ends_within(lines, corners, ends, end_count, wp.int64(i))
    count[i] = wp.int64(1 + own)


@wp.kernel
def _write_ramp_ends(
    # In:
    lines: MeasuredLines,
    corners: LineCorners,
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
    first, own = ramp_ends_within(lines, corners, ends, end_count, i)
    for k in range(own):
        share[row + wp.int64(1 + k)] = part_at(lines, i, ends[first + wp.int64(k)])


@wp.func
def gap_between(lines: MeasuredLines, line: int, a: wp.float64, b: wp.float64):
    """Distance between two arc lengths of a polyline, on a loop the shorter one [m]."""
    gap = wp.abs(a - b)
    if is_loop(lines, line):
        gap = wp.min(gap, wp.abs(lines.total[line] - gap))
    return gap


@wp.kernel
def _weigh_points(lines: MeasuredLines, corners: LineCorners, reach: wp.float64, level: wp.float64):
    """Multiply a point's intensity by 1 to `level` as the arc to its polyline's nearest corner grows to `reach` [m]."""
    i = wp.tid()
    line = lines.line[i]
    first = corners.start[line]
    stop = corners.start[line + 1]
    value = level
    if first < stop:
        arc = lines.arc[i]
        at = first_beyond(corners.arc, first, stop, arc)  # the nearest is one beside it, or across the seam
        nearest = gap_between(lines, line, arc, corners.arc[wp.max(at - wp.int64(1), first)])
        nearest = wp.min(nearest, gap_between(lines, line, arc, corners.arc[wp.min(at, stop - wp.int64(1))]))
        nearest = wp.min(nearest, gap_between(lines, line, arc, corners.arc[first]))
        nearest = wp.min(nearest, gap_between(lines, line, arc, corners.arc[stop - wp.int64(1)]))
        falls = wp.float64(2.0) * (wp.float64(1.0) - nearest / reach)
        value = level + (wp.float64(1.0) - level) * wp.clamp(falls, wp.float64(0.0), wp.float64(1.0))
    value = value * wp.float64(lines.c.intensity[i])
    lines.c.intensity[i] = wp.float32(wp.clamp(value, wp.float64(0.0), wp.float64(1.0)))


@wp.kernel
def _pause_at_corners(c: Contours, corners: LineCorners, place: wp.array[wp.int64], pause: wp.float32):
    """Add a pause [s] at each corner of a polyline, at the seam of a loop to both of its points.

    c: with the points put in; place: where each old point is now.
    """
    line = wp.tid()
    first = corners.start[line]
    for k in range(int(corners.start[line + 1] - first)):
        i = place[corners.point[first + wp.int64(k)]]
        c.dwell[i] = c.dwell[i] + pause
    start = c.polyline_start[line]
    last = c.polyline_start[line + 1] - wp.int64(1)
    if c.polyline_closed[line] != wp.uint8(0) and last > start:
        c.dwell[last] = c.dwell[start]


def measure_lines(contours: Contours) -> MeasuredLines:
    """Contours on a device with the arc lengths of their points."""
    device, count, line_count = contours.points.device, contours.points.shape[0], contours.polyline_closed.shape[0]
    out = MeasuredLines()
    out.c = contours
    out.line = wp.empty(count, dtype=wp.int32, device=device)
    out.arc = wp.empty(count, dtype=wp.float64, device=device)
    out.total = wp.empty(line_count, dtype=wp.float64, device=device)
    launch(_measure_lines, line_count, [], [out])
    return out


def find_corners(contours: Contours, *, angle: float, window: float) -> tuple[MeasuredLines, LineCorners]:
    """Corners of polylines: vertices where they turn by more than `angle` [rad] within `window` [m] at either side.

    No two of a polyline are within a window of each other along it; on loops the window is a sixth of it at most.
    """
    device, count, lines = contours.points.device, contours.points.shape[0], measure_lines(contours)
    turn, order = (wp.empty(count, dtype=wp.int64, device=device) for _ in range(2))
    chosen = wp.zeros(count + 1, dtype=wp.int64, device=device)
    launch(_measure_turns, count, [lines, wp.float64(angle), wp.float64(window)], [turn])
    launch(_choose_corners, contours.polyline_closed.shape[0], [lines, wp.float64(window), turn, order], [chosen])
    corners = LineCorners()
    corners.point, before = number_selected(chosen)
    corners.start = move_offsets(contours.polyline_start, before)
    corners.arc = wp.empty(corners.point.shape[0], dtype=wp.float64, device=device)
    launch(_gather_arcs, corners.point.shape[0], [lines], [corners])
    return lines, corners


@on_one_device
def ramp_rows(
    lines: MeasuredLines, corners: LineCorners, reach: float, point_limit: int | None = None
) -> tuple[wp.array, wp.array]:
    """Rows that put points at the ends of ramps, as `insert_points` takes them.

    reach: along a polyline from a corner to where intensity has fallen [m]. Raises PointLimitError before memory is
    allocated for more points than `point_limit`.
    """
    device, count, line_count = lines.arc.device, lines.arc.shape[0], lines.total.shape[0]
    ends = wp.empty(RAMP_ENDS * corners.point.shape[0], dtype=wp.float64, device=device)
    end_count = wp.empty(line_count, dtype=wp.int32, device=device)
    launch(_find_ramp_ends, line_count, [lines, corners, wp.float64(reach)], [ends, end_count])
    (share,), (row_start,) = count_then_fill(
        _count_ramp_ends,
        _write_ramp_ends,
        count,
        [lines, corners, ends, end_count],
        lambda total: [wp.empty(total, dtype=wp.float64, device=device)],
        rows=count,
        limit=point_limit,
    )
    return row_start, share


@on_one_device
def weigh_corners(contours: Contours, corners: LineCorners, *, reach: float, level: float) -> Contours:
    """Contours with the ramps' points, their intensity times 1 at corners and `level` from `reach` [m] on."""
    contours = with_columns(contours, intensity=full_intensity(contours))
    inputs = [measure_lines(contours), corners, wp.float64(reach), wp.float64(level)]
    launch(_weigh_points, contours.points.shape[0], inputs, [])
    return contours


@on_one_device
def pause_at_corners(new: Inserted, corners: LineCorners, pause: float) -> Contours:
    """Contours with points put in, and at each corner a pause more [s]."""
    old = new.contours.dwell
    count, device = new.contours.points.shape[0], new.place.device
    dwell = wp.zeros(count, dtype=wp.float32, device=device) if old is None else wp.clone(old)
    contours = with_columns(new.contours, dwell=dwell)
    launch(_pause_at_corners, contours.polyline_closed.shape[0], [contours, corners, new.place, wp.float32(pause)], [])
    return contours
