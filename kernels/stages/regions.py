"""Polylines in the planes of their patches: areas, which polylines bound a region together, and points back in space.

Seen from a patch's +n side, inside lies to the left of a closed polyline: an outer loop has a positive area and a hole
a negative one. A region is an outer loop with the holes that it is the smallest loop around.

Stages draw other polylines for regions in these planes; `lift_polylines` makes contours in the array's frame of them.
"""

from typing import Any, NamedTuple

import warp as wp

from ..contours import Contours, find_poses, room_for
from ..offsets import count_then_fill, launch, scan_counts
from ..one_device import on_one_device
from ..patch import EXACT, to_float32, to_float64
from ..section.draw import MADE
from .prune import Patches

wp.set_module_options(EXACT)


@wp.struct
class Regions:
    """The polylines of contours in their patches' planes, by region."""

    local: wp.array[wp.vec3d]  # coordinates along u, v and n of the point's patch [m], shape [point]
    polyline_start: wp.array[wp.int64]  # offsets into the points, shape [polyline + 1]
    polyline_closed: wp.array[wp.uint8]
    line_pose: wp.array[wp.int32]  # shape [polyline]
    line_patch: wp.array[wp.int32]
    area: wp.array2d[wp.float64]  # area [m2], first [m3] and second moments xx xy yy [m4], 0 of open polylines
    region_start: wp.array[wp.int64]  # offsets into `region_line`: regions by pose, then patch, then first polyline
    region_line: wp.array[wp.int32]  # polylines by region, in rising order within each, shape [polyline]


class FlatLines(NamedTuple):
    """Polylines drawn for regions in the planes of their patches, in the order of the regions; device arrays."""

    points: wp.array  # vec2d, along u and v [m], shape [point]; the first point of a closed one is not repeated
    line_start: wp.array  # int64, offsets into points, shape [line + 1]
    line_region: wp.array  # int32, shape [line]


@wp.func
def pose_patch_of(r: Regions, region: int):
    """Pose and patch of a region."""
    line = r.region_line[r.region_start[region]]
    return r.line_pose[line], r.line_patch[line]


@wp.func
def winding_number(local: wp.array[wp.vec3d], first: wp.int64, last: wp.int64, x: wp.float64, y: wp.float64):
    """How often the loop of points first..last, which ends where it began, goes around (x, y)."""
    turns = int(0)
    a = local[first]
    i = first
    while i < last:
        i += wp.int64(1)
        b = local[i]
        if (a[1] <= y) != (b[1] <= y):
            left = (b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])
            if a[1] <= y and left > wp.float64(0.0):
                turns += 1
            elif a[1] > y and left < wp.float64(0.0):
                turns -= 1
        a = b
    return turns


@wp.func
def holds_loop(r: Regions, outer: int, inner: int):
    """Whether a loop winds around another that does not cross it: more of its vertices are inside than not."""
    first = r.polyline_start[outer]
    last = r.polyline_start[outer + 1] - wp.int64(1)
    start = r.polyline_start[inner]
    left = int(r.polyline_start[inner + 1] - start) - 1  # vertices that are not looked at yet
    lead = int(0)  # vertices inside, less those outside
    i = start
    while left > 0 and left >= wp.abs(lead):  # the rest cannot turn a longer lead
        lead += wp.where(winding_number(r.local, first, last, r.local[i][0], r.local[i][1]) != 0, 1, -1)
        left -= 1
        i += wp.int64(1)
    return lead > 0


@wp.kernel
def _place_polylines(c: Contours, patches: Patches, r: Regions):
    """Write the coordinates of a polyline's points along the axes of its patch, and its area and moments if closed."""
    line = wp.tid()
    pose = r.line_pose[line]
    patch = r.line_patch[line]
    origin = patches.origin[pose, patch]
    u = patches.u[pose, patch]
    v = patches.v[pose, patch]
    n = patches.n[pose, patch]
    i = r.polyline_start[line]
    while i < r.polyline_start[line + 1]:
        off = to_float64(c.points[i]) - origin
        r.local[i] = wp.vec3d(wp.dot(off, u), wp.dot(off, v), wp.dot(off, n))
        i += wp.int64(1)
    if c.polyline_closed[line] == wp.uint8(0):
        return
    two = wp.float64(2.0)
    six = wp.float64(6.0)
    twelve = wp.float64(12.0)
    i = r.polyline_start[line]
    while i < r.polyline_start[line + 1] - wp.int64(1):
        x = r.local[i][0]
        y = r.local[i][1]
        i += wp.int64(1)
        p = r.local[i][0]
        q = r.local[i][1]
        cross = x * q - p * y
        r.area[line, 0] += cross * wp.float64(0.5)
        r.area[line, 1] += cross * ((x + p) / six)
        r.area[line, 2] += cross * ((y + q) / six)
        r.area[line, 3] += cross * ((x * x + x * p + p * p) / twelve)
        r.area[line, 4] += cross * ((two * x * y + x * q + p * y + two * p * q) / wp.float64(24.0))
        r.area[line, 5] += cross * ((y * y + y * q + q * q) / twelve)


