"""Polylines in the planes of their patches: areas, and which polylines bound a region together.

Seen from a patch's +n side, inside lies to the left of a closed polyline: an outer loop has a positive area and a hole
a negative one. A region is an outer loop with the holes that it is the smallest loop around.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

from ..offsets import last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT, to_float64
from .cut import launch
from .prune import Patches, find_poses

wp.set_module_options(EXACT)


@dataclass(frozen=True, eq=False)
class Regions:
    """The polylines of a batch in their patches' planes, by region; all arrays on one device."""

    local: wp.array
    """Coordinates along u, v and n of the point's patch [m], vec3d, shape [point]."""
    polyline_start: wp.array
    """Offsets into the points, int64, shape [polyline + 1]."""
    polyline_closed: wp.array
    """uint8, shape [polyline]."""
    line_pose: wp.array
    """int32, shape [polyline]."""
    line_patch: wp.array
    """int32, shape [polyline]."""
    area: wp.array
    """Area [m2], first [m3] and second moments xx xy yy [m4], 0 of open polylines, float64, shape [polyline, 6]."""
    region_start: wp.array
    """Offsets into `region_line`, int64, shape [region + 1]: regions by pose, then patch, then first polyline."""
    region_line: wp.array
    """Polylines by region, in rising order within each, int32, shape [polyline]."""

    @property
    def region_count(self) -> int:
        """Number of regions."""
        return self.region_start.shape[0] - 1


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
def holds_loop(local: wp.array[wp.vec3d], polyline_start: wp.array[wp.int64], outer: int, inner: int):
    """Whether a loop winds around another that does not cross it: more of its vertices are inside than not."""
    first = polyline_start[outer]
    last = polyline_start[outer + 1] - wp.int64(1)
    start = polyline_start[inner]
    left = int(polyline_start[inner + 1] - start) - 1  # vertices that are not looked at yet
    lead = int(0)  # vertices inside, less those outside
    i = start
    while left > 0 and left >= wp.abs(lead):  # the rest cannot turn a longer lead
        lead += wp.where(winding_number(local, first, last, local[i][0], local[i][1]) != 0, 1, -1)
        left -= 1
        i += wp.int64(1)
    return lead > 0


@wp.kernel
def _find_local_points(
    # In:
    points: wp.array[wp.vec3],  # [m]
    polyline_start: wp.array[wp.int64],
    line_pose: wp.array[wp.int32],
    line_patch: wp.array[wp.int32],
    patches: Patches,
    # Out:
    local: wp.array[wp.vec3d],  # [m]
):
    """Coordinates of a polyline's points along the axes of its patch."""
    line = wp.tid()
    pose = line_pose[line]
    patch = line_patch[line]
    origin = patches.origin[pose, patch]
    u = patches.u[pose, patch]
    v = patches.v[pose, patch]
    n = patches.n[pose, patch]
    i = polyline_start[line]
    while i < polyline_start[line + 1]:
        off = to_float64(points[i]) - origin
        local[i] = wp.vec3d(wp.dot(off, u), wp.dot(off, v), wp.dot(off, n))
        i += wp.int64(1)


@wp.kernel
def _measure_areas(
    # In:
    local: wp.array[wp.vec3d],  # [m]
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    # Out:
    area: wp.array2d[wp.float64],  # 0, shape [polyline, 6]
):
    """Sum what each segment of a closed polyline adds to its area and moments."""
    line = wp.tid()
    if polyline_closed[line] == wp.uint8(0):
        return
    two = wp.float64(2.0)
    six = wp.float64(6.0)
    twelve = wp.float64(12.0)
    i = polyline_start[line]
    while i < polyline_start[line + 1] - wp.int64(1):
        x = local[i][0]
        y = local[i][1]
        i += wp.int64(1)
        p = local[i][0]
        q = local[i][1]
        cross = x * q - p * y
        area[line, 0] += cross * wp.float64(0.5)
        area[line, 1] += cross * ((x + p) / six)
        area[line, 2] += cross * ((y + q) / six)
        area[line, 3] += cross * ((x * x + x * p + p * p) / twelve)
        area[line, 4] += cross * ((two * x * y + x * q + p * y + two * p * q) / wp.float64(24.0))
        area[line, 5] += cross * ((y * y + y * q + q * q) / twelve)


@wp.kernel
def _choose_owners(
    # In:
    local: wp.array[wp.vec3d],
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    line_pose: wp.array[wp.int32],
    line_patch: wp.array[wp.int32],
    pose_start: wp.array[wp.int64],
    area: wp.array2d[wp.float64],
    whole: int,  # 1: all polylines of a patch are one region
    # Out:
    owner: wp.array[wp.int32],  # a polyline of the same region, the same for all of them
):
    """Find the smallest outer loop around a hole; other polylines own themselves."""
    line = wp.tid()
    pose = line_pose[line]
    own = line
    least = wp.float64(wp.inf)
    if whole == 1 or (polyline_closed[line] != wp.uint8(0) and area[line, 0] < wp.float64(0.0)):
        for other in range(int(pose_start[pose]), int(pose_start[pose + 1])):
            if line_patch[other] == line_patch[line]:
                if whole == 1:
                    own = wp.min(own, other)
                elif polyline_closed[other] != wp.uint8(0):
                    size = area[other, 0]
                    if size > wp.float64(0.0) and size < least and holds_loop(local, polyline_start, other, line):
                        own = other
                        least = size
    owner[line] = own


