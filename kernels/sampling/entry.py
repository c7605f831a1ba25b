"""Motions gone through pose by pose: drawing goes on along each pose's track where the focal point is.

As `Sampler` and `entered` in render/sampling, without sections and continuity "finish".
"""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import (
    DrawnTracks,
    PoseEntry,
    PoseSchedule,
    age_of,
    cycle_knot,
    focus_knot,
    gain_of,
    level_on,
    point_on,
    shown_knot,
    way_at,
)
from .layout import (
    INFINITE,
    ONE,
    TINY,
    ZERO,
    FocusPlace,
    MotionContours,
    PoseTrack,
    SamplingPlan,
    TrackNodes,
    product,
    squared,
)
from .pauses import entered_by_pauses, place_by_pauses
from .tracks import lay_tracks

wp.set_module_options(EXACT)

NEAR_STEPS = wp.constant(wp.float64(3.0))  # ordinary steps, as in render/sampling/track.py
AGAINST = wp.constant(wp.float64(1e-9))  # share of a way by which it runs against a direction


@wp.func
def approach(nodes: TrackNodes, at: wp.int64, point: wp.vec3d):
    """How near the way from a node to the next comes to a point [m], infinite for jumps, and where, 0..1."""
    a = nodes.point[at]
    step = nodes.point[at + wp.int64(1)] - a
    square = squared(step)
    if nodes.knot[at + wp.int64(1)] <= nodes.knot[at] or square == ZERO:
        return INFINITE, ZERO
    off = point - a
    part = product(off, step) / wp.max(square, TINY)
    part = wp.min(wp.max(part, ZERO), ONE)
    return wp.sqrt(squared(off - part * step)), part


@wp.func
def is_against(nodes: TrackNodes, at: wp.int64, direction: wp.vec3d):
    """Whether the way from a node to the next runs against a direction."""
    step = nodes.point[at + wp.int64(1)] - nodes.point[at]
    return wp.dot(step, direction) < -AGAINST * wp.sqrt(squared(step))


@wp.struct
class NearestWay:
    """The way of a track that costs least to go on along."""

    cost: wp.float64  # [m]
    way: wp.int32
    part: wp.float64  # where on it, 0..1


@wp.func
def nearer(best: NearestWay, way: int, cost: wp.float64, part: wp.float64):
    """The best way, or another that costs less [m]."""
    out = best
    if cost < best.cost:
        out.cost = cost
        out.way = way
        out.part = part
    return out


@wp.func
def entered(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace):
    """Knot at which drawing goes on: the nearest place, in the same direction if that is not much farther.

    Where a way is near, no direction is a reason for one that is not, unless a pause could be left out or made twice.
    """
    near = NearestWay()
    near.cost = INFINITE
    far = near
    directed = squared(place.direction) > ZERO
    for i in range(track.count - 1):
        away, part = approach(nodes, track.first + wp.int64(i), place.point)
        cost = away
        if directed and away < INFINITE and is_against(nodes, track.first + wp.int64(i), place.direction):
            cost += plan.threshold
        if track.pauses > 0 or away <= NEAR_STEPS * track.ordinary:
            near = nearer(near, i, cost, part)
        else:
            far = nearer(far, i, cost, part)
    if near.cost == INFINITE:
        near = far
    knot = nodes.knot[track.first + wp.int64(near.way)]
    knot += near.part * (nodes.knot[track.first + wp.int64(near.way + 1)] - knot)
    return entered_by_pauses(plan, nodes, track, place, knot, near.cost)


@wp.func
def direction_at(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """Direction in which a focal point moves at a knot; zero where it rests."""
    way = wp.min(way_at(nodes.knot, track.first, track.count, knot), track.count - 2)
    at = track.first + wp.int64(way)
    step = nodes.point[at + wp.int64(1)] - nodes.point[at]
    if way > 0 and squared(step) == ZERO:
        step = nodes.point[at] - nodes.point[at - wp.int64(1)]
    length = wp.sqrt(squared(step))
    if length > ZERO:
        step = step / length
    return step


@wp.func
def is_silent_at_end(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    track: PoseTrack,
    pose: int,
    knot: wp.float64,
    hold: wp.float64,
):
    """Whether the last sample of a pose, at this knot of its track, is of intensity 0."""
    age, block_end = age_of(plan, schedule, pose, schedule.count[pose] - wp.int64(1))
    if gain_of(plan, age, block_end, hold) <= ZERO:
        return int(1)
    if nodes.intensity.shape[0] == 0:
        return int(0)
    silent = int(1)
    for focus in range(plan.foci):
        at = shown_knot(plan, schedule.shown, track, focus_knot(plan, track, knot, focus))
        if level_on(nodes, track, way_at(nodes.knot, track.first, track.count, at), at) > ZERO:
            silent = int(0)
    return silent


@wp.func
def differ(c: MotionContours, a: wp.int64, b: wp.int64):
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
def enter_track(
    c: MotionContours, plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, pose: int, place: FocusPlace
):
    """Where drawing goes on along the contours of a new pose."""
    entry = PoseEntry()
    entry.drawn = 1
    entry.silent = place.silent
    entry.before = place.pose
    entry.index = wp.int64(0)
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
    place = FocusPlace()
    last = cycle_knot(plan, track, entry.anchor, entry.index + schedule.count[pose] - wp.int64(1))
    place.pose = wp.int64(pose)
    place.point = point_on(nodes, track, way_at(nodes.knot, track.first, track.count, last), last)
    place.direction = direction_at(nodes, track, last)
    place.silent = is_silent_at_end(plan, schedule, nodes, track, pose, last, hold)
    place.rested = -ONE
    return place_by_pauses(plan, nodes, track, place, last)


@wp.kernel
def _enter_poses(
    # In:
    c: MotionContours,
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
        if tracks[pose].count > 0:
            track = tracks[pose]
            entry = enter_track(c, plan, nodes, track, pose, place)
            entries[pose] = entry
            place = place_after(plan, schedule, nodes, track, entry, pose, hold)
        elif schedule.count[pose] > wp.int64(0):
            place.silent = 1
        pose += 1


def enter_poses(contours: MotionContours, plan: SamplingPlan, schedule: PoseSchedule, pose: wp.array) -> DrawnTracks:
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
