"""Courses: nodes of a pose's cycle, and when each is reached; one thread lays the track of a pose.

As `lay_track` in render/sampling/track.py.
"""

import warp as wp

from ..contours import Contours
from ..patch import to_float64
from .cursor import way_piece
from .layout import (
    CAPPED,
    FREQUENCY,
    ONE,
    STILL,
    ZERO,
    PoseTrack,
    RouteRows,
    SamplingPlan,
    TrackNodes,
    distance,
    samples_of,
    squared,
    sum_of,
)
from .pauses import copy_pause, drawn_dwell, insert_pauses, mark_corners, no_pause
from .pieces import drawn_level, drawn_size, drawn_vertex, is_loop, size_of
from .route import PIECES_MOST
from .sections import begin_sections, divide_course, fastest_in_sections, passages_in_sections, sum_in_sections

SHARE_LEAST = wp.constant(wp.float64(1 / 8))  # of a step that a piece takes at least, as in drawing_turns.py
NOISE_SHARE = wp.constant(wp.float64(1e-3))  # of a sample: ways that take less say nothing of the speed


@wp.func
def first_node(c: Contours, plan: SamplingPlan, pose: int):
    """First node of a pose's track; before it is room for every earlier pose's."""
    line = c.pose_start[pose]
    own = wp.int64(pose) * wp.int64(wp.max(plan.sections, 1))
    return wp.int64(plan.passes) * (c.polyline_start[line] + wp.int64(2) * line) + own


@wp.func
def has_short(c: Contours, plan: SamplingPlan, rows: RouteRows, first: wp.int64, count: int, length: wp.float64):
    """Whether a piece is shorter than the way from sample to sample."""
    step = length / wp.float64(samples_of(plan, length / plan.speed))
    found = int(0)
    for k in range(count):
        if rows.span[first + wp.int64(k)] < step:
            found = int(1)
    return found


@wp.func
def is_plain(c: Contours, plan: SamplingPlan, rows: RouteRows, pose: int, count: int, length: wp.float64):
    """Whether arc length alone decides when each vertex of a pose is reached."""
    lines = c.pose_start[pose + 1] - c.pose_start[pose]
    in_order = lines < wp.int64(2) or lines > wp.int64(PIECES_MOST) or plan.shortest == 0
    if plan.plain == 0 or c.dwell.shape[0] > 0 or not in_order:
        return False
    return lines == wp.int64(1) or has_short(c, plan, rows, c.pose_start[pose], count, length) == 0


@wp.func
def lay_plain(c: Contours, plan: SamplingPlan, nodes: TrackNodes, pose: int):
    """Write the vertices of a pose as nodes that are reached by arc length; returns how many there are."""
    at = first_node(c, plan, pose)
    count = int(0)
    piece = int(-1)
    arc = ZERO
    line = c.pose_start[pose]
    while line < c.pose_start[pose + 1]:
        row = c.polyline_start[line]
        begin = at
        before = arc
        while row < c.polyline_start[line + wp.int64(1)]:
            point = to_float64(c.points[row])
            if at > begin:
                arc += wp.sqrt(squared(point - nodes.point[at - wp.int64(1)]))
            nodes.point[at] = point
            nodes.knot[at] = arc
            if c.intensity.shape[0] > 0:
                nodes.intensity[at] = wp.float64(c.intensity[row])
            at += wp.int64(1)
            count += 1
            row += wp.int64(1)
        if arc > before:
            piece += 1
        while begin < at:
            nodes.piece[begin] = piece
            begin += wp.int64(1)
        line += wp.int64(1)
    return count


@wp.func
def write_node(nodes: TrackNodes, at: wp.int64, point: wp.vec3d, level: wp.float64, piece: int, duration: wp.float64):
    """Write a node and how long the way to it takes [s]."""
    nodes.point[at] = point
    nodes.piece[at] = piece
    nodes.knot[at] = duration
    if nodes.intensity.shape[0] > 0:
        nodes.intensity[at] = level
    no_pause(nodes, at)


@wp.func
def copy_node(nodes: TrackNodes, source: wp.int64, at: wp.int64, piece: int, duration: wp.float64):
    """Write a node at the place of another."""
    level = ONE
    if nodes.intensity.shape[0] > 0:
        level = nodes.intensity[source]
    write_node(nodes, at, nodes.point[source], level, piece, duration)
    copy_pause(nodes, source, at)


