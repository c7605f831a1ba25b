"""Ellipses, circles, and small circles at centroids, in the place of regions.

They have the moments of the area that a region's polylines enclose, or of the lines themselves, in a patch's plane.
The main axes come in closed form. Where both variances are equal, every axis is right. Rounding of points to float32
decides then, so the axis is u where the variances differ by less than 2e-6 of their mean; that moves no semi-axis's end
of a contact by more than 1e-7 m.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..contours import Contours
from ..offsets import launch, scan_counts
from ..patch import EXACT
from .regions import FlatLines, Regions, lift_polylines

wp.set_module_options(EXACT)

AREA, LINE, SECOND_MOMENTS = 0, 1, 2
OF = {"area": AREA, "line": LINE, "moments": SECOND_MOMENTS}
"""What an oval has of a region: its area, its lines' moments, its second moments."""
SLIVER = wp.constant(wp.float64(1e-9))  # of the squared length of lines: a smaller area is all rounding
ROUND = wp.constant(wp.float64(1e-6))  # of the mean variance: both count as equal if they are this near to it
LARGEST = wp.constant(wp.float64(0.1))  # [m] of the radius of a circle around lines
STRAIGHT = wp.constant(wp.float64(1e-6))  # of the larger variance: with a smaller one, lines are straight
PI = wp.constant(wp.float64(math.pi))
ROOT_TWO = wp.constant(wp.float64(math.sqrt(2.0)))


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
class Oval:
    """An ellipse in the plane of a patch."""

    there: int  # 0: the region has no length, so it has none
    middle: wp.vec2d  # [m]
    axis: wp.vec2d  # unit vector of the first semi-axis
    size: wp.vec2d  # semi-axes [m]
    height: wp.float64  # above the plane [m]


@wp.kernel
def _measure_strokes(r: Regions, stroke: wp.array2d[wp.float64]):
    """Sum length [m], first [m2] and second moments xx xy yy [m3] of segments, and length times height [m2].

    stroke: 0 before, shape [polyline, 7].
    """
    line = wp.tid()
    two = wp.float64(2.0)
    three = wp.float64(3.0)
    i = r.polyline_start[line]
    while i < r.polyline_start[line + 1] - wp.int64(1):
        a = r.local[i]
        i += wp.int64(1)
        b = r.local[i]
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
def sum_of(value: wp.array2d[wp.float64], r: Regions, region: int, column: int):
    """Sum of a column over the polylines of a region."""
    total = wp.float64(0.0)
    for k in range(int(r.region_start[region]), int(r.region_start[region + 1])):
        total += value[r.region_line[k], column]
    return total


@wp.func
def moment_of(r: Regions, stroke: wp.array2d[wp.float64], region: int, column: int, lines: int):
    """A moment of a region's area, or of its lines."""
    if lines == 1:
        return sum_of(stroke, r, region, column)
    return sum_of(r.area, r, region, column)


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
def spread_of(r: Regions, stroke: wp.array2d[wp.float64], region: int, of: int):
    """Moments of the area that a region encloses, or of its lines: of LINE, or where it encloses none."""
    s = Spread()
    zero = wp.float64(0.0)
    length = sum_of(stroke, r, region, 0)
    s.area = sum_of(r.area, r, region, 0)
    lines = int(0)
    total = s.area
    if of == LINE or s.area <= SLIVER * (length * length):
        lines = int(1)
        s.area = wp.max(s.area, zero)
        total = length
    s.there = int(0)
    if length > zero and total > zero:
        s.there = int(1)
        s.height = sum_of(stroke, r, region, 6) / length
        x = moment_of(r, stroke, region, 1, lines) / total
        y = moment_of(r, stroke, region, 2, lines) / total
        s.middle = wp.vec2d(x, y)
        xx = moment_of(r, stroke, region, 3, lines) / total - x * x
        xy = moment_of(r, stroke, region, 4, lines) / total - x * y
        yy = moment_of(r, stroke, region, 5, lines) / total - y * y
        variance, axis = main_axis(xx, xy, yy)
        s.variance = variance
        s.axis = axis
    return s


@wp.func
def oval_of(s: Spread, middle: wp.vec2d, size: wp.vec2d):
    """The oval of a region."""
    out = Oval()
    out.there = s.there
    out.middle = middle
    out.axis = s.axis
    out.size = size
    out.height = s.height
    return out


