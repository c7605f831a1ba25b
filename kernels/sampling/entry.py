"""Entry: the place on each pose's cycle at which drawing goes on from where the focal point is.

| where the focal point is | where it goes on |
|---|---|
| anywhere | at the nearest point passed in the same direction; one passed the other way must be nearer by a slack |
| three ordinary steps or less from any | at one so near, the other way if need be |
| resting at a corner | resting at the nearest corner, for what is left of the pause, if that is not much farther |
| shortly before a corner, or behind it | not behind it, or before it: a pause is neither left out nor made twice |
| in a section | in the section whose middle is nearest, as far through its time |

A new pose does not restart the drawing, since restarting makes closed contours as loud as open ones.
"""

import warp as wp

from ..contours import Contours
from ..patch import EXACT
from .layout import (
    HALF,
    INFINITE,
    ONE,
    TINY,
    TWO,
    ZERO,
    CycleNodes,
    FocusPlace,
    PoseCycle,
    PoseEntry,
    PoseSchedule,
    SamplerState,
    SamplingPlan,
    distance,
    part_of,
    squared,
    without_rounding,
)
from .pieces import goes_on
from .segments import (
    CycleSegment,
    age_of,
    base_parameter,
    cycle_segment,
    find_segment,
    focus_parameter,
    gain_of,
    has_next,
    level_on,
    next_segment,
    point_on,
    section_end,
    section_segment,
    segment_at,
    segments_of,
    shown_parameter,
    step_of,
)

wp.set_module_options(EXACT)

NEAR_STEPS = wp.constant(wp.float64(3.0))  # ordinary steps: by so much contours may move between inserted poses
MIXED = wp.constant(wp.int64(0x9E3779B9))  # an odd number with its bits spread
SAME_COST = wp.constant(wp.float64(1e-12))  # [m]
AGAINST = wp.constant(wp.float64(1e-9))  # share of its length by which a segment runs against a direction
WHOLE_SECTION = wp.constant(wp.float64(1e-3))  # [m] that its whole time counts among passes of the same place


@wp.func
def approach(nodes: CycleNodes, segment: CycleSegment, point: wp.vec3d):
    """Distance of a segment from a point [m], infinite for jumps, and the nearest place on it, 0..1."""
    a = nodes.point[segment.a]
    step = step_of(nodes, segment)
    square = squared(step)
    if segment.end <= segment.begin or square == ZERO:
        return INFINITE, ZERO
    off = point - a
    part = part_of(step, off)
    return wp.sqrt(squared(off - part * step)), part


@wp.func
def is_against(nodes: CycleNodes, segment: CycleSegment, direction: wp.vec3d):
    """Whether a segment runs against a direction."""
    step = step_of(nodes, segment)
    return wp.dot(step, direction) < -AGAINST * wp.sqrt(squared(step))


@wp.func
def is_pause(nodes: CycleNodes, cycle: PoseCycle, segment: int):
    """Whether the focal point rests on a segment."""
    at = cycle.first + segment
    step = nodes.point[at + 1] - nodes.point[at]
    return squared(step) == ZERO and nodes.parameter[at + 1] > nodes.parameter[at]


@wp.struct
class PausesAround:
    """The pauses before and behind a place on a cycle."""

    behind: wp.float64  # distance since the last one [m]
    ahead: wp.float64  # to the next one [m]
    last: wp.int32  # number of the segment
    following: wp.int32


@wp.func
def modulo(value: wp.float64, period: wp.float64):
    """A value within 0..period, as Python has it."""
    out = wp.mod(value, period)
    if out < ZERO:
        out += period
    return out


