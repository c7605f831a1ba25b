"""Motions gone through pose by pose: drawing goes on along each pose's track where the focal point is.

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
    FocusPlace,
    PoseEntry,
    PoseSchedule,
    PoseTrack,
    SamplerState,
    SamplingPlan,
    TrackNodes,
    distance,
    part_of,
    squared,
    without_rounding,
)
from .pieces import goes_on
from .ways import (
    TrackWay,
    age_of,
    cycle_knot,
    find_way,
    focus_knot,
    gain_of,
    has_next,
    level_on,
    next_way,
    plain_way,
    point_on,
    section_end,
    section_way,
    shown_knot,
    step_of,
    way_at,
    ways_of,
)

wp.set_module_options(EXACT)

NEAR_STEPS = wp.constant(wp.float64(3.0))  # ordinary steps: by so much contours may move between inserted poses
MIXED = wp.constant(wp.int64(0x9E3779B9))  # an odd number with its bits spread
SAME_COST = wp.constant(wp.float64(1e-12))  # [m]
AGAINST = wp.constant(wp.float64(1e-9))  # share of a way by which it runs against a direction
WHOLE_SECTION = wp.constant(wp.float64(1e-3))  # [m] that its whole time counts among passes of the same place


@wp.func
def approach(nodes: TrackNodes, way: TrackWay, point: wp.vec3d):
    """How near a way comes to a point [m], infinite for jumps, and where, 0..1."""
    a = nodes.point[way.a]
    step = step_of(nodes, way)
    square = squared(step)
    if way.end <= way.begin or square == ZERO:
        return INFINITE, ZERO
    off = point - a
    part = part_of(step, off)
    return wp.sqrt(squared(off - part * step)), part


@wp.func
def is_against(nodes: TrackNodes, way: TrackWay, direction: wp.vec3d):
    """Whether a way runs against a direction."""
    step = step_of(nodes, way)
    return wp.dot(step, direction) < -AGAINST * wp.sqrt(squared(step))


@wp.func
def is_pause(nodes: TrackNodes, track: PoseTrack, way: int):
    """Whether the focal point rests on a way from node to node."""
    at = track.first + way
    step = nodes.point[at + 1] - nodes.point[at]
    return squared(step) == ZERO and nodes.knot[at + 1] > nodes.knot[at]


@wp.struct
class PausesAround:
    """The pauses before and behind a place on a track, which is a cycle."""

    behind: wp.float64  # way since the last one [m]
    ahead: wp.float64  # to the next one [m]
    last: wp.int32  # way from node to node
    following: wp.int32


@wp.func
def modulo(value: wp.float64, period: wp.float64):
    """A value within 0..period, as Python has it."""
    out = wp.mod(value, period)
    if out < ZERO:
        out += period
    return out


@wp.func
def pauses_around(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """The pauses around a knot of a track that has some."""
    out = PausesAround()
    found = way_at(nodes.knot, track.first, track.count, knot)
    own = wp.min(found, track.count - 2)
    arc = ZERO
    here = ZERO
    before = -ONE  # arcs of pauses; those first and last on the track serve where there is none on that side
    behind = -ONE
    first = -ONE
    latest = ZERO
    first_way = int(0)
    latest_way = int(0)
    for i in range(track.count):
        at = track.first + i
        if i == track.count - 1:
            if found == i:
                here = arc
        else:
            step = wp.sqrt(squared(nodes.point[at + 1] - nodes.point[at]))
            if found == i:
                here = arc
                if knot != nodes.knot[at]:
                    slope = ((arc + step) - arc) / (nodes.knot[at + 1] - nodes.knot[at])
                    here = slope * (knot - nodes.knot[at]) + arc
            if is_pause(nodes, track, i):
                latest = arc
                latest_way = i
                if first < ZERO:
                    first = arc
                    first_way = i
                if i < own:
                    before = arc
                    out.last = i
                elif behind < ZERO:
                    behind = arc
                    out.following = i
            arc += step
    if before < ZERO:
        before = latest
        out.last = latest_way
    if behind < ZERO:
        behind = first
        out.following = first_way
    out.behind = modulo(here - before, arc)
    out.ahead = modulo(behind - here, arc)
    return out


@wp.func
def place_by_pauses(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace, knot: wp.float64):
    """A place at a knot, with how far a pause is over there, or on which side of a near one it is."""
    out = place
    if track.pauses == 0:
        return out
    way = wp.min(way_at(nodes.knot, track.first, track.count, knot), track.count - 2)
    begin = nodes.knot[track.first + way]
    if is_pause(nodes, track, way):
        out.rested = (knot - begin) / (nodes.knot[track.first + way + 1] - begin)
        return out
    around = pauses_around(nodes, track, knot)
    if wp.min(around.behind, around.ahead) < plan.threshold:
        out.beside = wp.where(around.behind <= around.ahead, 1, -1)
    return out


@wp.func
def nearest_pause(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace):
    """The pause of a track nearest to a place, best one that is reached in the same direction; and how near [m]."""
    least = INFINITE
    best = int(0)
    for i in range(track.count - 1):
        if is_pause(nodes, track, i):
            apart = distance(place.point, nodes.point[track.first + i])
            if squared(place.direction) > ZERO:
                before = i - 1
                if i == 0:
                    before = track.count - 2
                at = track.first + before
                step = nodes.point[at + 1] - nodes.point[at]
                length = wp.max(distance(nodes.point[at], nodes.point[at + 1]), TINY)
                apart += plan.threshold * (ONE - wp.dot(step, place.direction) / length) / TWO
            if apart < least:
                least = apart
                best = i
    return best, least


@wp.func
def entered_by_pauses(
    plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace, knot: wp.float64, cost: wp.float64
):
    """Knot at which drawing goes on, if without pauses it were at one that costs so much [m].

    A pause goes on at the nearest one. Shortly before a pause, or behind it, none is left out or made twice.
    """
    if track.pauses == 0:
        return knot
    if place.rested >= ZERO:
        way, apart = nearest_pause(plan, nodes, track, place)
        if apart <= cost + plan.threshold:
            begin = nodes.knot[track.first + way]
            return begin + place.rested * (nodes.knot[track.first + way + 1] - begin)
        return knot
    around = pauses_around(nodes, track, knot)
    if place.beside > 0 and around.ahead < plan.threshold and around.ahead < around.behind:
        return nodes.knot[track.first + around.following + 1]
    if place.beside < 0 and around.behind < plan.threshold and around.behind < around.ahead:
        return nodes.knot[track.first + around.last]
    return knot


@wp.struct
class NearestKnot:
    """The place on a track that costs least to go on at."""

    cost: wp.float64  # [m]
    way: TrackWay
    part: wp.float64  # 0..1 of that way


@wp.func
def nearer(best: NearestKnot, way: TrackWay, cost: wp.float64, part: wp.float64):
    """The best place, or another, 0..1 of a way, that costs less [m]; of equals the first: rounding does not decide."""
    out = best
    if cost + SAME_COST < best.cost:
        out.cost = cost
        out.way = way
        out.part = part
    return out


@wp.func
def knot_of(nodes: TrackNodes, near: NearestKnot):
    """Knot of a place on a track."""
    part = without_rounding(step_of(nodes, near.way), near.part)
    if part == ONE:
        part = near.part  # the end's own knot may be that of another piece, to which the focal point jumps there
    return near.way.begin + part * (near.way.end - near.way.begin)


@wp.func
def entered(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace):
    """Knot at which drawing goes on: the nearest place, in the same direction if that is not much farther.

    Where a way is near, no direction is a reason for one that is not, unless a pause could be left out or made twice.
    """
    if track.sections > 0:
        return entered_in_section(plan, nodes, track, place)
    near = NearestKnot()
    near.cost = INFINITE
    far = near
    directed = squared(place.direction) > ZERO
    for i in range(track.count - 1):
        way = plain_way(nodes, track, i)
        away, part = approach(nodes, way, place.point)
        cost = away
        if directed and away < INFINITE and is_against(nodes, way, place.direction):
            cost += plan.threshold
        if track.pauses > 0 or away <= NEAR_STEPS * track.ordinary:
            near = nearer(near, way, cost, part)
        else:
            far = nearer(far, way, cost, part)
    if near.cost == INFINITE:
        near = far
    return entered_by_pauses(plan, nodes, track, place, knot_of(nodes, near), near.cost)


@wp.func
def middle_of(nodes: TrackNodes, track: PoseTrack, section: int):
    """Middle between the ends of a section [m]."""
    own = nodes.section[track.section + section]
    return HALF * (nodes.point[track.first + own.start] + nodes.point[track.first + own.stop])


@wp.func
def entered_in_section(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace):
    """Knot at which drawing goes on: in the section whose middle is nearest, as far through its time."""
    nearest = int(0)
    least = INFINITE
    for k in range(track.sections):
        apart = distance(place.middle, middle_of(nodes, track, k))
        if apart < least:
            least = apart
            nearest = k
    own = nodes.section[track.section + nearest]
    took = section_end(nodes, track, nearest) - own.begin
    directed = squared(place.direction) > ZERO
    near = NearestKnot()
    near.cost = INFINITE
    way = section_way(nodes, track, nearest, 0, own.begin)
    for _i in range(ways_of(own)):
        cost, part = approach(nodes, way, place.point)
        if directed and cost < INFINITE and is_against(nodes, way, place.direction):
            cost += plan.threshold
        knot = way.begin + part * (way.end - way.begin)
        cost += WHOLE_SECTION * wp.abs((knot - own.begin) / took - place.through)
        near = nearer(near, way, cost, part)
        if has_next(nodes, track, way):
            way = next_way(nodes, track, way)
    return knot_of(nodes, near)


@wp.func
def direction_on(nodes: TrackNodes, track: PoseTrack, way: TrackWay):
    """Direction in which a focal point moves on a way, or on the one before if it rests there; zero if on both."""
    step = step_of(nodes, way)
    if track.sections == 0 and way.number > 0 and squared(step) == ZERO:
        step = nodes.point[way.a] - nodes.point[way.a - 1]
    length = wp.sqrt(squared(step))
    if length > ZERO:
        step = step / length
    return step


@wp.func
def is_silent_at(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    track: PoseTrack,
    pose: int,
    sample: int,
    knot: wp.float64,
    hold: wp.float64,
):
    """Whether a sample of a pose, at this knot of a track, is of intensity 0."""
    if gain_of(plan, age_of(schedule, pose, sample), hold) <= ZERO:
        return int(1)
    if nodes.intensity.shape[0] == 0:
        return int(0)
    silent = int(1)
    for focus in range(plan.foci):
        at = shown_knot(plan, schedule.shown, track, focus_knot(plan, track, knot, focus))
        if level_on(nodes, find_way(nodes, track, at, TrackWay()), at) > ZERO:
            silent = int(0)
    return silent


@wp.func
def shape_of(c: Contours, pose: int):
    """How many polylines a pose has and which are closed, as one number; beyond 62 of them all but surely."""
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
def enter_track(
    plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, shape: wp.int64, place: FocusPlace, before: int
):
    """Where drawing goes on along the contours of a new pose of a shape; before: the pose drawn before in the span."""
    entry = PoseEntry()
    entry.drawn = 1
    entry.silent = place.silent
    entry.first = 1 - place.drawn
    entry.before = before
    if place.drawn == 0 or (plan.restarts == 1 and shape != place.shape):
        return entry
    entry.found = 1
    entry.anchor = entered(plan, nodes, track, place)
    entry.index = wp.int64(1 - place.silent)
    return entry


@wp.func
def place_at(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """Where the focal point is at a knot of a track."""
    place = FocusPlace()
    way = find_way(nodes, track, knot, TrackWay())
    place.point = point_on(nodes, way, knot)
    place.direction = direction_on(nodes, track, way)
    place.rested = -ONE
    if track.sections > 0:
        begin = nodes.section[track.section + way.section].begin
        place.middle = middle_of(nodes, track, way.section)
        place.through = (knot - begin) / (section_end(nodes, track, way.section) - begin)
        return place
    return place_by_pauses(plan, nodes, track, place, knot)


@wp.kernel
def _enter_poses(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    tracks: wp.array[PoseTrack],  # shape [pose]
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
        if tracks[pose].count > 0:
            track = tracks[pose]
            shape = wp.int64(0)
            if plan.restarts == 1:
                shape = shape_of(c, pose)
            if goes_on(c, schedule, state, pose, track.pieces):
                entry.drawn = 1
                entry.again = 1
                entry.found = 1
                entry.silent = place.silent
                entry.anchor = anchor
                entry.index = index
            else:
                entry = enter_track(plan, nodes, track, shape, place, before)
            anchor = entry.anchor
            index = entry.index + wp.int64(schedule.count[pose])
            last = cycle_knot(plan, track, anchor, index - wp.int64(1))
            place = place_at(plan, nodes, track, last)
            place.drawn = 1
            place.shape = shape
            sample = schedule.count[pose] - 1
            place.silent = is_silent_at(plan, schedule, nodes, track, pose, sample, last, hold)
            before = pose + 0
        elif schedule.count[pose] > 0:
            place.silent = 1
        entries[pose] = entry
        pose += 1
    state.motion[motion].place = place
    state.motion[motion].anchor = anchor
    state.motion[motion].index = index
