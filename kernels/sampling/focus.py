"""Focal points of all poses at once: one thread a pose draws its samples and counts jumps, hops and silence.

As `Cursor.take` and `Sampler._count_jumps` in render/sampling.
"""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, to_float32
from .course import way_piece
from .cursor import (
    BLOCK_SAMPLES,
    DrawnTracks,
    PoseSchedule,
    age_of,
    cycle_knot,
    focus_knot,
    gain_of,
    level_on,
    point_on,
    shown_knot,
    track_point,
    way_at,
    way_from,
)
from .layout import HALF, ONE, STILL, TWO, ZERO, SamplingPlan, squared
from .steps import RE_ENTRY, StepCount, add_step, count_step, counted_length

wp.set_module_options(EXACT)

REST_HEIGHT = wp.constant(wp.float64(0.2))  # [m] of the focal points before there were any
FOCI_MOST = 64  # as SamplingStrategy has it
FULL_TURN = wp.constant(wp.float64(2 * np.pi))


@wp.struct
class PiecePassages:
    """Which samples of a pose are on each of its drawn pieces, by the pieces' rows; -1: none."""

    first: wp.array[wp.int64]
    last: wp.array[wp.int64]


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
    """What amplitude modulation leaves of the intensity at a sample."""
    if plan.wave == 0:
        return ONE
    turns = wp.mod(wp.float64(number) * plan.wave_turns, ONE)
    low = HALF + HALF * wp.cos(FULL_TURN * turns)
    if plan.wave == 2:
        low = wp.where(turns < HALF, ONE, ZERO)
    return ONE - plan.wave_depth * low


@wp.func
def sample_knot(
    plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, pose: wp.int64, sample: wp.int64, focus: int
):
    """Knot at which a focal point of a pose's sample is shown."""
    track = d.tracks[pose]
    entry = d.entries[pose]
    knot = cycle_knot(plan, track, entry.anchor, entry.index + sample)
    return shown_knot(plan, schedule.shown, track, focus_knot(plan, track, knot, focus))


@wp.func
def sample_point(
    plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, pose: wp.int64, sample: wp.int64, focus: int
):
    """A focal point of a pose's sample [m]."""
    point = track_point(d.nodes, d.tracks[pose], sample_knot(plan, schedule, d, pose, sample, focus))
    if plan.circle_radius > ZERO:
        point += circle_offset(plan, d.pose[pose], schedule.number[pose] + sample)
    return point


@wp.func
def shown_before(plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, pose: int, focus: int):
    """Where a focal point was before a pose [m]."""
    before = d.entries[pose].before
    if before < wp.int64(0):
        return wp.vec3d(ZERO, ZERO, REST_HEIGHT)
    return sample_point(plan, schedule, d, before, schedule.count[before] - wp.int64(1), focus)


@wp.func
def gain_at(plan: SamplingPlan, schedule: PoseSchedule, pose: int, sample: wp.int64, hold: wp.float64):
    """What a fade leaves of a sample's intensity, and whether the pose is older than `hold` then, 0 or 1."""
    age, block_end = age_of(plan, schedule, pose, sample)
    held = wp.int64(0)
    if block_end > hold and age > hold:
        held = wp.int64(1)
    return gain_of(plan, age, block_end, hold), held


@wp.func
def level_at(plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, pose: int, sample: wp.int64, focus: int):
    """Intensity of the contours at a focal point of a sample."""
    if d.nodes.intensity.shape[0] == 0:
        return ONE
    track = d.tracks[pose]
    knot = sample_knot(plan, schedule, d, wp.int64(pose), sample, focus)
    return level_on(d.nodes, track, way_at(d.nodes.knot, track.first, track.count, knot), knot)