@wp.func
def pauses_around(nodes: CycleNodes, cycle: PoseCycle, parameter: wp.float64):
    """The pauses around a parameter of a cycle that has some."""
    out = PausesAround()
    found = segment_at(nodes.parameter, cycle.first, cycle.count, parameter)
    own = wp.min(found, cycle.count - 2)
    arc = ZERO
    here = ZERO
    before = -ONE  # arcs of pauses; those first and last on the cycle serve where there is none on that side
    behind = -ONE
    first = -ONE
    latest = ZERO
    first_segment = int(0)
    latest_segment = int(0)
    for i in range(cycle.count):
        at = cycle.first + i
        if i == cycle.count - 1:
            if found == i:
                here = arc
        else:
            step = wp.sqrt(squared(nodes.point[at + 1] - nodes.point[at]))
            if found == i:
                here = arc
                if parameter != nodes.parameter[at]:
                    slope = ((arc + step) - arc) / (nodes.parameter[at + 1] - nodes.parameter[at])
                    here = slope * (parameter - nodes.parameter[at]) + arc
            if is_pause(nodes, cycle, i):
                latest = arc
                latest_segment = i
                if first < ZERO:
                    first = arc
                    first_segment = i
                if i < own:
                    before = arc
                    out.last = i
                elif behind < ZERO:
                    behind = arc
                    out.following = i
            arc += step
    if before < ZERO:
        before = latest
        out.last = latest_segment
    if behind < ZERO:
        behind = first
        out.following = first_segment
    out.behind = modulo(here - before, arc)
    out.ahead = modulo(behind - here, arc)
    return out


@wp.func
def place_by_pauses(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, place: FocusPlace, parameter: wp.float64):
    """A place at a parameter, with how far a pause is over there, or on which side of a near one it is."""
    out = place
    if cycle.pauses == 0:
        return out
    segment = wp.min(segment_at(nodes.parameter, cycle.first, cycle.count, parameter), cycle.count - 2)
    begin = nodes.parameter[cycle.first + segment]
    if is_pause(nodes, cycle, segment):
        out.rested = (parameter - begin) / (nodes.parameter[cycle.first + segment + 1] - begin)
        return out
    around = pauses_around(nodes, cycle, parameter)
    if wp.min(around.behind, around.ahead) < plan.threshold:
        out.beside = wp.where(around.behind <= around.ahead, 1, -1)
    return out


@wp.func
def nearest_pause(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, place: FocusPlace):
    """The pause nearest to a place, preferably one that is reached in the same direction; and how near it is [m]."""
    least = INFINITE
    best = int(0)
    for i in range(cycle.count - 1):
        if is_pause(nodes, cycle, i):
            apart = distance(place.point, nodes.point[cycle.first + i])
            if squared(place.direction) > ZERO:
                before = i - 1
                if i == 0:
                    before = cycle.count - 2
                at = cycle.first + before
                step = nodes.point[at + 1] - nodes.point[at]
                length = wp.max(distance(nodes.point[at], nodes.point[at + 1]), TINY)
                apart += plan.threshold * (ONE - wp.dot(step, place.direction) / length) / TWO
            if apart < least:
                least = apart
                best = i
    return best, least


@wp.func
def entered_by_pauses(
    plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, place: FocusPlace, parameter: wp.float64, cost: wp.float64
):
    """Parameter at which drawing goes on, if without pauses it were at one that costs so much [m].

    A pause goes on at the nearest one. Shortly before a pause, or behind it, none is left out or made twice.
    """
    if cycle.pauses == 0:
        return parameter
    if place.rested >= ZERO:
        segment, apart = nearest_pause(plan, nodes, cycle, place)
        if apart <= cost + plan.threshold:
            begin = nodes.parameter[cycle.first + segment]
            return begin + place.rested * (nodes.parameter[cycle.first + segment + 1] - begin)
        return parameter
    around = pauses_around(nodes, cycle, parameter)
    if place.beside > 0 and around.ahead < plan.threshold and around.ahead < around.behind:
        return nodes.parameter[cycle.first + around.following + 1]
    if place.beside < 0 and around.behind < plan.threshold and around.behind < around.ahead:
        return nodes.parameter[cycle.first + around.last]
    return parameter


@wp.struct
class NearestPlace:
    """The place on a cycle that costs least to go on at."""

    cost: wp.float64  # [m]
    segment: CycleSegment
    part: wp.float64  # 0..1 of that segment


