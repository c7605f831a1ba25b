"""Tracks of all poses, laid at once where they do not depend on each other.

The route through several polylines keeps the order of the pose before, if that has several, too. So poses form runs: a
run begins at a pose of several polylines behind one that has at most one, and ends at the next pose that has one. One
thread lays the tracks of a run in turn. Any other pose has one polyline and a thread of its own.
"""

from typing import NamedTuple

import warp as wp

from ..contours import Contours
from ..offsets import BLOCK
from ..patch import EXACT
from .course import is_plain, lay_course
from .cursor import PoseSchedule
from .doors import DOORS
from .layout import DrawnPiece, DrawnSection, PoseTrack, RouteRows, SamplingPlan, TrackNodes
from .pieces import collect_pieces, mark_pieces, match_pieces
from .route import append_all, lay_route
from .search import ROOM, SUMS

wp.set_module_options(EXACT)

RUNS_MOST = 16_384  # that are laid at once: the room of a run's searches takes 15 KB


@wp.struct
class PosePieces:
    """The pieces of poses: polylines of non-zero length."""

    count: wp.array[wp.int32]  # 0: the pose has none, or no sample
    length: wp.array[wp.float64]  # of all [m]


@wp.kernel
def _collect_pieces(
    # In:
    c: Contours,
    schedule: PoseSchedule,
    # Out:
    rows: RouteRows,
    pieces: PosePieces,
):
    """Collect the pieces of a pose."""
    pose = wp.tid()
    count = int(0)
    if schedule.count[pose] > wp.int64(0):
        found, length = collect_pieces(c, rows, pose)
        pieces.length[pose] = length
        count = found
    pieces.count[pose] = count


@wp.func
def pieces_before(schedule: PoseSchedule, pieces: PosePieces, pose: int):
    """How many pieces the pose has that is drawn before one in its motion; 0 if it is the first."""
    motion = wp.lower_bound(schedule.motion_start, wp.int64(pose + 1)) - 1
    before = pose - 1
    count = int(0)
    while before >= int(schedule.motion_start[motion]) and count == 0:
        count = pieces.count[before]
        before -= 1
    return count


@wp.kernel
def _lay_single(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    pieces: PosePieces,
    # Out:
    rows: RouteRows,
    nodes: TrackNodes,
    tracks: wp.array[PoseTrack],  # shape [pose], zero-initialised
    begin: wp.array[wp.int32],  # first pose of each run, in any order
    runs: wp.array[wp.int32],  # how many there are, shape [1], zero-initialised
):
    """Lay the track of a pose of one piece, or note that a run begins with it."""
    pose = wp.tid()
    count = pieces.count[pose]
    if count == 0:
        return
    if pieces_before(schedule, pieces, pose) > 1:
        return
    if count > 1:
        begin[wp.atomic_add(runs, 0, 1)] = pose
        return
    append_all(rows, c.pose_start[pose], count)
    length = pieces.length[pose]
    plain = is_plain(c, plan, rows, pose, count, length)
    tracks[pose] = lay_course(c, plan, rows, nodes, pose, count, plain, length / plan.speed)


@wp.func
def lay_track(
    c: Contours,
    plan: SamplingPlan,
    pieces: PosePieces,
    rows: RouteRows,
    nodes: TrackNodes,
    run: int,
    pose: int,
    before: int,
    earlier: PoseTrack,
):
    """The track of a pose of a run; before, earlier: the pose drawn before in the run, if any, and its track."""
    first = c.pose_start[pose]
    count = pieces.count[pose]
    length = pieces.length[pose]
    plain = is_plain(c, plan, rows, pose, count, length)
    row = c.pose_start[before]
    known = match_pieces(c, plan, rows, first, count, row, earlier.pieces)
    least = lay_route(c, plan, rows, run, first, count, known, plain, row, earlier)
    if earlier.pieces < 2 and count > 1:  # they were not marked as the batch has them
        mark_pieces(c, plan, rows.drawn, first, count)
    track = lay_course(c, plan, rows, nodes, pose, count, plain, length / plan.speed)
    track.least = least
    return track


@wp.kernel
def _lay_run(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    pieces: PosePieces,
    begin: wp.array[wp.int32],  # first pose of each run
    # Out:
    rows: RouteRows,
    nodes: TrackNodes,
    tracks: wp.array[PoseTrack],  # shape [pose]
):
    """Lay the tracks of a run of poses in turn."""
    run = wp.tid()
    pose = begin[run]
    motion = wp.lower_bound(schedule.motion_start, wp.int64(pose + 1)) - 1
    stop = int(schedule.motion_start[motion + 1])
    before = int(pose)
    earlier = PoseTrack()
    while pose < stop:
        if pieces.count[pose] > 0:
            earlier = lay_track(c, plan, pieces, rows, nodes, run, pose, before, earlier)
            tracks[pose] = earlier
            before = pose
            if earlier.pieces == 1:
                stop = pose
        pose += 1


