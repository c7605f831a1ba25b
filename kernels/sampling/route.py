"""Routes from pose to pose: the order of the pose before is kept unless another is shorter by a margin.

As `steady_route` in render/sampling/route.py.
"""

import warp as wp

from ..contours import Contours
from .doors import STARTS_TRIED, entered_at, insertion_of
from .layout import (
    INFINITE,
    ONE,
    TINY,
    ZERO,
    DrawnPiece,
    PoseTrack,
    RouteRows,
    SamplingPlan,
    distance,
    product,
    squared,
    sum_few,
)
from .pieces import begun, drawn_size, drawn_vertex, end_of, is_loop, opposite, size_of, start_of, vertex
from .search import search_route

PIECES_MOST = wp.constant(128)  # more are drawn in the batch's order
INSERTED_MOST = wp.constant(16)  # new pieces that are inserted one by one
JUMP_SLACK = wp.constant(wp.float64(5e-3))  # [m] by which a kept route may be longer whatever its length


@wp.func
def jumps_of(
    c: Contours,
    plan: SamplingPlan,
    rows: RouteRows,
    pieces: wp.array[DrawnPiece],
    first: wp.int64,
    count: int,
):
    """Length of the jumps from each piece to the next, and from the last to the first of a cycle [m]."""
    jumps = count
    if plan.pendulum == 1:
        jumps -= 1
    for k in range(jumps):
        end = end_of(c, plan, pieces[first + wp.int64(k)])
        start = start_of(c, plan, pieces[first + wp.int64((k + 1) % count)])
        rows.span[first + wp.int64(k)] = distance(end, start)
    return sum_few(rows.span, first, jumps)


@wp.func
def nearest_way(c: Contours, plan: SamplingPlan, line: wp.int64, point: wp.vec3d):
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
def drawn_like(c: Contours, plan: SamplingPlan, piece: DrawnPiece, start: wp.vec3d, end: wp.vec3d):
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
    c: Contours, plan: SamplingPlan, rows: RouteRows, first: wp.int64, count: int, before: wp.int64, earlier: int
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
def take_candidate(rows: RouteRows, first: wp.int64, count: int):
    """Draw the pieces as the search found them."""
    for k in range(count):
        rows.drawn[first + wp.int64(k)] = rows.candidate[first + wp.int64(k)]


@wp.func
def append_new(rows: RouteRows, first: wp.int64, count: int, known: int):
    """Draw the new pieces behind the known ones."""
    drawn = known
    for k in range(count):
        piece = rows.given[first + wp.int64(k)]
        if piece.earlier < 0:
            rows.drawn[first + wp.int64(drawn)] = piece
            drawn += 1


@wp.func
def insert_new(c: Contours, plan: SamplingPlan, rows: RouteRows, run: int, first: wp.int64, count: int, known: int):
    """Insert the new pieces into the route of the known ones, where they cost least."""
    drawn = known
    for k in range(count):
        piece = rows.given[first + wp.int64(k)]
        if piece.earlier < 0:
            place, door = insertion_of(c, plan, rows, run, first, drawn, piece)
            i = drawn
            while i > place + 1:
                rows.drawn[first + wp.int64(i)] = rows.drawn[first + wp.int64(i - 1)]
                i -= 1
            rows.drawn[first + wp.int64(place + 1)] = entered_at(c, plan, piece, door, STARTS_TRIED)
            drawn += 1


@wp.func
def is_longer(plan: SamplingPlan, length: wp.float64, least: wp.float64):
    """Whether jumps are longer than the least by more than the margin [m]."""
    return length > (ONE + plan.margin) * least + JUMP_SLACK


@wp.func
def search_in_turn(
    c: Contours,
    plan: SamplingPlan,
    rows: RouteRows,
    run: int,
    first: wp.int64,
    count: int,
    known: int,
    to_search: int,
    length: wp.float64,
    known_least: wp.float64,
):
    """Search for the route of the known pieces, if asked to, then for that of new ones, if they are many.

    length: of the known pieces' jumps [m]. known_least: the least known. Returns the least after the search [m].
    """
    searched = int(to_search)
    least = known_least
    begin = int(0)
    while begin < count:  # first the known pieces, then new ones if they are many: one search is compiled, not three
        if searched > 0:
            row = first + wp.int64(begin)
            search_route(c, plan, rows, run, row, searched, wp.where(begin > 0, 1, plan.pendulum))
            if begin == 0:
                least = jumps_of(c, plan, rows, rows.candidate, row, searched)
            if begin > 0 or is_longer(plan, length, least):
                take_candidate(rows, row, searched)
        if begin > 0 or count - known <= INSERTED_MOST:
            begin = count
        else:
            append_new(rows, first, count, known)
            begin = known
            searched = count - known
    return least


@wp.func
def lay_route(
    c: Contours,
    plan: SamplingPlan,
    rows: RouteRows,
    run: int,
    first: wp.int64,
    count: int,
    matched: int,
    as_they_come: bool,
    before: wp.int64,
    earlier: PoseTrack,
):
    """Draw the pieces of a pose; returns the least jumps known [m].

    first, before: row of the first piece of the pose, and of the pose before. matched: pieces that it had.
    """
    if as_they_come or plan.shortest == 0 or count < 2 or count > PIECES_MOST:
        append_all(rows, first, count)
        return INFINITE
    known = int(matched)
    length = INFINITE
    least = INFINITE
    searched = int(0)  # pieces whose route is to be searched for, from `begin` on
    if known < 2:  # there is no order to keep
        known = count
        append_all(rows, first, count)
        searched = count
    else:
        keep_order(c, plan, rows, first, count, before, earlier.pieces)
        length = jumps_of(c, plan, rows, rows.drawn, first, known)
        least = wp.min(earlier.least, length)
        if is_longer(plan, length, least):
            searched = known
    least = search_in_turn(c, plan, rows, run, first, count, known, searched, length, least)
    if known < count and count - known <= INSERTED_MOST:
        insert_new(c, plan, rows, run, first, count, known)
    return least


@wp.func
def append_all(rows: RouteRows, first: wp.int64, count: int):
    """Draw all pieces as the batch has them."""
    for k in range(count):
        rows.drawn[first + wp.int64(k)] = rows.given[first + wp.int64(k)]
