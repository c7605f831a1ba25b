"""Focal points of all poses at once: one thread a pose draws its samples and counts jumps, hops and silence.

As `Cursor.take` and `Sampler._count_jumps` in render/sampling.
"""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, to_float32
from .cursor import (
    DrawnTracks,
    PoseSchedule,
    TrackWay,
    age_of,
    contours_at,
    cycle_knot,
    find_way,
    focus_knot,
    gain_of,
    is_on,
    level_on,
    point_on,
    sample_index,
    shown_knot,
    track_point,
    way_piece,
)
from .layout import HALF, ONE, STILL, TWO, ZERO, SamplingPlan, squared
from .steps import StepCount, count_move

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
    """Knot at which a focal point of a pose's sample is shown, on the contours that the sample is on."""
    own = contours_at(d, pose, sample)
    track = d.tracks[own]
    entry = d.entries[own]
    knot = cycle_knot(plan, track, entry.anchor, sample_index(schedule, entry, own, pose, sample))
    return shown_knot(plan, schedule.shown, track, focus_knot(plan, track, knot, focus))


@wp.func
def sample_point(
    plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, pose: wp.int64, sample: wp.int64, focus: int
):
    """A focal point of a pose's sample [m]."""
    track = d.tracks[contours_at(d, pose, sample)]
    point = track_point(d.nodes, track, sample_knot(plan, schedule, d, pose, sample, focus))
    if plan.circle_radius > ZERO:
        point += circle_offset(plan, d.pose[pose], schedule.number[pose] + sample)
    return point


@wp.func
def point_near(plan: SamplingPlan, d: DrawnTracks, pose: int, way: TrackWay, knot: wp.float64, number: wp.int64):
    """Point at a knot on a way [m], moved by the small circle, if there is one, of a sample at a pose."""
    point = point_on(d.nodes, way, knot)
    if plan.circle_radius > ZERO:
        point += circle_offset(plan, d.pose[pose], number)
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
    age = age_of(schedule, pose, sample)
    held = wp.int64(0)
    if age > hold:
        held = wp.int64(1)
    return gain_of(plan, age, hold), held


@wp.func
def level_at(plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, pose: int, sample: wp.int64, focus: int):
    """Intensity of the contours at a focal point of a sample."""
    if d.nodes.intensity.shape[0] == 0:
        return ONE
    track = d.tracks[contours_at(d, wp.int64(pose), sample)]
    knot = sample_knot(plan, schedule, d, wp.int64(pose), sample, focus)
    return level_on(d.nodes, find_way(d.nodes, track, knot, TrackWay()), knot)


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
    """Samples of a pose at which it is older than `hold` [ticks]."""
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
def pass_piece(passages: PiecePassages, d: DrawnTracks, own: wp.int64, way: TrackWay, sample: wp.int64):
    """Note that a sample is on a way of a pose's track; samples since the last one on the same piece, 0: none was.

    sample: counted from the first one on this track.
    """
    piece = int(0)
    if d.tracks[own].single == 0:
        piece = way_piece(d.nodes, way.a, way.b)
    since = wp.int64(0)
    if piece >= 0:
        row = d.line[own] + wp.int64(piece)
        if passages.first[row] < wp.int64(0):
            passages.first[row] = sample
        else:
            since = sample - passages.last[row]
        passages.last[row] = sample
    return since