def room_for(contours: Contours, plan: SamplingPlan) -> tuple[RouteRows, TrackNodes]:
    """Memory for the routes and tracks of all poses, on the contours' device."""
    device = contours.points.device
    points, lines = contours.points.shape[0], contours.polyline_closed.shape[0]
    poses = contours.pose_start.shape[0] - 1
    rows, nodes = RouteRows(), TrackNodes()
    rows.given = wp.empty(lines, dtype=DrawnPiece, device=device)
    rows.drawn = wp.empty(lines, dtype=DrawnPiece, device=device)
    rows.candidate = wp.empty(lines, dtype=DrawnPiece, device=device)
    rows.span = wp.empty(lines, dtype=wp.float64, device=device)
    count = plan.passes * (points + 2 * lines) + poses * max(plan.sections, 1)
    nodes.knot = wp.empty(count, dtype=wp.float64, device=device)
    nodes.point = wp.empty(count, dtype=wp.vec3d, device=device)
    nodes.piece = wp.empty(count, dtype=wp.int32, device=device)
    nodes.intensity = wp.empty(count if contours.intensity.shape[0] > 0 else 0, dtype=wp.float64, device=device)
    pauses = contours.dwell.shape[0] > 0 or plan.dwell_time > 0 or plan.dwell_ratio > 0
    nodes.pause = wp.empty(count if pauses else 0, dtype=wp.float64, device=device)
    nodes.corner = wp.empty(count if pauses else 0, dtype=wp.uint8, device=device)
    nodes.section = wp.empty(poses * plan.sections, dtype=DrawnSection, device=device)
    nodes.stretch = wp.empty(lines if plan.sections > 0 else 0, dtype=wp.float64, device=device)
    return rows, nodes


def make_search_room(rows: RouteRows, runs: int) -> None:
    """Memory for the searches of so many runs."""
    device = rows.given.device
    rows.room = wp.empty(runs * ROOM, dtype=wp.int32, device=device)
    rows.sums = wp.empty(runs * SUMS, dtype=wp.float64, device=device)
    rows.door = wp.empty((runs, DOORS), dtype=wp.vec3d, device=device)


class SingleTracks(NamedTuple):
    """Tracks of poses of one piece, and what those of the others are laid with."""

    rows: RouteRows
    nodes: TrackNodes
    pieces: PosePieces
    tracks: wp.array  # PoseTrack, shape [pose]; of no node where none is laid
    begin: wp.array  # first pose of each run, in any order
    runs: wp.array  # how many there are, shape [1]


def lay_single_tracks(contours: Contours, plan: SamplingPlan, schedule: PoseSchedule) -> SingleTracks:
    """Lay the tracks of poses of one piece behind one that has at most one. Each polyline must have vertices."""
    device, poses = contours.points.device, contours.pose_start.shape[0] - 1
    rows, nodes = room_for(contours, plan)
    pieces = PosePieces()
    pieces.count = wp.empty(poses, dtype=wp.int32, device=device)
    pieces.length = wp.empty(poses, dtype=wp.float64, device=device)
    tracks = wp.zeros(poses, dtype=PoseTrack, device=device)
    begin = wp.empty(poses, dtype=wp.int32, device=device)
    runs = wp.zeros(1, dtype=wp.int32, device=device)
    make_search_room(rows, 0)
    inputs, outputs = [contours, schedule], [rows, pieces]
    wp.launch(_collect_pieces, poses, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    inputs, outputs = [contours, plan, schedule, pieces], [rows, nodes, tracks, begin, runs]
    wp.launch(_lay_single, poses, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    return SingleTracks(rows, nodes, pieces, tracks, begin, runs)


def lay_tracks(contours: Contours, plan: SamplingPlan, schedule: PoseSchedule) -> tuple[TrackNodes, wp.array, wp.array]:
    """Nodes of the tracks of all poses, the tracks, PoseTrack, and the pieces as they are drawn, DrawnPiece.

    Each polyline must have vertices.
    """
    rows, nodes, pieces, tracks, begin, count = lay_single_tracks(contours, plan, schedule)
    runs = int(count.numpy()[0])
    make_search_room(rows, min(runs, RUNS_MOST))
    for first in range(0, runs, RUNS_MOST):
        part = begin[first : min(first + RUNS_MOST, runs)]
        inputs, outputs = [contours, plan, schedule, pieces, part], [rows, nodes, tracks]
        wp.launch(_lay_run, part.shape[0], inputs=inputs, outputs=outputs, device=tracks.device, block_dim=BLOCK)
    return nodes, tracks, rows.drawn
