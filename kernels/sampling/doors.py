"""Doors: points at which a piece may be entered, and the insertion of a piece into a route.

As in render/sampling/route.py, with the same choice among routes of equal length.
"""

import warp as wp

from ..contours import Contours
from .layout import (
    BEGUN,
    INFINITE,
    ZERO,
    DrawnPiece,
    RouteRows,
    SamplingPlan,
    distance,
    squared,
)
from .pieces import end_of, is_loop, opposite, row_of, size_of, start_of, vertex

DOORS = 258  # most that are looked at: two on each of 128 open pieces
STARTS_TRIED = wp.constant(16)  # on a loop that is inserted
NEAR = wp.constant(wp.float64(1e-9))  # [m]; vertices so near to a start are that start


@wp.func
def loop_length(c: Contours, line: wp.int64, size: int):
    """Length of a loop [m]."""
    arc = ZERO
    for i in range(1, size):
        arc += wp.sqrt(squared(vertex(c, line, i) - vertex(c, line, i - 1)))
    return arc


@wp.func
def write_doors(c: Contours, plan: SamplingPlan, rows: RouteRows, run: int, line: wp.int64, share: int, first: int):
    """Write the doors of a polyline into the run's room from a place on; returns how many: `share` on a loop."""
    size = size_of(c, plan, line)
    rows.door[run, first] = vertex(c, line, 0)
    if not is_loop(c, plan, line):
        rows.door[run, first + 1] = vertex(c, line, size - 1)
        return 2
    total = ZERO
    if share > 1:
        total = loop_length(c, line, size)
    arc = ZERO
    k = int(1)
    for i in range(1, size):
        a = vertex(c, line, i - 1)
        step = vertex(c, line, i) - a
        end = arc + wp.sqrt(squared(step))
        inside = int(1)
        while inside == 1 and k < share:
            at = total * wp.float64(k) / wp.float64(share)
            inside = int(0)
            if at < end:
                point = a
                if at != arc:
                    slope = step / (end - arc)
                    point = slope * (at - arc) + a
                rows.door[run, first + k] = point
                k += 1
                inside = int(1)
        arc = end
    return share


@wp.func
def entered_at(c: Contours, plan: SamplingPlan, piece: DrawnPiece, door: int, share: int):
    """A piece drawn from one of its doors on."""
    if door == 0:
        return piece
    if not is_loop(c, plan, piece.line):
        return opposite(piece)
    out = piece
    size = size_of(c, plan, piece.line)
    start = loop_length(c, piece.line, size) * wp.float64(door) / wp.float64(share)
    out.mode = BEGUN
    out.before = int(1)
    out.after = int(1)
    if ZERO >= start - NEAR:
        out.before = int(0)
    arc = ZERO
    for i in range(1, size):
        a = vertex(c, piece.line, i - 1)
        step = vertex(c, piece.line, i) - a
        end = arc + wp.sqrt(squared(step))
        if end < start - NEAR:
            out.before = i + 1
        if end < start + NEAR:
            out.after = i + 1
        if arc <= start and start < end:
            out.at = a
            has_levels = c.intensity.shape[0] > 0
            if has_levels:
                out.level = wp.float64(c.intensity[row_of(c, piece.line, i - 1)])
            if start != arc:
                out.at = (step / (end - arc)) * (start - arc) + a
                if has_levels:
                    rise = wp.float64(c.intensity[row_of(c, piece.line, i)]) - out.level
                    out.level = rise / (end - arc) * (start - arc) + out.level
        arc = end
    return out


@wp.func
def exit_of(c: Contours, plan: SamplingPlan, line: wp.int64, first: int, door: int):
    """Door at which a piece is left that is entered at one; first: its first door."""
    if is_loop(c, plan, line) or plan.turns_back == 1:
        return door
    return 2 * first + 1 - door


@wp.func
def insertion_of(
    c: Contours, plan: SamplingPlan, rows: RouteRows, run: int, first: wp.int64, count: int, piece: DrawnPiece
):
    """Behind which of the drawn pieces another makes their route least longer, and the door that does."""
    doors = write_doors(c, plan, rows, run, piece.line, STARTS_TRIED, 0)
    least = INFINITE
    best = int(0)
    best_door = int(0)
    for k in range(count):
        end = end_of(c, plan, rows.drawn[first + wp.int64(k)])
        following = start_of(c, plan, rows.drawn[first + wp.int64((k + 1) % count)])
        direct = distance(end, following)
        for d in range(doors):
            to = distance(rows.door[run, d], end)
            on = distance(rows.door[run, exit_of(c, plan, piece.line, 0, d)], following)
            cost = (to + on) - direct
            if plan.pendulum == 1 and k == count - 1:
                cost = to
            if cost < least:
                least = cost
                best = k
                best_door = d
    return best, best_door
