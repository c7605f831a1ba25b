"""Places on a cycle: curve parameters of samples, points and intensities there, and what a fade leaves of these."""

import warp as wp

from .layout import ONE, STILL, TICKS, ZERO, CycleNodes, DrawnSection, PoseCycle, PoseSchedule, SamplingPlan

TURN_SLACK = wp.constant(wp.float64(1e-9))  # of a turn


@wp.struct
class CycleSegment:
    """The straight segment of a cycle from a node to the next one."""

    a: wp.int32  # node
    b: wp.int32  # the next one
    begin: wp.float64  # parameter at the first node
    end: wp.float64  # parameter at the next one
    section: wp.int32  # number of the section that it is in
    number: wp.int32  # of the segment in the section, else in the cycle


@wp.func
def cycle_segment(nodes: CycleNodes, cycle: PoseCycle, number: int):
    """A segment by its number, of a cycle without sections."""
    segment = CycleSegment()
    segment.a = cycle.first + number
    segment.b = segment.a + 1
    segment.begin = nodes.parameter[segment.a]
    segment.end = nodes.parameter[segment.b]
    segment.number = number
    return segment


@wp.func
def segment_at(parameters: wp.array[wp.float64], first: int, count: int, parameter: wp.float64):
    """Number of the last node that is reached by a parameter."""
    low = int(0)
    high = count
    while high - low > 1:
        middle = (low + high) // 2
        if parameters[first + middle] <= parameter:
            low = middle
        else:
            high = middle
    return low


@wp.func
def section_segment(nodes: CycleNodes, cycle: PoseCycle, section: int, number: int, begin: wp.float64):
    """A segment of a section by its number; the one behind the last leads to the next section.

    begin: curve parameter of its first node.
    """
    own = nodes.section[cycle.section + section]
    segments = own.stop - own.start
    turn = number % (2 * segments)
    i = wp.min(turn, 2 * segments - turn)
    j = wp.where(turn < segments, i + 1, i - 1)
    segment = CycleSegment()
    segment.a = cycle.first + own.start + i
    segment.b = cycle.first + own.start + j
    segment.begin = begin
    segment.end = begin
    segment.section = section
    segment.number = number
    if number == segments * own.passes:
        segment.b = cycle.first + nodes.section[cycle.section + section + 1].start
    else:
        segment.end += section_duration(nodes, cycle, own.scale, wp.max(segment.a, segment.b))
    return segment


@wp.func
def section_duration(nodes: CycleNodes, cycle: PoseCycle, scale: wp.float64, at: int):
    """Duration of the segment to a node, or back from there, in a section [s]."""
    duration = nodes.parameter[at] * scale
    piece = segment_piece(nodes, at - 1, at)
    if cycle.pieces > 1 and piece >= 0:
        duration = duration * nodes.slowdown[cycle.line + piece]
    return duration


@wp.func
def segment_piece(nodes: CycleNodes, a: int, b: int):
    """Number of the piece that two nodes are on, -1: not on the same one."""
    piece = int(nodes.piece[a])
    if piece != int(nodes.piece[b]):
        piece = int(-1)
    return piece


@wp.func
def segments_of(section: DrawnSection):
    """Number of segments of a section, all passes together."""
    return (section.stop - section.start) * section.passes


@wp.func
def has_next(nodes: CycleNodes, cycle: PoseCycle, segment: CycleSegment):
    """Whether a segment is not the last one of a cycle."""
    if cycle.sections == 0:
        return segment.number + 2 < cycle.count
    if segment.section + 1 < cycle.sections:
        return True
    return segment.number + 1 < segments_of(nodes.section[cycle.section + segment.section])


@wp.func
def next_segment(nodes: CycleNodes, cycle: PoseCycle, segment: CycleSegment):
    """The segment behind one that is not the last."""
    if cycle.sections == 0:
        return cycle_segment(nodes, cycle, segment.number + 1)
    if segment.number < segments_of(nodes.section[cycle.section + segment.section]):
        return section_segment(nodes, cycle, segment.section, segment.number + 1, segment.end)
    return section_segment(nodes, cycle, segment.section + 1, 0, segment.end)


@wp.func
def section_at(nodes: CycleNodes, cycle: PoseCycle, parameter: wp.float64):
    """Number of the section of a cycle that is drawn at a parameter."""
    low = int(0)
    high = int(cycle.sections)
    while high - low > 1:
        middle = (low + high) // 2
        if nodes.section[cycle.section + middle].begin <= parameter:
            low = middle
        else:
            high = middle
    return low


@wp.func
def section_end(nodes: CycleNodes, cycle: PoseCycle, section: int):
    """Parameter at which a section ends."""
    if section + 1 < cycle.sections:
        return nodes.section[cycle.section + section + 1].begin
    return cycle.period


