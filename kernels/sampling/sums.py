"""Counts of motions: those of their poses, added in turn."""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import BLOCK_SAMPLES, DrawnTracks, PoseSchedule
from .focus import ORDER, POLYLINE, StepCount
from .layout import STILL, SamplingPlan

wp.set_module_options(EXACT)


@wp.struct
class MotionCount:
    """What the samples of a motion are counted as."""

    samples: wp.int64
    drawn: wp.int64
    cycles: wp.float64
    steps: StepCount


@wp.func
def cycles_of(samples: wp.int64, turns: int, repeat: wp.int64, before: wp.float64):
    """Cycles up to the end of a pose's samples, added block by block."""
    cycles = before
    left = samples
    while left > wp.int64(0):
        count = wp.min(left, BLOCK_SAMPLES)
        cycles += wp.float64(wp.int64(turns) * count) / wp.float64(repeat)
        left -= count
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


@wp.kernel
def _sum_counts(
    # In:
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnTracks,
    counts: wp.array[StepCount],  # shape [pose]
    # Out:
    sums: wp.array[MotionCount],  # shape [motion]
):
    """Sum the counts of a motion's poses."""
    motion = wp.tid()
    cause = wp.where(plan.points > wp.int64(0), ORDER, POLYLINE)
    out = MotionCount()
    pose = schedule.motion_start[motion]
    while pose < schedule.motion_start[motion + 1]:
        samples = schedule.count[pose]
        out.samples += samples
        out.steps = add_counts(out.steps, counts[pose], cause)
        if d.entries[pose].drawn == 1:
            out.drawn += samples
            if plan.pace != STILL:
                track = d.tracks[pose]
                out.cycles = cycles_of(samples, track.turns, track.repeat, out.cycles)
        pose += wp.int64(1)
    sums[motion] = out


def sum_counts(plan: SamplingPlan, schedule: PoseSchedule, tracks: DrawnTracks, counts: wp.array) -> wp.array:
    """Counts of each motion, MotionCount, from those of its poses."""
    motion_count = schedule.motion_start.shape[0] - 1
    sums = wp.empty(motion_count, dtype=MotionCount, device=counts.device)
    wp.launch(
        _sum_counts,
        motion_count,
        inputs=[plan, schedule, tracks, counts],
        outputs=[sums],
        device=counts.device,
        block_dim=BLOCK,
    )
    return sums
