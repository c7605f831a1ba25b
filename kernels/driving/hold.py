"""Focal points and intensities -> what is driven: amplitudes of frames, points that are held, pressure ratios."""

from typing import NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

TARGET_STEPS = 1 << 16  # pressure ratios are rounded to 1 / this, so that modulated frames with equal ratios stay equal


@wp.struct
class FocalBox:
    """Where an array can focus."""

    turn: wp.mat33d  # common frame -> its own
    middle: wp.vec3d  # of its face, common frame [m]
    lateral: wp.float32  # bound of |x| and |y|, own frame [m]
    low: wp.float32  # bounds of z [m]
    high: wp.float32


@wp.struct
class IntensityRule:
    """What arrays make of intensities."""

    intensity_most: wp.float32  # larger ones are refused
    amplitude_most: wp.float32  # amplitude of intensity 1
    is_force: wp.int32  # 1: an intensity is a force, so its root is the pressure


@wp.func
def is_within(box: FocalBox, x: wp.vec3):
    """Whether an array can focus at a point; NaN is in no box, as comparisons with it are false."""
    own = box.turn * (wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2])) - box.middle)
    a = wp.abs(wp.float32(own[0]))
    b = wp.abs(wp.float32(own[1]))
    z = wp.float32(own[2])
    return a <= box.lateral and b <= box.lateral and z >= box.low and z <= box.high


@wp.func
def pressure_of(boxes: wp.array[FocalBox], rule: IntensityRule, x: wp.vec3, intensity: wp.float32):
    """Relative pressure 0..1 of a focal point; -1 for one out of reach of all arrays, or whose intensity is none."""
    value = wp.float32(-1.0)
    if intensity >= 0.0 and intensity <= rule.intensity_most:
        for k in range(boxes.shape[0]):
            if value < 0.0 and is_within(boxes[k], x):
                value = wp.min(intensity, 1.0)
                if rule.is_force != 0:
                    value = wp.sqrt(value)
    return value


@wp.kernel
def _weigh_frames(
    # In:
    point: wp.array2d[wp.vec3],  # [m], shape [frame, focus]
    intensity: wp.array2d[wp.float32],
    boxes: wp.array[FocalBox],
    rule: IntensityRule,
    # Out:
    pressure: wp.array2d[wp.float32],  # relative, shape [frame, focus]
    usable: wp.array2d[wp.int32],  # shape [focus + 1, frame]: points that can be played; frames that sound
    amplitude: wp.array[wp.float32],  # 0..1 of each frame: the greatest of its points
    refused: wp.array[wp.int64],  # of one value: points that are silenced
):
    """Pressures of the focal points of a frame."""
    i = wp.tid()
    count = point.shape[1]
    most = float(0.0)
    for m in range(count):
        value = pressure_of(boxes, rule, point[i, m], intensity[i, m])
        if value < 0.0 and intensity[i, m] != 0.0:
            wp.atomic_add(refused, 0, wp.int64(1))
        usable[m, i] = wp.where(value < 0.0, 0, 1)
        pressure[i, m] = wp.max(value, 0.0)
        most = wp.max(most, value)
    usable[count, i] = wp.where(most > 0.0, 1, 0)
    amplitude[i] = most * rule.amplitude_most


@wp.kernel
def _list_usable(
    usable: wp.array[wp.int32],
    running: wp.array[wp.int32],  # how many are usable up to each, itself included
    listed: wp.array[wp.int32],  # indices of those that are
):
    """Index of each usable entry, one after the other."""
    i = wp.tid()
    if usable[i] != 0:
        listed[running[i] - 1] = i


@wp.func
def last_usable(running: wp.array2d[wp.int32], listed: wp.array[wp.int32], row: int, frame: int):
    """Last frame up to this one that is usable in a row; below 0 for none."""
    count = running[row, frame]
    if count == 0:
        return -1
    return listed[count - 1] - row * running.shape[1]  # one of a row before is below 0


@wp.func
def rests_before(rest_start: wp.array[wp.int32], frame: int):
    """How many times the frames up to this one have begun from rest anew."""
    low = int(0)
    high = rest_start.shape[0]
    while low < high:
        middle = (low + high) // 2
        if rest_start[middle] <= frame:
            low = middle + 1
        else:
            high = middle
    return low