@wp.kernel
def _choose_owners(r: Regions, pose_start: wp.array[wp.int64], whole: int, owner: wp.array[wp.int32]):
    """Find the smallest outer loop around a hole; other polylines own themselves.

    whole: 1: all polylines of a patch are one region, and the first owns them.
    """
    line = wp.tid()
    pose = r.line_pose[line]
    own = line
    least = wp.float64(wp.inf)
    if whole == 1 or (r.polyline_closed[line] != wp.uint8(0) and r.area[line, 0] < wp.float64(0.0)):
        for other in range(int(pose_start[pose]), int(pose_start[pose + 1])):
            if r.line_patch[other] == r.line_patch[line]:
                if whole == 1:
                    own = wp.min(own, other)
                elif r.polyline_closed[other] != wp.uint8(0):
                    size = r.area[other, 0]
                    if size > wp.float64(0.0) and size < least and holds_loop(r, other, line):
                        own = other
                        least = size
    owner[line] = own


@wp.kernel
def _find_first_lines(r: Regions, pose_start: wp.array[wp.int64], owner: wp.array[wp.int32], first: wp.array[wp.int32]):
    """Find the first polyline of each one's region."""
    line = wp.tid()
    other = int(pose_start[r.line_pose[line]])
    while owner[other] != owner[line]:
        other += 1
    first[line] = other


@wp.kernel
def _count_regions(pose_start: wp.array[wp.int64], first: wp.array[wp.int32], count: wp.array[wp.int64]):
    """Count the regions of each pose."""
    pose = wp.tid()
    for line in range(int(pose_start[pose]), int(pose_start[pose + 1])):
        if first[line] == line:
            count[pose] += wp.int64(1)


@wp.kernel
def _write_regions(
    pose_start: wp.array[wp.int64], first: wp.array[wp.int32], pose_region: wp.array[wp.int64], r: Regions
):
    """Write the polylines of a region, whose place is behind all of lower patches and of earlier first polylines.

    pose_region: offsets of each pose's regions.
    """
    line = wp.tid()
    if first[line] != line:
        return
    pose = r.line_pose[line]
    begin = int(pose_start[pose])
    end = int(pose_start[pose + 1])
    region = pose_region[pose]
    at = pose_start[pose]
    for other in range(begin, end):
        patch = r.line_patch[other]
        if patch < r.line_patch[line] or (patch == r.line_patch[line] and first[other] < line):
            at += wp.int64(1)
            if first[other] == other:
                region += wp.int64(1)
    r.region_start[region] = at
    for other in range(line, end):
        if first[other] == line:
            r.region_line[at] = other
            at += wp.int64(1)


@wp.kernel
def _lift_polylines(
    # In:
    flat: wp.array[wp.vec2d],  # [m]
    start: wp.array[wp.int64],
    line_region: wp.array[wp.int32],
    r: Regions,
    height: wp.array[wp.float64],  # above the plane [m]; empty: 0
    closed: int,
    patches: Patches,
    point_start: wp.array[wp.int64],  # offsets of each polyline's points and its own place; empty: count them
    line_start: wp.array[wp.int64],
    # Out:
    point_count: wp.array[wp.int64],
    line_count: wp.array[wp.int64],
    out: Contours,
):
    """Count or write the points of a polyline that differ from the one before."""
    line = wp.tid()
    writes = point_start.shape[0] > 0
    count = int(start[line + 1] - start[line])
    h = wp.float64(0.0)
    if height.shape[0] > 0:
        h = height[line]
    at = wp.int64(0)
    if writes:
        at = point_start[line]
        count = wp.where(point_start[line + 1] > at, count, 0)
    distinct = wp.int64(0)
    before = wp.vec3()
    pose, patch = pose_patch_of(r, line_region[line])
    u = patches.u[pose, patch]
    v = patches.v[pose, patch]
    middle = patches.origin[pose, patch] + h * patches.n[pose, patch]
    total = wp.where(count > 0, count + closed, 0)
    for k in range(total):
        p = flat[start[line] + wp.int64(k % count)]
        x = to_float32(middle + p[0] * u + p[1] * v)
        if k == 0 or x[0] != before[0] or x[1] != before[1] or x[2] != before[2]:
            if writes:
                out.points[at + distinct] = x
            distinct += wp.int64(1)
        before = x
    if not writes and distinct > wp.int64(1):
        point_count[line] = distinct
        line_count[line] = wp.int64(1)
    elif writes and distinct > wp.int64(0):
        own = line_start[line]
        out.polyline_start[own] = at
        out.polyline_patch[own] = patch
        out.polyline_closed[own] = wp.uint8(closed)