@wp.func
def nearer(best: NearestPlace, segment: CycleSegment, cost: wp.float64, part: wp.float64):
    """The best place, or another on a segment if that costs less [m]; of equals the first: rounding does not decide."""
    out = best
    if cost + SAME_COST < best.cost:
        out.cost = cost
        out.segment = segment
        out.part = part
    return out


@wp.func
def parameter_of(nodes: CycleNodes, near: NearestPlace):
    """Parameter of a place on a cycle."""
    part = without_rounding(step_of(nodes, near.segment), near.part)
    if part == ONE:
        part = near.part  # the end's own parameter may be that of another piece, to which the focal point jumps there
    return near.segment.begin + part * (near.segment.end - near.segment.begin)


@wp.func
def entered(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, place: FocusPlace):
    """Parameter at which drawing goes on: the nearest place, in the same direction if that is not much farther.

    If any segment is near, only near ones count, also against the direction, except where the cycle has pauses: there a
    wrong direction would leave one out or make it twice.
    """
    if cycle.sections > 0:
        return entered_in_section(plan, nodes, cycle, place)
    near = NearestPlace()
    near.cost = INFINITE
    far = near
    directed = squared(place.direction) > ZERO
    for i in range(cycle.count - 1):
        segment = cycle_segment(nodes, cycle, i)
        away, part = approach(nodes, segment, place.point)
        cost = away
        if directed and away < INFINITE and is_against(nodes, segment, place.direction):
            cost += plan.threshold
        if cycle.pauses > 0 or away <= NEAR_STEPS * cycle.ordinary:
            near = nearer(near, segment, cost, part)
        else:
            far = nearer(far, segment, cost, part)
    if near.cost == INFINITE:
        near = far
    return entered_by_pauses(plan, nodes, cycle, place, parameter_of(nodes, near), near.cost)


@wp.func
def middle_of(nodes: CycleNodes, cycle: PoseCycle, section: int):
    """Middle between the ends of a section [m]."""
    own = nodes.section[cycle.section + section]
    return HALF * (nodes.point[cycle.first + own.start] + nodes.point[cycle.first + own.stop])


@wp.func
def entered_in_section(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, place: FocusPlace):
    """Parameter at which drawing goes on: in the section whose middle is nearest, as far through its time."""
    nearest = int(0)
    least = INFINITE
    for k in range(cycle.sections):
        apart = distance(place.middle, middle_of(nodes, cycle, k))
        if apart < least:
            least = apart
            nearest = k
    own = nodes.section[cycle.section + nearest]
    took = section_end(nodes, cycle, nearest) - own.begin
    directed = squared(place.direction) > ZERO
    near = NearestPlace()
    near.cost = INFINITE
    segment = section_segment(nodes, cycle, nearest, 0, own.begin)
    for _i in range(segments_of(own)):
        cost, part = approach(nodes, segment, place.point)
        if directed and cost < INFINITE and is_against(nodes, segment, place.direction):
            cost += plan.threshold
        parameter = segment.begin + part * (segment.end - segment.begin)
        cost += WHOLE_SECTION * wp.abs((parameter - own.begin) / took - place.through)
        near = nearer(near, segment, cost, part)
        if has_next(nodes, cycle, segment):
            segment = next_segment(nodes, cycle, segment)
    return parameter_of(nodes, near)


@wp.func
def direction_on(nodes: CycleNodes, cycle: PoseCycle, segment: CycleSegment):
    """Direction in which a focal point moves on a segment, or on the one before if it rests there; zero if on both."""
    step = step_of(nodes, segment)
    if cycle.sections == 0 and segment.number > 0 and squared(step) == ZERO:
        step = nodes.point[segment.a] - nodes.point[segment.a - 1]
    length = wp.sqrt(squared(step))
    if length > ZERO:
        step = step / length
    return step


