"""Frames of an array that takes focal points, point after point in float64: what docs/formats/focal-points.md says."""

import math
import struct

import numpy as np
from scipy.spatial.transform import Rotation

REST = (0.0, 0.0, 0.2)  # [m]; where a point aims before its first place


def in_own_frame(place, pose):
    """A place of the common frame [m] in the frame of an array at a pose (position, quaternion xyzw), float64."""
    offset = np.asarray(place, np.float64) - np.asarray(pose[:3], np.float64)
    return Rotation.from_quat(pose[3:]).inv().apply(offset)


def is_in_reach(place, pose, zone):
    """Whether an array focuses there: its zone is judged by float32 values, as points are."""
    if not all(map(math.isfinite, place)):
        return False
    x, y, z = (float(np.float32(value)) for value in in_own_frame(place, pose))
    lateral, low, high = (float(np.float32(value)) for value in (zone.lateral, zone.z_min, zone.z_max))
    return abs(x) <= lateral and abs(y) <= lateral and low <= z <= high


def focus_frames(position, intensity, *, pose, zone, count, is_force=False, level_max=1.0):
    """Values of each frame, shape [frame, count, 4], and how many points were refused.

    position [m], shape [frame, focus, 3]; intensity, shape [frame, focus].
    """
    frames, refused = np.zeros((len(position), count, 4)), 0
    aims = [REST] * count
    for number, (places, levels) in enumerate(zip(position.tolist(), intensity.tolist(), strict=True)):
        for focus, (place, level) in enumerate(zip(places, levels, strict=True)):
            is_played = 0 <= level <= 1.000001 and is_in_reach(place, pose, zone)
            refused += not is_played and level != 0
            if is_played:
                aims[focus] = place
                pressure = min(level, 1.0)
                frames[number, focus, 3] = level_max * (math.sqrt(pressure) if is_force else pressure)
            frames[number, focus, :3] = in_own_frame(aims[focus], pose)
        for focus in range(len(places), count):  # points of a frame that nothing is asked of
            frames[number, focus, :3] = frames[number, 0, :3]
    return frames, refused


def unpacked(frame, count):
    """x, y, z [m] and intensity of each focal point of a frame's bytes, as a program reads them."""
    assert len(frame) == 16 * count
    return [struct.unpack_from("<4f", frame, 16 * focus) for focus in range(count)]