@wp.func
def is_drawn(plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, pose: int, sample: wp.int64, gain: wp.float64):
    """Whether a focal point of a sample has an intensity above 0."""
    if d.nodes.intensity.shape[0] == 0:
        return gain > ZERO
    most = ZERO
    for focus in range(plan.foci):
        most = wp.max(most, level_at(plan, schedule, d, pose, sample, focus) * gain)
    return most > ZERO


@wp.func
def held_of(plan: SamplingPlan, schedule: PoseSchedule, pose: int, hold: wp.float64):
    """Samples of a pose at which it is older than `hold` [s]."""
    count = wp.int64(0)
    sample = wp.int64(0)
    while sample < schedule.count[pose]:
        _gain, held = gain_at(plan, schedule, pose, sample, hold)
        count += held
        sample += wp.int64(1)
    return count


@wp.func
def rest(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnTracks,
    pose: int,
    hold: wp.float64,
    position: wp.array2d[wp.vec3],
    intensity: wp.array2d[wp.float32],
):
    """Write silence where the focal points are; returns what it counts as."""
    count = StepCount()
    count.silent = schedule.count[pose]
    count.held = held_of(plan, schedule, pose, hold)
    for focus in range(plan.foci):
        point = to_float32(shown_before(plan, schedule, d, pose, focus))
        row = schedule.row[pose]
        stop = row + schedule.count[pose]
        while row < stop:
            position[row, focus] = point
            intensity[row, focus] = 0.0
            row += wp.int64(1)
    return count


@wp.func
def pass_piece(passages: PiecePassages, d: DrawnTracks, pose: int, way: int, sample: wp.int64):
    """Note that a sample is on a way of a pose's track; samples since the last one on the same piece, 0: none was."""
    track = d.tracks[pose]
    piece = int(0)
    if track.single == 0:
        piece = way_piece(d.nodes, track.first + wp.int64(wp.min(way, track.count - 2)))
    since = wp.int64(0)
    if piece >= 0:
        row = d.line[pose] + wp.int64(piece)
        if passages.first[row] < wp.int64(0):
            passages.first[row] = sample
        else:
            since = sample - passages.last[row]
        passages.last[row] = sample
    return since


@wp.func
def repeat_sample(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnTracks,
    pose: int,
    sample: wp.int64,
    gain: wp.float64,
    wave: wp.float64,
    position: wp.array2d[wp.vec3],
    intensity: wp.array2d[wp.float32],
):
    """Draw a sample where the one before is."""
    row = schedule.row[pose] + sample
    for focus in range(plan.foci):
        position[row, focus] = position[row - wp.int64(1), focus]
        intensity[row, focus] = wp.float32(level_at(plan, schedule, d, pose, sample, focus) * gain * wave)


@wp.func
def pass_repeated(
    plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, passages: PiecePassages, pose: int, last: wp.int64
):
    """Note that the samples of a pose up to the last are on the pieces of the first; most samples between two of them.

    last: the last sample before a fade ends; below 1 there is nothing to note.
    """
    most = wp.int64(0)
    if last > wp.int64(0):
        track = d.tracks[pose]
        for focus in range(plan.foci):
            knot = sample_knot(plan, schedule, d, wp.int64(pose), wp.int64(0), focus)
            since = pass_piece(passages, d, pose, way_at(d.nodes.knot, track.first, track.count, knot), last)
            most = wp.max(most, wp.min(since, wp.int64(1)))
    return most


