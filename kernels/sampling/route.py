"""Routes from pose to pose: the order of the pose before is kept unless another is shorter by a margin.

As `steady_route` in render/sampling/route.py.
"""

import warp as wp

from .doors import SEARCHED, STARTS_TRIED, DoorSearch, entered_at, found_piece, insertion_of, search_route
from .layout import (
    INFINITE,
    ONE,
    TINY,
    ZERO,
    DrawnPiece,
    MotionContours,
    PoseTrack,
    RouteRows,
    SamplingPlan,
    distance,
    product,
    squared,
    sum_few,
)
from .pieces import begun, drawn_size, drawn_vertex, end_of, is_loop, opposite, size_of, start_of, vertex

PIECES_MOST = wp.constant(128)  # more are drawn in the batch's order
INSERTED_MOST = wp.constant(16)  # new pieces that are inserted one by one
JUMP_SLACK = wp.constant(wp.float64(5e-3))  # [m] by which a kept route may be longer whatever its length


@wp.func
def jumps_of(c: MotionContours, plan: SamplingPlan, rows: RouteRows, first: wp.int64, count: int):
    """Length of the jumps from each drawn piece to the next, and from the last to the first of a cycle [m]."""
    jumps = count
    if plan.pendulum == 1:
        jumps -= 1
    for k in range(jumps):
        end = end_of(c, plan, rows.drawn[first + wp.int64(k)])
        start = start_of(c, plan, rows.drawn[first + wp.int64((k + 1) % count)])
        rows.span[first + wp.int64(k)] = distance(end, start)
    return sum_few(rows.span, first, jumps)


@wp.func
def nearest_way(c: MotionContours, plan: SamplingPlan, line: wp.int64, point: wp.vec3d):
    """The way of a polyline from vertex to vertex that comes nearest to a point, and where on it, 0..1."""
    size = size_of(c, plan, line)
    best = int(0)
    best_part = ZERO
    least = INFINITE
    for i in range(size - 1):
        a = vertex(c, line, i)
        step = vertex(c, line, i + 1) - a
        part = product(point - a, step) / wp.max(squared(step), TINY)
        part = wp.min(wp.max(part, ZERO), ONE)
        square = squared((a + part * step) - point)
        if square < least:
            least = square
            best = i
            best_part = part
    return best, best_part


@wp.func
def drawn_like(c: MotionContours, plan: SamplingPlan, piece: DrawnPiece, start: wp.vec3d, end: wp.vec3d):
    """A piece the same way round as between two ends [m]; a loop from the point nearest to the first of them."""
    if is_loop(c, plan, piece.line):
        way, part = nearest_way(c, plan, piece.line, start)
        return begun(c, plan, piece, way, part)
    size = size_of(c, plan, piece.line)
    a = vertex(c, piece.line, 0)
    b = vertex(c, piece.line, size - 1)
    if distance(start, b) + distance(end, a) < distance(start, a) + distance(end, b):
        return opposite(piece)
    return piece


@wp.func
def keep_order(
    c: MotionContours, plan: SamplingPlan, rows: RouteRows, first: wp.int64, count: int, before: wp.int64, earlier: int
):
    """Draw the known pieces in the order of the pose before, and as then; returns how many there are."""
    known = int(0)
    for e in range(earlier):
        for k in range(count):
            piece = rows.given[first + wp.int64(k)]
            if piece.earlier == e:
                then = rows.drawn[before + wp.int64(e)]
                size = size_of(c, plan, then.line)
                start = drawn_vertex(c, then, size, 0)
                end = drawn_vertex(c, then, size, drawn_size(c, plan, then) - 1)
                rows.drawn[first + wp.int64(known)] = drawn_like(c, plan, piece, start, end)
                known += 1
    return known


@wp.func
def take_route(
    c: MotionContours,
    plan: SamplingPlan,
    rows: RouteRows,
    s: DoorSearch,
    pieces: wp.array[DrawnPiece],
    first: wp.int64,
    count: int,
):
    """Draw the pieces, at most SEARCHED, as a search found them."""
    one = found_piece(c, plan, s, pieces, first, count, 0)
    two = found_piece(c, plan, s, pieces, first, count, 1)
    three = two
    four = two
    if count > 2:
        three = found_piece(c, plan, s, pieces, first, count, 2)
    if count > 3:
        four = found_piece(c, plan, s, pieces, first, count, 3)
    rows.drawn[first] = one  # read all before: the pieces may stand here
    rows.drawn[first + wp.int64(1)] = two
    if count > 2:
        rows.drawn[first + wp.int64(2)] = three
    if count > 3:
        rows.drawn[first + wp.int64(3)] = four


