"""Focal points of all poses at once: one thread a pose draws its samples and counts jumps, hops and silence.

A step is a jump if it is longer than a threshold, a hop if it is no jump, but longer than twice the longest that the
focal point makes along these contours. It is counted by its cause: from one polyline to the next; because the order or
the number of points a cycle asks for it; because a new pose has its contours elsewhere; because contours come back
elsewhere after a silence.
"""

import numpy as np
import warp as wp

from ..patch import EXACT, to_float32
from .layout import (
    HALF,
    INFINITE,
    ONE,
    STILL,
    TWO,
    ZERO,
    DrawnCycles,
    PoseSchedule,
    SamplerState,
    SamplingPlan,
    StepCount,
    distance,
    squared,
)
from .segments import (
    CycleSegment,
    age_of,
    base_parameter,
    cycle_point,
    find_segment,
    focus_parameter,
    gain_of,
    is_on,
    level_on,
    point_on,
    segment_piece,
    shown_parameter,
)

wp.set_module_options(EXACT)

FOCI_MOST = 64  # as SamplingStrategy has it
FULL_TURN = wp.constant(wp.float64(2 * np.pi))
LENGTH_UNIT = wp.constant(wp.float64(2.0**-32))  # [m], 0.2 nm: sums of whole ones are exact, up to 2,000 km
POLYLINE, ORDER, POSE, RE_ENTRY = (wp.constant(k) for k in range(4))  # causes of jumps, in the order of CAUSES


@wp.struct
class PiecePassages:
    """First and last sample of a pose on each of its drawn pieces, by the pieces' rows; -1: none."""

    first: wp.array[wp.int32]
    last: wp.array[wp.int32]


@wp.struct
class PoseEnds:
    """Positions of the focal points at the last sample of each pose that is drawn [m], shape [pose, focus]."""

    shown: wp.array2d[wp.vec3d]
    last: wp.array2d[wp.vec3d]  # before points are held or reordered, without small circles


@wp.func
def turned(q: wp.quatd, x: wp.vec3d):
    """A vector rotated by a quaternion, as by `rotate` of datasets/rigid.py: one of norm 1 but for rounding."""
    axis = wp.vec3d(q[0], q[1], q[2])
    across = wp.cross(axis, x)
    return x + TWO * (q[3] * across + wp.cross(axis, across))


@wp.func
def circle_offset(plan: SamplingPlan, pose: wp.transformd, number: wp.int64):
    """From a focal point to where a small circle moves it at a sample [m]."""
    angle = FULL_TURN * wp.mod(wp.float64(number) * plan.circle_turns, ONE)
    q = wp.transform_get_rotation(pose)
    u = turned(q, wp.vec3d(plan.circle_radius, ZERO, ZERO))
    v = turned(q, wp.vec3d(ZERO, ZERO, -plan.circle_radius))
    return wp.cos(angle) * u + wp.sin(angle) * v


@wp.func
def wave_at(plan: SamplingPlan, number: wp.int64):
    """Factor of amplitude modulation at a sample."""
    if plan.wave == 0:
        return ONE
    turns = wp.mod(wp.float64(number) * plan.wave_turns, ONE)
    low = HALF + HALF * wp.cos(FULL_TURN * turns)
    if plan.wave == 2:
        low = wp.where(turns < HALF, ONE, ZERO)
    return ONE - plan.wave_depth * low


@wp.func
def sample_parameter(plan: SamplingPlan, schedule: PoseSchedule, d: DrawnCycles, pose: int, sample: int, focus: int):
    """Parameter at which a focal point is shown at a sample of a pose that is drawn."""
    cycle = d.cycles[pose]
    parameter = base_parameter(plan, cycle, d.entries[pose].anchor, d.entries[pose].index + wp.int64(sample))
    return shown_parameter(plan, schedule.shown, cycle, focus_parameter(plan, cycle, parameter, focus))


@wp.kernel
def _find_ends(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnCycles,
    ends: PoseEnds,  # out
    passages: PiecePassages,  # out
):
    """Find where the focal points are at the last sample of a pose, from where the next goes on; pass no piece yet."""
    pose = wp.tid()
    if d.entries[pose].drawn == 0:
        return
    cycle = d.cycles[pose]
    for k in range(cycle.pieces):
        passages.first[cycle.line + k] = -1
        passages.last[cycle.line + k] = -1
    sample = schedule.count[pose] - 1
    base = base_parameter(plan, cycle, d.entries[pose].anchor, d.entries[pose].index + wp.int64(sample))
    for focus in range(plan.foci):
        parameter = focus_parameter(plan, cycle, base, focus)
        point = cycle_point(d.nodes, cycle, parameter)
        ends.last[pose, focus] = point
        if plan.points > 0:
            point = cycle_point(d.nodes, cycle, shown_parameter(plan, schedule.shown, cycle, parameter))
        if plan.circle_radius > ZERO:
            point += circle_offset(plan, d.pose[pose], schedule.number[pose] + wp.int64(sample))
        ends.shown[pose, focus] = point