@wp.kernel
def _start_lifted_poses(
    line_region: wp.array[wp.int32], r: Regions, line_start: wp.array[wp.int64], pose_start: wp.array[wp.int64]
):
    """Write the first polyline of each pose; line_region: rising."""
    pose = wp.tid()
    low = int(0)
    high = line_region.shape[0]
    while low < high:
        middle = (low + high) // 2
        own, _patch = pose_patch_of(r, line_region[middle])
        if own < pose:
            low = middle + 1
        else:
            high = middle
    pose_start[pose] = line_start[low]


@wp.kernel
def _find_filled(r: Regions, filled: wp.array[wp.uint8], open_count: wp.array[wp.int32]):
    """Find the regions of closed polylines that enclose an area; count polylines that are open."""
    region = wp.tid()
    total = wp.float64(0.0)
    opened = int(0)
    for entry in range(int(r.region_start[region]), int(r.region_start[region + 1])):
        line = r.region_line[entry]
        total += r.area[line, 0]
        if r.polyline_closed[line] == wp.uint8(0):
            opened += 1
    filled[region] = wp.uint8(wp.where(opened == 0 and total > wp.float64(0.0), 1, 0))
    if opened > 0:
        wp.atomic_add(open_count, 0, opened)  # of integers: the order does not matter


@on_one_device
def find_regions(contours: Contours, patches: Any, *, per: str = "region") -> Regions:
    """The polylines that belong together, by pose and patch; per "region": an outer loop with its holes, or "patch".

    Holes go to the smallest outer loop around them. An open polyline, or a hole around which there is no loop, is a
    region of its own. patches: `Patches`.
    """
    device, line_count = contours.points.device, contours.polyline_patch.shape[0]
    r, pose_start = Regions(), contours.pose_start
    r.polyline_start, r.polyline_closed = contours.polyline_start, contours.polyline_closed
    r.line_pose, r.line_patch = find_poses(contours), contours.polyline_patch
    r.local = wp.empty(contours.points.shape[0], dtype=wp.vec3d, device=device)
    r.area = wp.zeros((line_count, 6), dtype=wp.float64, device=device)
    launch(_place_polylines, line_count, [contours, patches], [r])
    owner, first, r.region_line = (wp.empty(line_count, dtype=wp.int32, device=device) for _ in range(3))
    launch(_choose_owners, line_count, [r, pose_start, int(per == "patch")], [owner])
    launch(_find_first_lines, line_count, [r, pose_start, owner], [first])
    count = wp.zeros_like(pose_start)
    launch(_count_regions, pose_start.shape[0] - 1, [pose_start, first], [count])
    (pose_region,), (total,) = scan_counts(count)
    r.region_start = wp.full(total + 1, line_count, dtype=wp.int64, device=device)
    launch(_write_regions, line_count, [pose_start, first, pose_region], [r])
    return r


def find_filled(r: Regions) -> tuple[wp.array, int]:
    """Whether each region encloses an area, uint8, shape [region], and the number of polylines that are open.

    Those are regions of their own, which enclose nothing; so is a hole around which there is no loop.
    """
    device, count = r.local.device, r.region_start.shape[0] - 1
    filled = wp.empty(count, dtype=wp.uint8, device=device)
    open_count = wp.zeros(1, dtype=wp.int32, device=device)
    launch(_find_filled, count, [r], [filled, open_count])
    return filled, int(open_count.numpy()[0])


def room_for_lines(points: int, lines: int, device: wp.Device) -> FlatLines:
    """Memory for so many lines, which all start at the end."""
    return FlatLines(
        wp.empty(points, dtype=wp.vec2d, device=device),
        wp.full(lines + 1, points, dtype=wp.int64, device=device),
        wp.empty(lines, dtype=wp.int32, device=device),
    )


@on_one_device
def lift_polylines(
    flat: FlatLines,
    r: Regions,
    patches: Any,
    pose_count: int,
    *,
    closed: bool,
    height: wp.array | None = None,
    point_limit: int | None = None,
) -> Contours:
    """Contours of kind "made" of lines drawn for regions, without points that float32 makes equal to the one before.

    height: above the plane [m], float64, shape [line], None: 0. patches: `Patches`. Lines of fewer than two points that
    differ are left out. Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    device, count = flat.points.device, flat.line_region.shape[0]
    (out,), (_, line_start) = count_then_fill(
        _lift_polylines,
        None,
        count,
        [flat.points, flat.line_start, flat.line_region, r, height, int(closed), patches],
        lambda points, lines: [room_for(points, lines, device, kind=int(MADE))],
        rows=count,
        columns=2,
        limit=point_limit,
        blank=[Contours()],
    )
    out.pose_start = wp.empty(pose_count + 1, dtype=wp.int64, device=device)
    launch(_start_lifted_poses, pose_count + 1, [flat.line_region, r, line_start], [out.pose_start])
    return out
