"""Doors: points at which a piece may be entered; the shortest cycle through up to four pieces, and insertion of one.

As `render/sampling/route.py` does it, with the same choice among routes of equal length.
"""

import warp as wp

from .layout import (
    AS_GIVEN,
    BEGUN,
    INFINITE,
    ZERO,
    DrawnPiece,
    MotionContours,
    RouteRows,
    SamplingPlan,
    distance,
    squared,
)
from .pieces import end_of, is_loop, opposite, row_of, size_of, start_of, vertex

DOORS = 64  # starts looked at, over all pieces of a search
SEARCHED = wp.constant(4)  # pieces; a route through more is not searched for here
TWICE_DOORS = 2 * DOORS
DOOR_COUNT = wp.constant(DOORS)
STARTS_TRIED = wp.constant(16)  # on a loop that is inserted
NEAR = wp.constant(wp.float64(1e-9))  # [m]; vertices so near to a start are that start


@wp.func
def loop_length(c: MotionContours, line: wp.int64, size: int):
    """Length of a loop [m]."""
    arc = ZERO
    for i in range(1, size):
        arc += wp.sqrt(squared(vertex(c, line, i) - vertex(c, line, i - 1)))
    return arc


@wp.func
def write_doors(
    c: MotionContours, plan: SamplingPlan, rows: RouteRows, motion: int, line: wp.int64, share: int, first: int
):
    """Write the doors of a polyline into the motion's room from a place on; returns how many: `share` on a loop."""
    size = size_of(c, plan, line)
    rows.door[motion, first] = vertex(c, line, 0)
    if not is_loop(c, plan, line):
        rows.door[motion, first + 1] = vertex(c, line, size - 1)
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
                rows.door[motion, first + k] = point
                k += 1
                inside = int(1)
        arc = end
    return share


@wp.func
def entered_at(c: MotionContours, plan: SamplingPlan, piece: DrawnPiece, door: int, share: int):
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
def exit_of(c: MotionContours, plan: SamplingPlan, line: wp.int64, first: int, door: int):
    """Door at which a piece is left that is entered at one; first: its first door."""
    if is_loop(c, plan, line) or plan.turns_back == 1:
        return door
    return 2 * first + 1 - door


@wp.func
def route_step(rows: RouteRows, motion: int, out: int, into: int):
    """Length of a jump from one door to another [m]; -1: from or to the outside, at no distance from any."""
    if out < 0 or into < 0:
        return ZERO
    return distance(rows.door[motion, into], rows.door[motion, out])


@wp.struct
class DoorSearch:
    """Pieces of a search, as many as SEARCHED with the outside, and the shortest route so far."""

    count: wp.int32  # places: pieces, and the outside where the route is no cycle
    line: wp.vec4l  # polyline of each, -1: the outside
    first: wp.vec4i  # its first door
    doors: wp.vec4i
    order: wp.vec4i  # places in the order of the shortest route
    chosen: wp.vec4i  # their doors, -1: the outside
    length: wp.float64  # [m]


@wp.func
def door_at(s: DoorSearch, place: int, k: int):
    """Number of a place's k-th door; -1: the outside."""
    if s.line[place] < wp.int64(0):
        return -1
    return s.first[place] + k


@wp.func
def way_between(
    c: MotionContours, plan: SamplingPlan, rows: RouteRows, motion: int, s: DoorSearch, a: int, i: int, b: int, j: int
):
    """Jump from the place a, entered at its i-th door, to the j-th door of the place b [m]."""
    if s.line[a] < wp.int64(0) or s.line[b] < wp.int64(0):
        return ZERO
    out = exit_of(c, plan, s.line[a], s.first[a], s.first[a] + i)
    return route_step(rows, motion, out, s.first[b] + j)


