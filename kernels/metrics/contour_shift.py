"""Whether contours move farther from a pose to the next than a focal point may step.

A point's shift is its distance from the nearest point of the next pose's contours. Contours that appear there do not
count; those that disappear do, as the focal point that draws them must continue elsewhere.
"""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, to_float64

wp.set_module_options(EXACT)


@wp.func
def is_near(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, limit: wp.float64):
    """Whether a point is within a distance of a segment."""
    along = b - a
    share = wp.dot(p - a, along) / wp.max(wp.dot(along, along), wp.float64(1.0e-30))
    off = p - a - wp.clamp(share, wp.float64(0.0), wp.float64(1.0)) * along
    return wp.dot(off, off) <= limit * limit


@wp.func
def find_near(
    p: wp.vec3d,
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    begin: wp.int64,
    end: wp.int64,
    limit: wp.float64,
):
    """First point of a segment of polylines begin..end - 1 that is within a distance of a point; -1: there is none."""
    line = begin
    while line < end:
        i = polyline_start[line]
        while i + wp.int64(1) < polyline_start[line + wp.int64(1)]:
            if is_near(p, to_float64(points[i]), to_float64(points[i + wp.int64(1)]), limit):
                return i
            i += wp.int64(1)
        line += wp.int64(1)
    return wp.int64(-1)


@wp.kernel
def _find_shifts(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    pose_start: wp.array[wp.int64],
    polyline_pose: wp.array[wp.int32],
    compared: wp.array[wp.uint8],  # whether a pose is compared with the next, shape [pose]
    limit: wp.float64,  # [m]
    spacing: wp.float64,  # of the tested points [m]
    # Out:
    far: wp.array[wp.uint8],
):
    """Look from points along a polyline for the next pose's contours; one thread a polyline."""
    line = wp.int64(wp.tid())
    pose = polyline_pose[line]
    if compared[pose] == wp.uint8(0):
        return
    begin = pose_start[pose + 1]
    end = pose_start[pose + 2]
    if begin == end:  # nothing is drawn at the next pose
        return
    found = wp.int64(-1)
    i = polyline_start[line]
    while i + wp.int64(1) < polyline_start[line + wp.int64(1)] and far[pose] == wp.uint8(0):
        a = to_float64(points[i])
        way = to_float64(points[i + wp.int64(1)]) - a
        count = int(wp.ceil(wp.length(way) / spacing))
        for k in range(count + 1):
            p = a + wp.float64(k) / wp.max(wp.float64(count), wp.float64(1.0)) * way
            known = found >= wp.int64(0)  # where the point before was near, this one mostly is
            if known:
                known = is_near(p, to_float64(points[found]), to_float64(points[found + wp.int64(1)]), limit)
            if not known:
                found = find_near(p, points, polyline_start, begin, end, limit)
                if found < wp.int64(0):
                    far[pose] = wp.uint8(1)
                    return
        i += wp.int64(1)


def find_shifts(
    points: wp.array,
    polyline_start: wp.array,
    pose_start: wp.array,
    compared: np.ndarray,
    *,
    limit: float,
    spacing: float,
) -> np.ndarray:
    """Whether contours have a point that is farther than `limit` from those of the next pose, bool, shape [pose].

    Contours as in ContourBatch, on one device. compared: for which poses, bool, shape [pose]; the last has no next one.
    limit [m]; spacing: of the tested points along contours [m]; shifts up to half of it may be missed.
    """
    device, pose_count = points.device, len(compared)
    line_count = np.diff(pose_start.numpy())
    compared = np.append(compared[:-1], False)
    far = wp.zeros(pose_count, dtype=wp.uint8, device=device)
    wp.launch(
        _find_shifts,
        int(line_count.sum()),
        inputs=[
            points,
            polyline_start,
            pose_start,
            wp.array(np.repeat(np.arange(pose_count), line_count), dtype=wp.int32, device=device),
            wp.array(compared.astype(np.uint8), dtype=wp.uint8, device=device),
            float(limit),
            float(spacing),
        ],
        outputs=[far],
        device=device,
        block_dim=BLOCK,
    )
    return far.numpy() != 0
