"""Courses: nodes of a pose's cycle, and when each is reached; one thread lays the track of a pose.

Whatever a strategy asks for comes down to nodes and when each is reached. Between two nodes the focal point runs
evenly; no time between two places is a jump, no way in some time is a pause. A course with sections keeps its nodes,
with the duration of the way to each, and ways are gone through in the order of the passes (`next_way` in ways.py).
"""

import warp as wp

from ..contours import Contours
from ..patch import to_float64
from .layout import (
    CAPPED,
    FREQUENCY,
    INFINITE,
    ONE,
    STILL,
    TWO,
    ZERO,
    DrawnPiece,
    PoseTrack,
    RouteRows,
    SamplingPlan,
    TrackNodes,
    distance,
    samples_of,
    squared,
)
from .pieces import drawn_level, drawn_size, drawn_vertex, is_loop, row_of, size_of, source_of
from .route import PIECES_MOST
from .ways import has_next, next_way, plain_way, section_duration, section_way, way_at, way_piece

SHARE_LEAST = wp.constant(wp.float64(1 / 8))  # of a step that a piece takes at least
NOISE_SHARE = wp.constant(wp.float64(1e-3))  # of a sample: rounding would decide the speed on shorter ways
NEAR_CUT = wp.constant(wp.float64(0.1))  # of a section's length
PASSES_MOST = wp.constant(199)
SAME_TIME = wp.constant(wp.float64(1e-12))  # [s]; a cut so near to a node is there
TIME_LEAST = wp.constant(wp.float64(1e-12))  # [s]; least divisor


# Pauses: at corners, and where the contours have some of their own.


@wp.func
def drawn_dwell(c: Contours, plan: SamplingPlan, piece: DrawnPiece, size: int, i: int):
    """Pause that the contours have at the i-th vertex of a piece as drawn [s]; at the ends of a loop only the last."""
    k = source_of(piece, size, i)
    loop = is_loop(c, plan, piece.line)
    if k > 0 or (k == 0 and not loop):
        return wp.float64(c.dwell[row_of(c, piece.line, k)])
    total = ZERO
    if i > 0 and k < 0:  # the end of a loop that begins near these vertices, if any
        for near in range(wp.max(piece.before, 1), piece.after):
            total += wp.float64(c.dwell[row_of(c, piece.line, near)])
    return total


@wp.func
def no_pause(nodes: TrackNodes, at: int):
    """Let there be no pause at a node."""
    if nodes.pause.shape[0] > 0:
        nodes.pause[at] = ZERO
        nodes.corner[at] = wp.uint8(0)


@wp.func
def mark_corners(plan: SamplingPlan, nodes: TrackNodes, first: int, count: int, loop: bool):
    """Mark the nodes of a piece where it turns by more than an angle, and open ends.

    A loop's first node is marked at its end; for sections at its start, too.
    """
    if plan.dwell_time == ZERO and plan.dwell_ratio == ZERO:
        return
    begin = wp.vec3d(ZERO, ZERO, ZERO)  # direction of the first way
    before = begin
    last = int(0)  # node at the end of the way before
    for i in range(1, count):
        a = nodes.point[first + i - 1]
        b = nodes.point[first + i]
        length = distance(a, b)
        if length > ZERO:
            unit = (b - a) / length
            if last == 0:
                begin = unit
            elif wp.dot(before, unit) < plan.corner_cosine:
                nodes.corner[first + last] = wp.uint8(1)
            before = unit
            last = i
    if wp.dot(before, begin) < plan.corner_cosine:
        nodes.corner[first + last] = wp.uint8(1)
    if loop and plan.sections > 0:
        nodes.corner[first] = nodes.corner[first + count - 1]
    if not loop:
        nodes.corner[first] = wp.uint8(1)
        nodes.corner[first + count - 1] = wp.uint8(1)


