"""Counts of motions: those of their poses, added in turn."""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import DrawnTracks, PoseSchedule
from .focus import PiecePassages
from .layout import STILL, ZERO, SamplingPlan
from .steps import StepCount

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
def cycles_within(plan: SamplingPlan, d: DrawnTracks, own: wp.int64, samples: wp.int64):
    """Cycles that samples on the track of a pose are; none of no pose, -1, and of a focal point that stands still."""
    if own < wp.int64(0) or plan.pace == STILL:
        return ZERO
    track = d.tracks[own]
    return wp.float64(wp.int64(track.turns) * samples) / wp.float64(track.repeat)


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
    out = MotionCount()
    cycles_before = wp.float64(0.0)  # on tracks before the one under way
    on_track = wp.int64(0)  # samples on that one
    own = wp.int64(-1)  # its pose
    lost = bool(True)  # a dynamic variable for Warp
    pose = schedule.motion_start[motion]
    while pose < schedule.motion_start[motion + 1]:
        samples = schedule.count[pose]
        out.steps = add_counts(out.steps, counts[pose])
        if d.entries[pose].drawn == 1:
            out.drawn += samples
            start = d.entries[pose].start
            on_track += start
            if start < samples:
                cycles_before += cycles_within(plan, d, own, on_track)
                on_track = samples - start
                own = pose
                waited = wait_for_pieces(d, passages, pose, out.samples + start, lost, counts[pose].felt)
                out.absence = wp.max(out.absence, wp.max(counts[pose].absence, waited))
                lost = counts[pose].lost == 1
        elif samples > wp.int64(0):
            lost = bool(True)
        out.samples += samples
        pose += wp.int64(1)
    out.cycles = cycles_before + cycles_within(plan, d, own, on_track)
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
