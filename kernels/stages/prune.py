"""Selection of contour segments by their distance from the skin, their polyline's length, or their patch."""

import warp as wp

from ..one_device import on_one_device
from ..patch import EXACT
from .cut import Parts, launch, offsets_of, parts_from, point_at, segment_length

wp.set_module_options(EXACT)

SLACK = wp.constant(wp.float64(1e-6))  # [m]; nearer than this is as near as asked, and shorter pieces are none
HALVINGS = wp.constant(50)  # of a segment: below float64's rounding


@wp.struct
class Patches:
    """A hand's patches at every pose, in the array's frame; NaN for one that is not there."""

    origin: wp.array2d[wp.vec3d]  # [m], shape [pose, patch]
    u: wp.array2d[wp.vec3d]
    v: wp.array2d[wp.vec3d]
    n: wp.array2d[wp.vec3d]
    half: wp.array[wp.vec2d]  # half extents along u and v [m], shape [patch]


@wp.struct
class Line:
    """A segment in a patch's frame: from start, over way."""

    start: wp.vec3d
    way: wp.vec3d


@wp.func
def beyond(p: wp.float64, half: wp.float64):
    """Signed distance of a coordinate beyond the interval -half..half; 0 within it."""
    return p - wp.clamp(p, -half, half)


@wp.func
def off_patch(line: Line, half: wp.vec2d, t: wp.float64):
    """From the nearest point of the patch to the segment's point at t, in the patch's frame [m]."""
    x = line.start + t * line.way
    return wp.vec3d(beyond(x[0], half[0]), beyond(x[1], half[1]), x[2])


@wp.func
def slope_at(line: Line, half: wp.vec2d, t: wp.float64):
    """Half the derivative of the squared distance along the segment; it never falls, since the patch is convex."""
    return wp.dot(off_patch(line, half, t), line.way)


@wp.func
def is_near(line: Line, half: wp.vec2d, t: wp.float64, distance: wp.float64):
    """Whether the segment's point at t is at most this far from the patch; nothing is near a NaN."""
    return wp.length(off_patch(line, half, t)) <= distance


@wp.func
def border_between(line: Line, half: wp.vec2d, near: wp.float64, far: wp.float64, distance: wp.float64):
    """Place between a near and a far point where the segment leaves the patch's neighbourhood; the place is near."""
    a = near
    b = far
    for _i in range(HALVINGS):
        t = wp.float64(0.5) * (a + b)
        if is_near(line, half, t, distance):
            a = t
        else:
            b = t
    return a


@wp.func
def near_span(line: Line, half: wp.vec2d, distance: wp.float64):
    """First and last share of a segment that is at most so far from a patch; (2, 2) if none is."""
    low = wp.float64(0.0)
    high = wp.float64(1.0)
    if slope_at(line, half, low) >= wp.float64(0.0):
        high = low
    elif slope_at(line, half, high) <= wp.float64(0.0):
        low = high
    else:
        for _i in range(HALVINGS):
            t = wp.float64(0.5) * (low + high)
            if slope_at(line, half, t) < wp.float64(0.0):
                low = t
            else:
                high = t
    nearest = wp.float64(0.5) * (low + high)
    starts = is_near(line, half, wp.float64(0.0), distance + SLACK)
    ends = is_near(line, half, wp.float64(1.0), distance + SLACK)
    span = wp.vec2d(wp.float64(0.0), wp.float64(1.0))
    if starts and ends:
        return span
    if is_near(line, half, nearest, distance + SLACK):
        if not starts:
            span[0] = border_between(line, half, nearest, wp.float64(0.0), distance)
        if not ends:
            span[1] = border_between(line, half, nearest, wp.float64(1.0), distance)
        if (span[1] - span[0]) * wp.length(line.way) > SLACK:
            return span
    return wp.vec2d(wp.float64(2.0), wp.float64(2.0))


@wp.func
def span_near(patches: Patches, pose: int, patch: int, a: wp.vec3d, b: wp.vec3d, distance: wp.float64):
    """Part of the segment a..b that is at most so far from one patch of the hand."""
    o = patches.origin[pose, patch]
    u = patches.u[pose, patch]
    v = patches.v[pose, patch]
    n = patches.n[pose, patch]
    line = Line()
    line.start = wp.vec3d(wp.dot(u, a - o), wp.dot(v, a - o), wp.dot(n, a - o))
    line.way = wp.vec3d(wp.dot(u, b - a), wp.dot(v, b - a), wp.dot(n, b - a))
    return near_span(line, patches.half[patch], distance)


@wp.func
def next_border(
    patches: Patches, pose: int, a: wp.vec3d, b: wp.vec3d, at: wp.float64, distance: wp.float64, least: wp.float64
):
    """From a share of a segment to where it next comes near to the hand (negative), or no longer is (positive)."""
    patch_count = patches.half.shape[0]
    reach = at
    start = wp.float64(1.0)
    grew = int(1)
    while grew == 1 and reach < wp.float64(1.0):
        grew = int(0)
        for patch in range(patch_count):
            span = span_near(patches, pose, patch, a, b, distance)
            if span[0] <= reach + least:
                if span[1] > reach + least:
                    reach = span[1]
                    grew = int(1)
            elif span[0] < start:
                start = span[0]
    if reach > at:
        return reach
    return -start