@wp.func
def insert_pauses(plan: SamplingPlan, nodes: TrackNodes, first: int, count: int):
    """Repeat each node at which the focal point pauses; returns how many there are then.

    count: of nodes, each with the duration of the way to it, which for a repeated one is the pause.
    """
    marked = int(0)
    for i in range(count):
        marked += int(nodes.corner[first + i])
    each = plan.dwell_time
    if each == ZERO and marked > 0:
        total = ZERO
        for i in range(1, count):
            total += nodes.knot[first + i]
        each = plan.dwell_ratio * total / wp.float64(marked)
    more = int(0)
    for i in range(count):
        at = first + i
        if int(nodes.corner[at]) == 1:
            nodes.pause[at] = nodes.pause[at] + each
        if nodes.pause[at] > ZERO:
            more += 1
    to = first + count + more - 1
    for i in range(wp.where(more > 0, count, 0)):
        source = first + count - 1 - i
        pause = nodes.pause[source]
        if pause > ZERO:
            move_node(nodes, source, to, pause)
            to -= 1
        move_node(nodes, source, to, nodes.knot[source])
        to -= 1
    return count + more


@wp.func
def move_node(nodes: TrackNodes, source: int, at: int, duration: wp.float64):
    """Write a node as another, with the duration of the way to it [s]."""
    nodes.point[at] = nodes.point[source]
    nodes.piece[at] = nodes.piece[source]
    nodes.knot[at] = duration
    if nodes.intensity.shape[0] > 0:
        nodes.intensity[at] = nodes.intensity[source]


# Sections: a course cut into parts of equal time, each passed to and fro many times before the next one is.


@wp.func
def mark_section(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: wp.float64):
    """Mark the section at a place as one that holds a corner; place: in sections from the start."""
    k = wp.min(wp.max(int(wp.floor(place)), 0), plan.sections - 1)
    nodes.section[track.section + k].corner = 1


@wp.func
def mark_sections(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, total: wp.float64):
    """Mark the sections that hold a corner, both where one is near a cut; returns how many do.

    total: when the last node is reached [s].
    """
    for k in range(plan.sections):
        nodes.section[track.section + k].corner = 0
    for i in range(wp.where(nodes.corner.shape[0] > 0, track.count, 0)):
        at = track.first + i
        if int(nodes.corner[at]) == 1:
            place = nodes.knot[at] / total * wp.float64(plan.sections)
            mark_section(plan, nodes, track, place - NEAR_CUT)
            mark_section(plan, nodes, track, place + NEAR_CUT)
    marked = int(0)
    for k in range(plan.sections):
        marked += nodes.section[track.section + k].corner
    return marked