@wp.func
def is_on(segment: CycleSegment, parameter: wp.float64):
    """Whether a parameter lies on a segment."""
    return segment.begin <= parameter and parameter < segment.end


@wp.func
def find_segment(nodes: CycleNodes, cycle: PoseCycle, parameter: wp.float64, guess: CycleSegment):
    """The segment on which a parameter lies; found faster soon behind a guess. No guess: `CycleSegment()`."""
    segment = guess
    known = guess.a != guess.b and guess.begin <= parameter
    if cycle.sections == 0:
        if known and parameter >= guess.end and has_next(nodes, cycle, guess):
            segment = cycle_segment(nodes, cycle, guess.number + 1)
        if not known or parameter >= segment.end:
            number = segment_at(nodes.parameter, cycle.first, cycle.count, parameter)
            segment = cycle_segment(nodes, cycle, wp.min(number, cycle.count - 2))
        return segment
    section = section_at(nodes, cycle, parameter)
    if not known or section != guess.section:
        own = nodes.section[cycle.section + section]
        segment = section_segment(nodes, cycle, section, 0, own.begin)
    while parameter >= segment.end and has_next(nodes, cycle, segment):
        segment = next_segment(nodes, cycle, segment)
    return segment


@wp.func
def step_of(nodes: CycleNodes, segment: CycleSegment):
    """From a segment's node to the next [m]."""
    return nodes.point[segment.b] - nodes.point[segment.a]


@wp.func
def point_on(nodes: CycleNodes, segment: CycleSegment, parameter: wp.float64):
    """Point of a cycle at a parameter on a segment [m]."""
    if parameter >= segment.end:
        return nodes.point[segment.b]
    a = nodes.point[segment.a]
    if segment.begin == parameter:
        return a
    return ((nodes.point[segment.b] - a) / (segment.end - segment.begin)) * (parameter - segment.begin) + a


@wp.func
def level_on(nodes: CycleNodes, segment: CycleSegment, parameter: wp.float64):
    """Intensity of a cycle at a parameter on a segment."""
    if nodes.intensity.shape[0] == 0:
        return ONE
    if parameter >= segment.end:
        return nodes.intensity[segment.b]
    a = nodes.intensity[segment.a]
    if segment.begin == parameter:
        return a
    return (nodes.intensity[segment.b] - a) / (segment.end - segment.begin) * (parameter - segment.begin) + a


@wp.func
def cycle_point(nodes: CycleNodes, cycle: PoseCycle, parameter: wp.float64):
    """Point of a cycle at a parameter [m]."""
    return point_on(nodes, find_segment(nodes, cycle, parameter, CycleSegment()), parameter)


@wp.func
def base_parameter(plan: SamplingPlan, cycle: PoseCycle, anchor: wp.float64, index: wp.int64):
    """Parameter of the first focal point at a sample, before points are held or reordered."""
    one_sample = cycle.one_sample
    if plan.pace == STILL:
        one_sample = ZERO
    parameter = anchor + one_sample * wp.float64(index % cycle.repeat)
    if cycle.turns > 1:
        return wp.mod(parameter, cycle.period)
    if parameter >= cycle.period:
        parameter -= cycle.period
    return parameter


@wp.func
def focus_parameter(plan: SamplingPlan, cycle: PoseCycle, parameter: wp.float64, focus: int):
    """Parameter of a focal point, all being spaced evenly from the first one on."""
    if plan.foci == 1:
        return parameter
    return wp.mod(parameter + cycle.period * wp.float64(focus) / wp.float64(plan.foci), cycle.period)


@wp.func
def shown_parameter(plan: SamplingPlan, shown: wp.array[wp.int32], cycle: PoseCycle, parameter: wp.float64):
    """Parameter of the point that is held and shown in place of the one at a parameter."""
    if plan.points == 0:
        return parameter
    share = wp.float64(plan.points) / cycle.period
    turn = int(wp.floor(parameter * share + TURN_SLACK)) % plan.points
    return wp.float64(shown[turn]) / share


@wp.func
def age_of(schedule: PoseSchedule, pose: int, sample: int):
    """Age of a pose at one of its samples [ticks]."""
    return wp.float64(schedule.first[pose] + wp.int64(sample)) * TICKS - schedule.time[pose]


@wp.func
def gain_of(plan: SamplingPlan, age: wp.float64, hold: wp.float64):
    """Factor that a fade leaves of the intensity; age, hold: [ticks]."""
    if age <= hold:
        return ONE
    return wp.min(wp.max(ONE - (age - hold) / plan.fade, ZERO), ONE)