@wp.func
def write_piece(
    c: Contours, plan: SamplingPlan, rows: RouteRows, nodes: TrackNodes, row: wp.int64, first: wp.int64, k: int
):
    """Write the nodes of a route's k-th piece, there and back if it is so drawn; returns how many there are."""
    piece = rows.drawn[row]
    size = size_of(c, plan, piece.line)
    count = drawn_size(c, plan, piece)
    for i in range(count):
        at = first + wp.int64(i)
        point = drawn_vertex(c, piece, size, i)
        level = ONE
        if c.intensity.shape[0] > 0:
            level = drawn_level(c, piece, size, i)
        duration = ZERO
        if i > 0:
            duration = distance(nodes.point[at - wp.int64(1)], point) / plan.speed
        elif k > 0 and plan.returns == 1:
            duration = distance(nodes.point[at - wp.int64(1)], point) / plan.return_speed
        write_node(nodes, at, point, level, k, duration)
        if c.dwell.shape[0] > 0:
            nodes.pause[at] = drawn_dwell(c, plan, piece, size, i)
    loop = is_loop(c, plan, piece.line)
    mark_corners(plan, nodes, first, count, loop)
    if plan.turns_back == 0 or loop:
        return count
    for i in range(1, count):
        source = first + wp.int64(count - 1 - i)
        duration = distance(nodes.point[source + wp.int64(1)], nodes.point[source]) / plan.speed
        copy_node(nodes, source, first + wp.int64(count - 1 + i), k, duration)
    if plan.sections == 0:
        no_pause(nodes, first)  # it is made when the piece ends there
    return 2 * count - 1


@wp.func
def write_course(c: Contours, plan: SamplingPlan, rows: RouteRows, nodes: TrackNodes, pose: int, pieces: int):
    """Write the drawn pieces of a pose as nodes with the duration of the way to each; returns how many there are."""
    first = first_node(c, plan, pose)
    count = int(0)
    for k in range(pieces):
        count += write_piece(c, plan, rows, nodes, c.pose_start[pose] + wp.int64(k), first + wp.int64(count), k)
    last = first + wp.int64(count - 1)
    if plan.pendulum == 1:
        for i in range(1, count):
            source = last - wp.int64(i)
            way = nodes.knot[source + wp.int64(1)]
            copy_node(nodes, source, last + wp.int64(i), nodes.piece[source], way)
        no_pause(nodes, first)
        count += count - 1
    elif plan.returns == 1:
        way = distance(nodes.point[last], nodes.point[first]) / plan.return_speed
        copy_node(nodes, first, last + wp.int64(1), -1, way)
        no_pause(nodes, last + wp.int64(1))
        count += 1
    return count


@wp.func
def piece_behind(nodes: TrackNodes, at: wp.int64):
    """Number of the piece that the way from a node to the one behind it is on, -1: on none."""
    return way_piece(nodes, at, at + wp.int64(1))


@wp.func
def longest_passages(nodes: TrackNodes, rows: RouteRows, track: PoseTrack):
    """Write the time of the longest passage along each piece; 0 for one that has none."""
    first = track.first
    for k in range(track.pieces):
        rows.span[track.line + wp.int64(k)] = ZERO
    i = int(0)
    while i < track.count - 1:
        piece = piece_behind(nodes, first + wp.int64(i))
        begin = i
        i += 1
        while i < track.count - 1 and piece_behind(nodes, first + wp.int64(wp.min(i, track.count - 2))) == piece:
            i += 1
        if piece >= 0:
            took = nodes.knot[first + wp.int64(begin + 1)]
            if i > begin + 1:
                took += sum_of(nodes.knot, first + wp.int64(begin + 2), i - begin - 1)
            rows.span[track.line + wp.int64(piece)] = wp.max(rows.span[track.line + wp.int64(piece)], took)


@wp.func
def shortest_passage(nodes: TrackNodes, rows: RouteRows, track: PoseTrack):
    """Time of the longest passage along the piece that has the shortest one, which is none of length 0."""
    if track.sections > 0:
        passages_in_sections(nodes, rows, track)
    else:
        longest_passages(nodes, rows, track)
    least = wp.float64(1e300)
    for k in range(track.pieces):
        span = rows.span[track.line + wp.int64(k)]
        if span > ZERO:
            least = wp.min(least, span)
    return least