@wp.func
def is_silent_at(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: CycleNodes,
    cycle: PoseCycle,
    pose: int,
    sample: int,
    parameter: wp.float64,
    hold: wp.float64,
):
    """Whether a sample of a pose, at this parameter of a cycle, is of intensity 0."""
    if gain_of(plan, age_of(schedule, pose, sample), hold) <= ZERO:
        return int(1)
    if nodes.intensity.shape[0] == 0:
        return int(0)
    silent = int(1)
    for focus in range(plan.foci):
        at = shown_parameter(plan, schedule.shown, cycle, focus_parameter(plan, cycle, parameter, focus))
        if level_on(nodes, find_segment(nodes, cycle, at, CycleSegment()), at) > ZERO:
            silent = int(0)
    return silent


@wp.func
def shape_of(c: Contours, pose: int):
    """A number that says how many polylines a pose has and which are closed; beyond 62 of them all but surely."""
    shape = wp.int64(1)
    line = int(c.pose_start[pose])
    stop = int(c.pose_start[pose + 1])
    factor = wp.int64(2)
    if stop - line > 62:  # one bit each has no room
        factor = MIXED
    while line < stop:
        shape = shape * factor + wp.int64(c.polyline_closed[line])
        line += 1
    return shape


@wp.func
def enter_cycle(
    plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, shape: wp.int64, place: FocusPlace, before: int
):
    """Entry to the contours of a new pose of a shape; before: the pose drawn before in the span."""
    entry = PoseEntry()
    entry.drawn = 1
    entry.silent = place.silent
    entry.first = 1 - place.drawn
    entry.before = before
    if place.drawn == 0 or (plan.restarts == 1 and shape != place.shape):
        return entry
    entry.found = 1
    entry.anchor = entered(plan, nodes, cycle, place)
    entry.index = wp.int64(1 - place.silent)
    return entry


@wp.func
def place_at(plan: SamplingPlan, nodes: CycleNodes, cycle: PoseCycle, parameter: wp.float64):
    """Place of the focal point at a parameter of a cycle."""
    place = FocusPlace()
    segment = find_segment(nodes, cycle, parameter, CycleSegment())
    place.point = point_on(nodes, segment, parameter)
    place.direction = direction_on(nodes, cycle, segment)
    place.rested = -ONE
    if cycle.sections > 0:
        begin = nodes.section[cycle.section + segment.section].begin
        place.middle = middle_of(nodes, cycle, segment.section)
        place.through = (parameter - begin) / (section_end(nodes, cycle, segment.section) - begin)
        return place
    return place_by_pauses(plan, nodes, cycle, place, parameter)


@wp.kernel
def _enter_poses(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: CycleNodes,
    cycles: wp.array[PoseCycle],  # shape [pose]
    # Out:
    state: SamplerState,
    entries: wp.array[PoseEntry],  # shape [pose]
):
    """Go through the poses of a motion in turn."""
    motion = wp.tid()
    hold = schedule.hold[motion]
    place = state.motion[motion].place
    anchor = state.motion[motion].anchor
    index = state.motion[motion].index
    before = int(-1)
    pose = int(schedule.motion_start[motion])
    while pose < int(schedule.motion_start[motion + 1]):
        entry = PoseEntry()
        entry.before = before
        entry.first = 1 - place.drawn
        if cycles[pose].count > 0:
            cycle = cycles[pose]
            shape = wp.int64(0)
            if plan.restarts == 1:
                shape = shape_of(c, pose)
            if goes_on(c, schedule, state, pose, cycle.pieces):
                entry.drawn = 1
                entry.again = 1
                entry.found = 1
                entry.silent = place.silent
                entry.anchor = anchor
                entry.index = index
            else:
                entry = enter_cycle(plan, nodes, cycle, shape, place, before)
            anchor = entry.anchor
            index = entry.index + wp.int64(schedule.count[pose])
            last = base_parameter(plan, cycle, anchor, index - wp.int64(1))
            place = place_at(plan, nodes, cycle, last)
            place.drawn = 1
            place.shape = shape
            sample = schedule.count[pose] - 1
            place.silent = is_silent_at(plan, schedule, nodes, cycle, pose, sample, last, hold)
            before = pose + 0
        elif schedule.count[pose] > 0:
            place.silent = 1
        entries[pose] = entry
        pose += 1
    state.motion[motion].place = place
    state.motion[motion].anchor = anchor
    state.motion[motion].index = index
