"""Cycles of all poses, laid in parallel where they do not depend on each other.

The route through several polylines keeps the order of the pose before, if that has several, too. So poses form runs: a
run begins at a pose of several polylines behind one that has at most one, and ends at the next pose that has one. One
thread lays the cycles of a run in turn. Any other pose has one polyline and a thread of its own.
"""

import warp as wp

from ..contours import Contours
from ..patch import EXACT
from .layout import CycleNodes, PoseCycle, PoseSchedule, RouteRows, SamplerState, SamplingPlan
from .pieces import collect_pieces, goes_on, mark_ends, mark_pieces, match_pieces
from .route import lay_route
from .timing import is_plain, lay_cycle

wp.set_module_options(EXACT)


@wp.struct
class PosePieces:
    """The pieces of poses: polylines of non-zero length."""

    count: wp.array[wp.int32]  # 0: the pose has none, or no sample
    length: wp.array[wp.float64]  # of all [m]


@wp.func
def pieces_before(schedule: PoseSchedule, pieces: PosePieces, pose: int):
    """Number of pieces of the pose drawn before one in its motion, within this span; -1: there is none."""
    begin = int(schedule.motion_start[schedule.motion[pose]])
    before = pose - 1
    while before >= begin:
        if pieces.count[before] > 0:
            return pieces.count[before]
        before -= 1
    return int(-1)


@wp.func
def row_of_state(rows: RouteRows, state: SamplerState, motion: int):
    """Row of the first piece of a motion's state: they stand behind those of the span."""
    begin = rows.drawn.shape[0] - state.motion.shape[0] * state.room
    return begin + motion * state.room


@wp.kernel
def _collect_pieces(
    # In:
    c: Contours,
    schedule: PoseSchedule,
    state: SamplerState,
    # Out:
    rows: RouteRows,
    pieces: PosePieces,
    runs: wp.array[wp.int32],  # zeroed
):
    """Collect the pieces of a pose; before the first of a motion, those of its state."""
    pose = wp.tid()
    if pose == 0:
        runs[0] = 0
    motion = schedule.motion[pose]
    if pose == schedule.motion_start[motion]:
        begin = row_of_state(rows, state, motion)
        for k in range(wp.min(state.motion[motion].pieces, state.room)):
            rows.drawn[begin + k] = state.piece[motion * state.room + k]
    count = int(0)
    if schedule.count[pose] > 0:
        found, length = collect_pieces(c, rows, pose)
        pieces.length[pose] = length
        count = found
    pieces.count[pose] = count


@wp.kernel
def _list_poses(
    # In:
    schedule: PoseSchedule,
    pieces: PosePieces,
    state: SamplerState,
    # Out:
    cycles: wp.array[PoseCycle],  # shape [pose]
    single: wp.array[wp.int32],  # 1: the pose has one piece, and its cycle depends on no other, shape [pose]
    begin: wp.array[wp.int32],  # first pose of each run, in any order
    runs: wp.array[wp.int32],  # how many there are, shape [1], zero before
):
    """Find out whether the cycle of a pose can be laid alone, or a run begins with it."""
    pose = wp.tid()
    cycles[pose] = PoseCycle()
    single[pose] = 0
    count = pieces.count[pose]
    before = pieces_before(schedule, pieces, pose)
    carried = int(0)
    if before < 0:
        carried = state.motion[schedule.motion[pose]].pieces
    if count > 0 and before <= 1:
        if count > 1 or carried > 1:
            begin[wp.atomic_add(runs, 0, 1)] = pose
        else:
            single[pose] = 1


@wp.func
def restore_pieces(c: Contours, rows: RouteRows, state: SamplerState, motion: int, pose: int, count: int):
    """Draw the pieces of a pose as in the span before; each is, to the next span, that of this pose."""
    begin = row_of_state(rows, state, motion)
    for k in range(count):
        piece = rows.drawn[begin + k]
        piece.line += int(c.pose_start[pose])
        piece.earlier = k
        rows.drawn[int(c.pose_start[pose]) + k] = piece


@wp.func
def draw_pieces(
    c: Contours,
    plan: SamplingPlan,
    pieces: PosePieces,
    rows: RouteRows,
    run: int,
    pose: int,
    plain: bool,
    before: int,
    earlier: PoseCycle,
):
    """Draw the pieces of a pose that does not go on; returns the least jumps known [m].

    before, earlier: row of the first piece drawn before in the run, and its cycle.
    """
    first = int(c.pose_start[pose])
    count = pieces.count[pose]
    known = match_pieces(c, plan, rows, first, count, before, earlier.pieces)
    least = lay_route(c, plan, rows, run, first, count, known, plain, before, earlier)
    if earlier.pieces < 2 and count > 1:  # they were not marked as the batch has them
        mark_pieces(c, plan, rows.drawn, first, count)
    if earlier.pieces > 1 or count > 1:
        mark_ends(c, plan, rows.drawn, first, count)
    return least


@wp.kernel
def _lay_cycles(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    pieces: PosePieces,
    state: SamplerState,
    single: wp.array[wp.int32],  # see `_list_poses`
    begin: wp.array[wp.int32],
    first: int,  # run of the first thread; -1: each thread has a pose
    # Out:
    rows: RouteRows,
    nodes: CycleNodes,
    cycles: wp.array[PoseCycle],  # shape [pose]
):
    """Lay the cycle of a pose that depends on no other, or the cycles of a run of poses in turn."""
    run = wp.tid()
    pose = run
    if first < 0:
        if single[pose] == 0:
            return
    else:
        pose = begin[first + run]
    motion = schedule.motion[pose]
    stop = int(schedule.motion_start[motion + 1])
    earlier = PoseCycle()
    before = int(c.pose_start[pose])
    if pieces_before(schedule, pieces, pose) < 0:
        before = row_of_state(rows, state, motion)
        earlier.pieces = state.motion[motion].pieces
        earlier.least = state.motion[motion].least
    while pose < stop:
        count = pieces.count[pose]
        if count > 0:
            length = pieces.length[pose]
            plain = is_plain(c, plan, rows, pose, count, length)
            least = earlier.least
            if goes_on(c, schedule, state, pose, count):
                restore_pieces(c, rows, state, motion, pose, count)
            else:
                least = draw_pieces(c, plan, pieces, rows, run, pose, plain, before, earlier)
            earlier = lay_cycle(c, plan, rows, nodes, pose, count, plain, length / plan.speed)
            earlier.least = least
            cycles[pose] = earlier
            before = int(c.pose_start[pose])
            if count == 1:
                stop = pose
        pose += 1