@wp.kernel
def _hold_points(
    # In:
    point: wp.array2d[wp.vec3],  # [m], shape [frame, focus]
    pressure: wp.array2d[wp.float32],
    running: wp.array2d[wp.int32],  # shape [focus + 1, frame]
    listed: wp.array[wp.int32],
    held_point: wp.array[wp.vec3],  # of the frame before the first, shape [focus]
    held_target: wp.array[wp.float32],
    rest_start: wp.array[wp.int32],  # frames that begin from rest anew
    rest: wp.vec3,  # aim at rest [m]
    # Out:
    out: wp.array2d[wp.vec3],  # [m], shape [frame, focus or more]
    target: wp.array2d[wp.float32],  # pressures relative to the greatest of a frame
):
    """Points and targets of a frame; points beyond the focal points repeat the first, with target 0."""
    i = wp.tid()
    count = point.shape[1]
    rests = rests_before(rest_start, i)
    begin = int(0)
    if rests > 0:
        begin = rest_start[rests - 1]
    sounding = last_usable(running, listed, count, i)
    most = float(0.0)
    if sounding >= begin:
        for m in range(count):
            most = wp.max(most, pressure[sounding, m])
    for m in range(out.shape[1]):
        if m < count:
            x = rest
            ratio = float(1.0)
            if rests == 0:
                x = held_point[m]
                ratio = held_target[m]
            last = last_usable(running, listed, m, i)
            if last >= begin:
                x = point[last, m]
            if sounding >= begin:
                steps = wp.rint(pressure[sounding, m] / most * wp.float32(TARGET_STEPS))
                ratio = steps / wp.float32(TARGET_STEPS)
            out[i, m] = x
            target[i, m] = ratio
        else:
            out[i, m] = out[i, 0]
            target[i, m] = 0.0


class HeldFrames(NamedTuple):
    """Frames of several focal points as solvers take them."""

    point: wp.array
    """vec3 [m], shape [frame, size]."""
    target: wp.array
    """Pressure relative to the greatest of the frame, float32, shape [frame, size]."""
    amplitude: wp.array
    """0..1 of each frame, float32; 0 is silence."""
    refused: int
    """Focal points that are silenced."""


@on_one_device
def hold_points(
    point: wp.array,
    intensity: wp.array,
    boxes: wp.array,
    rule: IntensityRule,
    held: tuple[wp.array, ...],
    *,
    size: int,
    rest_start: wp.array,
    rest: tuple[float, float, float],
) -> HeldFrames:
    """Points, targets and amplitudes of frames, of which `size` points are solved, as many as given at least.

    point: vec3 [m], shape [frame, focus]; intensity: float32, the same shape; one frame at least. A point out of reach
    of all `boxes`, or whose intensity is below 0, above `rule.intensity_most` or not finite, is silenced: it aims where
    it did last, with target 0, and counts unless its intensity is 0. A silent frame keeps the targets of the last that
    sounds. held: points and targets of the frame before the first, shape [focus]. rest_start: increasing numbers of
    frames, int32, before which nothing counts: points aim at `rest` [m] until they can be played, with target 1.
    """
    (frame_count, count), device = point.shape, point.device
    pressure = wp.empty(point.shape, dtype=wp.float32, device=device)
    usable = wp.empty((count + 1, frame_count), dtype=wp.int32, device=device)
    amplitude = wp.empty(frame_count, dtype=wp.float32, device=device)
    refused = wp.zeros(1, dtype=wp.int64, device=device)
    inputs, outputs = [point, intensity, boxes, rule], [pressure, usable, amplitude, refused]
    wp.launch(_weigh_frames, frame_count, inputs, outputs, device=device, block_dim=BLOCK)
    running, listed = wp.empty_like(usable), wp.empty(usable.size, dtype=wp.int32, device=device)
    wp.utils.array_scan(usable.flatten(), running.flatten(), inclusive=True)
    inputs = [usable.flatten(), running.flatten()]
    wp.launch(_list_usable, usable.size, inputs, [listed], device=device, block_dim=BLOCK)
    out = wp.empty((frame_count, size), dtype=wp.vec3, device=device)
    target = wp.empty((frame_count, size), dtype=wp.float32, device=device)
    inputs = [point, pressure, running, listed, *held, rest_start, wp.vec3(*rest)]
    wp.launch(_hold_points, frame_count, inputs, [out, target], device=device, block_dim=BLOCK)
    return HeldFrames(out, target, amplitude, int(refused.numpy()[0]))
