"""Which regions enclose an area that can be filled, and where the lines that fill them belong."""

import warp as wp

from ..one_device import on_one_device
from ..patch import EXACT
from ..stages.cut import launch
from ..stages.regions import Regions

wp.set_module_options(EXACT)


@wp.kernel
def _find_filled(
    # In:
    region_start: wp.array[wp.int64],
    region_line: wp.array[wp.int32],
    polyline_closed: wp.array[wp.uint8],
    area: wp.array2d[wp.float64],  # [m2], shape [polyline, 6]
    # Out:
    filled: wp.array[wp.uint8],
    open_count: wp.array[wp.int32],  # shape [1], 0
):
    """Find the regions of closed polylines that enclose an area; count polylines that are open."""
    region = wp.tid()
    total = wp.float64(0.0)
    opened = int(0)
    for entry in range(int(region_start[region]), int(region_start[region + 1])):
        line = region_line[entry]
        total += area[line, 0]
        if polyline_closed[line] == wp.uint8(0):
            opened += 1
    filled[region] = wp.uint8(wp.where(opened == 0 and total > wp.float64(0.0), 1, 0))
    if opened > 0:
        wp.atomic_add(open_count, 0, opened)  # of integers: the order does not matter


@wp.kernel
def _locate_lines(
    # In:
    region_start: wp.array[wp.int64],
    region_line: wp.array[wp.int32],
    line_pose: wp.array[wp.int32],  # of the regions' polylines
    line_patch: wp.array[wp.int32],
    line_region: wp.array[wp.int32],  # of the lines that fill them
    # Out:
    pose: wp.array[wp.int32],
    patch: wp.array[wp.int32],
):
    """Find pose and patch of each line from its region."""
    i = wp.tid()
    line = region_line[region_start[line_region[i]]]
    pose[i] = line_pose[line]
    patch[i] = line_patch[line]


def find_filled(regions: Regions) -> tuple[wp.array, int]:
    """Whether each region encloses an area, uint8, shape [region], and the number of polylines that are open.

    Those are regions of their own, which enclose nothing; so is a hole around which there is no loop.
    """
    device = regions.local.device
    filled = wp.empty(regions.region_count, dtype=wp.uint8, device=device)
    open_count = wp.zeros(1, dtype=wp.int32, device=device)
    lines = [regions.region_start, regions.region_line, regions.polyline_closed, regions.area]
    launch(_find_filled, regions.region_count, lines, [filled, open_count])
    return filled, int(open_count.numpy()[0])


@on_one_device
def locate_lines(regions: Regions, line_region: wp.array) -> tuple[wp.array, wp.array]:
    """Pose and patch, int32, shape [line], of lines that fill regions; line_region: int32, which one each fills."""
    pose, patch = wp.empty_like(line_region), wp.empty_like(line_region)
    lines = [regions.region_start, regions.region_line, regions.line_pose, regions.line_patch, line_region]
    launch(_locate_lines, line_region.shape[0], lines, [pose, patch])
    return pose, patch