@wp.func
def total_duration(nodes: TrackNodes, track: PoseTrack):
    """Sum of the durations of all ways, added as by np.sum."""
    if track.sections > 0:
        return sum_in_sections(nodes, track)
    return sum_of(nodes.knot, track.first + wp.int64(1), track.count - 1)


@wp.func
def lengthen_short(nodes: TrackNodes, rows: RouteRows, track: PoseTrack, least: wp.float64):
    """Lengthen the durations on pieces whose passages take less than a least time."""
    for k in range(track.pieces):
        longest = rows.span[track.line + wp.int64(k)]
        if longest > ZERO and longest < least:
            rows.span[track.line + wp.int64(k)] = least / longest
        else:
            rows.span[track.line + wp.int64(k)] = ONE
        if track.sections > 0:
            nodes.stretch[track.line + wp.int64(k)] = rows.span[track.line + wp.int64(k)]
    for i in range(wp.where(track.sections > 0, 0, track.count - 1)):
        piece = piece_behind(nodes, track.first + wp.int64(i))
        if piece >= 0:
            at = track.first + wp.int64(i + 1)
            nodes.knot[at] = nodes.knot[at] * rows.span[track.line + wp.int64(piece)]


@wp.func
def draw_by_turns(plan: SamplingPlan, nodes: TrackNodes, rows: RouteRows, track: PoseTrack):
    """A track on whose samples every piece is drawn, some not in every cycle; see render/sampling/drawing_turns.py."""
    out = track
    least = shortest_passage(nodes, rows, track)
    samples = wp.float64(track.repeat)
    step = total_duration(nodes, track) / samples
    if least >= step * (ONE - wp.float64(1e-9)):
        return out
    if least < SHARE_LEAST * step:
        least = SHARE_LEAST * step
        lengthen_short(nodes, rows, track, least)
        step = total_duration(nodes, track) / samples
    turns = wp.int64(wp.ceil(step / least + ONE / samples))
    more = wp.int64(1)
    if plan.pace == CAPPED:
        if plan.rate * wp.float64(turns) < plan.lowest * wp.float64(track.repeat * turns + wp.int64(1)):
            more = wp.int64(-1)
    out.turns = int(turns)
    out.repeat = track.repeat * turns + more
    return out


@wp.func
def sum_durations(nodes: TrackNodes, track: PoseTrack):
    """Sum the durations of ways up to when each node is reached."""
    knot = ZERO
    nodes.knot[track.first] = knot
    for i in range(1, track.count):
        knot += nodes.knot[track.first + wp.int64(i)]
        nodes.knot[track.first + wp.int64(i)] = knot


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
        at = track.first + wp.int64(i)
        took = nodes.knot[at + wp.int64(1)] - nodes.knot[at]
        if took > NOISE_SHARE * track.one_sample:
            step = nodes.point[at + wp.int64(1)] - nodes.point[at]
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
        total += nodes.knot[track.first + wp.int64(i)]
    track.repeat = samples_of(plan, total)
    if plan.points == wp.int64(0) and plan.pace != STILL and track.pieces > 1:
        track = draw_by_turns(plan, nodes, rows, track)
    if track.sections > 0:
        track.period = begin_sections(nodes, track)
    else:
        sum_durations(nodes, track)
        track.period = nodes.knot[track.first + wp.int64(track.count - 1)]
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
    track.line = c.pose_start[pose]
    track.section = wp.int64(pose) * wp.int64(plan.sections)
    track.turns = 1
    if plain:
        track.count = lay_plain(c, plan, nodes, pose)
        track.single = wp.where(c.pose_start[pose + 1] - c.pose_start[pose] == wp.int64(1), 1, 0)
        track.repeat = samples_of(plan, seconds)
        track.period = nodes.knot[track.first + wp.int64(track.count - 1)]
    else:
        track.count = write_course(c, plan, rows, nodes, pose, pieces)
        track = time_course(plan, nodes, rows, track)
    track.one_sample = wp.float64(track.turns) * track.period / wp.float64(track.repeat)
    track.ordinary = longest_step(plan, nodes, track)
    return track
