"""Contours of many poses as kernels take and give them: one struct, whose columns are those of a ContourBatch."""

import warp as wp


@wp.struct
class Contours:
    """Polylines of many poses, ragged; a column of length 0 stands for what the batch does not have."""

    points: wp.array[wp.vec3]  # vertices of polylines [m], array frame, shape [point]
    kind: wp.array[wp.uint8]  # of the segment that starts here: 0 object, 1 hand, 2 made; a last point repeats it
    intensity: wp.array[wp.float32]  # 0..1 at each point, linear in between; of length 0: 1 everywhere
    dwell: wp.array[wp.float32]  # pause of the focal point at each point [s]; of length 0: none
    polyline_start: wp.array[wp.int64]  # offsets into points, shape [polyline + 1]
    polyline_patch: wp.array[wp.int32]  # of the hand, shape [polyline]
    polyline_closed: wp.array[wp.uint8]  # 1: closed, and its last point repeats its first
    pose_start: wp.array[wp.int64]  # offsets into polylines, shape [pose + 1]
