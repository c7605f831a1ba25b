"""Contours -> lengths by kind."""

import warp as wp

from ..contours import Contours
from ..offsets import launch
from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _measure_contours(c: Contours, length: wp.array2d[wp.float32]):
    """Sum the segments of each pose, in float64; length: [m], shape [pose, kind]."""
    pose = wp.tid()
    total = wp.vec3d()
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        base = c.polyline_start[line]
        for k in range(int(c.polyline_start[line + 1] - base) - 1):
            i = base + wp.int64(k)
            d = c.points[i + wp.int64(1)] - c.points[i]
            e = wp.vec3d(wp.float64(d[0]), wp.float64(d[1]), wp.float64(d[2]))
            total[int(c.kind[i])] = total[int(c.kind[i])] + wp.length(e)
    for k in range(3):
        length[pose, k] = wp.float32(total[k])


def measure_contours(contours: Contours) -> wp.array:
    """Length of each pose's segments by kind [m], float32, shape [pose, 3]."""
    pose_count = contours.pose_start.shape[0] - 1
    length = wp.zeros((pose_count, 3), dtype=wp.float32, device=contours.points.device)
    launch(_measure_contours, pose_count, [contours], [length])
    return length
