"""Poses in float32, as hands have them -> in float64, as focal points are placed with."""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _widen_poses(pose: wp.array[wp.transform], wide: wp.array[wp.transformd]):
    """Each number exactly."""
    i = wp.tid()
    p = wp.transform_get_translation(pose[i])
    q = wp.transform_get_rotation(pose[i])
    at = wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))
    wide[i] = wp.transformd(at, wp.quatd(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2]), wp.float64(q[3])))


def widen_poses(pose: np.ndarray | wp.array, device: str) -> wp.array:
    """Poses on a device as transformd, shape [pose]. pose: wp.transform or transformd, or numbers, shape [pose, 7]."""
    if not isinstance(pose, wp.array):
        return wp.array(np.asarray(pose, np.float64).reshape(-1, 7), dtype=wp.transformd, device=device)
    if pose.dtype == wp.transformd:
        return pose.to(device)
    wide = wp.empty(pose.shape[0], dtype=wp.transformd, device=device)
    wp.launch(_widen_poses, pose.shape[0], inputs=[pose.to(device)], outputs=[wide], device=device, block_dim=BLOCK)
    return wide
