"""Pieces: polylines of a pose that have a length, as they are drawn, recognised from pose to pose, and entered.

A start is a candidate: a point from which a piece may be drawn.
"""

import warp as wp

from ..contours import Contours
from ..patch import to_float64
from .layout import (
    AS_GIVEN,
    BEGUN,
    HALF,
    INFINITE,
    ONE,
    REVERSED,
    TINY,
    ZERO,
    DrawnPiece,
    PoseSchedule,
    RouteRows,
    SamplerState,
    SamplingPlan,
    distance,
    squared,
)

NEARNESS = wp.constant(wp.float64(0.02**2))  # [m^2]; a piece farther from where it was is another: 1.8 m/s at 90 Hz
MARKS_A_METRE = wp.constant(wp.float64(1e7))  # to which marks are rounded
STARTS_MOST = 258  # candidate starts of all pieces: two on each of 128 open ones
STARTS_TRIED = wp.constant(16)  # on a loop that is inserted
NEAR = wp.constant(wp.float64(1e-9))  # [m]; vertices so near to a start are that start


@wp.func
def is_loop(c: Contours, plan: SamplingPlan, line: int):
    """Whether a polyline is drawn as a loop."""
    return int(c.polyline_closed[line]) != 0 or plan.closes == 1


@wp.func
def size_of(c: Contours, plan: SamplingPlan, line: int):
    """Vertices of a polyline, with the chord's end where it is closed by one."""
    count = int(c.polyline_start[line + 1] - c.polyline_start[line])
    if plan.closes == 1 and int(c.polyline_closed[line]) == 0:
        count += 1
    return count


@wp.func
def row_of(c: Contours, line: int, i: int):
    """Row of a polyline's vertex; the one behind the last is the first."""
    row = int(c.polyline_start[line]) + i
    if row == int(c.polyline_start[line + 1]):
        row = int(c.polyline_start[line])
    return row


@wp.func
def vertex(c: Contours, line: int, i: int):
    """A vertex of a polyline [m]."""
    return to_float64(c.points[row_of(c, line, i)])


@wp.func
def drawn_size(c: Contours, plan: SamplingPlan, piece: DrawnPiece):
    """Vertices of a piece as it is drawn."""
    count = size_of(c, plan, piece.line)
    if piece.mode == BEGUN:
        count = 2 + (count - piece.after) + wp.max(piece.before - 1, 0)
    return count


@wp.func
def source_of(piece: DrawnPiece, size: int, i: int):
    """Vertex of the polyline that is the i-th of the piece as drawn; -1: where a loop begins. size: of the polyline."""
    if piece.mode == AS_GIVEN:
        return i
    if piece.mode == REVERSED:
        return size - 1 - i
    rest = size - piece.after
    if i == 0:
        return -1
    if i <= rest:
        return piece.after + i - 1
    if i - rest < piece.before:
        return i - rest
    return -1


@wp.func
def drawn_vertex(c: Contours, piece: DrawnPiece, size: int, i: int):
    """The i-th vertex of a piece as drawn [m]."""
    k = source_of(piece, size, i)
    if k < 0:
        return piece.at
    return vertex(c, piece.line, k)


@wp.func
def drawn_level(c: Contours, piece: DrawnPiece, size: int, i: int):
    """Intensity at the i-th vertex of a piece as drawn."""
    k = source_of(piece, size, i)
    if k < 0:
        return piece.level
    return wp.float64(c.intensity[row_of(c, piece.line, k)])


@wp.func
def start_of(c: Contours, plan: SamplingPlan, piece: DrawnPiece):
    """Start of a piece [m]."""
    return drawn_vertex(c, piece, size_of(c, plan, piece.line), 0)


@wp.func
def end_of(c: Contours, plan: SamplingPlan, piece: DrawnPiece):
    """End of a piece [m]: its start, if it is a loop or drawn there and back."""
    if is_loop(c, plan, piece.line) or plan.turns_back == 1:
        return start_of(c, plan, piece)
    size = size_of(c, plan, piece.line)
    return drawn_vertex(c, piece, size, size - 1)


@wp.func
def sizes_of(c: Contours, pose: int):
    """The sizes of a pose's polylines, and which are closed, as one number; others have another one, all but surely."""
    sizes = wp.int64(0)
    line = int(c.pose_start[pose])
    while line < int(c.pose_start[pose + 1]):
        count = c.polyline_start[line + 1] - c.polyline_start[line]
        sizes = sizes * wp.int64(0x9E3779B9) + wp.int64(2) * count + wp.int64(c.polyline_closed[line])
        line += 1
    return sizes


