"""Motions gone through pose by pose: each pose's track is laid, and drawing goes on along it where the focal point is.

As `Sampler` and `entered` in render/sampling, without pauses, sections and continuity "finish".
"""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .course import is_plain, lay_course, longest_step
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
from .doors import DOORS
from .layout import (
    INFINITE,
    ONE,
    TINY,
    ZERO,
    DrawnPiece,
    MotionContours,
    PoseTrack,
    RouteRows,
    SamplingPlan,
    TrackNodes,
    product,
    squared,
)
from .pieces import collect_pieces, mark_pieces, match_pieces
from .route import lay_route
from .search import ROOM, SUMS

wp.set_module_options(EXACT)

NEAR_STEPS = wp.constant(wp.float64(3.0))  # ordinary steps, as in render/sampling/track.py
AGAINST = wp.constant(wp.float64(1e-9))  # share of a way by which it runs against a direction


@wp.struct
class FocusPlace:
    """Where the focal point is, such that it can be found on another track."""

    pose: wp.int64  # drawn last, -1: none
    point: wp.vec3d  # [m]
    direction: wp.vec3d  # of its motion; zero: none is known
    silent: wp.int32  # 1: the last sample was


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


@wp.func
def entered(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace, ordinary: wp.float64):
    """Knot at which drawing goes on: the nearest place, in the same direction if that is not much farther."""
    least = INFINITE
    for i in range(track.count - 1):
        cost, part = approach(nodes, track.first + wp.int64(i), place.point)
        least = wp.min(least, cost)
    near = NEAR_STEPS * ordinary
    directed = squared(place.direction) > ZERO
    best = int(0)
    best_part = ZERO
    lowest = INFINITE
    for i in range(track.count - 1):
        cost, part = approach(nodes, track.first + wp.int64(i), place.point)
        if directed and cost < INFINITE:
            if is_against(nodes, track.first + wp.int64(i), place.direction) or (least <= near and cost > near):
                cost += plan.threshold
        if cost < lowest:
            lowest = cost
            best = i
            best_part = part
    knot = nodes.knot[track.first + wp.int64(best)]
    return knot + best_part * (nodes.knot[track.first + wp.int64(best + 1)] - knot)


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
    entry.ordinary = longest_step(plan, nodes, track)
    entry.index = wp.int64(0)
    if place.pose < wp.int64(0):
        return entry
    if plan.restarts == 1:
        if differ(c, place.pose, wp.int64(pose)):
            return entry
    entry.found = 1
    entry.anchor = entered(plan, nodes, track, place, entry.ordinary)
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
    return place


@wp.func
def lay_track(
    c: MotionContours,
    plan: SamplingPlan,
    rows: RouteRows,
    nodes: TrackNodes,
    motion: int,
    pose: int,
    before: wp.int64,
    earlier: PoseTrack,
):
    """The track of a pose; of no nodes where there is nothing to draw, of -1 where it cannot be laid here.

    before, earlier: the pose drawn before and its track, -1 where there is none.
    """
    track = PoseTrack()
    first = c.pose_start[pose]
    count, length, good = collect_pieces(c, rows, pose)
    if good == 0:
        track.count = -1
    if good == 0 or count == 0:
        return track
    plain = is_plain(c, plan, rows, pose, count, length)
    row = wp.int64(0)
    pieces = int(0)
    if before >= wp.int64(0):
        row = c.pose_start[before]
        pieces = earlier.pieces
    known = match_pieces(c, plan, rows, first, count, row, pieces)
    least = lay_route(c, plan, rows, motion, first, count, known, plain, row, earlier)
    if pieces < 2 and count > 1:  # they were not marked as the batch has them
        mark_pieces(c, plan, rows.drawn, first, count)
    track = lay_course(c, plan, rows, nodes, pose, count, plain, length / plan.speed)
    track.least = least
    return track


@wp.func
def clear_entries(schedule: PoseSchedule, motion: int, entries: wp.array[PoseEntry]):
    """Let no pose of a motion be drawn."""
    nothing = PoseEntry()
    nothing.before = wp.int64(-1)
    pose = schedule.motion_start[motion]
    while pose < schedule.motion_start[motion + 1]:
        entries[pose] = nothing
        pose += wp.int64(1)


