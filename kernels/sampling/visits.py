"""Revisits: how long picked places on the skin have waited since they were visited before; one thread a pick.

In each interval one place that a focal point draws is picked. A visit is a run of drawn samples with a focal point near
the place; docs/guide/sampling.md has the definition. A pose has a box around the places of each focal point, and so
have sixteen samples in a row: a pick looks only into boxes that are near to its place. A pose whose focal points rest
is looked at once. Samples before those that are given count as none, so the last two limits before them must be given.
"""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .layout import INFINITE, ONE, TWO, ZERO, PoseSchedule

wp.set_module_options(EXACT)

REVISIT_RADIUS = 5e-3  # [m] on the skin: half a focal point's width 0.2 m above an array of 0.16 m
NEAR = wp.constant(wp.float64(REVISIT_RADIUS**2))  # [m^2]
SURELY_NEAR = wp.constant(wp.float64((1.001 * REVISIT_RADIUS) ** 2))  # [m^2]; no rounding leaves a near sample out
GROUP = wp.constant(16)  # samples in a row that have a box
EMPTY, FAR, NEARBY = (wp.constant(k) for k in range(3))  # what a box is to a place
GOLDEN = wp.constant(wp.float64((np.sqrt(5.0) - 1.0) / 2.0))
NONE, IN_VAIN, VISITED = (wp.constant(k) for k in range(3))  # results of a pick


@wp.struct
class SkinSamples:
    """Focal points, and the boxes around them on the skin; a pose's first box is around all its samples."""

    position: wp.array2d[wp.vec3]  # [m], array frame, shape [sample, focus]
    intensity: wp.array2d[wp.float32]
    pose: wp.array[wp.transformd]  # hand frame -> array frame
    low: wp.array2d[wp.vec3d]  # [m], hand frame, of what is drawn, shape [box, focus]; above `high` if nothing is
    high: wp.array2d[wp.vec3d]
    rests: wp.array[wp.int32]  # 1: in every sample of a pose that is drawn the same focal points are, where they were


@wp.struct
class HandFrame:
    """Axes and origin of a hand frame in the array frame."""

    across: wp.vec3d
    up: wp.vec3d
    along: wp.vec3d
    at: wp.vec3d  # [m]


@wp.func
def frame_of(pose: wp.transformd):
    """The frame of a hand pose."""
    frame = HandFrame()
    q = wp.transform_get_rotation(pose)
    x = q[0]
    y = q[1]
    z = q[2]
    w = q[3]
    frame.across = wp.vec3d(ONE - TWO * (y * y + z * z), TWO * (x * y + z * w), TWO * (x * z - y * w))
    frame.up = wp.vec3d(TWO * (x * y - z * w), ONE - TWO * (x * x + z * z), TWO * (y * z + x * w))
    frame.along = wp.vec3d(TWO * (x * z + y * w), TWO * (y * z - x * w), ONE - TWO * (x * x + y * y))
    frame.at = wp.transform_get_translation(pose)
    return frame


