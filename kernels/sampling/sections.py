"""Sections: a course cut into parts of equal time, each passed to and fro many times before the next one is.

As `_in_sections` in render/sampling/track.py. The host writes the nodes of every pass. Here a course keeps its nodes,
with the duration of the way to each, and ways are gone through in the order of the passes (`next_way` in cursor.py).
"""

import warp as wp

from .cursor import TrackWay, has_next, next_way, section_duration, section_way, way_at, way_piece, ways_of
from .layout import ONE, TWO, ZERO, PoseTrack, RouteRows, SamplingPlan, TrackNodes, squared, sum_of
from .pauses import move_node

NEAR_CUT = wp.constant(wp.float64(0.1))  # of a section's length, as in render/sampling/track.py
PASSES_MOST = wp.constant(199)  # as there
SAME_TIME = wp.constant(wp.float64(1e-12))  # [s]; a cut so near to a node is there
TIME_LEAST = wp.constant(wp.float64(1e-12))  # [s]; least divisor


@wp.func
def mark_section(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: wp.float64):
    """Mark the section at a place as one that holds a corner; place: in sections from the start."""
    k = wp.min(wp.max(int(wp.floor(place)), 0), plan.sections - 1)
    nodes.section[track.section + wp.int64(k)].corner = 1


@wp.func
def mark_sections(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, total: wp.float64):
    """Mark the sections that hold a corner, both where one is near a cut; returns how many do.

    total: when the last node is reached [s].
    """
    for k in range(plan.sections):
        nodes.section[track.section + wp.int64(k)].corner = 0
    for i in range(wp.where(nodes.corner.shape[0] > 0, track.count, 0)):
        at = track.first + wp.int64(i)
        if int(nodes.corner[at]) == 1:
            place = nodes.knot[at] / total * wp.float64(plan.sections)
            mark_section(plan, nodes, track, place - NEAR_CUT)
            mark_section(plan, nodes, track, place + NEAR_CUT)
    marked = int(0)
    for k in range(plan.sections):
        marked += nodes.section[track.section + wp.int64(k)].corner
    return marked


@wp.func
def nodes_before(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """How many nodes are reached before a knot."""
    low = int(0)
    high = int(track.count)
    while low < high:
        middle = (low + high) // 2
        if nodes.knot[track.first + wp.int64(middle)] < knot:
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
        row = track.section + wp.int64(k)
        cut = total * wp.float64(k) / wp.float64(plan.sections)
        near = int(0)
        new = int(0)
        if k > 0:
            near = wp.min(nodes_before(nodes, track, cut), track.count - 1)
            below = nodes.knot[track.first + wp.int64(near - 1)]
            above = nodes.knot[track.first + wp.int64(near)]
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
def write_cut(nodes: TrackNodes, behind: wp.int64, at: wp.int64, knot: wp.float64):
    """Write a node at a knot on the way to a node."""
    a = behind - wp.int64(1)
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
    to = track.first + wp.int64(track.count + more - 1)
    source = track.count - 1
    for i in range(1, plan.sections):
        own = nodes.section[track.section + wp.int64(plan.sections - i)]
        if own.passes == 1:
            while source >= own.start:
                at = track.first + wp.int64(source)
                move_node(nodes, at, to, nodes.knot[at])
                to -= wp.int64(1)
                source -= 1
            write_cut(nodes, track.first + wp.int64(own.start), to, own.begin)
            to -= wp.int64(1)


@wp.func
def bound_sections(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack):
    """Write the first and the last node of each section; jumps between two sections are in neither."""
    last = track.count - 1
    for i in range(plan.sections):
        row = track.section + wp.int64(plan.sections - 1 - i)
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
        row = track.section + wp.int64(k)
        own = nodes.section[row]
        stop = track.count - 1
        if k + 1 < plan.sections:
            stop = nodes.section[row + wp.int64(1)].start
        way = track.first + wp.int64(own.start + 1)
        once = nodes.knot[way]
        if stop > own.start + 1:
            once += sum_of(nodes.knot, way + wp.int64(1), stop - own.start - 1)
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
    total = nodes.knot[track.first + wp.int64(track.count - 1)]
    marked = mark_sections(plan, nodes, track, total)
    more = place_cuts(plan, nodes, track, total)
    insert_cuts(plan, nodes, track, more)
    track.count += more
    track.sections = plan.sections
    bound_sections(plan, nodes, track)
    for i in range(1, track.count):
        at = track.first + wp.int64(track.count - i)
        nodes.knot[at] = nodes.knot[at] - nodes.knot[at - wp.int64(1)]
    plan_passes(plan, nodes, track, marked)
    for k in range(track.pieces):
        nodes.stretch[track.line + wp.int64(k)] = ONE
    return track


@wp.func
def begin_sections(nodes: TrackNodes, track: PoseTrack):
    """Write the knot at which each section begins, added way by way as np.cumsum does; returns that of the end."""
    knot = ZERO
    for k in range(track.sections):
        own = nodes.section[track.section + wp.int64(k)]
        nodes.section[track.section + wp.int64(k)].begin = knot
        ways = own.stop - own.start
        for i in range(own.passes):
            for j in range(ways):
                behind = wp.where(i % 2 == 0, own.start + j + 1, own.stop - j)
                knot += section_duration(nodes, track, own.scale, track.first + wp.int64(behind))
    return knot


@wp.func
def fastest_in_sections(nodes: TrackNodes, track: PoseTrack, least: wp.float64):
    """Greatest speed on a way that takes longer than a least time, in metres a knot."""
    fastest = ZERO
    for k in range(track.sections):
        own = nodes.section[track.section + wp.int64(k)]
        for i in range(own.start + 1, own.stop + 1):
            at = track.first + wp.int64(i)
            took = section_duration(nodes, track, own.scale, at)
            if took > least:
                step = nodes.point[at] - nodes.point[at - wp.int64(1)]
                fastest = wp.max(fastest, wp.sqrt(squared(step)) / took)
    return fastest


@wp.func
def next_duration(nodes: TrackNodes, track: PoseTrack, way: TrackWay):
    """The next way, from knot 0 to how long it takes; after the last way itself again."""
    out = way
    if has_next(nodes, track, way):
        out.end = ZERO
        out = next_way(nodes, track, out)
    return out


@wp.func
def sum_next(nodes: TrackNodes, track: PoseTrack, first: TrackWay, count: int):
    """Sum of at most 128 durations from a way on, added as by np.sum, and the way behind them."""
    way = first
    part = wp.zeros(shape=8, dtype=wp.float64)
    whole = wp.where(count < 8, 0, count - count % 8)
    total = ZERO
    for i in range(count):
        if i < whole:
            part[i % 8] = part[i % 8] + way.end
        else:
            total += way.end
        if i == whole - 1:
            total = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]))
        way = next_duration(nodes, track, way)
    return total, way