@wp.func
def insert_new(
    c: MotionContours, plan: SamplingPlan, rows: RouteRows, motion: int, first: wp.int64, count: int, known: int
):
    """Insert the new pieces into the route of the known ones, where they cost least."""
    drawn = known
    for k in range(count):
        piece = rows.given[first + wp.int64(k)]
        if piece.earlier < 0:
            place, door = insertion_of(c, plan, rows, motion, first, drawn, piece)
            i = drawn
            while i > place + 1:
                rows.drawn[first + wp.int64(i)] = rows.drawn[first + wp.int64(i - 1)]
                i -= 1
            rows.drawn[first + wp.int64(place + 1)] = entered_at(c, plan, piece, door, STARTS_TRIED)
            drawn += 1


@wp.func
def search_again(
    c: MotionContours, plan: SamplingPlan, rows: RouteRows, motion: int, first: wp.int64, count: int, length: wp.float64
):
    """Take the shortest route of the drawn pieces where theirs, of a length [m], is longer by the margin.

    Returns the jumps of the shortest [m].
    """
    last = wp.int64(count - 1)
    one = rows.drawn[first]
    two = rows.drawn[first + wp.int64(1)]
    three = rows.drawn[first + wp.min(wp.int64(2), last)]
    four = rows.drawn[first + last]
    s = search_route(c, plan, rows, motion, rows.drawn, first, count, plan.pendulum)
    take_route(c, plan, rows, s, rows.drawn, first, count)
    least = jumps_of(c, plan, rows, first, count)
    if not is_longer(plan, length, least):
        rows.drawn[first] = one
        rows.drawn[first + wp.int64(1)] = two
        rows.drawn[first + wp.min(wp.int64(2), last)] = three
        rows.drawn[first + last] = four
    return least


@wp.func
def is_longer(plan: SamplingPlan, length: wp.float64, least: wp.float64):
    """Whether jumps are longer than the least by more than the margin [m]."""
    return length > (ONE + plan.margin) * least + JUMP_SLACK


@wp.func
def keep_route(
    c: MotionContours,
    plan: SamplingPlan,
    rows: RouteRows,
    motion: int,
    first: wp.int64,
    count: int,
    before: wp.int64,
    earlier: PoseTrack,
):
    """Draw pieces in the order of the pose before; returns the least jumps [m], negative where a search is too long."""
    known = keep_order(c, plan, rows, first, count, before, earlier.pieces)
    length = jumps_of(c, plan, rows, first, known)
    least = wp.min(earlier.least, length)
    if is_longer(plan, length, least):
        if known + plan.pendulum > SEARCHED:
            return -ONE
        least = search_again(c, plan, rows, motion, first, known, length)
    if count - known > INSERTED_MOST:
        return -ONE
    insert_new(c, plan, rows, motion, first, count, known)
    return least


@wp.func
def lay_route(
    c: MotionContours,
    plan: SamplingPlan,
    rows: RouteRows,
    motion: int,
    first: wp.int64,
    count: int,
    known: int,
    as_they_come: bool,
    before: wp.int64,
    earlier: PoseTrack,
):
    """Draw the pieces of a pose; returns the least jumps [m], negative where a search would be too long.

    first, before: row of the first piece of the pose, and of the pose before. known: pieces that it had.
    """
    if as_they_come or plan.shortest == 0 or count < 2 or count > PIECES_MOST:
        for k in range(count):
            rows.drawn[first + wp.int64(k)] = rows.given[first + wp.int64(k)]
        return INFINITE
    if known >= 2:
        return keep_route(c, plan, rows, motion, first, count, before, earlier)
    if count + plan.pendulum > SEARCHED:
        return -ONE
    s = search_route(c, plan, rows, motion, rows.given, first, count, plan.pendulum)
    take_route(c, plan, rows, s, rows.given, first, count)
    return jumps_of(c, plan, rows, first, count)
