"""Motions gone through pose by pose, where a polyline under way is finished before other contours are entered.

As `Sampler` in render/sampling with continuity "finish". Whether a pose's contours are entered at all depends on what
is under way, and their route on those entered before. So one thread a motion lays the tracks of several polylines, too.
"""

import warp as wp

from ..contours import Contours
from ..offsets import BLOCK
from ..patch import SELDOM
from .cursor import (
    DrawnTracks,
    PoseEntry,
    PoseSchedule,
    TrackWay,
    cycle_knot,
    find_way,
    has_next,
    next_way,
    sample_index,
    step_of,
)
from .entry import differ, enter_track, is_silent_at, place_at
from .layout import (
    ONE,
    STILL,
    ZERO,
    FocusPlace,
    PoseTrack,
    RouteRows,
    SamplingPlan,
    TrackNodes,
    squared,
)
from .tracks import RUNS_MOST, PosePieces, lay_single_tracks, lay_track, make_search_room

wp.set_module_options(SELDOM)

BEHIND = wp.constant(wp.float64(1e-12))  # knots by which an end must lie behind a sample
ROUNDING = wp.constant(wp.float64(1e-9))  # share of a sample


@wp.struct
class UnderWay:
    """What is drawn in a motion."""

    own: wp.int64  # pose whose contours were entered last, -1: none
    before: wp.int64  # pose drawn last, -1: none
    goes_on: wp.int32  # 1: drawing is on the contours of `own`, and not between two poses
    left: wp.int64  # samples until these are finished; 0: they are not to be
    silent: wp.int32  # 1: the last sample was


@wp.func
def samples_to_end(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, last: wp.float64):
    """Samples from one at a knot until the polyline under way ends."""
    if plan.pace == STILL:
        return wp.int64(0)
    end = track.period
    way = find_way(nodes, track, last, TrackWay())
    left = int(1)
    while left == 1:
        left = wp.where(has_next(nodes, track, way), 1, 0)
        if way.end <= way.begin and way.end > last + BEHIND and squared(step_of(nodes, way)) > ZERO:
            end = way.end
            left = 0
        if left == 1:
            way = next_way(nodes, track, way)
    return wp.int64((end - last) / track.one_sample * (ONE - ROUNDING))


@wp.func
def knot_of(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    track: PoseTrack,
    entry: PoseEntry,
    own: wp.int64,
    pose: wp.int64,
    sample: wp.int64,
):
    """Knot of a pose's sample on a track; own, entry: the pose of the track, and how it was entered."""
    return cycle_knot(plan, track, entry.anchor, sample_index(schedule, entry, own, pose, sample))


@wp.func
def is_silent_on(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    track: PoseTrack,
    entry: PoseEntry,
    own: wp.int64,
    pose: int,
    sample: wp.int64,
):
    """Whether a pose's sample on a track is of intensity 0."""
    knot = knot_of(plan, schedule, track, entry, own, wp.int64(pose), sample)
    motion = wp.lower_bound(schedule.motion_start, wp.int64(pose + 1)) - 1
    return is_silent_at(plan, schedule, nodes, track, pose, sample, knot, schedule.hold[motion])


@wp.func
def left_of(
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    track: PoseTrack,
    entry: PoseEntry,
    now: UnderWay,
    pose: int,
):
    """Samples that are left of the polyline under way when a pose comes."""
    if now.left > wp.int64(0) or now.goes_on == 0 or now.silent == 1:
        return now.left
    if not differ(c, now.own, wp.int64(pose)):
        return now.left
    sample = schedule.count[now.before] - wp.int64(1)
    return samples_to_end(plan, nodes, track, knot_of(plan, schedule, track, entry, now.own, now.before, sample))


