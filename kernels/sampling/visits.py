"""Revisits: how long picked places on the skin have waited since they were visited before; one thread a pick.

As `RevisitWatch` in render/sampling/revisits.py. Sixteen samples in a row have a box: a pick looks only into boxes that
are near to its place.
"""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import PoseSchedule
from .layout import INFINITE, ONE, TWO, ZERO

wp.set_module_options(EXACT)

GOLDEN = wp.constant(wp.float64((np.sqrt(5.0) - 1.0) / 2.0))
REVISIT_RADIUS = 5e-3  # [m], as in render/sampling/revisits.py
NEAR = wp.constant(wp.float64(REVISIT_RADIUS**2))  # [m^2]
SURELY_NEAR = wp.constant(wp.float64((1.001 * REVISIT_RADIUS) ** 2))  # [m^2]; no rounding leaves a near sample out
BOX = wp.constant(wp.int64(16))  # samples
NONE, IN_VAIN, VISITED = (wp.constant(k) for k in range(3))  # results of a pick


@wp.struct
class SkinSamples:
    """Focal points on the skin, and the boxes around them."""

    point: wp.array2d[wp.vec3d]  # [m], hand frame, shape [sample, focus]
    intensity: wp.array2d[wp.float32]
    low: wp.array[wp.vec3d]  # of the drawn samples in a box [m]; above `high` where there are none
    high: wp.array[wp.vec3d]


@wp.struct
class PickRule:
    """When places are picked, and how long they may wait, in samples."""

    interval: wp.int64
    limit: wp.int64


@wp.kernel
def _move_to_skin(
    # In:
    schedule: PoseSchedule,
    pose: wp.array[wp.transformd],
    position: wp.array2d[wp.vec3],  # [m], array frame, shape [sample, focus]
    # Out:
    point: wp.array2d[wp.vec3d],  # [m], hand frame
):
    """Move the focal points of a pose into the hand frame."""
    i = wp.tid()
    q = wp.transform_get_rotation(pose[i])
    at = wp.transform_get_translation(pose[i])
    x = q[0]
    y = q[1]
    z = q[2]
    w = q[3]
    across = wp.vec3d(ONE - TWO * (y * y + z * z), TWO * (x * y + z * w), TWO * (x * z - y * w))
    up = wp.vec3d(TWO * (x * y - z * w), ONE - TWO * (x * x + z * z), TWO * (y * z + x * w))
    along = wp.vec3d(TWO * (x * z + y * w), TWO * (y * z - x * w), ONE - TWO * (x * x + y * y))
    row = schedule.row[i]
    stop = row + schedule.count[i]
    while row < stop:
        for focus in range(position.shape[1]):
            p = position[row, focus]
            off = wp.vec3d(wp.float64(p[0]) - at[0], wp.float64(p[1]) - at[1], wp.float64(p[2]) - at[2])
            point[row, focus] = wp.vec3d(in_order(across, off), in_order(up, off), in_order(along, off))
        row += wp.int64(1)


