"""Revisits: how long picked places on the skin have waited since they were visited before; one thread a pick.

As `RevisitWatch` in render/sampling/revisits.py. A pose has a box around the places of each focal point, and so have
sixteen samples in a row: a pick looks only into boxes that are near to its place. A pose whose focal points rest is
looked at once.
"""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import PoseSchedule
from .layout import INFINITE, ONE, ZERO
from .skin_boxes import (
    FAR,
    GROUP,
    NEAR,
    NEARBY,
    SkinSamples,
    first_box,
    first_drawn,
    frame_of,
    nearness,
    on_skin,
    square_to,
)

wp.set_module_options(EXACT)

GOLDEN = wp.constant(wp.float64((np.sqrt(5.0) - 1.0) / 2.0))
NONE, IN_VAIN, VISITED = (wp.constant(k) for k in range(3))  # results of a pick


@wp.struct
class PickRule:
    """When places are picked, and how long they may wait, in samples."""

    interval: wp.int64
    limit: wp.int64


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
def pass_rest(
    schedule: PoseSchedule, skin: SkinSamples, rule: PickRule, look: LookBack, pose: wp.int64, place: wp.vec3d
):
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
    schedule: PoseSchedule,
    skin: SkinSamples,
    rule: PickRule,
    before: LookBack,
    pose: wp.int64,
    last: wp.int64,
    place: wp.vec3d,
):
    """Go on by the samples of a pose from `last` back; box by box, and in boxes nearby one by one."""
    look = before
    frame = frame_of(skin.pose[pose])
    first = schedule.row[pose]
    end = first + schedule.count[pose] - wp.int64(1)
    row = last
    while row >= first and look.phase < 3:
        group = (row - first) / GROUP
        begin = first + group * GROUP
        near = int(NEARBY)
        if row == wp.min(begin + GROUP - wp.int64(1), end):
            near = nearness(skin, first_box(schedule, pose) + wp.int64(1) + group, place)
        if look.phase > 0 and row < look.entered - rule.limit:
            row = first - wp.int64(1)
        elif near != NEARBY:
            if near == FAR:
                look = pass_sample(look, row, INFINITE)
            row = begin - wp.int64(1)
        else:
            square = square_to(skin, frame, row, place)
            if square >= ZERO:
                look = pass_sample(look, row, square)
            row -= wp.int64(1)
    return look


@wp.func
def look_back(
    schedule: PoseSchedule,
    skin: SkinSamples,
    rule: PickRule,
    begin: wp.int64,
    own: wp.int64,
    own_pose: wp.int64,
    place: wp.vec3d,
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
        last = schedule.row[pose] - wp.int64(1)
        pose -= wp.int64(1)
    return look


@wp.func
def pose_of(schedule: PoseSchedule, motion: int, row: wp.int64):
    """Number of the pose of a motion that a sample belongs to."""
    low = schedule.motion_start[motion]
    high = schedule.motion_start[motion + 1]
    while high - low > wp.int64(1):
        middle = (low + high) / wp.int64(2)
        if schedule.row[middle] <= row:
            low = middle
        else:
            high = middle
    return low


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
    elif earliest >= begin:
        result[i] = IN_VAIN
        wait[i] = look.entered - first_drawn(skin, earliest, look.entered)


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


def count_revisits(
    schedule: PoseSchedule,
    skin: SkinSamples,
    sample_start: wp.array,
    pick_start: wp.array,
    *,
    interval: int,
    limit: int,
    rate: float,
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
    inputs = [rule, schedule, skin, sample_start, pick_start]
    wp.launch(_look_back, picks, inputs=inputs, outputs=[result, wait], device=device, block_dim=BLOCK)
    revisits = wp.empty(motion_count, dtype=wp.int64, device=device)
    time = wp.empty(motion_count, dtype=wp.float64, device=device)
    inputs = [pick_start, result, wait, wp.float64(1.0 / rate)]
    wp.launch(_sum_waits, motion_count, inputs=inputs, outputs=[revisits, time], device=device, block_dim=BLOCK)
    return revisits, time
