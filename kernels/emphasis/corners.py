"""Corners of polylines: vertices where they turn sharply within a window.

A corner is a vertex where the way within a window behind it turns by more than an angle from that within a window
before it; of several within a window the sharpest, the first of equals. Rounded corners count, finely drawn arcs do
not.
"""

from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT, to_float64
from ..stages.arc_length import SHORTEST, MeasuredLines, is_loop, measure_lines, point_along
from ..stages.simplify import move_offsets, number_kept

wp.set_module_options(EXACT)

TURN_UNITS = wp.constant(wp.float64(1e6))  # a radian; turns that are equal in these are equally sharp
TURN_MOST = wp.constant(wp.int64(2**22))  # above half a turn
POINTS_MOST = wp.constant(wp.int64(2**32))  # of a polyline


class PolylineCorners(NamedTuple):
    """Corners of polylines, in order, on a device."""

    lines: MeasuredLines
    point: wp.array  # int64, shape [corner]: the points that are corners; a loop's seam is its first point
    start: wp.array  # int64, shape [polyline + 1]: offsets of polylines' corners
    arc: wp.array  # float64, shape [corner]: of each from its polyline's first point [m]


@wp.kernel
def _measure_turns(
    # In:
    lines: MeasuredLines,
    angle: wp.float64,  # [rad]
    window: wp.float64,  # [m]
    # Out:
    turn: wp.array[wp.int64],  # in TURN_UNITS, shape [point]; -1: no corner
):
    """Measure by how much a polyline turns at a point, if that is more than an angle."""
    p = wp.tid()
    i = wp.int64(p)
    line = lines.line[p]
    turn[p] = wp.int64(-1)
    seam = i == lines.polyline_start[line]
    if i == lines.polyline_start[line + 1] - wp.int64(1) or (seam and not is_loop(lines, line)):
        return  # an end, or a loop's first point again
    reach = window_on(lines, line, window)
    x = to_float64(lines.points[p])
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
    first = lines.polyline_start[line]
    last = lines.polyline_start[line + 1] - one
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
    first = lines.polyline_start[line]
    count = int(0)
    for k in range(int(lines.polyline_start[line + 1] - first)):
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
def _gather_arcs(
    # In:
    lines: MeasuredLines,
    point: wp.array[wp.int64],
    # Out:
    arc: wp.array[wp.float64],
):
    """Arc length of each corner."""
    c = wp.tid()
    arc[c] = lines.arc[point[c]]


@on_one_device
def find_corners(
    points: wp.array, polyline_start: wp.array, polyline_closed: wp.array, *, angle: float, window: float
) -> PolylineCorners:
    """Corners of polylines: vertices where they turn by more than `angle` [rad] within `window` [m] at either side.

    No two of a polyline are within a window of each other along it; on loops the window is a sixth of it at most.
    """
    device, count = points.device, points.shape[0]
    lines = measure_lines(points, polyline_start, polyline_closed)
    turn, order = (wp.empty(count, dtype=wp.int64, device=device) for _ in range(2))
    chosen = wp.zeros(count + 1, dtype=wp.int64, device=device)
    inputs = [lines, wp.float64(angle), wp.float64(window)]
    wp.launch(_measure_turns, count, inputs=inputs, outputs=[turn], device=device, block_dim=BLOCK)
    inputs = [lines, wp.float64(window), turn, order]
    line_count = polyline_closed.shape[0]
    wp.launch(_choose_corners, line_count, inputs=inputs, outputs=[chosen], device=device, block_dim=BLOCK)
    point, before = number_kept(chosen)
    arc = wp.empty(point.shape[0], dtype=wp.float64, device=device)
    wp.launch(_gather_arcs, arc.shape[0], inputs=[lines, point], outputs=[arc], device=device, block_dim=BLOCK)
    return PolylineCorners(lines, point, move_offsets(polyline_start, before), arc)
