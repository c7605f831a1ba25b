"""Contours -> lengths by kind."""

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _measure_contours(
    # In:
    points: wp.array[wp.vec3],
    kind: wp.array[wp.uint8],
    polyline_start: wp.array[wp.int64],
    pose_start: wp.array[wp.int64],
    # Out:
    length: wp.array2d[wp.float32],  # [m], shape [pose, kind]
):
    """Sum the segments of each pose, in float64."""
    pose = wp.tid()
    total = wp.vec3d()
    for line in range(int(pose_start[pose]), int(pose_start[pose + 1])):
        base = polyline_start[line]
        for k in range(int(polyline_start[line + 1] - base) - 1):
            i = base + wp.int64(k)
            d = points[i + wp.int64(1)] - points[i]
            e = wp.vec3d(wp.float64(d[0]), wp.float64(d[1]), wp.float64(d[2]))
            total[int(kind[i])] = total[int(kind[i])] + wp.length(e)
    for k in range(3):
        length[pose, k] = wp.float32(total[k])


@on_one_device
def measure_contours(points: wp.array, kind: wp.array, polyline_start: wp.array, pose_start: wp.array) -> wp.array:
    """Length of each pose's segments by kind [m], float32, shape [pose, 3]."""
    pose_count = pose_start.shape[0] - 1
    length = wp.zeros((pose_count, 3), dtype=wp.float32, device=points.device)
    wp.launch(
        _measure_contours,
        pose_count,
        inputs=[points, kind, polyline_start, pose_start],
        outputs=[length],
        device=points.device,
        block_dim=BLOCK,
    )
    return length