@wp.func
def try_order(
    c: MotionContours,
    plan: SamplingPlan,
    rows: RouteRows,
    motion: int,
    s: DoorSearch,
    order: wp.vec4i,
    best: wp.float64,
):
    """The best doors of places in an order, if that is shorter than `best` [m]: dynamic programming."""
    out = s
    total = wp.zeros(shape=DOORS, dtype=wp.float64)
    following = wp.zeros(shape=DOORS, dtype=wp.float64)
    back = wp.zeros(shape=TWICE_DOORS, dtype=wp.int32)  # door of the place before, for the third and fourth place
    least = INFINITE
    last = s.count - 1
    for i in range(s.doors[order[0]]):
        for j in range(s.doors[order[1]]):
            total[j] = way_between(c, plan, rows, motion, s, order[0], i, order[1], j)
        for k in range(2, s.count):
            for j in range(s.doors[order[k]]):
                nearest = INFINITE
                for h in range(s.doors[order[k - 1]]):
                    through = total[h] + way_between(c, plan, rows, motion, s, order[k - 1], h, order[k], j)
                    if through < nearest:
                        nearest = through
                        back[(k - 2) * DOORS + j] = h
                following[j] = nearest
            for j in range(s.doors[order[k]]):
                total[j] = following[j]
        for j in range(s.doors[order[last]]):
            length = total[j] + way_between(c, plan, rows, motion, s, order[last], j, order[0], i)
            if length < least:
                least = length
                if length < best:
                    out.length = length
                    out.order = order
                    door = j
                    out.chosen[last] = door_at(s, order[last], door)
                    for step in range(1, last):
                        k = last - step
                        door = back[(k - 1) * DOORS + door]
                        out.chosen[k] = door_at(s, order[k], door)
                    out.chosen[0] = door_at(s, order[0], i)
    return out


@wp.func
def search_route(
    c: MotionContours,
    plan: SamplingPlan,
    rows: RouteRows,
    motion: int,
    pieces: wp.array[DrawnPiece],
    first: wp.int64,
    count: int,
    outside: int,
):
    """The shortest route through 2..4 pieces, the outside counted among them if the route is no cycle."""
    s = DoorSearch()
    s.count = count + outside
    s.length = INFINITE
    share = DOOR_COUNT // count
    at = int(0)
    for k in range(count):
        line = pieces[first + wp.int64(k)].line
        s.line[k] = line
        s.first[k] = at
        s.doors[k] = write_doors(c, plan, rows, motion, line, share, at)
        at += s.doors[k]
    if outside == 1:
        s.line[count] = wp.int64(-1)
        s.doors[count] = 1
    s = try_order(c, plan, rows, motion, s, wp.vec4i(0, 1, 2, 3), s.length)
    if s.count == 4:
        s = try_order(c, plan, rows, motion, s, wp.vec4i(0, 1, 3, 2), s.length)
        s = try_order(c, plan, rows, motion, s, wp.vec4i(0, 2, 1, 3), s.length)
    return s


@wp.func
def place_in_turn(s: DoorSearch, k: int):
    """Position in the route found of the k-th place that is drawn: behind the outside, if there is one."""
    begin = int(0)
    for i in range(s.count):
        if s.line[s.order[i]] < wp.int64(0):
            begin = i + 1
    return (begin + k) % s.count


@wp.func
def found_piece(
    c: MotionContours,
    plan: SamplingPlan,
    s: DoorSearch,
    pieces: wp.array[DrawnPiece],
    first: wp.int64,
    count: int,
    k: int,
):
    """The k-th piece of the route that was found, as it draws it."""
    i = place_in_turn(s, k)
    place = s.order[i]
    piece = pieces[first + wp.int64(place)]
    piece.mode = AS_GIVEN
    return entered_at(c, plan, piece, s.chosen[i] - s.first[place], DOOR_COUNT // count)


@wp.func
def insertion_of(
    c: MotionContours, plan: SamplingPlan, rows: RouteRows, motion: int, first: wp.int64, count: int, piece: DrawnPiece
):
    """Behind which of the drawn pieces another makes their route least longer, and the door that does."""
    doors = write_doors(c, plan, rows, motion, piece.line, STARTS_TRIED, 0)
    least = INFINITE
    best = int(0)
    best_door = int(0)
    for k in range(count):
        end = end_of(c, plan, rows.drawn[first + wp.int64(k)])
        following = start_of(c, plan, rows.drawn[first + wp.int64((k + 1) % count)])
        direct = distance(end, following)
        for d in range(doors):
            to = distance(rows.door[motion, d], end)
            on = distance(rows.door[motion, exit_of(c, plan, piece.line, 0, d)], following)
            cost = (to + on) - direct
            if plan.pendulum == 1 and k == count - 1:
                cost = to
            if cost < least:
                least = cost
                best = k
                best_door = d
    return best, best_door
