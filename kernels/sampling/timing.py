"""Timing: the nodes of a pose's cycle, and when each is reached; one thread lays the cycle of a pose.

Whatever a strategy asks for comes down to nodes and when each is reached. Between two nodes the focal point runs
evenly: a segment of no duration is a jump, one of no length is a pause. In a cycle with sections each node holds the
duration of the segment to it, and `next_segment` in segments.py goes through the segments in the order of the passes.
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
    CycleNodes,
    DrawnPiece,
    PoseCycle,
    RouteRows,
    SamplingPlan,
    distance,
    samples_of,
    squared,
)
from .pieces import drawn_level, drawn_size, drawn_vertex, is_loop, row_of, size_of, source_of
from .route import PIECES_MOST
from .segments import (
    cycle_segment,
    has_next,
    next_segment,
    section_duration,
    section_segment,
    segment_at,
    segment_piece,
)

SHARE_LEAST = wp.constant(wp.float64(1 / 8))  # of a step that a piece takes at least
NOISE_SHARE = wp.constant(wp.float64(1e-3))  # of a sample: rounding would decide the speed on shorter segments
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
def no_pause(nodes: CycleNodes, at: int):
    """Let there be no pause at a node."""
    if nodes.pause.shape[0] > 0:
        nodes.pause[at] = ZERO
        nodes.corner[at] = wp.uint8(0)


@wp.func
def mark_corners(plan: SamplingPlan, nodes: CycleNodes, first: int, count: int, loop: bool):
    """Mark the nodes of a piece where it turns by more than an angle, and open ends.

    A loop's first node is marked at its end; for sections at its start, too.
    """
    if plan.dwell_time == ZERO and plan.dwell_ratio == ZERO:
        return
    begin = wp.vec3d(ZERO, ZERO, ZERO)  # direction of the first segment
    before = begin
    last = int(0)  # node at the end of the segment before
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
def insert_pauses(plan: SamplingPlan, nodes: CycleNodes, first: int, count: int):
    """Repeat each node at which the focal point pauses; returns how many there are then.

    count: of nodes, each with the duration of the segment to it, which for a repeated one is the pause.
    """
    marked = int(0)
    for i in range(count):
        marked += int(nodes.corner[first + i])
    each = plan.dwell_time
    if each == ZERO and marked > 0:
        total = ZERO
        for i in range(1, count):
            total += nodes.parameter[first + i]
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
        move_node(nodes, source, to, nodes.parameter[source])
        to -= 1
    return count + more


@wp.func
def move_node(nodes: CycleNodes, source: int, at: int, duration: wp.float64):
    """Write a node as another, with the duration of the segment to it [s]."""
    nodes.point[at] = nodes.point[source]
    nodes.piece[at] = nodes.piece[source]
    nodes.parameter[at] = duration
    if nodes.intensity.shape[0] > 0:
        nodes.intensity[at] = nodes.intensity[source]


# Sections: a cycle cut into parts of equal time, each drawn to and fro many times before the next one is.


@wp.func
def mark_section(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, place: wp.float64):
    """Mark the section at a place as one that holds a corner; place: in sections from the start."""
    k = wp.min(wp.max(int(wp.floor(place)), 0), plan.sections - 1)
    nodes.section[cycle.section + k].corner = 1


@wp.func
def mark_sections(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, total: wp.float64):
    """Mark the sections that hold a corner, both where one is near a cut; returns how many do.

    total: when the last node is reached [s].
    """
    for k in range(plan.sections):
        nodes.section[cycle.section + k].corner = 0
    for i in range(wp.where(nodes.corner.shape[0] > 0, cycle.count, 0)):
        at = cycle.first + i
        if int(nodes.corner[at]) == 1:
            place = nodes.parameter[at] / total * wp.float64(plan.sections)
            mark_section(plan, nodes, cycle, place - NEAR_CUT)
            mark_section(plan, nodes, cycle, place + NEAR_CUT)
    marked = int(0)
    for k in range(plan.sections):
        marked += nodes.section[cycle.section + k].corner
    return marked


@wp.func
def nodes_before(nodes: CycleNodes, cycle: PoseCycle, parameter: wp.float64):
    """Number of nodes that are reached before a parameter."""
    low = int(0)
    high = int(cycle.count)
    while low < high:
        middle = (low + high) // 2
        if nodes.parameter[cycle.first + middle] < parameter:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def place_cuts(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, total: wp.float64):
    """Write when each section begins, and the node at or behind that; returns how many begin at no node.

    Those have `passes` 1, the others 0, until the passes are known.
    """
    more = int(0)
    for k in range(plan.sections):
        row = cycle.section + k
        cut = total * wp.float64(k) / wp.float64(plan.sections)
        near = int(0)
        new = int(0)
        if k > 0:
            near = wp.min(nodes_before(nodes, cycle, cut), cycle.count - 1)
            below = nodes.parameter[cycle.first + near - 1]
            above = nodes.parameter[cycle.first + near]
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
def write_cut(nodes: CycleNodes, behind: int, at: int, parameter: wp.float64):
    """Write a node at a parameter on the segment to a node."""
    a = behind - 1
    begin = nodes.parameter[a]
    took = nodes.parameter[behind] - begin
    point = ((nodes.point[behind] - nodes.point[a]) / took) * (parameter - begin) + nodes.point[a]
    piece = segment_piece(nodes, a, behind)
    if nodes.intensity.shape[0] > 0:
        level = nodes.intensity[a]
        nodes.intensity[at] = (nodes.intensity[behind] - level) / took * (parameter - begin) + level
    nodes.point[at] = point
    nodes.piece[at] = piece
    nodes.parameter[at] = parameter


@wp.func
def insert_cuts(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, more: int):
    """Insert nodes where sections begin at none; more: how many."""
    to = cycle.first + cycle.count + more - 1
    source = cycle.count - 1
    for i in range(1, plan.sections):
        own = nodes.section[cycle.section + plan.sections - i]
        if own.passes == 1:
            while source >= own.start:
                at = cycle.first + source
                move_node(nodes, at, to, nodes.parameter[at])
                to -= 1
                source -= 1
            write_cut(nodes, cycle.first + own.start, to, own.begin)
            to -= 1


@wp.func
def bound_sections(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle):
    """Write the first and the last node of each section; jumps between two sections are in neither."""
    last = cycle.count - 1
    for i in range(plan.sections):
        row = cycle.section + plan.sections - 1 - i
        nodes.section[row].stop = last
        cut = nodes.section[row].begin
        start = int(0)
        if i + 1 < plan.sections:
            start = segment_at(nodes.parameter, cycle.first, cycle.count, cut)
            last = nodes_before(nodes, cycle, cut)
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
def plan_passes(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, marked: int):
    """Write how often each section is passed, and how fast."""
    for k in range(plan.sections):
        row = cycle.section + k
        own = nodes.section[row]
        stop = cycle.count - 1
        if k + 1 < plan.sections:
            stop = nodes.section[row + 1].start
        segment = cycle.first + own.start + 1
        once = ZERO
        for i in range(stop - own.start):
            once += nodes.parameter[segment + i]
        once = wp.max(once, TIME_LEAST)
        time = time_of(plan, own.corner, marked)
        wanted = time * plan.section_speed / (once * plan.speed)
        turns = wp.rint((wanted - ONE) / TWO)
        passes = 1 + 2 * int(wp.min(wp.max(turns, ZERO), wp.float64(PASSES_MOST // 2)))
        nodes.section[row].passes = passes
        nodes.section[row].scale = time / (once * wp.float64(passes))


@wp.func
def divide_cycle(plan: SamplingPlan, nodes: CycleNodes, whole: PoseCycle):
    """A cycle whose nodes hold when each is reached, divided into sections."""
    cycle = whole
    total = nodes.parameter[cycle.first + cycle.count - 1]
    marked = mark_sections(plan, nodes, cycle, total)
    more = place_cuts(plan, nodes, cycle, total)
    insert_cuts(plan, nodes, cycle, more)
    cycle.count += more
    cycle.sections = plan.sections
    bound_sections(plan, nodes, cycle)
    for i in range(1, cycle.count):
        at = cycle.first + cycle.count - i
        nodes.parameter[at] = nodes.parameter[at] - nodes.parameter[at - 1]
    plan_passes(plan, nodes, cycle, marked)
    for k in range(cycle.pieces):
        nodes.slowdown[cycle.line + k] = ONE
    return cycle


@wp.func
def begin_sections(nodes: CycleNodes, cycle: PoseCycle):
    """Write the parameter at which each section begins, a sum segment by segment; returns that of the end."""
    parameter = ZERO
    for k in range(cycle.sections):
        own = nodes.section[cycle.section + k]
        nodes.section[cycle.section + k].begin = parameter
        segments = own.stop - own.start
        for i in range(own.passes):
            for j in range(segments):
                behind = wp.where(i % 2 == 0, own.start + j + 1, own.stop - j)
                parameter += section_duration(nodes, cycle, own.scale, cycle.first + behind)
    return parameter


@wp.func
def fastest_in_sections(nodes: CycleNodes, cycle: PoseCycle, least: wp.float64):
    """Greatest speed on a segment that takes longer than a least time [m/s]."""
    fastest = ZERO
    for k in range(cycle.sections):
        own = nodes.section[cycle.section + k]
        for i in range(own.start + 1, own.stop + 1):
            at = cycle.first + i
            took = section_duration(nodes, cycle, own.scale, at)
            if took > least:
                step = nodes.point[at] - nodes.point[at - 1]
                fastest = wp.max(fastest, wp.sqrt(squared(step)) / took)
    return fastest


# The whole cycle.


@wp.func
def first_node(c: Contours, plan: SamplingPlan, pose: int):
    """First node of a pose's cycle; before it is room for every earlier pose's."""
    line = int(c.pose_start[pose])
    own = pose * wp.max(plan.sections, 1)
    return plan.passes * (int(c.polyline_start[line]) + 2 * line) + own


@wp.func
def has_short(plan: SamplingPlan, rows: RouteRows, first: int, count: int, length: wp.float64):
    """Whether a piece is shorter than the step from sample to sample."""
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
def lay_plain(c: Contours, plan: SamplingPlan, nodes: CycleNodes, pose: int):
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
            nodes.parameter[at] = arc
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
def write_node(nodes: CycleNodes, at: int, point: wp.vec3d, level: wp.float64, piece: int, duration: wp.float64):
    """Write a node and the duration of the segment to it [s]."""
    nodes.point[at] = point
    nodes.piece[at] = piece
    nodes.parameter[at] = duration
    if nodes.intensity.shape[0] > 0:
        nodes.intensity[at] = level
    no_pause(nodes, at)


@wp.func
def copy_node(nodes: CycleNodes, source: int, at: int, piece: int, duration: wp.float64):
    """Write a node at the place of another."""
    level = ONE
    if nodes.intensity.shape[0] > 0:
        level = nodes.intensity[source]
    write_node(nodes, at, nodes.point[source], level, piece, duration)
    if nodes.pause.shape[0] > 0:
        nodes.pause[at] = nodes.pause[source]
        nodes.corner[at] = nodes.corner[source]


@wp.func
def write_piece(c: Contours, plan: SamplingPlan, rows: RouteRows, nodes: CycleNodes, row: int, first: int, k: int):
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
def write_nodes(c: Contours, plan: SamplingPlan, rows: RouteRows, nodes: CycleNodes, pose: int, pieces: int):
    """Write a pose's drawn pieces as nodes, each with the duration of the segment to it; returns how many there are."""
    first = first_node(c, plan, pose)
    count = int(0)
    for k in range(pieces):
        count += write_piece(c, plan, rows, nodes, int(c.pose_start[pose]) + k, first + count, k)
    last = first + count - 1
    if plan.pendulum == 1:
        for i in range(1, count):
            source = last - i
            copy_node(nodes, source, last + i, nodes.piece[source], nodes.parameter[source + 1])
        no_pause(nodes, first)
        count += count - 1
    elif plan.returns == 1:
        duration = distance(nodes.point[last], nodes.point[first]) / plan.return_speed
        copy_node(nodes, first, last + 1, -1, duration)
        no_pause(nodes, last + 1)
        count += 1
    return count


