"""Contours of an object that moves: from where it was rendered to where it is."""

import numpy as np
import warp as wp

from ..contours import Contours
from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT, rotate, to_float32, to_float64

wp.set_module_options(EXACT)


@wp.kernel
def _move_contours(c: Contours, object_pose: wp.array[wp.transform], object_centre: wp.vec3d):
    """Turn each pose's points about the object's centre [m] and move them with it."""
    pose = wp.tid()
    q = wp.transform_get_rotation(object_pose[pose])
    a = to_float64(wp.vec3(q[0], q[1], q[2]))
    to = to_float64(wp.transform_get_translation(object_pose[pose]))
    begin = c.polyline_start[c.pose_start[pose]]
    for k in range(int(c.polyline_start[c.pose_start[pose + 1]] - begin)):
        i = begin + wp.int64(k)
        c.points[i] = to_float32(to + rotate(a, wp.float64(q[3]), to_float64(c.points[i]) - object_centre))


@on_one_device
def move_contours(contours: Contours, object_pose: wp.array, object_centre: np.ndarray) -> None:
    """Move the points of each pose in place with the object.

    object_pose: position of the object's centre and its rotation, wp.transform, shape [pose].
    object_centre: the point of the object as rendered that moves there [m], shape [3].
    """
    launch(_move_contours, object_pose.shape[0], [contours, object_pose, wp.vec3d(*map(float, object_centre))], [])
