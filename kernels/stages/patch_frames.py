"""Frames of a rigid hand's patches at poses, made on the device."""

from typing import Any

import warp as wp

from ..one_device import on_one_device
from ..patch import EXACT, to_float64
from .cut import launch
from .prune import Patches

wp.set_module_options(EXACT)


@wp.func
def turn_by(a: wp.vec3d, w: wp.float64, x: wp.vec3d):
    """Rotate x by the unit quaternion (a, w), by the same operations as `datasets.rigid.rotate`."""
    across = wp.cross(a, x)
    return x + wp.float64(2.0) * (w * across + wp.cross(a, across))


@wp.kernel
def _place_patches(
    # In:
    pose: wp.array[wp.transform],  # hand frame -> array frame, rotation of any norm
    rest: Patches,  # of one pose, in the hand's frame
    # Out:
    placed: Patches,
):
    """Turn and move a patch's frame with the hand."""
    row, patch = wp.tid()
    q = wp.transform_get_rotation(pose[row])
    x = wp.float64(q[0])
    y = wp.float64(q[1])
    z = wp.float64(q[2])
    w = wp.float64(q[3])
    size = wp.sqrt(x * x + y * y + z * z + w * w)
    a = wp.vec3d(x / size, y / size, z / size)
    w = w / size
    place = to_float64(wp.transform_get_translation(pose[row]))
    placed.origin[row, patch] = place + turn_by(a, w, rest.origin[0, patch])
    placed.u[row, patch] = turn_by(a, w, rest.u[0, patch])
    placed.v[row, patch] = turn_by(a, w, rest.v[0, patch])
    placed.n[row, patch] = turn_by(a, w, rest.n[0, patch])


@on_one_device
def place_patches(pose: wp.array, rest: Any) -> Any:
    """Patches of a rigid hand at poses, `Patches`; rest: those of one pose, in the hand's frame, on the same device.

    pose: hand frame -> array frame, wp.transform, shape [pose].
    """
    shape, placed = (pose.shape[0], rest.origin.shape[1]), Patches()
    for name in ("origin", "u", "v", "n"):
        setattr(placed, name, wp.empty(shape, dtype=wp.vec3d, device=pose.device))
    placed.half = rest.half
    launch(_place_patches, shape, [pose, rest], [placed])
    return placed