@wp.func
def first_duration(nodes: CycleNodes, cycle: PoseCycle):
    """The first segment of a cycle whose nodes hold durations: from parameter 0 to its duration."""
    if cycle.sections > 0:
        return section_segment(nodes, cycle, 0, 0, ZERO)
    segment = cycle_segment(nodes, cycle, 0)
    segment.begin = ZERO
    return segment


@wp.func
def measure_passages(nodes: CycleNodes, rows: RouteRows, cycle: PoseCycle):
    """Write the time of the longest passage along each piece, 0 for one that has none; returns that of the cycle."""
    for k in range(cycle.pieces):
        rows.span[cycle.line + k] = ZERO
    segment = first_duration(nodes, cycle)
    total = ZERO
    left = int(1)
    while left == 1:
        piece = segment_piece(nodes, segment.a, segment.b)
        took = ZERO
        same = int(1)
        while same == 1:
            took += segment.end
            left = wp.where(has_next(nodes, cycle, segment), 1, 0)
            if left == 1:
                segment.end = ZERO  # the next one begins at parameter 0, so its end is its duration
                segment = next_segment(nodes, cycle, segment)
            same = wp.where(left == 1 and segment_piece(nodes, segment.a, segment.b) == piece, 1, 0)
        total += took
        if piece >= 0:
            rows.span[cycle.line + piece] = wp.max(rows.span[cycle.line + piece], took)
    return total