@wp.func
def goes_on(c: Contours, schedule: PoseSchedule, state: SamplerState, pose: int, pieces: int):
    """Whether a pose of so many pieces is the last one of the span before, and has polylines as large as then."""
    motion = schedule.motion[pose]
    if schedule.goes_on[motion] == 0 or pose != schedule.motion_start[motion]:
        return False
    return state.motion[motion].pieces == pieces and state.motion[motion].sizes == sizes_of(c, pose)


@wp.func
def collect_pieces(c: Contours, rows: RouteRows, pose: int):
    """Write the pieces of a pose; returns how many there are, and the length of all [m]."""
    first = int(c.pose_start[pose])
    count = int(0)
    arc = ZERO
    line = first
    while line < int(c.pose_start[pose + 1]):
        begin = arc
        size = int(c.polyline_start[line + 1] - c.polyline_start[line])
        for i in range(1, size):
            arc += wp.sqrt(squared(vertex(c, line, i) - vertex(c, line, i - 1)))
        if arc > begin:
            piece = DrawnPiece()  # as the batch has it: AS_GIVEN
            piece.line = line
            piece.earlier = -1
            rows.given[first + count] = piece
            rows.span[first + count] = arc - begin
            count += 1
        line += 1
    return count, arc


@wp.func
def rounded_mark(value: wp.float64):
    """A number of a mark on its grid: else rounding would decide between pieces that lie on each other."""
    return wp.rint(MARKS_A_METRE * value) / MARKS_A_METRE


@wp.func
def mark_of(c: Contours, plan: SamplingPlan, piece: DrawnPiece):
    """Middle of a piece and the root of its mean squared distance from there [m], to 1e-7, weighted by length.

    A loop that begins between two vertices has one segment more, so its mark is not that of the polyline.
    """
    size = size_of(c, plan, piece.line)
    count = drawn_size(c, plan, piece)
    total = ZERO
    middle = wp.vec3d(ZERO, ZERO, ZERO)
    for i in range(1, count):
        a = drawn_vertex(c, piece, size, i - 1)
        step = drawn_vertex(c, piece, size, i) - a
        length = wp.sqrt(squared(step))
        total += length
        middle += length * (a + HALF * step)
    total = wp.max(total, TINY)
    middle = middle / total
    square = ZERO
    for i in range(1, count):
        a = drawn_vertex(c, piece, size, i - 1)
        step = drawn_vertex(c, piece, size, i) - a
        square += wp.sqrt(squared(step)) * squared((a + HALF * step) - middle)
    return wp.vec4d(
        rounded_mark(middle[0]), rounded_mark(middle[1]), rounded_mark(middle[2]), rounded_mark(wp.sqrt(square / total))
    )


@wp.func
def mark_pieces(c: Contours, plan: SamplingPlan, pieces: wp.array[DrawnPiece], first: int, count: int):
    """Mark pieces, by which the next pose's are recognised."""
    for k in range(count):
        piece = pieces[first + k]
        piece.mark = mark_of(c, plan, piece)
        pieces[first + k] = piece


@wp.func
def mark_ends(c: Contours, plan: SamplingPlan, pieces: wp.array[DrawnPiece], first: int, count: int):
    """Write where pieces begin and end as they are drawn, by which the next pose draws them alike."""
    for k in range(count):
        piece = pieces[first + k]
        size = size_of(c, plan, piece.line)
        piece.start = drawn_vertex(c, piece, size, 0)
        piece.end = drawn_vertex(c, piece, size, drawn_size(c, plan, piece) - 1)
        pieces[first + k] = piece


@wp.func
def nearest_mark(mark: wp.vec4d, pieces: wp.array[DrawnPiece], first: int, count: int):
    """Number of the piece with the nearest mark, the first of equals, and the square distance [m^2]."""
    best = int(0)
    least = INFINITE
    for k in range(count):
        off = mark - pieces[first + k].mark
        square = wp.dot(off, off)
        if square < least:
            least = square
            best = k
    return best, least


@wp.func
def match_pieces(
    c: Contours, plan: SamplingPlan, rows: RouteRows, first: int, count: int, before: int, before_count: int
):
    """Mark the pieces of a pose and match them with the drawn ones of the pose before; returns how many it had.

    first, before: row of the first piece of the pose, and of the pose before. before_count: of its pieces; below 2
    nothing is matched, nor marked.
    """
    known = int(0)
    if before_count < 2:
        return known
    mark_pieces(c, plan, rows.given, first, count)
    for k in range(count):
        piece = rows.given[first + k]
        other, square = nearest_mark(piece.mark, rows.drawn, before, before_count)
        again, _square = nearest_mark(rows.drawn[before + other].mark, rows.given, first, count)
        if again == k and square <= NEARNESS:
            piece.earlier = other
            rows.given[first + k] = piece
            known += 1
    return known