@wp.func
def sum_durations_from(nodes: TrackNodes, track: PoseTrack, first: TrackWay, count: int):
    """Sum of durations from a way on, added as by np.sum; see `sum_of`."""
    right = wp.zeros(shape=32, dtype=wp.int32)  # how many values the other half has; 0: it is being summed
    left = wp.zeros(shape=32, dtype=wp.float64)  # sum of the half before it
    way = first
    depth = int(0)
    left_over = count
    total = ZERO
    busy = int(1)
    while busy == 1:
        while left_over > 128:
            half = left_over // 2
            half -= half % 8
            right[depth] = left_over - half
            depth += 1
            left_over = half
        total, way = sum_next(nodes, track, way, left_over)
        while depth > 0 and right[wp.max(depth - 1, 0)] == 0:
            depth -= 1
            total = left[depth] + total
        if depth == 0:
            busy = 0
        else:
            left[depth - 1] = total
            left_over = right[depth - 1]
            right[depth - 1] = 0
    return total


@wp.func
def sum_in_sections(nodes: TrackNodes, track: PoseTrack):
    """Sum of the durations of all ways."""
    count = track.sections - 1  # those from section to section
    for k in range(track.sections):
        count += ways_of(nodes.section[track.section + wp.int64(k)])
    return sum_durations_from(nodes, track, section_way(nodes, track, 0, 0, ZERO), count)


@wp.func
def passages_in_sections(nodes: TrackNodes, rows: RouteRows, track: PoseTrack):
    """Write the time of the longest passage along each piece, 0 for one that has none."""
    for k in range(track.pieces):
        rows.span[track.line + wp.int64(k)] = ZERO
    way = section_way(nodes, track, 0, 0, ZERO)
    left = int(1)
    while left == 1:
        piece = way_piece(nodes, way.a, way.b)
        begin = way
        count = int(0)
        same = int(1)
        while same == 1:
            count += 1
            left = wp.where(has_next(nodes, track, way), 1, 0)
            way = next_duration(nodes, track, way)
            same = wp.where(left == 1 and way_piece(nodes, way.a, way.b) == piece, 1, 0)
        if piece >= 0:
            took = begin.end
            if count > 1:
                took += sum_durations_from(nodes, track, next_duration(nodes, track, begin), count - 1)
            rows.span[track.line + wp.int64(piece)] = wp.max(rows.span[track.line + wp.int64(piece)], took)