@wp.func
def pass_carried(
    plan: SamplingPlan, schedule: PoseSchedule, d: DrawnTracks, passages: PiecePassages, pose: int, count: StepCount
):
    """Note on which pieces of a pose the samples of later poses are that finish what was under way."""
    out = count
    if plan.finishes == 0 or d.entries[pose].start == schedule.count[pose]:
        return out
    motion = wp.lower_bound(schedule.motion_start, wp.int64(pose + 1)) - 1
    own = wp.int64(pose)
    track = d.tracks[own]
    begin = schedule.number[own] + d.entries[own].start
    later = own + wp.int64(1)
    while later < schedule.motion_start[motion + 1]:
        start = wp.int64(0)
        if d.entries[later].drawn == 1:
            start = d.entries[later].start
        sample = wp.int64(0)
        while sample < start:
            number = schedule.number[later] + sample - begin
            gain, _held = gain_at(plan, schedule, int(later), sample, schedule.hold[motion])
            if gain > ZERO:
                out.felt = number + wp.int64(1)
                for focus in range(plan.foci):
                    knot = sample_knot(plan, schedule, d, later, sample, focus)
                    way = find_way(d.nodes, track, knot, TrackWay())
                    out.absence = wp.max(out.absence, pass_piece(passages, d, own, way, number))
            else:
                out.lost = 1
            sample += wp.int64(1)
        later += wp.int64(1)
        if start < schedule.count[later - wp.int64(1)]:
            later = schedule.motion_start[motion + 1]
    return out


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
            way = find_way(d.nodes, track, knot, TrackWay())
            since = pass_piece(passages, d, wp.int64(pose), way, last)
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
    rests = plan.pace == STILL and plan.circle_radius == ZERO
    last = wp.int64(0)  # sample that is felt, of those that repeat the first
    start = d.entries[pose].start
    drawn_before = d.entries[pose].silent == 0
    previous = wp.zeros(shape=FOCI_MOST, dtype=wp.vec3d)
    for focus in range(plan.foci):
        previous[focus] = shown_before(plan, schedule, d, pose, focus)
    sample = wp.int64(0)
    while sample < schedule.count[pose]:  # once for samples on the contours before, once for those on the pose's own
        own = contours_at(d, wp.int64(pose), sample)
        track = d.tracks[own]
        entry = d.entries[own]
        stop = wp.where(sample < start, wp.min(start, schedule.count[pose]), schedule.count[pose])
        ways = wp.zeros(shape=FOCI_MOST, dtype=TrackWay)
        while sample < stop:
            gain, held = gain_at(plan, schedule, pose, sample, hold)
            count.held += held
            drawn = is_drawn(plan, schedule, d, pose, sample, gain)
            number = schedule.number[pose] + sample
            wave = wave_at(plan, number)
            row = schedule.row[pose] + sample
            count.silent += wp.where(drawn, wp.int64(0), wp.int64(1))
            count.felt = wp.where(sample >= start and gain > ZERO, sample - start + wp.int64(1), count.felt)
            count.lost = wp.where(sample >= start and gain <= ZERO, 1, count.lost)
            if rests and sample > wp.int64(0):
                repeat_sample(plan, schedule, d, pose, sample, gain, wave, position, intensity)
                last = wp.where(gain > ZERO, sample, last)
            cycle = cycle_knot(plan, track, entry.anchor, sample_index(schedule, entry, own, wp.int64(pose), sample))
            for focus in range(wp.where(rests and sample > wp.int64(0), 0, plan.foci)):
                knot = shown_knot(plan, schedule.shown, track, focus_knot(plan, track, cycle, focus))
                if not is_on(ways[focus], knot):
                    ways[focus] = find_way(d.nodes, track, knot, ways[focus])
                way = ways[focus]
                point = point_near(plan, d, pose, way, knot, number)
                position[row, focus] = to_float32(point)
                intensity[row, focus] = wp.float32(level_on(d.nodes, way, knot) * gain * wave)
                length = wp.sqrt(squared(point - previous[focus]))
                if drawn:
                    count = count_move(plan, schedule, d, count, pose, sample, focus, length, drawn_before)
                if gain > ZERO and sample >= start:
                    count.absence = wp.max(count.absence, pass_piece(passages, d, own, way, sample - start))
                previous[focus] = point
            drawn_before = drawn
            sample += wp.int64(1)
    count.absence = wp.max(count.absence, pass_repeated(plan, schedule, d, passages, pose, last))
    counts[pose] = pass_carried(plan, schedule, d, passages, pose, count)


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
