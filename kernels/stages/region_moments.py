"""Moments of regions: of the area that their polylines enclose, or of the lines themselves, in a patch's plane.

The main axes come in closed form. Where both variances are equal, every axis is right. Rounding of points to float32
decides then, so the axis is u where the variances differ by less than 2e-6 of their mean; that moves no semi-axis's end
of a contact by more than 1e-7 m.
"""

from typing import Any

import warp as wp

from ..patch import EXACT
from .cut import launch
from .regions import Regions

wp.set_module_options(EXACT)

AREA, LINE, SECOND_MOMENTS = 0, 1, 2
OF = {"area": AREA, "line": LINE, "moments": SECOND_MOMENTS}
"""What an oval has of a region: its area, its lines' moments, its second moments."""
SLIVER = wp.constant(wp.float64(1e-9))  # of the squared length of lines: a smaller area is all rounding
ROUND = wp.constant(wp.float64(1e-6))  # of the mean variance: both count as equal if they are this near to it


@wp.struct
class Spread:
    """Where a region is in its plane and how it spreads."""

    there: int  # 0: it has no length
    middle: wp.vec2d  # [m]
    height: wp.float64  # mean of the lines above the plane [m]
    area: wp.float64  # [m2]; 0 where nothing is enclosed, and the rest is that of the lines
    variance: wp.vec2d  # along the main axes [m2], the larger first
    axis: wp.vec2d  # unit vector of the larger


@wp.struct
class RegionSums:
    """RegionSums over polylines, and which of them each region has."""

    area: wp.array2d[wp.float64]  # as `Regions.area`
    stroke: wp.array2d[wp.float64]  # of `_measure_strokes`
    region_start: wp.array[wp.int64]
    region_line: wp.array[wp.int32]


@wp.kernel
def _measure_strokes(
    # In:
    local: wp.array[wp.vec3d],  # [m]
    polyline_start: wp.array[wp.int64],
    # Out:
    stroke: wp.array2d[wp.float64],  # 0, shape [polyline, 7]
):
    """Sum length [m], first [m2] and second moments xx xy yy [m3] of segments, and length times height [m2]."""
    line = wp.tid()
    two = wp.float64(2.0)
    three = wp.float64(3.0)
    i = polyline_start[line]
    while i < polyline_start[line + 1] - wp.int64(1):
        a = local[i]
        i += wp.int64(1)
        b = local[i]
        x = a[0]
        y = a[1]
        p = b[0]
        q = b[1]
        length = wp.sqrt((p - x) * (p - x) + (q - y) * (q - y))
        stroke[line, 0] += length
        stroke[line, 1] += length * ((x + p) / two)
        stroke[line, 2] += length * ((y + q) / two)
        stroke[line, 3] += length * ((x * x + x * p + p * p) / three)
        stroke[line, 4] += length * ((two * x * y + x * q + p * y + two * p * q) / wp.float64(6.0))
        stroke[line, 5] += length * ((y * y + y * q + q * q) / three)
        stroke[line, 6] += wp.length(b - a) * (a[2] + b[2]) / two


@wp.func
def sum_of(value: wp.array2d[wp.float64], sums: RegionSums, region: int, column: int):
    """Sum of a column over the polylines of a region."""
    total = wp.float64(0.0)
    for k in range(int(sums.region_start[region]), int(sums.region_start[region + 1])):
        total += value[sums.region_line[k], column]
    return total


@wp.func
def moment_of(sums: RegionSums, region: int, column: int, lines: int):
    """A moment of a region's area, or of its lines."""
    if lines == 1:
        return sum_of(sums.stroke, sums, region, column)
    return sum_of(sums.area, sums, region, column)


@wp.func
def main_axis(xx: wp.float64, xy: wp.float64, yy: wp.float64):
    """Variances along the main axes of a symmetric tensor, the larger first, and the unit vector of the larger."""
    zero = wp.float64(0.0)
    mean = wp.float64(0.5) * (xx + yy)
    off = wp.float64(0.5) * (xx - yy)
    radius = wp.sqrt(off * off + xy * xy)
    axis = wp.vec2d(wp.float64(1.0), zero)
    if radius > ROUND * mean:
        if off >= zero:  # each form where it does not cancel
            axis = wp.vec2d(off + radius, xy)
        else:
            axis = wp.vec2d(xy, radius - off)
        axis = axis / wp.length(axis)
        if axis[0] < zero or (axis[0] == zero and axis[1] < zero):
            axis = -axis
    return wp.vec2d(wp.max(mean + radius, zero), wp.max(mean - radius, zero)), axis


@wp.func
def spread_of(sums: RegionSums, region: int, of: int):
    """Moments of the area that a region encloses, or of its lines: of LINE, or where it encloses none."""
    s = Spread()
    zero = wp.float64(0.0)
    length = sum_of(sums.stroke, sums, region, 0)
    s.area = sum_of(sums.area, sums, region, 0)
    lines = int(0)
    total = s.area
    if of == LINE or s.area <= SLIVER * (length * length):
        lines = int(1)
        s.area = wp.max(s.area, zero)
        total = length
    s.there = int(0)
    if length > zero and total > zero:
        s.there = int(1)
        s.height = sum_of(sums.stroke, sums, region, 6) / length
        x = moment_of(sums, region, 1, lines) / total
        y = moment_of(sums, region, 2, lines) / total
        s.middle = wp.vec2d(x, y)
        xx = moment_of(sums, region, 3, lines) / total - x * x
        xy = moment_of(sums, region, 4, lines) / total - x * y
        yy = moment_of(sums, region, 5, lines) / total - y * y
        variance, axis = main_axis(xx, xy, yy)
        s.variance = variance
        s.axis = axis
    return s


def sum_moments(regions: Regions) -> Any:
    """RegionSums over the polylines of regions that `spread_of` takes, `RegionSums`."""
    sums = RegionSums()
    sums.area, sums.region_start, sums.region_line = regions.area, regions.region_start, regions.region_line
    sums.stroke = wp.zeros((regions.line_pose.shape[0], 7), dtype=wp.float64, device=regions.local.device)
    launch(_measure_strokes, sums.stroke.shape[0], [regions.local, regions.polyline_start], [sums.stroke])
    return sums