@wp.func
def lengthen_short(nodes: CycleNodes, rows: RouteRows, cycle: PoseCycle, least: wp.float64):
    """Lengthen the durations on pieces whose passages take less than a least time."""
    for k in range(cycle.pieces):
        longest = rows.span[cycle.line + k]
        if longest > ZERO and longest < least:
            rows.span[cycle.line + k] = least / longest
        else:
            rows.span[cycle.line + k] = ONE
        if cycle.sections > 0:
            nodes.slowdown[cycle.line + k] = rows.span[cycle.line + k]
    for i in range(wp.where(cycle.sections > 0, 0, cycle.count - 1)):
        piece = segment_piece(nodes, cycle.first + i, cycle.first + i + 1)
        if piece >= 0:
            at = cycle.first + i + 1
            nodes.parameter[at] = nodes.parameter[at] * rows.span[cycle.line + piece]


@wp.func
def draw_by_turns(plan: SamplingPlan, nodes: CycleNodes, rows: RouteRows, cycle: PoseCycle):
    """A cycle on whose samples every piece is drawn, some not in every cycle.

    One cycle where each piece takes a step at least. Else those that take less than SHARE_LEAST of a step are
    lengthened to it, and there is one sample more in as many cycles as let every piece be drawn, or one less where a
    draw frequency has a lower bound. The numbers of samples and of cycles then have no divisor in common, so the
    samples of all these cycles lie evenly: a piece that takes 1 / n of a step has one in one of about n cycles.
    """
    out = cycle
    samples = wp.float64(cycle.samples)
    step = measure_passages(nodes, rows, cycle) / samples
    least = INFINITE  # time of the longest passage along the piece that has the shortest one
    for k in range(cycle.pieces):
        span = rows.span[cycle.line + k]
        if span > ZERO:
            least = wp.min(least, span)
    if least >= step * (ONE - wp.float64(1e-9)):
        return out
    if least < SHARE_LEAST * step:
        least = SHARE_LEAST * step
        lengthen_short(nodes, rows, cycle, least)
        step = measure_passages(nodes, rows, cycle) / samples
    turns = wp.int64(wp.ceil(step / least + ONE / samples))
    more = wp.int64(1)
    if plan.pace == CAPPED:
        if plan.rate * wp.float64(turns) < plan.lowest * wp.float64(cycle.samples * turns + wp.int64(1)):
            more = wp.int64(-1)
    out.turns = int(turns)
    out.repeat = cycle.samples * turns + more
    return out