@wp.kernel
def _find_first_lines(
    # In:
    line_pose: wp.array[wp.int32],
    pose_start: wp.array[wp.int64],
    owner: wp.array[wp.int32],
    # Out:
    first: wp.array[wp.int32],  # the first polyline of the same region
):
    """Find the first polyline of each one's region."""
    line = wp.tid()
    other = int(pose_start[line_pose[line]])
    while owner[other] != owner[line]:
        other += 1
    first[line] = other


@wp.kernel
def _count_regions(
    # In:
    pose_start: wp.array[wp.int64],
    first: wp.array[wp.int32],
    # Out:
    count: wp.array[wp.int64],  # shape [pose + 1]
):
    """Count the regions of each pose."""
    pose = wp.tid()
    for line in range(int(pose_start[pose]), int(pose_start[pose + 1])):
        if first[line] == line:
            count[pose] += wp.int64(1)


@wp.kernel
def _write_regions(
    # In:
    line_pose: wp.array[wp.int32],
    line_patch: wp.array[wp.int32],
    pose_start: wp.array[wp.int64],
    first: wp.array[wp.int32],
    pose_region: wp.array[wp.int64],  # offsets of each pose's regions
    # Out:
    region_start: wp.array[wp.int64],
    region_line: wp.array[wp.int32],
):
    """Write the polylines of a region, whose place is behind all of lower patches and of earlier first polylines."""
    line = wp.tid()
    if first[line] != line:
        return
    pose = line_pose[line]
    begin = int(pose_start[pose])
    end = int(pose_start[pose + 1])
    region = pose_region[pose]
    at = pose_start[pose]
    for other in range(begin, end):
        patch = line_patch[other]
        if patch < line_patch[line] or (patch == line_patch[line] and first[other] < line):
            at += wp.int64(1)
            if first[other] == other:
                region += wp.int64(1)
    region_start[region] = at
    for other in range(line, end):
        if first[other] == line:
            region_line[at] = other
            at += wp.int64(1)


@on_one_device
def find_local_points(
    points: wp.array, polyline_start: wp.array, line_pose: wp.array, line_patch: wp.array, patches: Any
) -> wp.array:
    """Coordinates of points along u, v and n of their patch [m], vec3d, shape [point]; patches: `Patches`."""
    local = wp.empty(points.shape[0], dtype=wp.vec3d, device=points.device)
    lines = [polyline_start, line_pose, line_patch]
    launch(_find_local_points, line_pose.shape[0], [points, *lines, patches], [local])
    return local


@on_one_device
def measure_areas(local: wp.array, polyline_start: wp.array, polyline_closed: wp.array) -> wp.array:
    """Signed areas and moments of closed polylines, as `Regions.area`."""
    area = wp.zeros((polyline_closed.shape[0], 6), dtype=wp.float64, device=local.device)
    launch(_measure_areas, area.shape[0], [local, polyline_start, polyline_closed], [area])
    return area


@on_one_device
def find_regions(
    points: wp.array,
    polyline_start: wp.array,
    polyline_patch: wp.array,
    polyline_closed: wp.array,
    pose_start: wp.array,
    patches: Any,
    *,
    per: str = "region",
) -> Regions:
    """The polylines that belong together, by pose and patch; per "region": an outer loop with its holes, or "patch".

    Holes go to the smallest outer loop around them. An open polyline, or a hole around which there is no loop, is a
    region of its own. patches: `Patches`, on the device of the other arrays, which are those of a contour batch.
    """
    device, line_count = points.device, polyline_patch.shape[0]
    line_pose = find_poses(pose_start, line_count)
    local = find_local_points(points, polyline_start, line_pose, polyline_patch, patches)
    area = measure_areas(local, polyline_start, polyline_closed)
    owner, first, region_line = (wp.empty(line_count, dtype=wp.int32, device=device) for _ in range(3))
    lines = [local, polyline_start, polyline_closed, line_pose, polyline_patch, pose_start, area]
    launch(_choose_owners, line_count, [*lines, int(per == "patch")], [owner])
    launch(_find_first_lines, line_count, [line_pose, pose_start, owner], [first])
    count = wp.zeros_like(pose_start)
    launch(_count_regions, pose_start.shape[0] - 1, [pose_start, first], [count])
    pose_region = offsets_of(count)
    region_start = wp.full(last_of(pose_region) + 1, line_count, dtype=wp.int64, device=device)
    where = [line_pose, polyline_patch, pose_start, first, pose_region]
    launch(_write_regions, line_count, where, [region_start, region_line])
    return Regions(local, polyline_start, polyline_closed, line_pose, polyline_patch, area, region_start, region_line)
