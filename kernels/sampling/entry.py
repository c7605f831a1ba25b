"""Motions gone through pose by pose: drawing goes on along each pose's track where the focal point is.

As `Sampler` and `entered` in render/sampling; continuity "finish" is in finishing.py.
"""

import warp as wp

from ..contours import Contours
from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import (
    DrawnTracks,
    PoseEntry,
    PoseSchedule,
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
    ways_of,
)
from .layout import (
    HALF,
    INFINITE,
    ONE,
    TINY,
    ZERO,
    FocusPlace,
    PoseTrack,
    SamplingPlan,
    TrackNodes,
    distance,
    product,
    squared,
)
from .pauses import entered_by_pauses, place_by_pauses
from .tracks import lay_tracks

wp.set_module_options(EXACT)

NEAR_STEPS = wp.constant(wp.float64(3.0))  # ordinary steps, as in render/sampling/track.py
AGAINST = wp.constant(wp.float64(1e-9))  # share of a way by which it runs against a direction
WHOLE_SECTION = wp.constant(wp.float64(1e-3))  # [m], as in render/sampling/continuity.py


@wp.func
def approach(nodes: TrackNodes, way: TrackWay, point: wp.vec3d):
    """How near a way comes to a point [m], infinite for jumps, and where, 0..1."""
    a = nodes.point[way.a]
    step = step_of(nodes, way)
    square = squared(step)
    if way.end <= way.begin or square == ZERO:
        return INFINITE, ZERO
    off = point - a
    part = product(off, step) / wp.max(square, TINY)
    part = wp.min(wp.max(part, ZERO), ONE)
    return wp.sqrt(squared(off - part * step)), part


@wp.func
def is_against(nodes: TrackNodes, way: TrackWay, direction: wp.vec3d):
    """Whether a way runs against a direction."""
    step = step_of(nodes, way)
    return wp.dot(step, direction) < -AGAINST * wp.sqrt(squared(step))


@wp.struct
class NearestKnot:
    """The place on a track that costs least to go on at."""

    cost: wp.float64  # [m]
    knot: wp.float64


@wp.func
def nearer(best: NearestKnot, way: TrackWay, cost: wp.float64, part: wp.float64):
    """The best place, or another, 0..1 of a way, that costs less [m]."""
    out = best
    if cost < best.cost:
        out.cost = cost
        out.knot = way.begin + part * (way.end - way.begin)
    return out


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
    return entered_by_pauses(plan, nodes, track, place, near.knot, near.cost)


@wp.func
def middle_of(nodes: TrackNodes, track: PoseTrack, section: int):
    """Middle between the ends of a section [m]."""
    own = nodes.section[track.section + wp.int64(section)]
    return HALF * (nodes.point[track.first + wp.int64(own.start)] + nodes.point[track.first + wp.int64(own.stop)])


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
    own = nodes.section[track.section + wp.int64(nearest)]
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
    return near.knot


@wp.func
def direction_on(nodes: TrackNodes, track: PoseTrack, way: TrackWay):
    """Direction in which a focal point moves on a way, or on the one before if it rests there; zero if on both."""
    step = step_of(nodes, way)
    if track.sections == 0 and way.number > 0 and squared(step) == ZERO:
        step = nodes.point[way.a] - nodes.point[way.a - wp.int64(1)]
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
    sample: wp.int64,
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
def differ(c: Contours, a: wp.int64, b: wp.int64):
    """Whether two poses differ in their number of polylines, or in which of them are closed."""
    count = c.pose_start[a + wp.int64(1)] - c.pose_start[a]
    if count != c.pose_start[b + wp.int64(1)] - c.pose_start[b]:
        return True
    found = int(0)
    i = wp.int64(0)
    while i < count:
        if c.polyline_closed[c.pose_start[a] + i] != c.polyline_closed[c.pose_start[b] + i]:
            found = int(1)
        i += wp.int64(1)
    return found == 1


@wp.func
def enter_track(c: Contours, plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, pose: int, place: FocusPlace):
    """Where drawing goes on along the contours of a new pose."""
    entry = PoseEntry()
    entry.drawn = 1
    entry.silent = place.silent
    entry.before = place.pose
    entry.earlier = place.pose
    if place.pose < wp.int64(0):
        return entry
    if plan.restarts == 1:
        if differ(c, place.pose, wp.int64(pose)):
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
        begin = nodes.section[track.section + wp.int64(way.section)].begin
        place.middle = middle_of(nodes, track, way.section)
        place.through = (knot - begin) / (section_end(nodes, track, way.section) - begin)
        return place
    return place_by_pauses(plan, nodes, track, place, knot)


@wp.func
def place_after(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    track: PoseTrack,
    entry: PoseEntry,
    pose: int,
    hold: wp.float64,
):
    """Where the focal point is after a pose's samples."""
    sample = schedule.count[pose] - wp.int64(1)
    last = cycle_knot(plan, track, entry.anchor, entry.index + sample)
    place = place_at(plan, nodes, track, last)
    place.pose = wp.int64(pose)
    place.silent = is_silent_at(plan, schedule, nodes, track, pose, sample, last, hold)
    return place


@wp.kernel
def _enter_poses(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    tracks: wp.array[PoseTrack],  # shape [pose]
    # Out:
    entries: wp.array[PoseEntry],  # shape [pose], zero-initialised
):
    """Go through the poses of a motion in turn."""
    motion = wp.tid()
    hold = schedule.hold[motion]
    place = FocusPlace()
    place.pose = wp.int64(-1)
    place.silent = 1
    place.rested = -ONE
    pose = int(schedule.motion_start[motion])
    while pose < int(schedule.motion_start[motion + 1]):
        entries[pose].before = place.pose
        entries[pose].earlier = place.pose
        if tracks[pose].count > 0:
            track = tracks[pose]
            entry = enter_track(c, plan, nodes, track, pose, place)
            entries[pose] = entry
            place = place_after(plan, schedule, nodes, track, entry, pose, hold)
        elif schedule.count[pose] > wp.int64(0):
            place.silent = 1
        pose += 1


def enter_poses(contours: Contours, plan: SamplingPlan, schedule: PoseSchedule, pose: wp.array) -> DrawnTracks:
    """Tracks of all poses, and where drawing goes on along each; one thread a motion.

    pose: hand frame -> array frame, transformd, shape [pose].
    """
    device = pose.device
    drawn = DrawnTracks()
    drawn.nodes, drawn.tracks, drawn.routes = lay_tracks(contours, plan, schedule)
    drawn.pose, drawn.line = pose, contours.pose_start
    drawn.entries = wp.zeros(pose.shape[0], dtype=PoseEntry, device=device)
    wp.launch(
        _enter_poses,
        schedule.motion_start.shape[0] - 1,
        inputs=[contours, plan, schedule, drawn.nodes, drawn.tracks],
        outputs=[drawn.entries],
        device=device,
        block_dim=BLOCK,
    )
    return drawn