@wp.kernel
def _draw_samples(
    # In:
    plan: SamplingPlan,
    schedule: PoseSchedule,
    d: DrawnTracks,
    motion: wp.array[wp.int64],  # number of each pose's motion
    # Out:
    passages: PiecePassages,  # -1 everywhere
    position: wp.array2d[wp.vec3],  # [m], shape [sample, focus]
    intensity: wp.array2d[wp.float32],  # shape [sample, focus]
    counts: wp.array[StepCount],  # shape [pose]
):
    """Draw the samples of a pose and count its steps."""
    pose = wp.tid()
    hold = schedule.hold[motion[pose]]
    if d.entries[pose].drawn == 0:
        counts[pose] = rest(plan, schedule, d, pose, hold, position, intensity)
        return
    count = StepCount()
    track = d.tracks[pose]
    rests = plan.pace == STILL and plan.circle_radius == ZERO
    last = wp.int64(0)  # sample that is felt, of those that repeat the first
    silent = d.entries[pose].silent == 1
    drawn_before = bool(False)  # a dynamic variable for Warp
    ways = wp.zeros(shape=FOCI_MOST, dtype=int)
    previous = wp.zeros(shape=FOCI_MOST, dtype=wp.vec3d)
    for focus in range(plan.foci):
        previous[focus] = shown_before(plan, schedule, d, pose, focus)
    sample = wp.int64(0)
    while sample < schedule.count[pose]:
        gain, held = gain_at(plan, schedule, pose, sample, hold)
        count.held += held
        drawn = is_drawn(plan, schedule, d, pose, sample, gain)
        number = schedule.number[pose] + sample
        wave = wave_at(plan, number)
        row = schedule.row[pose] + sample
        first = sample % BLOCK_SAMPLES == wp.int64(0)
        if first and sample > wp.int64(0):
            silent = not drawn_before
        count.silent += wp.where(drawn, wp.int64(0), wp.int64(1))
        count.felt += wp.where(gain > ZERO, wp.int64(1), wp.int64(0))
        if rests and sample > wp.int64(0):
            repeat_sample(plan, schedule, d, pose, sample, gain, wave, position, intensity)
            last = wp.where(gain > ZERO, sample, last)
        for focus in range(wp.where(rests and sample > wp.int64(0), 0, plan.foci)):
            knot = sample_knot(plan, schedule, d, wp.int64(pose), sample, focus)
            way = way_from(d.nodes.knot, track.first, track.count, knot, ways[focus])
            ways[focus] = way
            point = point_on(d.nodes, track, way, knot)
            if plan.circle_radius > ZERO:
                point += circle_offset(plan, d.pose[pose], number)
            position[row, focus] = to_float32(point)
            intensity[row, focus] = wp.float32(level_on(d.nodes, track, way, knot) * gain * wave)
            length = wp.sqrt(squared(point - previous[focus]))
            if first and silent and drawn and (d.entries[pose].before >= wp.int64(0) or sample > wp.int64(0)):
                count = add_step(plan, count, RE_ENTRY, length, d.tracks[pose].ordinary)
            length = counted_length(length, drawn, drawn_before, first, silent)
            count = count_step(plan, schedule, d, count, pose, sample, focus, length)
            if gain > ZERO:
                count.absence = wp.max(count.absence, pass_piece(passages, d, pose, way, sample))
            previous[focus] = point
        drawn_before = drawn
        sample += wp.int64(1)
    count.absence = wp.max(count.absence, pass_repeated(plan, schedule, d, passages, pose, last))
    counts[pose] = count


def draw_samples(
    plan: SamplingPlan,
    schedule: PoseSchedule,
    tracks: DrawnTracks,
    motion: wp.array,
    position: wp.array,
    intensity: wp.array,
) -> tuple[wp.array, PiecePassages]:
    """Draw the focal points of all poses; one thread a pose. Returns what each pose is counted as, StepCount.

    motion: number of each pose's motion, int64.
    """
    device, lines = position.device, tracks.routes.shape[0]
    passages = PiecePassages()
    passages.first = wp.full(lines, -1, dtype=wp.int64, device=device)
    passages.last = wp.full(lines, -1, dtype=wp.int64, device=device)
    counts = wp.empty(motion.shape[0], dtype=StepCount, device=device)
    wp.launch(
        _draw_samples,
        counts.shape[0],
        inputs=[plan, schedule, tracks, motion],
        outputs=[passages, position, intensity, counts],
        device=device,
        block_dim=BLOCK,
    )
    return counts, passages