@wp.func
def sum_durations(nodes: CycleNodes, cycle: PoseCycle):
    """Sum the durations of segments up to when each node is reached."""
    parameter = ZERO
    nodes.parameter[cycle.first] = parameter
    for i in range(1, cycle.count):
        parameter += nodes.parameter[cycle.first + i]
        nodes.parameter[cycle.first + i] = parameter


@wp.func
def longest_step(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle):
    """Longest step between two samples on the same segment of a cycle, small circles included [m]."""
    if plan.pace != FREQUENCY and plan.pace != CAPPED:
        return plan.ordinary
    fastest = ZERO
    if cycle.sections > 0:
        fastest = fastest_in_sections(nodes, cycle, NOISE_SHARE * cycle.one_sample)
        return fastest * cycle.one_sample + plan.circle_step
    for i in range(cycle.count - 1):
        at = cycle.first + i
        took = nodes.parameter[at + 1] - nodes.parameter[at]
        if took > NOISE_SHARE * cycle.one_sample:
            step = nodes.point[at + 1] - nodes.point[at]
            fastest = wp.max(fastest, wp.sqrt(squared(step)) / took)
    return fastest * cycle.one_sample + plan.circle_step


@wp.func
def time_cycle(plan: SamplingPlan, nodes: CycleNodes, rows: RouteRows, untimed: PoseCycle):
    """A cycle whose nodes hold durations, with its pauses or sections, its samples and its period."""
    cycle = untimed
    if plan.sections > 0:
        sum_durations(nodes, cycle)
        cycle = divide_cycle(plan, nodes, cycle)
    elif nodes.pause.shape[0] > 0:
        cycle.count = insert_pauses(plan, nodes, cycle.first, untimed.count)
        cycle.pauses = cycle.count - untimed.count
    total = ZERO
    for i in range(1, cycle.count):
        total += nodes.parameter[cycle.first + i]
    cycle.samples = samples_of(plan, total)
    cycle.repeat = cycle.samples
    if plan.points == 0 and plan.pace != STILL and cycle.pieces > 1:
        cycle = draw_by_turns(plan, nodes, rows, cycle)
    if cycle.sections > 0:
        cycle.period = begin_sections(nodes, cycle)
    else:
        sum_durations(nodes, cycle)
        cycle.period = nodes.parameter[cycle.first + cycle.count - 1]
    return cycle