@wp.kernel
def _enter_poses(
    # In:
    c: MotionContours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    # Out:
    rows: RouteRows,
    nodes: TrackNodes,
    tracks: wp.array[PoseTrack],  # shape [pose]
    entries: wp.array[PoseEntry],  # shape [pose], zero-initialised
    left: wp.array[wp.int32],  # shape [motion]; 1: the motion cannot be drawn here
):
    """Go through the poses of a motion in turn."""
    motion = wp.tid()
    hold = schedule.hold[motion]
    place = FocusPlace()
    place.pose = wp.int64(-1)
    place.silent = 1
    pose = int(schedule.motion_start[motion])
    stop = int(schedule.motion_start[motion + 1])
    while pose < stop:
        entries[pose].before = place.pose
        if schedule.count[pose] > wp.int64(0):
            earlier = PoseTrack()
            if place.pose >= wp.int64(0):
                earlier = tracks[place.pose]
            track = lay_track(c, plan, rows, nodes, motion, pose, place.pose, earlier)
            if track.count < 0:
                left[motion] = 1
                clear_entries(schedule, motion, entries)
                stop = pose
            elif track.count == 0:
                place.silent = 1
            else:
                entry = enter_track(c, plan, nodes, track, pose, place)
                tracks[pose] = track
                entries[pose] = entry
                place = place_after(plan, schedule, nodes, track, entry, pose, hold)
        pose += 1


def room_for(contours: MotionContours, plan: SamplingPlan, motion_count: int) -> tuple[RouteRows, TrackNodes]:
    """Memory for the routes and tracks of all poses, on the contours' device."""
    device = contours.points.device
    points, lines = contours.points.shape[0], contours.polyline_closed.shape[0]
    poses = contours.pose_start.shape[0] - 1
    rows, nodes = RouteRows(), TrackNodes()
    rows.given = wp.empty(lines, dtype=DrawnPiece, device=device)
    rows.drawn = wp.empty(lines, dtype=DrawnPiece, device=device)
    rows.candidate = wp.empty(lines, dtype=DrawnPiece, device=device)
    rows.room = wp.empty(motion_count * ROOM, dtype=wp.int32, device=device)
    rows.sums = wp.empty(motion_count * SUMS, dtype=wp.float64, device=device)
    rows.span = wp.empty(lines, dtype=wp.float64, device=device)
    rows.door = wp.empty((motion_count, DOORS), dtype=wp.vec3d, device=device)
    count = plan.passes * (points + 2 * lines) + poses
    nodes.knot = wp.empty(count, dtype=wp.float64, device=device)
    nodes.point = wp.empty(count, dtype=wp.vec3d, device=device)
    nodes.piece = wp.empty(count, dtype=wp.int32, device=device)
    nodes.intensity = wp.empty(count if contours.intensity.shape[0] > 0 else 0, dtype=wp.float64, device=device)
    return rows, nodes


def enter_poses(
    contours: MotionContours, plan: SamplingPlan, schedule: PoseSchedule, pose: wp.array
) -> tuple[DrawnTracks, wp.array]:
    """Tracks of all poses, and where drawing goes on along each; one thread a motion.

    pose: hand frame -> array frame, transformd, shape [pose]. Also returns of each motion whether it is left to the
    host, 1 or 0: for a polyline without vertices. Then none of its poses is drawn.
    """
    device, motion_count = pose.device, schedule.motion_start.shape[0] - 1
    rows, nodes = room_for(contours, plan, motion_count)
    drawn = DrawnTracks()
    drawn.nodes, drawn.routes, drawn.pose = nodes, rows.drawn, pose
    drawn.line = contours.pose_start
    drawn.tracks = wp.zeros(pose.shape[0], dtype=PoseTrack, device=device)
    drawn.entries = wp.zeros(pose.shape[0], dtype=PoseEntry, device=device)
    left = wp.zeros(motion_count, dtype=wp.int32, device=device)
    wp.launch(
        _enter_poses,
        motion_count,
        inputs=[contours, plan, schedule],
        outputs=[rows, nodes, drawn.tracks, drawn.entries, left],
        device=device,
        block_dim=BLOCK,
    )
    return drawn, left
