"""Contours of an object that moves: from where it was rendered to where it is."""

import numpy as np
import warp as wp

from ..contours import Contours
from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT, rotate, to_float32, to_float64

wp.set_module_options(EXACT)


@wp.kernel
def _move_contours(c: Contours, moved: wp.array[wp.transform], pivot: wp.vec3d):
    """Turn each pose's points about the pivot [m] and move them with it."""
    pose = wp.tid()
    q = wp.transform_get_rotation(moved[pose])
    a = to_float64(wp.vec3(q[0], q[1], q[2]))
    to = to_float64(wp.transform_get_translation(moved[pose]))
    begin = c.polyline_start[c.pose_start[pose]]
    for k in range(int(c.polyline_start[c.pose_start[pose + 1]] - begin)):
        i = begin + wp.int64(k)
        c.points[i] = to_float32(to + rotate(a, wp.float64(q[3]), to_float64(c.points[i]) - pivot))


@on_one_device
def move_contours(contours: Contours, moved: wp.array, pivot: np.ndarray) -> None:
    """Move the points of each pose in place by its transform in `moved`, wp.transform, shape [pose].

    pivot: where the transforms' origin is among the points [m], shape [3].
    """
    launch(_move_contours, moved.shape[0], [contours, moved, wp.vec3d(*map(float, pivot))], [])