@wp.func
def shown_before(schedule: PoseSchedule, d: DrawnCycles, ends: PoseEnds, state: SamplerState, pose: int, focus: int):
    """Position of a focal point before a pose [m]."""
    before = d.entries[pose].before
    if before < 0:
        return state.shown[schedule.motion[pose], focus]
    return ends.shown[before, focus]


@wp.func
def below(x: wp.float64):
    """The greatest number below a positive one."""
    return wp.cast(wp.cast(x, wp.int64) - wp.int64(1), wp.float64)


@wp.func
def moved_by(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnCycles,
    ends: PoseEnds,
    state: SamplerState,
    pose: int,
    focus: int,
):
    """From where a focal point was to where it entered the contours of a pose [m]; infinite if anywhere."""
    entry = d.entries[pose]
    if entry.found == 0:
        return INFINITE
    point = state.last[schedule.motion[pose], focus]
    if entry.before >= 0:
        point = ends.last[entry.before, focus]
    cycle = d.cycles[pose]
    parameter = focus_parameter(plan, cycle, entry.anchor, focus)
    behind = parameter
    if parameter <= ZERO:
        behind = cycle.period
    return wp.min(  # at a jump, both its sides
        distance(point, cycle_point(d.nodes, cycle, parameter)),
        distance(point, cycle_point(d.nodes, cycle, below(behind))),
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
def count_move(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnCycles,
    ends: PoseEnds,
    state: SamplerState,
    count: StepCount,
    pose: int,
    sample: int,
    focus: int,
    length: wp.float64,
    drawn_before: bool,
):
    """Count the step of a focal point to a sample that is drawn [m], by its cause.

    drawn_before: whether the sample before is. After one that is not, the step is a re-entry.
    """
    out = count
    ordinary = d.cycles[pose].ordinary
    if not drawn_before:
        if d.entries[pose].first == 0 or sample > 0:  # at the very first sample nothing comes back
            out = add_step(plan, count, RE_ENTRY, length, ordinary)
        return out
    out.step_longest = wp.max(out.step_longest, length)
    if length <= plan.threshold and length <= TWO * ordinary:
        return out
    cause = int(POLYLINE)
    if plan.points > 0:
        cause = ORDER
    if sample == 0 and d.entries[pose].again == 0:
        # else the cycle itself has a step as long between these two samples
        if TWO * moved_by(plan, schedule, d, ends, state, pose, focus) >= length:
            cause = POSE
    return add_step(plan, out, cause, length, ordinary)


@wp.func
def gain_at(plan: SamplingPlan, schedule: PoseSchedule, pose: int, sample: int, hold: wp.float64):
    """Factor that a fade leaves of a sample's intensity, and 1 if the pose is older than `hold` then, else 0."""
    age = age_of(schedule, pose, sample)
    held = wp.int64(0)
    if age > hold:
        held = wp.int64(1)
    return gain_of(plan, age, hold), held


@wp.func
def level_at(plan: SamplingPlan, schedule: PoseSchedule, d: DrawnCycles, pose: int, sample: int, focus: int):
    """Intensity of the contours at a focal point of a sample."""
    if d.nodes.intensity.shape[0] == 0:
        return ONE
    parameter = sample_parameter(plan, schedule, d, pose, sample, focus)
    return level_on(d.nodes, find_segment(d.nodes, d.cycles[pose], parameter, CycleSegment()), parameter)


@wp.func
def is_drawn(plan: SamplingPlan, schedule: PoseSchedule, d: DrawnCycles, pose: int, sample: int, gain: wp.float64):
    """Whether a focal point of a sample has an intensity above 0."""
    if d.nodes.intensity.shape[0] == 0:
        return gain > ZERO
    most = ZERO
    for focus in range(plan.foci):
        most = wp.max(most, level_at(plan, schedule, d, pose, sample, focus) * gain)
    return most > ZERO


@wp.func
def held_of(plan: SamplingPlan, schedule: PoseSchedule, pose: int, hold: wp.float64):
    """Samples of a pose at which it is older than `hold` [ticks]."""
    count = wp.int64(0)
    sample = int(0)
    while sample < schedule.count[pose]:
        _gain, held = gain_at(plan, schedule, pose, sample, hold)
        count += held
        sample += 1
    return count


@wp.func
def rest(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnCycles,
    ends: PoseEnds,
    state: SamplerState,
    pose: int,
    hold: wp.float64,
    position: wp.array2d[wp.vec3],
    intensity: wp.array2d[wp.float32],
):
    """Write silence where the focal points are; returns what it counts as."""
    count = StepCount()
    count.silent = wp.int64(schedule.count[pose])
    count.held = held_of(plan, schedule, pose, hold)
    for focus in range(plan.foci):
        point = to_float32(shown_before(schedule, d, ends, state, pose, focus))
        row = schedule.row[pose]
        stop = row + schedule.count[pose]
        while row < stop:
            position[row, focus] = point
            intensity[row, focus] = 0.0
            row += 1
    return count


@wp.func
def pass_piece(passages: PiecePassages, d: DrawnCycles, pose: int, segment: CycleSegment, sample: int):
    """Note which piece a sample is on; returns the samples since the last one on that piece, 0 if there was none."""
    piece = int(0)
    if d.cycles[pose].single == 0:
        piece = segment_piece(d.nodes, segment.a, segment.b)
    since = int(0)
    if piece >= 0:
        row = d.cycles[pose].line + piece
        if passages.first[row] < 0:
            passages.first[row] = sample
        else:
            since = sample - passages.last[row]
        passages.last[row] = sample
    return since


@wp.func
def pass_repeated(
    plan: SamplingPlan, schedule: PoseSchedule, d: DrawnCycles, passages: PiecePassages, pose: int, last: int
):
    """Note that the samples of a pose up to the last are on the pieces of the first; most samples between two of them.

    last: the last sample before a fade ends; below 1 there is nothing to note.
    """
    most = int(0)
    if last > 0:
        for focus in range(plan.foci):
            parameter = sample_parameter(plan, schedule, d, pose, 0, focus)
            segment = find_segment(d.nodes, d.cycles[pose], parameter, CycleSegment())
            most = wp.max(most, wp.min(pass_piece(passages, d, pose, segment, last), 1))
    return most


@wp.kernel
def _draw_samples(
    # In:
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnCycles,
    ends: PoseEnds,
    state: SamplerState,
    # Out:
    passages: PiecePassages,
    position: wp.array2d[wp.vec3],  # [m], shape [sample, focus]
    intensity: wp.array2d[wp.float32],  # shape [sample, focus]
    counts: wp.array[StepCount],  # shape [pose]
):
    """Draw the samples of a pose and count its steps."""
    pose = wp.tid()
    hold = schedule.hold[schedule.motion[pose]]
    if d.entries[pose].drawn == 0:
        counts[pose] = rest(plan, schedule, d, ends, state, pose, hold, position, intensity)
        return
    count = StepCount()
    rests = plan.pace == STILL and plan.circle_radius == ZERO
    cycle = d.cycles[pose]
    entry = d.entries[pose]
    drawn_before = entry.silent == 0
    previous = wp.zeros(shape=FOCI_MOST, dtype=wp.vec3d)
    segments = wp.zeros(shape=FOCI_MOST, dtype=CycleSegment)
    for focus in range(plan.foci):
        previous[focus] = shown_before(schedule, d, ends, state, pose, focus)
    sample = int(0)
    while sample < schedule.count[pose]:
        gain, held = gain_at(plan, schedule, pose, sample, hold)
        count.held += held
        drawn = is_drawn(plan, schedule, d, pose, sample, gain)
        number = schedule.number[pose] + wp.int64(sample)
        wave = wave_at(plan, number)
        row = schedule.row[pose] + sample
        count.silent += wp.where(drawn, wp.int64(0), wp.int64(1))
        count.felt = wp.where(gain > ZERO, sample + 1, count.felt)
        count.lost = wp.where(gain <= ZERO, 1, count.lost)
        if rests and sample > 0:
            for focus in range(plan.foci):  # where the sample before is
                position[row, focus] = position[row - 1, focus]
                level = level_at(plan, schedule, d, pose, sample, focus)
                intensity[row, focus] = wp.float32(level * gain * wave)
        base = base_parameter(plan, cycle, entry.anchor, entry.index + wp.int64(sample))
        for focus in range(wp.where(rests and sample > 0, 0, plan.foci)):
            parameter = shown_parameter(plan, schedule.shown, cycle, focus_parameter(plan, cycle, base, focus))
            if not is_on(segments[focus], parameter):
                segments[focus] = find_segment(d.nodes, cycle, parameter, segments[focus])
            segment = segments[focus]
            point = point_on(d.nodes, segment, parameter)
            if plan.circle_radius > ZERO:
                point += circle_offset(plan, d.pose[pose], number)
            position[row, focus] = to_float32(point)
            intensity[row, focus] = wp.float32(level_on(d.nodes, segment, parameter) * gain * wave)
            length = wp.sqrt(squared(point - previous[focus]))
            if drawn:
                count = count_move(plan, schedule, d, ends, state, count, pose, sample, focus, length, drawn_before)
            if gain > ZERO:
                count.absence = wp.max(count.absence, wp.int64(pass_piece(passages, d, pose, segment, sample)))
            previous[focus] = point
        drawn_before = drawn
        sample += 1
    last = wp.where(rests, count.felt - 1, 0)  # sample that is felt, of those that repeat the first
    count.absence = wp.max(count.absence, wp.int64(pass_repeated(plan, schedule, d, passages, pose, last)))
    counts[pose] = count