@wp.func
def opposite(piece: DrawnPiece):
    """An open piece the other way round."""
    out = piece
    out.mode = REVERSED
    return out


@wp.func
def begun(c: Contours, plan: SamplingPlan, piece: DrawnPiece, segment: int, part: wp.float64):
    """A loop drawn from a point on a segment on, part 0..1; segment: number of its first vertex."""
    out = piece
    size = size_of(c, plan, piece.line)
    k = segment
    share = part
    if part >= ONE:
        k = segment + 1
        share = ZERO
    if share == ZERO and (k == 0 or k == size - 1):
        return out
    out.mode = BEGUN
    a = vertex(c, piece.line, k)
    out.at = a
    out.after = k + 1
    out.before = k
    has_levels = c.intensity.shape[0] > 0
    if has_levels:
        out.level = wp.float64(c.intensity[row_of(c, piece.line, k)])
    if share > ZERO:
        out.before = k + 1
        out.at = a + share * (vertex(c, piece.line, k + 1) - a)
        if has_levels:
            out.level += share * (wp.float64(c.intensity[row_of(c, piece.line, k + 1)]) - out.level)
    return out


@wp.func
def loop_length(c: Contours, line: int, size: int):
    """Length of a loop [m]."""
    arc = ZERO
    for i in range(1, size):
        arc += wp.sqrt(squared(vertex(c, line, i) - vertex(c, line, i - 1)))
    return arc


@wp.func
def write_starts(c: Contours, plan: SamplingPlan, rows: RouteRows, run: int, line: int, share: int, first: int):
    """Write the candidate starts of a polyline into the run's room; returns how many: `share` on a loop, else 2.

    first: where the first one is written.
    """
    size = size_of(c, plan, line)
    rows.start[run, first] = vertex(c, line, 0)
    if not is_loop(c, plan, line):
        rows.start[run, first + 1] = vertex(c, line, size - 1)
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
                rows.start[run, first + k] = point
                k += 1
                inside = int(1)
        arc = end
    return share


@wp.func
def entered_at(c: Contours, plan: SamplingPlan, piece: DrawnPiece, start: int, share: int):
    """A piece drawn from one of its candidate starts on."""
    if start == 0:
        return piece
    if not is_loop(c, plan, piece.line):
        return opposite(piece)
    out = piece
    size = size_of(c, plan, piece.line)
    begin = loop_length(c, piece.line, size) * wp.float64(start) / wp.float64(share)
    out.mode = BEGUN
    out.before = int(1)
    out.after = int(1)
    if ZERO >= begin - NEAR:
        out.before = int(0)
    arc = ZERO
    for i in range(1, size):
        a = vertex(c, piece.line, i - 1)
        step = vertex(c, piece.line, i) - a
        end = arc + wp.sqrt(squared(step))
        if end < begin - NEAR:
            out.before = i + 1
        if end < begin + NEAR:
            out.after = i + 1
        if arc <= begin and begin < end:
            out.at = a
            has_levels = c.intensity.shape[0] > 0
            if has_levels:
                out.level = wp.float64(c.intensity[row_of(c, piece.line, i - 1)])
            if begin != arc:
                out.at = (step / (end - arc)) * (begin - arc) + a
                if has_levels:
                    rise = wp.float64(c.intensity[row_of(c, piece.line, i)]) - out.level
                    out.level = rise / (end - arc) * (begin - arc) + out.level
        arc = end
    return out


@wp.func
def exit_of(c: Contours, plan: SamplingPlan, line: int, first: int, start: int):
    """The candidate at which a piece ends that is drawn from a start on; first: its first candidate."""
    if is_loop(c, plan, line) or plan.turns_back == 1:
        return start
    return 2 * first + 1 - start


@wp.func
def insertion_of(c: Contours, plan: SamplingPlan, rows: RouteRows, run: int, first: int, count: int, piece: DrawnPiece):
    """The drawn piece behind which another one adds least to the jumps, and the start of the other that does so."""
    starts = write_starts(c, plan, rows, run, piece.line, STARTS_TRIED, 0)
    least = INFINITE
    best = int(0)
    best_start = int(0)
    for k in range(count):
        end = end_of(c, plan, rows.drawn[first + k])
        following = start_of(c, plan, rows.drawn[first + ((k + 1) % count)])
        direct = distance(end, following)
        for d in range(starts):
            to = distance(rows.start[run, d], end)
            on = distance(rows.start[run, exit_of(c, plan, piece.line, 0, d)], following)
            cost = (to + on) - direct
            if plan.pendulum == 1 and k == count - 1:
                cost = to
            if cost < least:
                least = cost
                best = k
                best_start = d
    return best, best_start