@wp.kernel
def _fit_ellipses(
    r: Regions, stroke: wp.array2d[wp.float64], of: int, scale: wp.float64, smallest: wp.float64, oval: wp.array[Oval]
):
    """Fit the ellipse of a region's area and proportions, or of its second moments."""
    region = wp.tid()
    s = spread_of(r, stroke, region, of)
    if s.there == 0:
        return
    a = wp.sqrt(s.variance[0])
    b = wp.sqrt(s.variance[1])
    size = wp.vec2d(ROOT_TWO * a, ROOT_TWO * b)
    if of != LINE and s.area > wp.float64(0.0):
        size = wp.vec2d(wp.float64(2.0) * a, wp.float64(2.0) * b)
        if of == AREA and b > wp.float64(0.0):
            size = wp.vec2d(wp.sqrt(s.area / PI * a / b), wp.sqrt(s.area / PI * b / a))
    size = wp.vec2d(wp.max(scale * size[0], smallest), wp.max(scale * size[1], smallest))
    oval[region] = oval_of(s, s.middle, size)


@wp.struct
class CircleSums:
    """Integrals along lines about a middle, for the circle nearest to them."""

    xx: wp.float64  # [m3]
    xy: wp.float64
    yy: wp.float64
    x: wp.float64  # of the squared distance times x [m4]
    y: wp.float64


@wp.func
def add_place(c: CircleSums, x: wp.vec2d, weight: wp.float64):
    """The integrals with a place's share."""
    square = wp.dot(x, x)
    c.xx += weight * (x[0] * x[0])
    c.xy += weight * (x[0] * x[1])
    c.yy += weight * (x[1] * x[1])
    c.x += weight * (square * x[0])
    c.y += weight * (square * x[1])
    return c


@wp.func
def add_line(c: CircleSums, local: wp.array[wp.vec3d], first: wp.int64, last: wp.int64, middle: wp.vec2d):
    """The integrals with a polyline's share, by Simpson's rule along each segment, which is exact for cubics."""
    i = first
    while i < last:
        a = wp.vec2d(local[i][0], local[i][1])
        i += wp.int64(1)
        b = wp.vec2d(local[i][0], local[i][1])
        weight = wp.length(b - a) / wp.float64(6.0)
        a = a - middle
        b = b - middle
        c = add_place(c, a, weight)
        c = add_place(c, wp.float64(0.5) * (a + b), wp.float64(4.0) * weight)
        c = add_place(c, b, weight)
    return c


@wp.func
def nearest_circle(s: Spread, c: CircleSums, length: wp.float64):
    """Shift of the middle [m], and radius [m], of the circle nearest to lines by least squares (Kasa 1976).

    s: moments of the lines. Their middle is their centroid, so the radius decouples from the shift in the normal
    equations, and the shift is 0.5 xx^-1 x: the tensor's inverse on the vector of third moments.
    """
    none = wp.vec2d()
    around = wp.min(ROOT_TWO * wp.sqrt(s.variance[0]), LARGEST)
    if s.variance[1] <= STRAIGHT * s.variance[0]:  # a straight line: a circle around it
        return none, around
    det = c.xx * c.yy - c.xy * c.xy
    if det <= wp.float64(0.0):
        return none, around
    half = wp.float64(0.5)
    p = half * (c.yy * c.x - c.xy * c.y) / det
    q = half * (c.xx * c.y - c.xy * c.x) / det
    radius = wp.sqrt((c.xx + c.yy) / length + p * p + q * q)
    if radius > LARGEST:
        return none, around
    return wp.vec2d(p, q), radius


@wp.kernel
def _fit_circles(
    r: Regions, stroke: wp.array2d[wp.float64], of: int, scale: wp.float64, smallest: wp.float64, oval: wp.array[Oval]
):
    """Fit the circle of a region's area, or the one nearest to its lines."""
    region = wp.tid()
    s = spread_of(r, stroke, region, of)
    if s.there == 0:
        return
    middle = s.middle
    radius = wp.sqrt(s.area / PI)
    if of == LINE or radius <= wp.float64(0.0):
        c = CircleSums()
        for k in range(int(r.region_start[region]), int(r.region_start[region + 1])):
            line = r.region_line[k]
            c = add_line(c, r.local, r.polyline_start[line], r.polyline_start[line + 1] - wp.int64(1), middle)
        shift, nearest = nearest_circle(s, c, sum_of(stroke, r, region, 0))
        middle = middle + shift
        radius = nearest
    radius = wp.max(scale * radius, smallest)
    oval[region] = oval_of(s, middle, wp.vec2d(radius, radius))


@wp.kernel
def _find_centroids(r: Regions, stroke: wp.array2d[wp.float64], radius: wp.float64, oval: wp.array[Oval]):
    """Put a circle of this radius around a region's centroid."""
    region = wp.tid()
    s = spread_of(r, stroke, region, AREA)
    oval[region] = oval_of(s, s.middle, wp.vec2d(radius, radius))