@wp.func
def in_order(a: wp.vec3d, b: wp.vec3d):
    """Scalar product, summed in order."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


@wp.kernel
def _box_samples(
    # In:
    skin: SkinSamples,
    # Out:
    low: wp.array[wp.vec3d],
    high: wp.array[wp.vec3d],
):
    """Put a box around samples in a row."""
    box = wp.tid()
    least = wp.vec3d(INFINITE, INFINITE, INFINITE)
    most = -least
    row = wp.int64(box) * BOX
    stop = wp.min(row + BOX, wp.int64(skin.point.shape[0]))
    while row < stop:
        for focus in range(skin.point.shape[1]):
            if skin.intensity[row, focus] > 0.0:
                least = wp.min(least, skin.point[row, focus])
                most = wp.max(most, skin.point[row, focus])
        row += wp.int64(1)
    low[box] = least
    high[box] = most


@wp.func
def is_far(skin: SkinSamples, box: wp.int64, place: wp.vec3d):
    """Whether no sample in a box is near a place."""
    if skin.low[box][0] > skin.high[box][0]:
        return True
    off = wp.max(wp.max(skin.low[box] - place, place - skin.high[box]), wp.vec3d(ZERO, ZERO, ZERO))
    return in_order(off, off) >= SURELY_NEAR


@wp.func
def square_to(skin: SkinSamples, row: wp.int64, place: wp.vec3d):
    """Square distance of the nearest drawn focal point of a sample from a place [m^2]; negative if none is drawn."""
    least = -ONE
    for focus in range(skin.point.shape[1]):
        if skin.intensity[row, focus] > 0.0:
            off = skin.point[row, focus] - place
            square = in_order(off, off)
            if least < ZERO or square < least:
                least = square
    return least


@wp.struct
class LookBack:
    """A walk back in time from a pick, over the visit under way, 0, between visits, 1, or over the one before, 2."""

    phase: wp.int32
    entered: wp.int64  # first sample of the visit under way
    now: wp.int64  # its moment: the first sample that is nearest to the place
    now_square: wp.float64  # [m^2]
    then: wp.int64  # moment of the visit before
    then_square: wp.float64  # [m^2]


@wp.func
def pass_sample(look: LookBack, row: wp.int64, square: wp.float64):
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
def look_back(skin: SkinSamples, rule: PickRule, begin: wp.int64, own: wp.int64, place: wp.vec3d):
    """Walk back from a sample; begin: the first sample of the motion. Phase 4: the visit has lasted for too long."""
    look = LookBack()
    look.now_square = INFINITE
    look.then_square = INFINITE
    look.entered = own
    row = own
    while row >= begin and look.phase < 3:
        if look.phase > 0 and row < look.entered - rule.limit:
            row = begin - wp.int64(1)
        elif row % BOX == BOX - wp.int64(1) and row - row % BOX >= begin and is_far(skin, row / BOX, place):
            box = row / BOX
            if skin.low[box][0] <= skin.high[box][0]:
                look = pass_sample(look, row, INFINITE)
            row = box * BOX - wp.int64(1)
        else:
            square = square_to(skin, row, place)
            if square >= ZERO:
                look = pass_sample(look, row, square)
            row -= wp.int64(1)
        if own - look.entered > rule.limit:
            look.phase = 4
    return look


@wp.func
def wait_in_vain(skin: SkinSamples, first: wp.int64, entered: wp.int64):
    """Samples from the first drawn one at or behind `first` until a visit."""
    row = first
    drawn = int(0)
    while row < entered and drawn == 0:
        for focus in range(skin.point.shape[1]):
            if skin.intensity[row, focus] > 0.0:
                drawn = int(1)
        if drawn == 0:
            row += wp.int64(1)
    return entered - row


@wp.kernel
def _look_back(
    # In:
    rule: PickRule,
    skin: SkinSamples,
    sample_start: wp.array[wp.int64],  # offsets of motions into samples, shape [motion + 1]
    pick_start: wp.array[wp.int64],  # offsets of motions into picks, shape [motion + 1]
    # Out:
    result: wp.array[wp.int32],  # NONE, IN_VAIN or VISITED, shape [pick]
    wait: wp.array[wp.int64],  # samples
):
    """Find how long the place of a pick has waited."""
    i = wp.int64(wp.tid())
    motion = wp.lower_bound(pick_start, i + wp.int64(1)) - 1
    begin = sample_start[motion]
    pick = i - pick_start[motion]
    share = wp.mod(wp.float64(pick) * GOLDEN, ONE)
    own = begin + pick * rule.interval + wp.int64(wp.floor(wp.float64(rule.interval) * share))
    result[i] = NONE
    wait[i] = wp.int64(0)
    if own >= sample_start[motion + 1]:
        return
    focus = int(pick % wp.int64(skin.point.shape[1]))
    if not skin.intensity[own, focus] > 0.0:
        return
    look = look_back(skin, rule, begin, own, skin.point[own, focus])
    if look.phase == 4:
        return
    earliest = look.entered - rule.limit
    if look.then_square < INFINITE:
        result[i] = VISITED
        wait[i] = look.now - look.then
    elif earliest >= begin:
        result[i] = IN_VAIN
        wait[i] = wait_in_vain(skin, earliest, look.entered)


@wp.kernel
def _sum_waits(
    # In:
    pick_start: wp.array[wp.int64],
    result: wp.array[wp.int32],
    wait: wp.array[wp.int64],
    period: wp.float64,  # of samples [s]
    # Out:
    revisits: wp.array[wp.int64],  # shape [motion]
    time: wp.array[wp.float64],  # that places had waited [s]
):
    """Sum the picks of a motion in turn."""
    motion = wp.tid()
    total = ZERO
    count = wp.int64(0)
    pick = pick_start[motion]
    while pick < pick_start[motion + 1]:
        if result[pick] != NONE:
            total += wp.float64(wait[pick]) * period
            if result[pick] == VISITED:
                count += wp.int64(1)
        pick += wp.int64(1)
    revisits[motion] = count
    time[motion] = total


def skin_samples(schedule: PoseSchedule, pose: wp.array, position: wp.array, intensity: wp.array) -> SkinSamples:
    """Focal points in the hand frame, and the boxes around them."""
    device, count = position.device, position.shape[0]
    boxes = -(-count // 16)
    skin = SkinSamples()
    skin.intensity = intensity
    skin.point = wp.empty(position.shape, dtype=wp.vec3d, device=device)
    skin.low = wp.empty(boxes, dtype=wp.vec3d, device=device)
    skin.high = wp.empty(boxes, dtype=wp.vec3d, device=device)
    inputs = [schedule, pose, position]
    wp.launch(_move_to_skin, pose.shape[0], inputs=inputs, outputs=[skin.point], device=device, block_dim=BLOCK)
    wp.launch(_box_samples, boxes, inputs=[skin], outputs=[skin.low, skin.high], device=device, block_dim=BLOCK)
    return skin


def count_revisits(
    skin: SkinSamples, sample_start: wp.array, pick_start: wp.array, *, interval: int, limit: int, rate: float
) -> tuple[wp.array, wp.array]:
    """Picked places that had been visited before, and how long all had waited [s], of each motion.

    sample_start, pick_start: offsets of motions into samples and into picks, of which there is one in each `interval`
    samples. limit: samples without a visit after which a place waits in vain. rate: of samples [Hz].
    """
    device, motion_count = sample_start.device, sample_start.shape[0] - 1
    rule = PickRule()
    rule.interval, rule.limit = interval, limit
    picks = int(pick_start[-1:].numpy()[0])
    result = wp.empty(picks, dtype=wp.int32, device=device)
    wait = wp.empty(picks, dtype=wp.int64, device=device)
    inputs = [rule, skin, sample_start, pick_start]
    wp.launch(_look_back, picks, inputs=inputs, outputs=[result, wait], device=device, block_dim=BLOCK)
    revisits = wp.empty(motion_count, dtype=wp.int64, device=device)
    time = wp.empty(motion_count, dtype=wp.float64, device=device)
    inputs = [pick_start, result, wait, wp.float64(1.0 / rate)]
    wp.launch(_sum_waits, motion_count, inputs=inputs, outputs=[revisits, time], device=device, block_dim=BLOCK)
    return revisits, time