@wp.func
def nodes_before(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """How many nodes are reached before a knot."""
    low = int(0)
    high = int(track.count)
    while low < high:
        middle = (low + high) // 2
        if nodes.knot[track.first + middle] < knot:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def place_cuts(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, total: wp.float64):
    """Write when each section begins, and the node at or behind that; returns how many begin at no node.

    Those have `passes` 1, the others 0, until the passes are known.
    """
    more = int(0)
    for k in range(plan.sections):
        row = track.section + k
        cut = total * wp.float64(k) / wp.float64(plan.sections)
        near = int(0)
        new = int(0)
        if k > 0:
            near = wp.min(nodes_before(nodes, track, cut), track.count - 1)
            below = nodes.knot[track.first + near - 1]
            above = nodes.knot[track.first + near]
            if wp.abs(cut - below) < SAME_TIME:
                cut = below
            elif wp.abs(above - cut) < SAME_TIME:
                cut = above
            else:
                new = 1
        nodes.section[row].begin = cut
        nodes.section[row].start = near
        nodes.section[row].passes = new
        more += new
    return more


@wp.func
def write_cut(nodes: TrackNodes, behind: int, at: int, knot: wp.float64):
    """Write a node at a knot on the way to a node."""
    a = behind - 1
    begin = nodes.knot[a]
    took = nodes.knot[behind] - begin
    point = ((nodes.point[behind] - nodes.point[a]) / took) * (knot - begin) + nodes.point[a]
    piece = way_piece(nodes, a, behind)
    if nodes.intensity.shape[0] > 0:
        level = nodes.intensity[a]
        nodes.intensity[at] = (nodes.intensity[behind] - level) / took * (knot - begin) + level
    nodes.point[at] = point
    nodes.piece[at] = piece
    nodes.knot[at] = knot


@wp.func
def insert_cuts(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, more: int):
    """Insert nodes where sections begin at none; more: how many."""
    to = track.first + track.count + more - 1
    source = track.count - 1
    for i in range(1, plan.sections):
        own = nodes.section[track.section + plan.sections - i]
        if own.passes == 1:
            while source >= own.start:
                at = track.first + source
                move_node(nodes, at, to, nodes.knot[at])
                to -= 1
                source -= 1
            write_cut(nodes, track.first + own.start, to, own.begin)
            to -= 1


@wp.func
def bound_sections(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack):
    """Write the first and the last node of each section; jumps between two sections are in neither."""
    last = track.count - 1
    for i in range(plan.sections):
        row = track.section + plan.sections - 1 - i
        nodes.section[row].stop = last
        cut = nodes.section[row].begin
        start = int(0)
        if i + 1 < plan.sections:
            start = way_at(nodes.knot, track.first, track.count, cut)
            last = nodes_before(nodes, track, cut)
        nodes.section[row].start = start


@wp.func
def time_of(plan: SamplingPlan, corner: int, marked: int):
    """Time of a section [s]; corner: whether it holds one; marked: how many do."""
    time = ONE / wp.float64(plan.sections)
    if plan.section_share > ZERO and marked > 0 and marked < plan.sections:
        if corner == 1:
            time = plan.section_share / wp.float64(marked)
        else:
            time = (ONE - plan.section_share) / wp.float64(plan.sections - marked)
    return time / plan.frequency


@wp.func
def plan_passes(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, marked: int):
    """Write how often each section is passed, and how fast."""
    for k in range(plan.sections):
        row = track.section + k
        own = nodes.section[row]
        stop = track.count - 1
        if k + 1 < plan.sections:
            stop = nodes.section[row + 1].start
        way = track.first + own.start + 1
        once = ZERO
        for i in range(stop - own.start):
            once += nodes.knot[way + i]
        once = wp.max(once, TIME_LEAST)
        time = time_of(plan, own.corner, marked)
        wanted = time * plan.section_speed / (once * plan.speed)
        turns = wp.rint((wanted - ONE) / TWO)
        passes = 1 + 2 * int(wp.min(wp.max(turns, ZERO), wp.float64(PASSES_MOST // 2)))
        nodes.section[row].passes = passes
        nodes.section[row].scale = time / (once * wp.float64(passes))


@wp.func
def divide_course(plan: SamplingPlan, nodes: TrackNodes, whole: PoseTrack):
    """The track of a course whose nodes hold when each is reached, divided into sections."""
    track = whole
    total = nodes.knot[track.first + track.count - 1]
    marked = mark_sections(plan, nodes, track, total)
    more = place_cuts(plan, nodes, track, total)
    insert_cuts(plan, nodes, track, more)
    track.count += more
    track.sections = plan.sections
    bound_sections(plan, nodes, track)
    for i in range(1, track.count):
        at = track.first + track.count - i
        nodes.knot[at] = nodes.knot[at] - nodes.knot[at - 1]
    plan_passes(plan, nodes, track, marked)
    for k in range(track.pieces):
        nodes.stretch[track.line + k] = ONE
    return track


@wp.func
def begin_sections(nodes: TrackNodes, track: PoseTrack):
    """Write the knot at which each section begins, added way by way; returns that of the end."""
    knot = ZERO
    for k in range(track.sections):
        own = nodes.section[track.section + k]
        nodes.section[track.section + k].begin = knot
        ways = own.stop - own.start
        for i in range(own.passes):
            for j in range(ways):
                behind = wp.where(i % 2 == 0, own.start + j + 1, own.stop - j)
                knot += section_duration(nodes, track, own.scale, track.first + behind)
    return knot


@wp.func
def fastest_in_sections(nodes: TrackNodes, track: PoseTrack, least: wp.float64):
    """Greatest speed on a way that takes longer than a least time, in metres a knot."""
    fastest = ZERO
    for k in range(track.sections):
        own = nodes.section[track.section + k]
        for i in range(own.start + 1, own.stop + 1):
            at = track.first + i
            took = section_duration(nodes, track, own.scale, at)
            if took > least:
                step = nodes.point[at] - nodes.point[at - 1]
                fastest = wp.max(fastest, wp.sqrt(squared(step)) / took)
    return fastest


# Courses.


@wp.func
def first_node(c: Contours, plan: SamplingPlan, pose: int):
    """First node of a pose's track; before it is room for every earlier pose's."""
    line = int(c.pose_start[pose])
    own = pose * wp.max(plan.sections, 1)
    return plan.passes * (int(c.polyline_start[line]) + 2 * line) + own


@wp.func
def has_short(plan: SamplingPlan, rows: RouteRows, first: int, count: int, length: wp.float64):
    """Whether a piece is shorter than the way from sample to sample."""
    step = length / wp.float64(samples_of(plan, length / plan.speed))
    found = int(0)
    for k in range(count):
        if rows.span[first + k] < step:
            found = int(1)
    return found


@wp.func
def is_plain(c: Contours, plan: SamplingPlan, rows: RouteRows, pose: int, count: int, length: wp.float64):
    """Whether arc length alone decides when each vertex of a pose is reached."""
    lines = int(c.pose_start[pose + 1]) - int(c.pose_start[pose])
    in_order = lines < 2 or lines > PIECES_MOST or plan.shortest == 0
    if plan.plain == 0 or c.dwell.shape[0] > 0 or not in_order:
        return False
    return lines == 1 or has_short(plan, rows, int(c.pose_start[pose]), count, length) == 0


@wp.func
def lay_plain(c: Contours, plan: SamplingPlan, nodes: TrackNodes, pose: int):
    """Write the vertices of a pose as nodes that are reached by arc length; returns how many there are."""
    at = first_node(c, plan, pose)
    count = int(0)
    piece = int(-1)
    arc = ZERO
    line = int(c.pose_start[pose])
    while line < int(c.pose_start[pose + 1]):
        row = int(c.polyline_start[line])
        begin = at
        before = arc
        while row < int(c.polyline_start[line + 1]):
            point = to_float64(c.points[row])
            if at > begin:
                arc += wp.sqrt(squared(point - nodes.point[at - 1]))
            nodes.point[at] = point
            nodes.knot[at] = arc
            if c.intensity.shape[0] > 0:
                nodes.intensity[at] = wp.float64(c.intensity[row])
            at += 1
            count += 1
            row += 1
        if arc > before:
            piece += 1
        while begin < at:
            nodes.piece[begin] = piece
            begin += 1
        line += 1
    return count


@wp.func
def write_node(nodes: TrackNodes, at: int, point: wp.vec3d, level: wp.float64, piece: int, duration: wp.float64):
    """Write a node and how long the way to it takes [s]."""
    nodes.point[at] = point
    nodes.piece[at] = piece
    nodes.knot[at] = duration
    if nodes.intensity.shape[0] > 0:
        nodes.intensity[at] = level
    no_pause(nodes, at)


@wp.func
def copy_node(nodes: TrackNodes, source: int, at: int, piece: int, duration: wp.float64):
    """Write a node at the place of another."""
    level = ONE
    if nodes.intensity.shape[0] > 0:
        level = nodes.intensity[source]
    write_node(nodes, at, nodes.point[source], level, piece, duration)
    if nodes.pause.shape[0] > 0:
        nodes.pause[at] = nodes.pause[source]
        nodes.corner[at] = nodes.corner[source]


@wp.func
def write_piece(c: Contours, plan: SamplingPlan, rows: RouteRows, nodes: TrackNodes, row: int, first: int, k: int):
    """Write the nodes of a route's k-th piece, there and back if it is so drawn; returns how many there are."""
    piece = rows.drawn[row]
    size = size_of(c, plan, piece.line)
    count = drawn_size(c, plan, piece)
    for i in range(count):
        at = first + i
        point = drawn_vertex(c, piece, size, i)
        level = ONE
        if c.intensity.shape[0] > 0:
            level = drawn_level(c, piece, size, i)
        duration = ZERO
        if i > 0:
            duration = distance(nodes.point[at - 1], point) / plan.speed
        elif k > 0 and plan.returns == 1:
            duration = distance(nodes.point[at - 1], point) / plan.return_speed
        write_node(nodes, at, point, level, k, duration)
        if c.dwell.shape[0] > 0:
            nodes.pause[at] = drawn_dwell(c, plan, piece, size, i)
    loop = is_loop(c, plan, piece.line)
    mark_corners(plan, nodes, first, count, loop)
    if plan.turns_back == 0 or loop:
        return count
    for i in range(1, count):
        source = first + count - 1 - i
        duration = distance(nodes.point[source + 1], nodes.point[source]) / plan.speed
        copy_node(nodes, source, first + (count - 1 + i), k, duration)
    if plan.sections == 0:
        no_pause(nodes, first)  # it is made when the piece ends there
    return 2 * count - 1


@wp.func
def write_course(c: Contours, plan: SamplingPlan, rows: RouteRows, nodes: TrackNodes, pose: int, pieces: int):
    """Write the drawn pieces of a pose as nodes with the duration of the way to each; returns how many there are."""
    first = first_node(c, plan, pose)
    count = int(0)
    for k in range(pieces):
        count += write_piece(c, plan, rows, nodes, int(c.pose_start[pose]) + k, first + count, k)
    last = first + count - 1
    if plan.pendulum == 1:
        for i in range(1, count):
            source = last - i
            way = nodes.knot[source + 1]
            copy_node(nodes, source, last + i, nodes.piece[source], way)
        no_pause(nodes, first)
        count += count - 1
    elif plan.returns == 1:
        way = distance(nodes.point[last], nodes.point[first]) / plan.return_speed
        copy_node(nodes, first, last + 1, -1, way)
        no_pause(nodes, last + 1)
        count += 1
    return count


@wp.func
def first_duration(nodes: TrackNodes, track: PoseTrack):
    """The first way of a track, from knot 0 to how long it takes; its knots are no sums yet."""
    if track.sections > 0:
        return section_way(nodes, track, 0, 0, ZERO)
    way = plain_way(nodes, track, 0)
    way.begin = ZERO
    return way


@wp.func
def measure_passages(nodes: TrackNodes, rows: RouteRows, track: PoseTrack):
    """Write the time of the longest passage along each piece, 0 for one that has none; returns that of all ways."""
    for k in range(track.pieces):
        rows.span[track.line + k] = ZERO
    way = first_duration(nodes, track)
    total = ZERO
    left = int(1)
    while left == 1:
        piece = way_piece(nodes, way.a, way.b)
        took = ZERO
        same = int(1)
        while same == 1:
            took += way.end
            left = wp.where(has_next(nodes, track, way), 1, 0)
            if left == 1:
                way.end = ZERO  # the next one begins at knot 0, so its end is how long it takes
                way = next_way(nodes, track, way)
            same = wp.where(left == 1 and way_piece(nodes, way.a, way.b) == piece, 1, 0)
        total += took
        if piece >= 0:
            rows.span[track.line + piece] = wp.max(rows.span[track.line + piece], took)
    return total


@wp.func
def lengthen_short(nodes: TrackNodes, rows: RouteRows, track: PoseTrack, least: wp.float64):
    """Lengthen the durations on pieces whose passages take less than a least time."""
    for k in range(track.pieces):
        longest = rows.span[track.line + k]
        if longest > ZERO and longest < least:
            rows.span[track.line + k] = least / longest
        else:
            rows.span[track.line + k] = ONE
        if track.sections > 0:
            nodes.stretch[track.line + k] = rows.span[track.line + k]
    for i in range(wp.where(track.sections > 0, 0, track.count - 1)):
        piece = way_piece(nodes, track.first + i, track.first + i + 1)
        if piece >= 0:
            at = track.first + i + 1
            nodes.knot[at] = nodes.knot[at] * rows.span[track.line + piece]


@wp.func
def draw_by_turns(plan: SamplingPlan, nodes: TrackNodes, rows: RouteRows, track: PoseTrack):
    """A track on whose samples every piece is drawn, some not in every cycle.

    One cycle where each piece takes a step at least. Else those that take less than SHARE_LEAST of a step are
    lengthened to it, and there is one sample more in as many cycles as let every piece be drawn, or one less where a
    draw frequency has a lower bound. The numbers of samples and of cycles then have no divisor in common, so the
    samples of all these cycles lie evenly: a piece that takes 1 / n of a step has one in one of about n cycles.
    """
    out = track
    samples = wp.float64(track.samples)
    step = measure_passages(nodes, rows, track) / samples
    least = INFINITE  # time of the longest passage along the piece that has the shortest one
    for k in range(track.pieces):
        span = rows.span[track.line + k]
        if span > ZERO:
            least = wp.min(least, span)
    if least >= step * (ONE - wp.float64(1e-9)):
        return out
    if least < SHARE_LEAST * step:
        least = SHARE_LEAST * step
        lengthen_short(nodes, rows, track, least)
        step = measure_passages(nodes, rows, track) / samples
    turns = wp.int64(wp.ceil(step / least + ONE / samples))
    more = wp.int64(1)
    if plan.pace == CAPPED:
        if plan.rate * wp.float64(turns) < plan.lowest * wp.float64(track.samples * turns + wp.int64(1)):
            more = wp.int64(-1)
    out.turns = int(turns)
    out.repeat = track.samples * turns + more
    return out


@wp.func
def sum_durations(nodes: TrackNodes, track: PoseTrack):
    """Sum the durations of ways up to when each node is reached."""
    knot = ZERO
    nodes.knot[track.first] = knot
    for i in range(1, track.count):
        knot += nodes.knot[track.first + i]
        nodes.knot[track.first + i] = knot


@wp.func
def longest_step(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack):
    """Longest step between two samples on the same way of a track, small circles included [m]."""
    if plan.pace != FREQUENCY and plan.pace != CAPPED:
        return plan.ordinary
    fastest = ZERO
    if track.sections > 0:
        fastest = fastest_in_sections(nodes, track, NOISE_SHARE * track.one_sample)
        return fastest * track.one_sample + plan.circle_step
    for i in range(track.count - 1):
        at = track.first + i
        took = nodes.knot[at + 1] - nodes.knot[at]
        if took > NOISE_SHARE * track.one_sample:
            step = nodes.point[at + 1] - nodes.point[at]
            fastest = wp.max(fastest, wp.sqrt(squared(step)) / took)
    return fastest * track.one_sample + plan.circle_step


@wp.func
def time_course(plan: SamplingPlan, nodes: TrackNodes, rows: RouteRows, course: PoseTrack):
    """The track of a course whose nodes hold the duration of the way to each: pauses or sections, and its cycle."""
    track = course
    if plan.sections > 0:
        sum_durations(nodes, track)
        track = divide_course(plan, nodes, track)
    elif nodes.pause.shape[0] > 0:
        track.count = insert_pauses(plan, nodes, track.first, course.count)
        track.pauses = track.count - course.count
    total = ZERO
    for i in range(1, track.count):
        total += nodes.knot[track.first + i]
    track.samples = samples_of(plan, total)
    track.repeat = track.samples
    if plan.points == 0 and plan.pace != STILL and track.pieces > 1:
        track = draw_by_turns(plan, nodes, rows, track)
    if track.sections > 0:
        track.period = begin_sections(nodes, track)
    else:
        sum_durations(nodes, track)
        track.period = nodes.knot[track.first + track.count - 1]
    return track


@wp.func
def lay_course(
    c: Contours,
    plan: SamplingPlan,
    rows: RouteRows,
    nodes: TrackNodes,
    pose: int,
    pieces: int,
    plain: bool,
    seconds: wp.float64,
):
    """The track of a pose whose route is drawn; seconds: what a plain cycle takes [s]."""
    track = PoseTrack()
    track.first = first_node(c, plan, pose)
    track.pieces = pieces
    track.line = int(c.pose_start[pose])
    track.section = pose * plan.sections
    track.turns = 1
    if plain:
        track.count = lay_plain(c, plan, nodes, pose)
        track.single = wp.where(int(c.pose_start[pose + 1]) - int(c.pose_start[pose]) == 1, 1, 0)
        track.samples = samples_of(plan, seconds)
        track.repeat = track.samples
        track.period = nodes.knot[track.first + track.count - 1]
    else:
        track.count = write_course(c, plan, rows, nodes, pose, pieces)
        track = time_course(plan, nodes, rows, track)
    track.one_sample = wp.float64(track.turns) * track.period / wp.float64(track.repeat)
    track.ordinary = longest_step(plan, nodes, track)
    return track