@wp.kernel
def _count_corners(
    oval: wp.array[Oval],
    corners: int,
    count: wp.array[wp.int64],
    region_of: wp.array[wp.int32],
    height: wp.array[wp.float64],
):
    """Write how many corners a region's oval has, the region, and the oval's height; count: shape [region + 1]."""
    region = wp.tid()
    count[region] = wp.int64(oval[region].there * corners)
    region_of[region] = region
    height[region] = oval[region].height


@wp.kernel
def _draw_ovals(
    # In:
    oval: wp.array[Oval],
    turn: wp.array[wp.vec2d],  # cosine and sine at each corner
    bulge: wp.float64,
    start: wp.array[wp.int64],
    # Out:
    flat: wp.array[wp.vec2d],  # [m]
):
    """Write one corner of an oval, the first at the end of its first semi-axis."""
    region, k = wp.tid()
    if start[region + 1] > start[region]:
        one = oval[region]
        along = one.size[0] * turn[k][0] * one.axis
        across = one.size[1] * turn[k][1] * wp.vec2d(-one.axis[1], one.axis[0])
        flat[start[region] + wp.int64(k)] = one.middle + bulge * (along + across)


class Ovals(NamedTuple):
    """The ovals of regions."""

    regions: Regions
    oval: wp.array  # Oval, shape [region]


def fit_ellipses(regions: Regions, *, of: str, scale: float, smallest: float) -> Ovals:
    """The ellipse of each region's "area" and proportions, of its second "moments", or of those of its "line".

    What encloses nothing is taken as of "line". scale: factor on the semi-axes; none is below `smallest` [m].
    """
    return _fitted(_fit_ellipses, regions, OF[of], wp.float64(scale), wp.float64(smallest))


def fit_circles(regions: Regions, *, of: str, scale: float, smallest: float) -> Ovals:
    """The circle of each region's "area", or the one nearest to its "line", also of what encloses nothing."""
    return _fitted(_fit_circles, regions, OF[of], wp.float64(scale), wp.float64(smallest))


def find_centroids(regions: Regions, radius: float) -> Ovals:
    """A circle of this radius [m] around the centroid of each region's area, or of its lines if it encloses nothing."""
    return _fitted(_find_centroids, regions, wp.float64(radius))


def measure_strokes(regions: Regions) -> wp.array:
    """Moments of the lines of polylines that `spread_of` takes, float64, shape [polyline, 7]."""
    stroke = wp.zeros((regions.line_pose.shape[0], 7), dtype=wp.float64, device=regions.local.device)
    launch(_measure_strokes, stroke.shape[0], [regions], [stroke])
    return stroke


def _fitted(kernel: wp.Kernel, regions: Regions, *options: Any) -> Ovals:
    """The ovals that a kernel finds."""
    count = regions.region_start.shape[0] - 1
    out = Ovals(regions, wp.zeros(count, dtype=Oval, device=regions.local.device))
    launch(kernel, count, [regions, measure_strokes(regions), *options], [out.oval])
    return out


@lru_cache(maxsize=8)
def _turns(corners: int, device: str) -> wp.array:
    """Cosine and sine at the corners of a polygon, by NumPy: devices' own would differ in the last bit."""
    angle = 2 * np.pi * np.arange(corners) / corners
    return wp.array(np.stack([np.cos(angle), np.sin(angle)], axis=1), dtype=wp.vec2d, device=device)


def draw_ovals(
    ovals: Ovals, corners: int, patches: Any, pose_count: int, *, point_limit: int | None = None
) -> Contours:
    """Polygons of exactly the ovals' areas, counter-clockwise from an end of the first semi-axis, in the array's frame.

    patches: `Patches`. Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    device, count = ovals.oval.device, ovals.oval.shape[0]
    size, region = wp.zeros(count + 1, dtype=wp.int64, device=device), wp.empty(count, dtype=wp.int32, device=device)
    height = wp.empty(count, dtype=wp.float64, device=device)
    launch(_count_corners, count, [ovals.oval, corners], [size, region, height])
    (start,), (total,) = scan_counts(size, limit=point_limit)
    flat = FlatLines(wp.empty(total, dtype=wp.vec2d, device=device), start, region)
    bulge = wp.float64(math.sqrt(2 * math.pi / (corners * math.sin(2 * math.pi / corners))))
    launch(_draw_ovals, (count, corners), [ovals.oval, _turns(corners, str(device)), bulge, start], [flat.points])
    limits = {"height": height, "point_limit": point_limit}
    return lift_polylines(flat, ovals.regions, patches, pose_count, closed=True, **limits)
