"""Steps of focal points: how long each is, and whether it counts as a jump or a hop, and of what cause.

As `Sampler._count_jumps` in render/sampling.
"""

import warp as wp

from .cursor import (
    DrawnTracks,
    PoseSchedule,
    contours_at,
    cycle_knot,
    focus_knot,
    sample_index,
    track_point,
)
from .layout import INFINITE, TWO, ZERO, SamplingPlan, distance

LENGTH_UNIT = wp.constant(wp.float64(2.0**-32))  # [m]: lengths are summed in whole ones, as by the host
POLYLINE, ORDER, POSE, RE_ENTRY = (wp.constant(k) for k in range(4))  # causes of jumps, in the order of CAUSES


@wp.struct
class StepCount:
    """What the samples of a pose are counted as; vectors are by cause."""

    silent: wp.int64
    held: wp.int64
    jumps: wp.vec4l
    jump_lengths: wp.vec4d  # [m]
    hops: wp.vec4l
    hops_longest: wp.vec4d  # [m]
    step_longest: wp.float64  # [m]
    felt: wp.int64  # samples on the pose's contours up to the last one that no fade has ended, those in between too
    lost: wp.int32  # 1: a fade has ended one of these
    absence: wp.int64  # most samples from one on a piece to the next on it


@wp.func
def below(x: wp.float64):
    """The greatest number below a positive one."""
    return wp.cast(wp.cast(x, wp.int64) - wp.int64(1), wp.float64)


@wp.func
def moved_by(plan: SamplingPlan, d: DrawnTracks, schedule: PoseSchedule, pose: int, focus: int):
    """From where a focal point was to where it entered the contours of a pose [m]; infinite if anywhere."""
    entry = d.entries[pose]
    if entry.found == 0:
        return INFINITE
    track = d.tracks[pose]
    then = d.tracks[entry.earlier]
    other = d.entries[entry.earlier]
    before = wp.int64(pose)  # the pose of the sample before
    sample = entry.start - wp.int64(1)
    if sample < wp.int64(0):
        before = entry.before
        sample = schedule.count[before] - wp.int64(1)
    last = cycle_knot(plan, then, other.anchor, sample_index(schedule, other, entry.earlier, before, sample))
    point = track_point(d.nodes, then, focus_knot(plan, then, last, focus))
    knot = focus_knot(plan, track, entry.anchor, focus)
    behind = knot
    if knot <= ZERO:
        behind = track.period
    return wp.min(
        distance(point, track_point(d.nodes, track, knot)),  # at a jump, both its sides
        distance(point, track_point(d.nodes, track, below(behind))),
    )


@wp.func
def add_step(plan: SamplingPlan, count: StepCount, cause: int, length: wp.float64, ordinary: wp.float64):
    """Count a step as a jump or a hop, if it is one."""
    out = count
    if length > plan.threshold:
        out.jumps[cause] += wp.int64(1)
        out.jump_lengths[cause] += wp.rint(length / LENGTH_UNIT) * LENGTH_UNIT
    elif length > TWO * ordinary:
        out.hops[cause] += wp.int64(1)
        out.hops_longest[cause] = wp.max(out.hops_longest[cause], length)
    return out


@wp.func
def count_step(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnTracks,
    count: StepCount,
    pose: int,
    sample: wp.int64,
    focus: int,
    length: wp.float64,
):
    """Count a step to a sample by its cause."""
    out = count
    out.step_longest = wp.max(out.step_longest, length)
    ordinary = d.tracks[contours_at(d, wp.int64(pose), sample)].ordinary
    if length <= plan.threshold and length <= TWO * ordinary:
        return out
    cause = int(POLYLINE)
    if plan.points > wp.int64(0):
        cause = ORDER
    if sample == d.entries[pose].start:
        if TWO * moved_by(plan, d, schedule, pose, focus) >= length:  # else it is the way between two that is long
            cause = POSE
    return add_step(plan, out, cause, length, ordinary)


@wp.func
def count_move(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnTracks,
    count: StepCount,
    pose: int,
    sample: wp.int64,
    focus: int,
    length: wp.float64,
    drawn_before: bool,
):
    """Count the way of a focal point to a sample that is drawn [m].

    drawn_before: whether the sample before is. After one that is not, the step is a re-entry.
    """
    if drawn_before:
        return count_step(plan, schedule, d, count, pose, sample, focus, length)
    if d.entries[pose].before >= wp.int64(0) or sample > wp.int64(0):  # at the very first sample nothing comes back
        ordinary = d.tracks[contours_at(d, wp.int64(pose), sample)].ordinary
        return add_step(plan, count, RE_ENTRY, length, ordinary)
    return count
