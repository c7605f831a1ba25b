"""Contours of an object that moves: from where it was rendered to where it is."""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT, rotate, to_float32, to_float64

wp.set_module_options(EXACT)


@wp.kernel
def _move_contours(
    # In:
    polyline_start: wp.array[wp.int64],
    pose_start: wp.array[wp.int64],
    moved: wp.array[wp.transform],  # where the pivot is and how the object is turned, shape [pose]
    pivot: wp.vec3d,  # [m]
    # Out:
    points: wp.array[wp.vec3],
):
    """Turn each pose's points about the pivot and move them with it."""
    pose = wp.tid()
    q = wp.transform_get_rotation(moved[pose])
    a = to_float64(wp.vec3(q[0], q[1], q[2]))
    to = to_float64(wp.transform_get_translation(moved[pose]))
    begin = polyline_start[pose_start[pose]]
    for k in range(int(polyline_start[pose_start[pose + 1]] - begin)):
        i = begin + wp.int64(k)
        points[i] = to_float32(to + rotate(a, wp.float64(q[3]), to_float64(points[i]) - pivot))


@on_one_device
def move_contours(
    points: wp.array, polyline_start: wp.array, pose_start: wp.array, moved: wp.array, pivot: np.ndarray
) -> None:
    """Move contours in place: points [m], vec3, of each pose by its transform in `moved`, wp.transform, shape [pose].

    pivot: where the transforms' origin is among the points [m], shape [3].
    """
    wp.launch(
        _move_contours,
        moved.shape[0],
        inputs=[polyline_start, pose_start, moved, wp.vec3d(*map(float, pivot))],
        outputs=[points],
        device=points.device,
        block_dim=BLOCK,
    )
