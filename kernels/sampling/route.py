"""Routes: the order of a pose's pieces, and the start and direction of each, such that jumps are short.

The order of the pose before stays unless another is shorter by a margin. The search for the shortest route chooses an
order, and one of the candidate starts of each piece. A place is a piece, or the outside, which is at no distance from
any start; a route that is no cycle begins and ends there. A route is one start of each place.
"""

import warp as wp

from ..contours import Contours
from .layout import (
    AS_GIVEN,
    INFINITE,
    ONE,
    ZERO,
    DrawnPiece,
    PoseCycle,
    RouteRows,
    SamplingPlan,
    distance,
    part_of,
    squared,
    without_rounding,
)
from .pieces import (
    STARTS_TRIED,
    begun,
    end_of,
    entered_at,
    insertion_of,
    is_loop,
    opposite,
    size_of,
    start_of,
    vertex,
    write_starts,
)

PIECES_MOST = wp.constant(128)  # more are drawn in the batch's order
INSERTED_MOST = wp.constant(16)  # new pieces that are inserted one by one
JUMP_SLACK = wp.constant(wp.float64(5e-3))  # [m] by which jumps may be longer in the order of the pose before
EXACT_MOST = wp.constant(4)  # places; all orders are tried of so many
SEARCHED_MOST = wp.constant(32)  # pieces; a route through more is not improved
STARTS = wp.constant(64)  # starts looked at, over all pieces
GAIN_LEAST = wp.constant(wp.float64(1e-9))  # [m]; a route is not turned for less
# Sections of a run's room: of each start its place, the candidate at which the piece then ends, and the start of the
# piece reversed; of each place its first start; four routes; of each start the one before it in the shortest route.
START_ROOM = 258
PLACE_ROOM = 131
PLACE, EXIT, FLIPPED, BACK = (wp.constant(k * START_ROOM) for k in range(4))
FIRST, ROUTE, TRIAL, BEST, SPARE = (wp.constant(4 * START_ROOM + k * PLACE_ROOM) for k in range(5))
ROOM = 4 * START_ROOM + 5 * PLACE_ROOM
ROOM_SIZE = wp.constant(ROOM)
SUMS = START_ROOM
SUMS_SIZE = wp.constant(SUMS)


@wp.struct
class RouteSearch:
    """The extent of one search for a route: its part of the room, and how many pieces, places and starts it has."""

    room: int  # start of the run's part of `RouteRows.room`
    sums: int  # of `RouteRows.sums`
    run: wp.int32
    pieces: wp.int32
    places: wp.int32  # pieces, and the outside where the route is no cycle
    starts: wp.int32


@wp.func
def noted(rows: RouteRows, s: RouteSearch, section: int, i: int):
    """A number in the run's room."""
    return int(rows.room[s.room + section + i])


@wp.func
def note(rows: RouteRows, s: RouteSearch, section: int, i: int, value: int):
    """Write a number into the run's room."""
    rows.room[s.room + section + i] = value


@wp.func
def jump_between(rows: RouteRows, s: RouteSearch, a: int, b: int):
    """The jump from the end of a piece drawn from one start to another start [m]."""
    out = noted(rows, s, EXIT, a)
    if out < 0 or noted(rows, s, EXIT, b) < 0:
        return ZERO
    return distance(rows.start[s.run, b], rows.start[s.run, out])