@wp.func
def lay_cycle(
    c: Contours,
    plan: SamplingPlan,
    rows: RouteRows,
    nodes: CycleNodes,
    pose: int,
    pieces: int,
    plain: bool,
    seconds: wp.float64,
):
    """The cycle of a pose whose route is drawn; seconds: what a plain cycle takes [s]."""
    cycle = PoseCycle()
    cycle.first = first_node(c, plan, pose)
    cycle.pieces = pieces
    cycle.line = int(c.pose_start[pose])
    cycle.section = pose * plan.sections
    cycle.turns = 1
    if plain:
        cycle.count = lay_plain(c, plan, nodes, pose)
        cycle.single = wp.where(int(c.pose_start[pose + 1]) - int(c.pose_start[pose]) == 1, 1, 0)
        cycle.samples = samples_of(plan, seconds)
        cycle.repeat = cycle.samples
        cycle.period = nodes.parameter[cycle.first + cycle.count - 1]
    else:
        cycle.count = write_nodes(c, plan, rows, nodes, pose, pieces)
        cycle = time_cycle(plan, nodes, rows, cycle)
    cycle.one_sample = wp.float64(cycle.turns) * cycle.period / wp.float64(cycle.repeat)
    cycle.ordinary = longest_step(plan, nodes, cycle)
    return cycle
