"""Counts of motions: those of their poses, added in turn; and what the next span of each motion goes on from."""

import warp as wp

from ..contours import Contours
from ..patch import EXACT
from .focus import PiecePassages, PoseEnds
from .layout import (
    STILL,
    ZERO,
    DrawnCycles,
    PoseCycle,
    PoseSchedule,
    SamplerState,
    SamplingPlan,
    StepCount,
)
from .pieces import sizes_of

wp.set_module_options(EXACT)


@wp.func
def cycles_within(plan: SamplingPlan, cycle: PoseCycle, samples: wp.int64):
    """Number of cycles that samples complete; 0 of a focal point that stands still."""
    if plan.pace == STILL:
        return ZERO
    return wp.float64(wp.int64(cycle.turns) * samples) / wp.float64(cycle.repeat)


@wp.func
def add_counts(a: StepCount, b: StepCount):
    """The sum of two counts, and the longest of both."""
    out = a
    out.silent += b.silent
    out.held += b.held
    out.jumps += b.jumps
    out.jump_lengths += b.jump_lengths
    out.hops += b.hops
    out.hops_longest = wp.max(a.hops_longest, b.hops_longest)
    out.step_longest = wp.max(a.step_longest, b.step_longest)
    return out


@wp.func
def wait_for_pieces(
    d: DrawnCycles,
    state: SamplerState,
    passages: PiecePassages,
    waits: wp.array[wp.int64],
    motion: int,
    pose: int,
    clock: wp.int64,
    lost: bool,
    felt: int,
):
    """Most samples that a piece of a pose waits to be drawn; lost: no piece is known any more.

    clock: samples before the pose. felt: of those on it, see `StepCount`.

    Writes into `waits` the sample, of all, in which each piece was drawn last or before which it appeared.
    """
    most = wp.int64(1)
    before = d.entries[pose].before
    for k in range(d.cycles[pose].pieces):
        row = d.cycles[pose].line + k
        since = clock - wp.int64(1)
        earlier = d.routes[row].earlier
        if earlier >= 0 and not lost:
            if before >= 0:
                since = waits[d.cycles[before].line + earlier]
            else:
                since = state.seen[motion * state.room + earlier]
        if passages.first[row] >= 0:
            most = wp.max(most, clock + wp.int64(passages.first[row]) - since)
            since = clock + wp.int64(passages.last[row])
        if felt > 0:
            most = wp.max(most, clock + wp.int64(felt) - since)
        waits[row] = since
    return most


@wp.kernel
def _sum_counts(
    # In:
    c: Contours,
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnCycles,
    ends: PoseEnds,
    counts: wp.array[StepCount],  # shape [pose]
    passages: PiecePassages,
    # Out:
    waits: wp.array[wp.int64],  # by the pieces' rows
    state: SamplerState,
):
    """Add the counts of a motion's poses to its state, and keep what the next span goes on from."""
    motion = wp.tid()
    out = state.motion[motion]
    lost = out.lost == 1
    own = int(-1)  # pose drawn last
    pose = schedule.motion_start[motion]
    while pose < schedule.motion_start[motion + 1]:
        samples = wp.int64(schedule.count[pose])
        out.steps = add_counts(out.steps, counts[pose])
        if d.entries[pose].drawn == 1:
            if d.entries[pose].again == 0:
                out.cycles_before = out.cycles
                out.on_cycle = wp.int64(0)
            out.drawn += samples
            out.on_cycle += samples
            out.cycles = out.cycles_before + cycles_within(plan, d.cycles[pose], out.on_cycle)
            waited = wait_for_pieces(d, state, passages, waits, motion, pose, out.samples, lost, counts[pose].felt)
            out.absence = wp.max(out.absence, wp.max(counts[pose].absence, waited))
            lost = counts[pose].lost == 1
            own = pose
        elif samples > wp.int64(0):
            lost = bool(True)
        out.samples += samples
        pose += 1
    out.lost = wp.where(lost, 1, 0)
    if own >= 0:
        cycle = d.cycles[own]
        out.pieces = wp.min(cycle.pieces, state.room)  # those that the state has room for: none if no span follows
        out.sizes = sizes_of(c, own)
        out.least = cycle.least
        for k in range(wp.min(cycle.pieces, state.room)):
            row = cycle.line + k
            piece = d.routes[row]
            piece.line -= int(c.pose_start[own])
            state.piece[motion * state.room + k] = piece
            state.seen[motion * state.room + k] = waits[row]
        for focus in range(plan.foci):
            state.shown[motion, focus] = ends.shown[own, focus]
            state.last[motion, focus] = ends.last[own, focus]
    state.motion[motion] = out
