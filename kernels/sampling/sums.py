"""Counts of motions: those of their poses, added in turn."""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import BLOCK_SAMPLES, DrawnTracks, PoseSchedule, contours_at
from .focus import PiecePassages
from .layout import STILL, PoseTrack, SamplingPlan
from .steps import ORDER, POLYLINE, StepCount

wp.set_module_options(EXACT)


@wp.struct
class MotionCount:
    """What the samples of a motion are counted as."""

    samples: wp.int64
    drawn: wp.int64
    cycles: wp.float64
    steps: StepCount
    absence: wp.int64  # most samples from one on a piece that is there from pose to pose to the next on it


@wp.func
def cycles_within(track: PoseTrack, begin: wp.int64, stop: wp.int64):
    """Cycles that samples begin..stop on a track are."""
    return wp.float64(wp.int64(track.turns) * (stop - begin)) / wp.float64(track.repeat)


@wp.func
def cycles_of(d: DrawnTracks, pose: wp.int64, samples: wp.int64, before: wp.float64):
    """Cycles up to the end of a pose's samples, added block by block; a change of contours ends a block, too."""
    cycles = before
    start = d.entries[pose].start
    begin = wp.int64(0)
    while begin < samples:
        stop = wp.min((begin / BLOCK_SAMPLES + wp.int64(1)) * BLOCK_SAMPLES, samples)
        if begin < start:
            stop = wp.min(stop, start)
        cycles += cycles_within(d.tracks[contours_at(d, pose, begin)], begin, stop)
        begin = stop
    return cycles


@wp.func
def add_counts(a: StepCount, b: StepCount, cause: int):
    """The sum of two counts, and the longest of both; cause: of jumps within a pose."""
    out = a
    out.silent += b.silent
    out.held += b.held
    out.jumps += b.jumps
    out.jump_lengths[cause] += b.jump_first
    out.jump_lengths += b.jump_lengths
    out.hops += b.hops
    out.hops_longest = wp.max(a.hops_longest, b.hops_longest)
    out.step_longest = wp.max(a.step_longest, b.step_longest)
    return out


@wp.func
def wait_for_pieces(
    d: DrawnTracks, passages: PiecePassages, pose: wp.int64, clock: wp.int64, lost: bool, felt: wp.int64
):
    """Most samples that a piece of a pose waits to be drawn; lost: no piece is known any more.

    clock: samples before the pose's contours are entered. felt: of those on them, see `StepCount`.

    Afterwards, `last` of each piece is the sample, of all, in which it was drawn last or before which it appeared.
    """
    most = wp.int64(1)
    first = d.line[pose]
    for k in range(d.tracks[pose].pieces):
        row = first + wp.int64(k)
        since = clock - wp.int64(1)
        earlier = d.routes[row].earlier
        if earlier >= 0 and not lost:
            since = passages.last[d.line[d.entries[pose].earlier] + wp.int64(earlier)]
        if passages.first[row] >= wp.int64(0):
            most = wp.max(most, clock + passages.first[row] - since)
            since = clock + passages.last[row]
        if felt > wp.int64(0):
            most = wp.max(most, clock + felt - since)
        passages.last[row] = since
    return most


@wp.kernel
def _sum_counts(
    # In:
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnTracks,
    counts: wp.array[StepCount],  # shape [pose]
    # Out:
    passages: PiecePassages,
    sums: wp.array[MotionCount],  # shape [motion]
):
    """Sum the counts of a motion's poses."""
    motion = wp.tid()
    cause = wp.where(plan.points > wp.int64(0), ORDER, POLYLINE)
    out = MotionCount()
    lost = bool(True)  # a dynamic variable for Warp
    pose = schedule.motion_start[motion]
    while pose < schedule.motion_start[motion + 1]:
        samples = schedule.count[pose]
        out.steps = add_counts(out.steps, counts[pose], cause)
        if d.entries[pose].drawn == 1:
            out.drawn += samples
            if plan.pace != STILL:
                out.cycles = cycles_of(d, pose, samples, out.cycles)
            start = d.entries[pose].start
            if start < samples:
                waited = wait_for_pieces(d, passages, pose, out.samples + start, lost, counts[pose].felt)
                out.absence = wp.max(out.absence, wp.max(counts[pose].absence, waited))
                lost = counts[pose].lost == 1
        elif samples > wp.int64(0):
            lost = bool(True)
        out.samples += samples
        pose += wp.int64(1)
    sums[motion] = out


def sum_counts(
    plan: SamplingPlan, schedule: PoseSchedule, tracks: DrawnTracks, counts: wp.array, passages: PiecePassages
) -> wp.array:
    """Counts of each motion, MotionCount, from those of its poses; `passages` are good for nothing afterwards."""
    motion_count = schedule.motion_start.shape[0] - 1
    sums = wp.empty(motion_count, dtype=MotionCount, device=counts.device)
    wp.launch(
        _sum_counts,
        motion_count,
        inputs=[plan, schedule, tracks, counts],
        outputs=[passages, sums],
        device=counts.device,
        block_dim=BLOCK,
    )
    return sums