@wp.kernel
def _part_off_skin(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    line_pose: wp.array[wp.int32],
    patches: Patches,
    distance: wp.float64,  # [m]
    start: wp.array[wp.int64],  # offsets of each segment's parts; empty: count them
    # Out:
    count: wp.array[wp.int64],  # shape [point + 1]
    share: wp.array[wp.float64],
    keep: wp.array[wp.uint8],
):
    """Divide segments where they come near to the hand and where they leave it, and keep what is near."""
    line = wp.tid()
    base = polyline_start[line]
    for k in range(int(polyline_start[line + 1] - base) - 1):
        i = base + wp.int64(k)
        a = point_at(points, i, wp.float64(0.0))
        b = point_at(points, i + wp.int64(1), wp.float64(0.0))
        least = SLACK / wp.max(wp.length(b - a), wp.float64(4.0) * SLACK)
        at = wp.float64(0.0)
        part = wp.int64(0)
        if start.shape[0] > 0:
            part = start[i]
        while at < wp.float64(1.0):
            border = next_border(patches, line_pose[line], a, b, at, distance, least)
            if start.shape[0] > 0:
                share[part] = at
                keep[part] = wp.uint8(int(border > wp.float64(0.0)))
            at = wp.abs(border)
            part += wp.int64(1)
        if start.shape[0] == 0:
            count[i] = part


@wp.kernel
def _find_poses(
    # In:
    pose_start: wp.array[wp.int64],
    # Out:
    line_pose: wp.array[wp.int32],
):
    """Write the pose of each polyline."""
    pose = wp.tid()
    for line in range(int(pose_start[pose]), int(pose_start[pose + 1])):
        line_pose[line] = pose


@wp.kernel
def _measure_lines(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    # Out:
    length: wp.array[wp.float64],  # [m], shape [polyline]
):
    """Sum each polyline's segments."""
    line = wp.tid()
    base = polyline_start[line]
    total = wp.float64(0.0)
    for k in range(int(polyline_start[line + 1] - base) - 1):
        total += segment_length(points, base + wp.int64(k))
    length[line] = total


@wp.kernel
def _keep_long(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    length: wp.array[wp.float64],
    least: wp.vec2d,  # of an open polyline and of a closed one [m]
    # Out:
    keep: wp.array[wp.uint8],  # by point
):
    """Keep polylines that are long enough."""
    line = wp.tid()
    kept = wp.uint8(int(length[line] >= least[int(polyline_closed[line])]))
    for i in range(int(polyline_start[line]), int(polyline_start[line + 1])):
        keep[i] = kept


@wp.kernel
def _keep_patches(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline_patch: wp.array[wp.int32],
    line_pose: wp.array[wp.int32],
    patch_keep: wp.array2d[wp.uint8],  # shape [pose, patch]
    # Out:
    keep: wp.array[wp.uint8],  # by point
):
    """Keep polylines of patches that are kept."""
    line = wp.tid()
    kept = patch_keep[line_pose[line], polyline_patch[line]]
    for i in range(int(polyline_start[line]), int(polyline_start[line + 1])):
        keep[i] = kept


def find_poses(pose_start: wp.array, line_count: int) -> wp.array:
    """Pose of each polyline, int32, shape [polyline]."""
    line_pose = wp.empty(line_count, dtype=wp.int32, device=pose_start.device)
    launch(_find_poses, pose_start.shape[0] - 1, [pose_start], [line_pose])
    return line_pose


@on_one_device
def part_off_skin(
    points: wp.array, polyline_start: wp.array, pose_start: wp.array, patches: Patches, distance: float
) -> tuple[Parts, wp.array]:
    """Segments divided where they pass `distance` [m] from the nearest patch, and which parts are nearer, uint8 [part].

    A rectangle is convex, so what is near to it of a segment is one span; its ends are found to 1e-15 of the segment.
    """
    line_count = polyline_start.shape[0] - 1
    line_pose = find_poses(pose_start, line_count)
    device = points.device
    none = (wp.empty(0, dtype=dtype, device=device) for dtype in (wp.int64, wp.float64, wp.uint8))
    no_start, no_share, no_keep = none
    count = wp.zeros(points.shape[0] + 1, dtype=wp.int64, device=device)
    inputs = [points, polyline_start, line_pose, patches, wp.float64(distance)]
    launch(_part_off_skin, line_count, [*inputs, no_start], [count, no_share, no_keep])
    parts = parts_from(offsets_of(count))
    keep = wp.empty(parts.segment.shape[0], dtype=wp.uint8, device=device)
    launch(_part_off_skin, line_count, [*inputs, parts.start], [no_start, parts.share, keep])
    return parts, keep


@on_one_device
def measure_lines(points: wp.array, polyline_start: wp.array) -> wp.array:
    """Length of each polyline [m], float64, shape [polyline]."""
    length = wp.empty(polyline_start.shape[0] - 1, dtype=wp.float64, device=points.device)
    launch(_measure_lines, length.shape[0], [points, polyline_start], [length])
    return length


@on_one_device
def keep_long(
    points: wp.array, polyline_start: wp.array, polyline_closed: wp.array, least_open: float, least_closed: float
) -> wp.array:
    """Whether a point's polyline is at least so long [m], uint8, shape [point]."""
    keep = wp.empty(points.shape[0], dtype=wp.uint8, device=points.device)
    length = measure_lines(points, polyline_start)
    least = wp.vec2d(least_open, least_closed)
    launch(_keep_long, length.shape[0], [polyline_start, polyline_closed, length, least], [keep])
    return keep


@on_one_device
def keep_patches(
    polyline_start: wp.array, polyline_patch: wp.array, pose_start: wp.array, patch_keep: wp.array, point_count: int
) -> wp.array:
    """Whether a point is on a kept patch: uint8 [pose, patch] -> uint8 [point]."""
    keep = wp.empty(point_count, dtype=wp.uint8, device=pose_start.device)
    line_pose = find_poses(pose_start, polyline_patch.shape[0])
    launch(_keep_patches, line_pose.shape[0], [polyline_start, polyline_patch, line_pose, patch_keep], [keep])
    return keep
