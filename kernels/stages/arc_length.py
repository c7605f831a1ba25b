"""Arc lengths along polylines, and points at arc lengths."""

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT
from .cut import point_at, segment_length

wp.set_module_options(EXACT)

SHORTEST = wp.constant(wp.float64(1e-30))  # [m]; lengths are divided by this much at least


@wp.struct
class MeasuredLines:
    """Polylines with the arc lengths of their points."""

    points: wp.array[wp.vec3]  # [m]
    polyline_start: wp.array[wp.int64]
    polyline_closed: wp.array[wp.uint8]
    line: wp.array[wp.int32]  # which polyline each point is of
    arc: wp.array[wp.float64]  # of each point from its polyline's first [m]
    total: wp.array[wp.float64]  # of each polyline [m]


@wp.kernel
def _measure_lines(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    # Out:
    line: wp.array[wp.int32],
    arc: wp.array[wp.float64],
    total: wp.array[wp.float64],
):
    """Sum the segments of a polyline from its first point on."""
    own = wp.tid()
    first = polyline_start[own]
    length = wp.float64(0.0)
    for k in range(int(polyline_start[own + 1] - first)):
        i = first + wp.int64(k)
        if k > 0:
            length += segment_length(points, i - wp.int64(1))
        line[i] = own
        arc[i] = length
    total[own] = length


@wp.func
def is_loop(lines: MeasuredLines, line: int):
    """Whether a polyline is closed."""
    return lines.polyline_closed[line] != wp.uint8(0)


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
    length = wp.max(segment_length(lines.points, i), SHORTEST)
    return wp.clamp((arc - lines.arc[i]) / length, wp.float64(0.0), wp.float64(1.0))


@wp.func
def point_along(lines: MeasuredLines, line: int, arc: wp.float64):
    """Point of a polyline that has a segment, at an arc length [m]."""
    a = arc_on(lines, line, arc)
    first = lines.polyline_start[line]
    stop = lines.polyline_start[line + 1]
    i = first_beyond(lines.arc, first, stop, a) - wp.int64(1)
    i = wp.clamp(i, first, stop - wp.int64(2))
    return point_at(lines.points, i, part_at(lines, i, a))


@on_one_device
def measure_lines(points: wp.array, polyline_start: wp.array, polyline_closed: wp.array) -> MeasuredLines:
    """Polylines on a device with the arc lengths of their points."""
    device, count, line_count = points.device, points.shape[0], polyline_closed.shape[0]
    out = MeasuredLines()
    out.points, out.polyline_start, out.polyline_closed = points, polyline_start, polyline_closed
    out.line = wp.empty(count, dtype=wp.int32, device=device)
    out.arc = wp.empty(count, dtype=wp.float64, device=device)
    out.total = wp.empty(line_count, dtype=wp.float64, device=device)
    inputs, outputs = [points, polyline_start], [out.line, out.arc, out.total]
    wp.launch(_measure_lines, line_count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    return out
