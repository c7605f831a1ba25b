"""Selection of contour segments by their distance from the skin, their polyline's length, or their patch.

The hand's patches at every pose, which other stages take too, are made here.
"""

from typing import Any

import warp as wp

from ..contours import Contours, find_poses, point_at, segment_length
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float64
from .cut import Parts, room_for_parts

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


@wp.func
def turn_by(a: wp.vec3d, w: wp.float64, x: wp.vec3d):
    """Rotate x by the unit quaternion (a, w), by the same operations as `datasets.rigid.rotate`."""
    across = wp.cross(a, x)
    return x + wp.float64(2.0) * (w * across + wp.cross(a, across))


@wp.kernel
def _place_patches(pose: wp.array[wp.transform], rest: Patches, placed: Patches):
    """Turn and move a patch's frame with the hand; poses have rotations of any norm, rest is of one pose."""
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


@wp.struct
class Line:
    """A segment in a patch's frame: from start by a step."""

    start: wp.vec3d
    step: wp.vec3d


@wp.func
def beyond(p: wp.float64, half: wp.float64):
    """Signed distance of a coordinate beyond the interval -half..half; 0 within it."""
    return p - wp.clamp(p, -half, half)


@wp.func
def off_patch(line: Line, half: wp.vec2d, t: wp.float64):
    """From the nearest point of the patch to the segment's point at t, in the patch's frame [m]."""
    x = line.start + t * line.step
    return wp.vec3d(beyond(x[0], half[0]), beyond(x[1], half[1]), x[2])


@wp.func
def slope_at(line: Line, half: wp.vec2d, t: wp.float64):
    """Half the derivative of the squared distance along the segment; it never falls, since the patch is convex."""
    return wp.dot(off_patch(line, half, t), line.step)


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
        if (span[1] - span[0]) * wp.length(line.step) > SLACK:
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
    line.step = wp.vec3d(wp.dot(u, b - a), wp.dot(v, b - a), wp.dot(n, b - a))
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
    c: Contours,
    line_pose: wp.array[wp.int32],
    patches: Patches,
    distance: wp.float64,  # [m]
    start: wp.array[wp.int64],  # offsets of each segment's parts; empty: count them
    # Out:
    count: wp.array[wp.int64],  # shape [point + 1]
    parts: Parts,
    keep: wp.array[wp.uint8],
):
    """Divide segments where they come near to the hand and where they leave it, and keep what is near."""
    line = wp.tid()
    base = c.polyline_start[line]
    for k in range(int(c.polyline_start[line + 1] - base) - 1):
        i = base + wp.int64(k)
        a = point_at(c.points, i, wp.float64(0.0))
        b = point_at(c.points, i + wp.int64(1), wp.float64(0.0))
        least = SLACK / wp.max(wp.length(b - a), wp.float64(4.0) * SLACK)
        at = wp.float64(0.0)
        part = wp.int64(0)
        if start.shape[0] > 0:
            part = start[i]
        while at < wp.float64(1.0):
            border = next_border(patches, line_pose[line], a, b, at, distance, least)
            if start.shape[0] > 0:
                parts.segment[part] = i
                parts.share[part] = at
                keep[part] = wp.uint8(int(border > wp.float64(0.0)))
            at = wp.abs(border)
            part += wp.int64(1)
        if start.shape[0] == 0:
            count[i] = part


@wp.kernel
def _keep_long(c: Contours, least: wp.vec2d, keep: wp.array[wp.uint8]):
    """Keep points of polylines that are long enough; least: of an open polyline and of a closed one [m]."""
    line = wp.tid()
    length = wp.float64(0.0)
    for i in range(int(c.polyline_start[line]), int(c.polyline_start[line + 1]) - 1):
        length += segment_length(c.points, wp.int64(i))
    stays = wp.uint8(int(length >= least[int(c.polyline_closed[line])]))
    for i in range(int(c.polyline_start[line]), int(c.polyline_start[line + 1])):
        keep[i] = stays


@wp.kernel
def _keep_patches(c: Contours, patch_keep: wp.array2d[wp.uint8], keep: wp.array[wp.uint8]):
    """Keep points of polylines of the patches that stay."""
    pose = wp.tid()
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        for i in range(int(c.polyline_start[line]), int(c.polyline_start[line + 1])):
            keep[i] = patch_keep[pose, c.polyline_patch[line]]


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


@on_one_device
def part_off_skin(contours: Contours, patches: Patches, distance: float) -> tuple[Parts, wp.array]:
    """Segments divided where they pass `distance` [m] from the nearest patch, and which parts are nearer, uint8 [part].

    A rectangle is convex, so what is near to it of a segment is one span; its ends are found to 1e-15 of the segment.
    """
    device = contours.points.device
    (parts, keep), (parts.start,) = count_then_fill(
        _part_off_skin,
        None,
        contours.polyline_closed.shape[0],
        [contours, find_poses(contours), patches, wp.float64(distance)],
        lambda total: [room_for_parts(total, device), wp.empty(total, dtype=wp.uint8, device=device)],
        rows=contours.points.shape[0],
        blank=[Parts(), None],
    )
    return parts, keep


def keep_long(contours: Contours, least_open: float, least_closed: float) -> wp.array:
    """Whether a point's polyline is at least so long [m], uint8, shape [point]."""
    keep = wp.empty(contours.points.shape[0], dtype=wp.uint8, device=contours.points.device)
    launch(_keep_long, contours.polyline_closed.shape[0], [contours, wp.vec2d(least_open, least_closed)], [keep])
    return keep


@on_one_device
def keep_patches(contours: Contours, patch_keep: wp.array) -> wp.array:
    """Whether a point is on a patch that stays: uint8 [pose, patch] -> uint8 [point]."""
    keep = wp.empty(contours.points.shape[0], dtype=wp.uint8, device=contours.points.device)
    launch(_keep_patches, contours.pose_start.shape[0] - 1, [contours, patch_keep], [keep])
    return keep