@wp.func
def list_starts(
    c: Contours,
    plan: SamplingPlan,
    rows: RouteRows,
    run: int,
    pieces: wp.array[DrawnPiece],
    first: int,
    count: int,
    outside: int,
):
    """Write the candidate starts of all places."""
    s = RouteSearch()
    s.room = run * ROOM_SIZE
    s.sums = run * SUMS_SIZE
    s.run = run
    s.pieces = count
    s.places = count + outside
    share = wp.max(1, STARTS // count)
    at = int(0)
    for k in range(count):
        line = pieces[first + k].line
        starts = write_starts(c, plan, rows, run, line, share, at)
        loop = is_loop(c, plan, line)
        note(rows, s, FIRST, k, at)
        for i in range(starts):
            other = at + i
            if not loop:
                other = at + 1 - i
            note(rows, s, PLACE, at + i, k)
            note(rows, s, FLIPPED, at + i, other)
            note(rows, s, EXIT, at + i, wp.where(plan.turns_back == 1, at + i, other))
        at += starts
    if outside == 1:
        note(rows, s, FIRST, count, at)
        note(rows, s, PLACE, at, count)
        note(rows, s, FLIPPED, at, at)
        note(rows, s, EXIT, at, -1)
        at += 1
    note(rows, s, FIRST, s.places, at)
    s.starts = at
    return s


@wp.func
def reach_starts(rows: RouteRows, s: RouteSearch, before: int, place: int):
    """Write the shortest route to each start of a place, and over which start of the place before it leads."""
    for d in range(noted(rows, s, FIRST, place), noted(rows, s, FIRST, place + 1)):
        least = INFINITE
        for h in range(noted(rows, s, FIRST, before), noted(rows, s, FIRST, before + 1)):
            through = rows.sums[s.sums + h] + jump_between(rows, s, h, d)
            if through < least:
                least = through
                note(rows, s, BACK, d, h)
        rows.sums[s.sums + d] = least


@wp.func
def best_starts(rows: RouteRows, s: RouteSearch, section: int, best: wp.float64):
    """Write the starts that make a route of this order shortest into TRIAL, if that is shorter than `best` [m].

    section: of a route in that order. Returns the length [m]. Dynamic programming from each start of the first place.
    """
    least = best
    begin = noted(rows, s, PLACE, noted(rows, s, section, 0))
    second = noted(rows, s, PLACE, noted(rows, s, section, 1))
    last = noted(rows, s, PLACE, noted(rows, s, section, s.places - 1))
    for i in range(noted(rows, s, FIRST, begin), noted(rows, s, FIRST, begin + 1)):
        for d in range(noted(rows, s, FIRST, second), noted(rows, s, FIRST, second + 1)):
            rows.sums[s.sums + d] = jump_between(rows, s, i, d)
        for k in range(2, s.places):
            before = noted(rows, s, PLACE, noted(rows, s, section, k - 1))
            reach_starts(rows, s, before, noted(rows, s, PLACE, noted(rows, s, section, k)))
        for d in range(noted(rows, s, FIRST, last), noted(rows, s, FIRST, last + 1)):
            length = rows.sums[s.sums + d] + jump_between(rows, s, d, i)
            if length < least:
                least = length
                start = int(d)
                for step in range(1, s.places):
                    note(rows, s, SPARE, s.places - step, start)
                    if step < s.places - 1:
                        start = noted(rows, s, BACK, start)
                note(rows, s, SPARE, 0, i)
    if least < best:
        copy_route(rows, s, SPARE, TRIAL)
    return least


@wp.func
def copy_route(rows: RouteRows, s: RouteSearch, source: int, section: int):
    """Copy a route."""
    for k in range(s.places):
        note(rows, s, section, k, noted(rows, s, source, k))


@wp.func
def try_orders(rows: RouteRows, s: RouteSearch):
    """Find the best starts of up to four places in any order, into BEST."""
    orders = int(1)
    if s.places == EXACT_MOST:
        orders = int(3)
    least = INFINITE
    k = int(0)
    while k < orders:  # a `for` over few would be unrolled, and compiled three times
        order = wp.vec4i(0, 1, 2, 3)
        if k == 1:
            order = wp.vec4i(0, 1, 3, 2)
        elif k == 2:
            order = wp.vec4i(0, 2, 1, 3)
        for i in range(s.places):
            note(rows, s, ROUTE, i, noted(rows, s, FIRST, order[i]))
        length = best_starts(rows, s, ROUTE, least)
        if length < least:
            least = length
            copy_route(rows, s, TRIAL, BEST)
        k += 1


@wp.func
def nearest_start(rows: RouteRows, s: RouteSearch, start: int, count: int):
    """The nearest start, from one on, of a place that is not among the first of the route."""
    least = INFINITE
    best = int(-1)
    for d in range(s.starts):
        place = noted(rows, s, PLACE, d)
        free = int(1)
        for k in range(count):
            if noted(rows, s, PLACE, noted(rows, s, ROUTE, k)) == place:
                free = int(0)
        if free == 1:
            length = jump_between(rows, s, start, d)
            if length < least or best < 0:  # a jump to a point that is none has no length
                least = length
                best = d
    return best


@wp.func
def nearest_route(rows: RouteRows, s: RouteSearch):
    """Write a route: from the shortest jump on, always to the nearest place that is left."""
    least = INFINITE
    start = int(0)
    for a in range(s.starts):
        for b in range(s.starts):
            if noted(rows, s, PLACE, a) != noted(rows, s, PLACE, b):
                length = jump_between(rows, s, a, b)
                if length < least:
                    least = length
                    start = a
    note(rows, s, ROUTE, 0, start)
    for k in range(1, s.places):
        note(rows, s, ROUTE, k, nearest_start(rows, s, noted(rows, s, ROUTE, k - 1), k))


@wp.func
def reverse_range(rows: RouteRows, s: RouteSearch, i: int, j: int):
    """Reverse the order of i..j in the route, and each piece in it."""
    a = int(i)
    b = int(j)
    while a <= b:
        one = noted(rows, s, FLIPPED, noted(rows, s, ROUTE, a))
        note(rows, s, ROUTE, a, noted(rows, s, FLIPPED, noted(rows, s, ROUTE, b)))
        note(rows, s, ROUTE, b, one)
        a += 1
        b -= 1


@wp.func
def gain_of_reversal(rows: RouteRows, s: RouteSearch, i: int, j: int):
    """By how much a route is shorter with i..j reversed, from 1 on [m]."""
    before = noted(rows, s, ROUTE, i - 1)
    begin = noted(rows, s, ROUTE, i)
    end = noted(rows, s, ROUTE, j)
    after = noted(rows, s, ROUTE, (j + 1) % s.places)
    now = jump_between(rows, s, before, begin) + jump_between(rows, s, end, after)
    to = jump_between(rows, s, before, noted(rows, s, FLIPPED, end))
    on = jump_between(rows, s, noted(rows, s, FLIPPED, begin), after)
    return now - (to + on)


@wp.func
def uncross(rows: RouteRows, s: RouteSearch):
    """2-opt: reverse ranges of the route while that shortens it; returns how many were."""
    turned = int(0)
    going = int(1)
    while going == 1 and turned < 4 * s.places:
        most = -INFINITE
        best_i = int(1)
        best_j = int(1)
        for i in range(1, s.places):
            for j in range(i, s.places):
                gain = gain_of_reversal(rows, s, i, j)
                if gain > most:
                    most = gain
                    best_i = i
                    best_j = j
        if most > GAIN_LEAST:
            reverse_range(rows, s, best_i, best_j)
            turned += 1
        else:
            going = int(0)
    return turned


@wp.func
def improve_route(rows: RouteRows, s: RouteSearch):
    """Improve the route by the best starts, and by 2-opt, twice, if not too long for that; returns its length [m]."""
    length = INFINITE
    rounds = int(0)
    while rounds < 2:
        turned = int(0)
        if s.pieces <= SEARCHED_MOST:
            turned = uncross(rows, s)
        if turned > 0 or rounds == 0:
            length = best_starts(rows, s, ROUTE, INFINITE)
            copy_route(rows, s, TRIAL, ROUTE)
        rounds += 1
    return length


@wp.func
def length_of(rows: RouteRows, s: RouteSearch):
    """Length of the route [m]."""
    total = ZERO
    for k in range(s.places):
        total += jump_between(rows, s, noted(rows, s, ROUTE, k), noted(rows, s, ROUTE, (k + 1) % s.places))
    return total


@wp.func
def search_many(rows: RouteRows, s: RouteSearch):
    """Find a short route through more places than all orders are tried of, into BEST."""
    least = INFINITE
    k = int(0)
    while k < 2:
        length = ZERO
        if k == 0:
            nearest_route(rows, s)
        else:
            for i in range(s.places):  # in order, each by its first start
                note(rows, s, ROUTE, i, noted(rows, s, FIRST, i))
        if k == 1 and s.pieces > SEARCHED_MOST:
            length = length_of(rows, s)
        else:
            length = improve_route(rows, s)
        if length < least:
            least = length
            copy_route(rows, s, ROUTE, BEST)
        k += 1


@wp.func
def search_route(c: Contours, plan: SamplingPlan, rows: RouteRows, run: int, first: int, count: int, outside: int):
    """Write the shortest route through 2..128 of the drawn pieces into `candidate`, each as it is drawn."""
    s = list_starts(c, plan, rows, run, rows.drawn, first, count, outside)
    if s.places <= EXACT_MOST:
        try_orders(rows, s)
    else:
        search_many(rows, s)
    begin = int(0)  # the outside comes last
    for k in range(s.places):
        if noted(rows, s, EXIT, noted(rows, s, BEST, k)) < 0:
            begin = k + 1
    share = wp.max(1, STARTS // count)
    for k in range(count):
        start = noted(rows, s, BEST, (begin + k) % s.places)
        place = noted(rows, s, PLACE, start)
        piece = rows.drawn[first + place]
        piece.mode = AS_GIVEN
        entered = entered_at(c, plan, piece, start - noted(rows, s, FIRST, place), share)
        rows.candidate[first + k] = entered


@wp.func
def jumps_of(c: Contours, plan: SamplingPlan, pieces: wp.array[DrawnPiece], first: int, count: int):
    """Length of the jumps from each piece to the next, and from the last to the first of a cycle [m]."""
    jumps = count
    if plan.pendulum == 1:
        jumps -= 1
    total = ZERO
    for k in range(jumps):
        end = end_of(c, plan, pieces[first + k])
        total += distance(end, start_of(c, plan, pieces[first + ((k + 1) % count)]))
    return total


@wp.func
def nearest_segment(c: Contours, plan: SamplingPlan, line: int, point: wp.vec3d):
    """The segment of a polyline nearest to a point, and where on it, 0..1."""
    size = size_of(c, plan, line)
    best = int(0)
    best_part = ZERO
    least = INFINITE
    for i in range(size - 1):
        a = vertex(c, line, i)
        step = vertex(c, line, i + 1) - a
        part = part_of(step, point - a)
        square = squared((a + part * step) - point)
        if square < least:
            least = square
            best = i
            best_part = part
    step = vertex(c, line, best + 1) - vertex(c, line, best)
    return best, without_rounding(step, best_part)


@wp.func
def drawn_like(c: Contours, plan: SamplingPlan, piece: DrawnPiece, start: wp.vec3d, end: wp.vec3d):
    """A piece the same way round as between two ends [m]; a loop from the point nearest to the first of them."""
    if is_loop(c, plan, piece.line):
        segment, part = nearest_segment(c, plan, piece.line, start)
        return begun(c, plan, piece, segment, part)
    size = size_of(c, plan, piece.line)
    a = vertex(c, piece.line, 0)
    b = vertex(c, piece.line, size - 1)
    if distance(start, b) + distance(end, a) < distance(start, a) + distance(end, b):
        return opposite(piece)
    return piece


@wp.func
def keep_order(c: Contours, plan: SamplingPlan, rows: RouteRows, first: int, count: int, before: int, earlier: int):
    """Draw the known pieces in the order of the pose before, and as then; returns how many there are."""
    known = int(0)
    for e in range(earlier):
        for k in range(count):
            piece = rows.given[first + k]
            if piece.earlier == e:
                then = rows.drawn[before + e]
                rows.drawn[first + known] = drawn_like(c, plan, piece, then.start, then.end)
                known += 1
    return known


@wp.func
def append_new(rows: RouteRows, first: int, count: int, known: int):
    """Draw the new pieces behind the known ones."""
    drawn = known
    for k in range(count):
        piece = rows.given[first + k]
        if piece.earlier < 0:
            rows.drawn[first + drawn] = piece
            drawn += 1


@wp.func
def insert_new(c: Contours, plan: SamplingPlan, rows: RouteRows, run: int, first: int, count: int, known: int):
    """Insert the new pieces into the route of the known ones, where they cost least."""
    drawn = known
    for k in range(count):
        piece = rows.given[first + k]
        if piece.earlier < 0:
            place, start = insertion_of(c, plan, rows, run, first, drawn, piece)
            i = drawn
            while i > place + 1:
                rows.drawn[first + i] = rows.drawn[first + i - 1]
                i -= 1
            rows.drawn[first + place + 1] = entered_at(c, plan, piece, start, STARTS_TRIED)
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
    first: int,
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
            row = first + begin
            search_route(c, plan, rows, run, row, searched, wp.where(begin > 0, 1, plan.pendulum))
            if begin == 0:
                least = jumps_of(c, plan, rows.candidate, row, searched)
            if begin > 0 or is_longer(plan, length, least):
                for k in range(searched):
                    rows.drawn[row + k] = rows.candidate[row + k]
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
    first: int,
    count: int,
    matched: int,
    as_they_come: bool,
    before: int,
    earlier: PoseCycle,
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
        length = jumps_of(c, plan, rows.drawn, first, known)
        least = wp.min(earlier.least, length)
        if is_longer(plan, length, least):
            searched = known
    least = search_in_turn(c, plan, rows, run, first, count, known, searched, length, least)
    if known < count and count - known <= INSERTED_MOST:
        insert_new(c, plan, rows, run, first, count, known)
    return least


@wp.func
def append_all(rows: RouteRows, first: int, count: int):
    """Draw all pieces as the batch has them."""
    for k in range(count):
        rows.drawn[first + k] = rows.given[first + k]