@wp.func
def in_order(a: wp.vec3d, b: wp.vec3d):
    """Scalar product, summed in order."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


@wp.func
def on_skin(frame: HandFrame, p: wp.vec3):
    """A point of the array frame in a hand frame [m]."""
    off = wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2])) - frame.at
    return wp.vec3d(in_order(frame.across, off), in_order(frame.up, off), in_order(frame.along, off))


@wp.func
def first_box(schedule: PoseSchedule, pose: int):
    """First box of a pose; before it is room for those of all earlier ones."""
    return 2 * pose + schedule.row[pose] // GROUP


@wp.func
def first_drawn(skin: SkinSamples, begin: int, stop: int):
    """The first sample from one on that draws a focal point; `stop` if none does."""
    row = begin
    drawn = int(0)
    while row < stop and drawn == 0:
        for focus in range(skin.intensity.shape[1]):
            if skin.intensity[row, focus] > 0.0:
                drawn = int(1)
        if drawn == 0:
            row += 1
    return row


@wp.func
def is_at_rest(skin: SkinSamples, first: int, stop: int):
    """Whether every sample that is drawn is as the first one: the same focal points at the same places."""
    row = first + 1
    while row < stop:
        silent = int(1)
        same = int(1)
        for focus in range(skin.intensity.shape[1]):
            shown = skin.intensity[row, focus] > 0.0
            if shown:
                silent = int(0)
            if shown != (skin.intensity[first, focus] > 0.0):
                same = int(0)
            elif shown and not (skin.position[row, focus] == skin.position[first, focus]):
                same = int(0)
        if silent == 0 and same == 0:
            return 0
        row += 1
    return 1


@wp.func
def box_around(skin: SkinSamples, frame: HandFrame, first: int, stop: int, focus: int):
    """Least and greatest coordinates of a focal point among samples, where it is drawn [m]."""
    least = wp.vec3d(INFINITE, INFINITE, INFINITE)
    most = -least
    row = first
    while row < stop:
        if skin.intensity[row, focus] > 0.0:
            point = on_skin(frame, skin.position[row, focus])
            least = wp.min(least, point)
            most = wp.max(most, point)
        row += 1
    return least, most


@wp.kernel
def _box_samples(
    # In:
    schedule: PoseSchedule,
    skin: SkinSamples,
    # Out:
    low: wp.array2d[wp.vec3d],
    high: wp.array2d[wp.vec3d],
    rests: wp.array[wp.int32],
):
    """Put boxes around the samples of a pose; around all at once if they rest."""
    pose = wp.tid()
    frame = frame_of(skin.pose[pose])
    stop = schedule.row[pose] + schedule.count[pose]
    drawn = first_drawn(skin, schedule.row[pose], stop)
    still = is_at_rest(skin, drawn, stop)
    rests[pose] = still
    begin = schedule.row[pose]
    if still == 1:
        begin = drawn
        stop = wp.min(drawn + 1, stop)
    own = first_box(schedule, pose)
    for focus in range(skin.intensity.shape[1]):
        least = wp.vec3d(INFINITE, INFINITE, INFINITE)
        most = -least
        row = begin
        box = own
        while row < stop:
            a, b = box_around(skin, frame, row, wp.min(row + GROUP, stop), focus)
            least = wp.min(least, a)
            most = wp.max(most, b)
            box += 1
            if still == 0:
                low[box, focus] = a
                high[box, focus] = b
            row += GROUP
        low[own, focus] = least
        high[own, focus] = most


@wp.func
def nearness(skin: SkinSamples, box: int, place: wp.vec3d):
    """Whether a sample in a box may be near to a place: EMPTY, FAR or NEARBY."""
    out = int(EMPTY)
    for focus in range(skin.low.shape[1]):
        if out != NEARBY and skin.low[box, focus][0] <= skin.high[box, focus][0]:
            out = FAR
            low = skin.low[box, focus] - place
            high = place - skin.high[box, focus]
            off = wp.max(wp.max(low, high), wp.vec3d(ZERO, ZERO, ZERO))
            if in_order(off, off) < SURELY_NEAR:
                out = NEARBY
    return out


@wp.func
def square_to(skin: SkinSamples, frame: HandFrame, row: int, place: wp.vec3d):
    """Square distance of the nearest drawn focal point of a sample from a place [m^2]; negative if none is drawn."""
    least = -ONE
    for focus in range(skin.intensity.shape[1]):
        if skin.intensity[row, focus] > 0.0:
            off = on_skin(frame, skin.position[row, focus]) - place
            square = in_order(off, off)
            if least < ZERO or square < least:
                least = square
    return least


@wp.struct
class PickRule:
    """When places are picked, and how long they may wait, in samples."""

    interval: wp.int32
    limit: wp.int32
    first_sample: wp.array[wp.int64]  # number of the first sample that is given, shape [motion]
    first_pick: wp.array[wp.int64]  # number of the first pick


@wp.struct
class LookBack:
    """A walk back in time from a pick, over the latest visit, 0, between visits, 1, or over the one before, 2."""

    phase: wp.int32
    entered: wp.int32  # first sample of the latest visit
    now: wp.int32  # its moment: the first sample that is nearest to the place
    now_square: wp.float64  # [m^2]
    then: wp.int32  # moment of the visit before
    then_square: wp.float64  # [m^2]


@wp.func
def pass_sample(look: LookBack, row: int, square: wp.float64):
    """Go on by a drawn sample, at a square distance from the place [m^2]; phase 3: the visit before has begun there."""
    out = look
    if square < NEAR:
        if look.phase == 0:
            out.entered = row
            if square <= look.now_square:
                out.now = row
                out.now_square = square
        else:
            out.phase = 2
            if square <= look.then_square:
                out.then = row
                out.then_square = square
    elif look.phase == 0:
        out.phase = 1
    elif look.phase == 2:
        out.phase = 3
    return out


@wp.func
def pass_rest(schedule: PoseSchedule, skin: SkinSamples, rule: PickRule, look: LookBack, pose: int, place: wp.vec3d):
    """Go on by a pose whose focal points rest: by its first drawn sample within the limit."""
    earliest = schedule.row[pose]
    stop = earliest + schedule.count[pose]
    if look.phase > 0:
        earliest = wp.max(earliest, look.entered - rule.limit)
    row = first_drawn(skin, earliest, stop)
    if row >= stop:
        return look
    return pass_sample(look, row, square_to(skin, frame_of(skin.pose[pose]), row, place))


@wp.func
def pass_samples(
    schedule: PoseSchedule, skin: SkinSamples, rule: PickRule, before: LookBack, pose: int, last: int, place: wp.vec3d
):
    """Go on by the samples of a pose from `last` back; box by box, and in boxes nearby one by one."""
    look = before
    frame = frame_of(skin.pose[pose])
    first = schedule.row[pose]
    end = first + schedule.count[pose] - 1
    row = last
    while row >= first and look.phase < 3:
        group = (row - first) // GROUP
        begin = first + group * GROUP
        near = int(NEARBY)
        if row == wp.min(begin + GROUP - 1, end):
            near = nearness(skin, first_box(schedule, pose) + 1 + group, place)
        if look.phase > 0 and row < look.entered - rule.limit:
            row = first - 1
        elif near != NEARBY:
            if near == FAR:
                look = pass_sample(look, row, INFINITE)
            row = begin - 1
        else:
            square = square_to(skin, frame, row, place)
            if square >= ZERO:
                look = pass_sample(look, row, square)
            row -= 1
    return look


@wp.func
def look_back(
    schedule: PoseSchedule, skin: SkinSamples, rule: PickRule, begin: int, own: int, own_pose: int, place: wp.vec3d
):
    """Walk back from a sample; begin: first pose of the motion. Phase 4: the visit has lasted for too long."""
    look = LookBack()
    look.now_square = INFINITE
    look.then_square = INFINITE
    look.entered = own
    pose = own_pose
    last = own
    while pose >= begin and look.phase < 3:
        near = nearness(skin, first_box(schedule, pose), place)
        if look.phase > 0 and last < look.entered - rule.limit:
            pose = begin
        elif near == FAR:
            look = pass_sample(look, last, INFINITE)
        elif near == NEARBY and skin.rests[pose] == 1:
            look = pass_rest(schedule, skin, rule, look, pose, place)
        elif near == NEARBY:
            look = pass_samples(schedule, skin, rule, look, pose, last, place)
        if own - look.entered > rule.limit:
            look.phase = 4
        last = schedule.row[pose] - 1
        pose -= 1
    return look


@wp.func
def pose_of(schedule: PoseSchedule, motion: int, row: int):
    """Number of the pose of a motion that a sample belongs to."""
    low = schedule.motion_start[motion]
    high = schedule.motion_start[motion + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if schedule.row[middle] <= row:
            low = middle
        else:
            high = middle
    return low


@wp.func
def sample_of(rule: PickRule, pick: wp.int64):
    """Sample of a pick: one, anywhere, in each interval; the multiples of GOLDEN keep step with no cycle."""
    share = wp.mod(wp.float64(pick) * GOLDEN, ONE)
    return pick * wp.int64(rule.interval) + wp.int64(wp.floor(wp.float64(rule.interval) * share))


@wp.kernel
def _look_back(
    # In:
    rule: PickRule,
    schedule: PoseSchedule,
    skin: SkinSamples,
    sample_start: wp.array[wp.int64],  # offsets of motions into samples, shape [motion + 1]
    pick_start: wp.array[wp.int64],  # offsets of motions into picks, shape [motion + 1]
    # Out:
    result: wp.array[wp.int32],  # NONE, IN_VAIN or VISITED, shape [pick]
    wait: wp.array[wp.int32],  # samples
):
    """Find how long the place of a pick has waited."""
    i = wp.tid()
    motion = wp.lower_bound(pick_start, wp.int64(i + 1)) - 1
    begin = sample_start[motion] - rule.first_sample[motion]  # row of the motion's very first sample
    pick = wp.int64(i) - pick_start[motion] + rule.first_pick[motion]
    result[i] = NONE
    wait[i] = 0
    if begin + sample_of(rule, pick) >= sample_start[motion + 1]:
        return
    own = int(begin + sample_of(rule, pick))
    focus = int(pick % wp.int64(skin.intensity.shape[1]))
    if not skin.intensity[own, focus] > 0.0:
        return
    pose = pose_of(schedule, motion, own)
    place = on_skin(frame_of(skin.pose[pose]), skin.position[own, focus])
    look = look_back(schedule, skin, rule, schedule.motion_start[motion], own, pose, place)
    if look.phase == 4:
        return
    earliest = look.entered - rule.limit
    if look.then_square < INFINITE:
        result[i] = VISITED
        wait[i] = look.now - look.then
    elif wp.int64(earliest) >= begin:
        result[i] = IN_VAIN
        wait[i] = look.entered - first_drawn(skin, earliest, look.entered)


@wp.kernel
def _sum_waits(
    pick_start: wp.array[wp.int64],
    result: wp.array[wp.int32],
    wait: wp.array[wp.int32],
    sums: wp.array2d[wp.int64],  # picks that were visited before, and samples that all had waited, shape [motion, 2]
):
    """Sum the picks of a motion."""
    motion = wp.tid()
    total = wp.int64(0)
    count = wp.int64(0)
    pick = pick_start[motion]
    while pick < pick_start[motion + 1]:
        if result[pick] != NONE:
            total += wp.int64(wait[pick])
            if result[pick] == VISITED:
                count += wp.int64(1)
        pick += wp.int64(1)
    sums[motion, 0] = count
    sums[motion, 1] = total


def picked_sample(pick: int, interval: int) -> int:
    """Sample of a pick, as `sample_of` has it."""
    return pick * interval + int(np.floor(interval * (pick * ((np.sqrt(5.0) - 1.0) / 2.0) % 1.0)))


def count_revisits(
    schedule: PoseSchedule,
    pose: wp.array,
    position: wp.array,
    intensity: wp.array,
    *,
    sample_start: np.ndarray,
    pick_count: np.ndarray,
    first_sample: np.ndarray,
    first_pick: np.ndarray,
    interval: int,
    limit: int,
) -> np.ndarray:
    """Picked places that had been visited before, and samples that all had waited, int64, shape [motion, 2].

    pose: transformd, at least as many as schedule's. position [m], intensity: shape [sample, focus]. sample_start:
    offsets of motions into samples, shape [motion + 1]. pick_count, first_sample, first_pick: picks, and the numbers of
    the first sample that is given and of the first pick, of each motion. interval: samples for one pick each. limit:
    samples without a visit after which a wait ends without a visit.
    """
    device, foci, poses = position.device, position.shape[1], int(schedule.motion_start.numpy()[len(pick_count)])
    boxes = 2 * poses + int(sample_start[-1]) // 16
    skin = SkinSamples()
    skin.position, skin.intensity, skin.pose = position, intensity, pose
    skin.low, skin.high = (wp.empty((boxes, foci), dtype=wp.vec3d, device=device) for _ in range(2))
    skin.rests = wp.empty(poses, dtype=wp.int32, device=device)
    outputs = [skin.low, skin.high, skin.rests]
    wp.launch(_box_samples, poses, inputs=[schedule, skin], outputs=outputs, device=device, block_dim=BLOCK)
    picks = np.concatenate([[0], np.cumsum(pick_count)])
    starts, pick_start, samples, first = (
        wp.array(values, dtype=wp.int64, device=device) for values in (sample_start, picks, first_sample, first_pick)
    )
    rule = PickRule()
    rule.interval, rule.limit, rule.first_sample, rule.first_pick = interval, limit, samples, first
    result = wp.empty(int(picks[-1]), dtype=wp.int32, device=device)
    wait = wp.empty(int(picks[-1]), dtype=wp.int32, device=device)
    inputs = [rule, schedule, skin, starts, pick_start]
    wp.launch(_look_back, len(result), inputs=inputs, outputs=[result, wait], device=device, block_dim=BLOCK)
    sums = wp.empty((len(pick_count), 2), dtype=wp.int64, device=device)
    inputs = [pick_start, result, wait]
    wp.launch(_sum_waits, len(pick_count), inputs=inputs, outputs=[sums], device=device, block_dim=BLOCK)
    return sums.numpy()