@wp.func
def place_before(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    nodes: TrackNodes,
    track: PoseTrack,
    entry: PoseEntry,
    now: UnderWay,
    pose: int,
    start: wp.int64,
):
    """Where the focal point is before a pose's sample `start`, which is the first on the pose's contours."""
    place = FocusPlace()
    silent = now.silent
    if now.own >= wp.int64(0):
        before = now.before
        sample = schedule.count[before] - wp.int64(1)
        if start > wp.int64(0):
            before = wp.int64(pose)
            sample = start - wp.int64(1)
            silent = is_silent_on(plan, schedule, nodes, track, entry, now.own, pose, sample)
        place = place_at(plan, nodes, track, knot_of(plan, schedule, track, entry, now.own, before, sample))
    place.pose = now.own
    place.silent = silent
    return place


@wp.kernel
def _finish_pieces(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    pieces: PosePieces,
    first: int,  # motion of the first thread
    # Out:
    rows: RouteRows,
    nodes: TrackNodes,
    tracks: wp.array[PoseTrack],  # shape [pose]; those of one piece are laid
    entries: wp.array[PoseEntry],  # shape [pose], zero-initialised
):
    """Go through the poses of a motion in turn."""
    run = wp.tid()
    now = UnderWay()
    now.own = wp.int64(-1)
    now.before = wp.int64(-1)
    now.silent = 1
    track = PoseTrack()  # of `now.own`
    entered = PoseEntry()  # and how it was entered
    pose = int(schedule.motion_start[first + run])
    while pose < int(schedule.motion_start[first + run + 1]):
        count = schedule.count[pose]
        entry = PoseEntry()
        if pieces.count[pose] > 0:
            left = left_of(c, plan, schedule, nodes, track, entered, now, pose)
            start = wp.min(left, count)
            now.left = left - start
            if start < count:
                place = place_before(plan, schedule, nodes, track, entered, now, pose, start)
                if tracks[pose].count == 0 or track.pieces > 1:
                    before = int(wp.where(now.own >= wp.int64(0), now.own, wp.int64(pose)))
                    tracks[pose] = lay_track(c, plan, pieces, rows, nodes, run, pose, before, track)
                track = tracks[pose]
                entry = enter_track(c, plan, nodes, track, pose, place)
            entry.start = start
            entry.drawn = 1
        entry.silent = now.silent
        entry.before = now.before
        entry.earlier = now.own
        entries[pose] = entry
        if entry.drawn == 1:
            now.before = wp.int64(pose)
            now.goes_on = wp.where(now.left > wp.int64(0), 1, 0)
            if entry.start < count:
                entered = entry
                now.own = now.before
                now.goes_on = 1
            now.silent = is_silent_on(plan, schedule, nodes, track, entered, now.own, pose, count - wp.int64(1))
        elif count > wp.int64(0):
            now.goes_on = 0
            now.left = wp.int64(0)
            now.silent = 1
        pose += 1


def finish_pieces(contours: Contours, plan: SamplingPlan, schedule: PoseSchedule, pose: wp.array) -> DrawnTracks:
    """Tracks of all poses whose contours are entered, and where drawing goes on along each; one thread a motion.

    pose: hand frame -> array frame, transformd, shape [pose].
    """
    device, motions = pose.device, schedule.motion_start.shape[0] - 1
    laid = lay_single_tracks(contours, plan, schedule)
    drawn = DrawnTracks()
    drawn.nodes, drawn.tracks, drawn.routes = laid.nodes, laid.tracks, laid.rows.drawn
    drawn.pose, drawn.line = pose, contours.pose_start
    drawn.entries = wp.zeros(pose.shape[0], dtype=PoseEntry, device=device)
    make_search_room(laid.rows, min(motions, RUNS_MOST))
    for first in range(0, motions, RUNS_MOST):
        count = min(motions - first, RUNS_MOST)
        inputs, outputs = [contours, plan, schedule, laid.pieces, first], [laid.rows, laid.nodes, laid.tracks]
        outputs.append(drawn.entries)
        wp.launch(_finish_pieces, count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    return drawn
