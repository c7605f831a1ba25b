"""Focal points and intensities -> amplitudes; of several a frame, also what is solved: held points, pressure ratios."""

from typing import NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

TARGET_STEPS = 1 << 16  # pressure ratios are rounded to 1 / this, so that modulated frames with equal ratios stay equal


@wp.struct
class FocalBox:
    """Where an array can focus, and what it makes of intensities."""

    turn: wp.mat33d  # common frame -> its own
    middle: wp.vec3d  # of its face, common frame [m]
    lateral: wp.float32  # bound of |x| and |y|, own frame [m]
    low: wp.float32  # bounds of z [m]
    high: wp.float32
    intensity_most: wp.float32  # larger ones are refused
    level_most: wp.float32  # amplitude of intensity 1
    is_force: wp.int32  # 1: an intensity is a force, so its root is the pressure


@wp.func
def pressure_of(box: FocalBox, x: wp.vec3, intensity: wp.float32):
    """Relative pressure 0..1 of a focal point; -1 for one out of reach, or whose intensity is none."""
    own = box.turn * (wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2])) - box.middle)
    a = wp.abs(wp.float32(own[0]))
    b = wp.abs(wp.float32(own[1]))
    z = wp.float32(own[2])
    value = wp.float32(-1.0)
    # comparisons with NaN are false
    if a <= box.lateral and b <= box.lateral and z >= box.low and z <= box.high:
        if intensity >= 0.0 and intensity <= box.intensity_most:
            value = wp.min(intensity, 1.0)
            if box.is_force != 0:
                value = wp.sqrt(value)
    return value


@wp.kernel
def _weigh_points(
    point: wp.array[wp.vec3],  # [m]
    intensity: wp.array[wp.float32],
    box: FocalBox,
    level: wp.array[wp.float32],  # amplitude 0..1
    refused: wp.array[wp.int64],  # of one value: points that are silenced
):
    """Amplitude of each focal point; 0 for one that is out of reach, or whose intensity is none."""
    i = wp.tid()
    value = pressure_of(box, point[i], intensity[i])
    level[i] = wp.max(value, 0.0) * box.level_most
    if value < 0.0 and intensity[i] != 0.0:
        wp.atomic_add(refused, 0, wp.int64(1))


@wp.kernel
def _weigh_frames(
    # In:
    point: wp.array2d[wp.vec3],  # [m], shape [frame, focus]
    intensity: wp.array2d[wp.float32],
    box: FocalBox,
    # Out:
    pressure: wp.array2d[wp.float32],  # relative, shape [frame, focus]
    usable: wp.array2d[wp.int32],  # shape [focus + 1, frame]: points that can be played; frames that sound
    level: wp.array[wp.float32],  # amplitude 0..1 of each frame: the greatest of its points
    refused: wp.array[wp.int64],  # of one value: points that are silenced
):
    """Pressures of the focal points of a frame."""
    i = wp.tid()
    count = point.shape[1]
    most = float(0.0)
    for m in range(count):
        value = pressure_of(box, point[i, m], intensity[i, m])
        if value < 0.0 and intensity[i, m] != 0.0:
            wp.atomic_add(refused, 0, wp.int64(1))
        usable[m, i] = wp.where(value < 0.0, 0, 1)
        pressure[i, m] = wp.max(value, 0.0)
        most = wp.max(most, value)
    usable[count, i] = wp.where(most > 0.0, 1, 0)
    level[i] = most * box.level_most


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


@wp.kernel
def _hold_points(
    # In:
    point: wp.array2d[wp.vec3],  # [m], shape [frame, focus]
    pressure: wp.array2d[wp.float32],
    running: wp.array2d[wp.int32],  # shape [focus + 1, frame]
    listed: wp.array[wp.int32],
    held_point: wp.array[wp.vec3],  # of the frame before the first, shape [focus]
    held_target: wp.array[wp.float32],
    # Out:
    out: wp.array2d[wp.vec3],  # [m], shape [frame, focus or more]
    target: wp.array2d[wp.float32],  # pressures relative to the greatest of a frame
):
    """Points and targets of a frame; points beyond the focal points repeat the first, with target 0."""
    i = wp.tid()
    count = point.shape[1]
    sounding = last_usable(running, listed, count, i)
    most = float(0.0)
    if sounding >= 0:
        for m in range(count):
            most = wp.max(most, pressure[sounding, m])
    for m in range(out.shape[1]):
        if m < count:
            x = held_point[m]
            last = last_usable(running, listed, m, i)
            if last >= 0:
                x = point[last, m]
            out[i, m] = x
            target[i, m] = held_target[m]
            if sounding >= 0:
                steps = wp.rint(pressure[sounding, m] / most * wp.float32(TARGET_STEPS))
                target[i, m] = steps / wp.float32(TARGET_STEPS)
        else:
            out[i, m] = out[i, 0]
            target[i, m] = 0.0


class HeldFrames(NamedTuple):
    """Frames of several focal points as solvers take them."""

    point: wp.array
    """vec3 [m], shape [frame, size]."""
    target: wp.array
    """Pressure relative to the greatest of the frame, float32, shape [frame, size]."""
    level: wp.array
    """Amplitude 0..1 of each frame, float32; 0 is silence."""
    refused: int
    """Focal points that are silenced."""


@on_one_device
def weigh_points(point: wp.array, intensity: wp.array, box: FocalBox) -> tuple[wp.array, int]:
    """Amplitudes 0..1, float32, of focal points, vec3 [m], with intensities, float32; and how many are silenced.

    All of shape [frame], on one device. Points out of reach, and those with intensities below 0, above
    `box.intensity_most` or not finite, get amplitude 0; with an intensity other than 0 they count.
    """
    count, device = point.shape[0], point.device
    level = wp.empty(count, dtype=wp.float32, device=device)
    refused = wp.zeros(1, dtype=wp.int64, device=device)
    wp.launch(
        _weigh_points, count, inputs=[point, intensity, box], outputs=[level, refused], device=device, block_dim=BLOCK
    )
    return level, int(refused.numpy()[0])


@on_one_device
def hold_points(
    point: wp.array, intensity: wp.array, box: FocalBox, held: tuple[wp.array, ...], *, size: int
) -> HeldFrames:
    """Points, targets and amplitudes of frames of several focal points, of which `size` are solved, more than given.

    point: vec3 [m], shape [frame, focus]; intensity: float32, the same shape; one frame at least. A point that
    `weigh_points` would silence aims where it did last, with target 0; a silent frame keeps the targets of the last
    that sounds. held: points and targets of the frame before the first, shape [focus].
    """
    (frame_count, count), device = point.shape, point.device
    pressure = wp.empty(point.shape, dtype=wp.float32, device=device)
    usable = wp.empty((count + 1, frame_count), dtype=wp.int32, device=device)
    level = wp.empty(frame_count, dtype=wp.float32, device=device)
    refused = wp.zeros(1, dtype=wp.int64, device=device)
    outputs = [pressure, usable, level, refused]
    wp.launch(
        _weigh_frames, frame_count, inputs=[point, intensity, box], outputs=outputs, device=device, block_dim=BLOCK
    )
    running, listed = wp.empty_like(usable), wp.empty(usable.size, dtype=wp.int32, device=device)
    wp.utils.array_scan(usable.flatten(), running.flatten(), inclusive=True)
    inputs = [usable.flatten(), running.flatten()]
    wp.launch(_list_usable, usable.size, inputs=inputs, outputs=[listed], device=device, block_dim=BLOCK)
    out = wp.empty((frame_count, size), dtype=wp.vec3, device=device)
    target = wp.empty((frame_count, size), dtype=wp.float32, device=device)
    inputs = [point, pressure, running, listed, *held]
    wp.launch(_hold_points, frame_count, inputs=inputs, outputs=[out, target], device=device, block_dim=BLOCK)
    return HeldFrames(out, target, level, int(refused.numpy()[0]))
