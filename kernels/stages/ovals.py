"""Ellipses, circles, and small circles at centroids, in the place of regions."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..offsets import PointLimitError, last_of, offsets_of
from ..patch import EXACT
from .cut import launch
from .lift import Lifted, lift_polylines
from .region_moments import AREA, LINE, OF, RegionSums, Spread, spread_of, sum_moments, sum_of
from .regions import Regions

wp.set_module_options(EXACT)

LARGEST = wp.constant(wp.float64(0.1))  # [m] of the radius of a circle around lines
STRAIGHT = wp.constant(wp.float64(1e-6))  # of the larger variance: with a smaller one, lines are straight
PI = wp.constant(wp.float64(math.pi))
ROOT_TWO = wp.constant(wp.float64(math.sqrt(2.0)))


@wp.struct
class Oval:
    """An ellipse in the plane of a patch."""

    middle: wp.vec2d  # [m]
    axis: wp.vec2d  # unit vector of the first semi-axis
    size: wp.vec2d  # semi-axes [m]


@wp.kernel
def _fit_ellipses(
    # In:
    sums: RegionSums,
    of: int,
    scale: wp.float64,
    smallest: wp.float64,  # [m]
    # Out:
    oval: wp.array[Oval],
    height: wp.array[wp.float64],
    there: wp.array[wp.int64],  # 0, shape [region]; 1: the region has an oval
):
    """Fit the ellipse of a region's area and proportions, or of its second moments."""
    region = wp.tid()
    s = spread_of(sums, region, of)
    if s.there == 0:
        return
    a = wp.sqrt(s.variance[0])
    b = wp.sqrt(s.variance[1])
    size = wp.vec2d(ROOT_TWO * a, ROOT_TWO * b)
    if of != LINE and s.area > wp.float64(0.0):
        size = wp.vec2d(wp.float64(2.0) * a, wp.float64(2.0) * b)
        if of == AREA and b > wp.float64(0.0):
            size = wp.vec2d(wp.sqrt(s.area / PI * a / b), wp.sqrt(s.area / PI * b / a))
    oval[region].middle = s.middle
    oval[region].axis = s.axis
    oval[region].size = wp.vec2d(wp.max(scale * size[0], smallest), wp.max(scale * size[1], smallest))
    height[region] = s.height
    there[region] = wp.int64(1)


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
    # In:
    local: wp.array[wp.vec3d],  # [m]
    polyline_start: wp.array[wp.int64],
    sums: RegionSums,
    of: int,
    scale: wp.float64,
    smallest: wp.float64,  # [m]
    # Out:
    oval: wp.array[Oval],
    height: wp.array[wp.float64],
    there: wp.array[wp.int64],  # 0, shape [region]; 1: the region has an oval
):
    """Fit the circle of a region's area, or the one nearest to its lines."""
    region = wp.tid()
    s = spread_of(sums, region, of)
    if s.there == 0:
        return
    middle = s.middle
    radius = wp.sqrt(s.area / PI)
    if of == LINE or radius <= wp.float64(0.0):
        c = CircleSums()
        for k in range(int(sums.region_start[region]), int(sums.region_start[region + 1])):
            line = sums.region_line[k]
            c = add_line(c, local, polyline_start[line], polyline_start[line + 1] - wp.int64(1), middle)
        shift, nearest = nearest_circle(s, c, sum_of(sums.stroke, sums, region, 0))
        middle = middle + shift
        radius = nearest
    radius = wp.max(scale * radius, smallest)
    oval[region].middle = middle
    oval[region].axis = s.axis
    oval[region].size = wp.vec2d(radius, radius)
    height[region] = s.height
    there[region] = wp.int64(1)


@wp.kernel
def _find_centroids(
    # In:
    sums: RegionSums,
    radius: wp.float64,  # [m]
    # Out:
    oval: wp.array[Oval],
    height: wp.array[wp.float64],
    there: wp.array[wp.int64],  # 0, shape [region]; 1: the region has an oval
):
    """Put a circle of this radius around a region's centroid."""
    region = wp.tid()
    s = spread_of(sums, region, AREA)
    if s.there == 0:
        return
    oval[region].middle = s.middle
    oval[region].axis = s.axis
    oval[region].size = wp.vec2d(radius, radius)
    height[region] = s.height
    there[region] = wp.int64(1)


@wp.kernel
def _describe_ovals(
    # In:
    there: wp.array[wp.int64],
    corners: int,
    region_start: wp.array[wp.int64],
    region_line: wp.array[wp.int32],
    line_pose: wp.array[wp.int32],
    line_patch: wp.array[wp.int32],
    # Out:
    count: wp.array[wp.int64],  # 0, shape [region + 1]
    pose: wp.array[wp.int32],
    patch: wp.array[wp.int32],
):
    """Write how many corners a region's oval has, and its pose and patch."""
    region = wp.tid()
    line = region_line[region_start[region]]
    count[region] = there[region] * wp.int64(corners)
    pose[region] = line_pose[line]
    patch[region] = line_patch[line]


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
    """Device arrays of the ovals of regions, and the regions."""

    regions: Regions
    oval: wp.array  # Oval, shape [region]
    height: wp.array  # above the patch's plane [m], float64, shape [region]
    there: wp.array  # int64, shape [region]; 0: the region has no length, so it has no oval


def fit_ellipses(regions: Regions, *, of: str, scale: float, smallest: float) -> Ovals:
    """The ellipse of each region's "area" and proportions, of its second "moments", or of those of its "line".

    What encloses nothing is taken as of "line". scale: factor on the semi-axes; none is below `smallest` [m].
    """
    ovals = _no_ovals(regions)
    options = [OF[of], wp.float64(scale), wp.float64(smallest)]
    launch(_fit_ellipses, regions.region_count, [sum_moments(regions), *options], list(ovals[1:]))
    return ovals


def fit_circles(regions: Regions, *, of: str, scale: float, smallest: float) -> Ovals:
    """The circle of each region's "area", or the one nearest to its "line", also of what encloses nothing."""
    ovals = _no_ovals(regions)
    options = [OF[of], wp.float64(scale), wp.float64(smallest)]
    lines = [regions.local, regions.polyline_start, sum_moments(regions)]
    launch(_fit_circles, regions.region_count, [*lines, *options], list(ovals[1:]))
    return ovals


def find_centroids(regions: Regions, radius: float) -> Ovals:
    """A circle of this radius [m] around the centroid of each region's area, or of its lines if it encloses nothing."""
    ovals = _no_ovals(regions)
    launch(_find_centroids, regions.region_count, [sum_moments(regions), wp.float64(radius)], list(ovals[1:]))
    return ovals


def _no_ovals(regions: Regions) -> Ovals:
    """Arrays for the ovals of regions, none written."""
    count, device = regions.region_count, regions.local.device
    oval = wp.zeros(count, dtype=Oval, device=device)
    height = wp.zeros(count, dtype=wp.float64, device=device)
    return Ovals(regions, oval, height, wp.zeros(count, dtype=wp.int64, device=device))


@lru_cache(maxsize=8)
def _turns(corners: int, device: str) -> wp.array:
    """Cosine and sine at the corners of a polygon, by NumPy: devices' own would differ in the last bit."""
    angle = 2 * np.pi * np.arange(corners) / corners
    return wp.array(np.stack([np.cos(angle), np.sin(angle)], axis=1), dtype=wp.vec2d, device=device)


def draw_ovals(ovals: Ovals, corners: int, patches: Any, pose_count: int, *, point_limit: int | None = None) -> Lifted:
    """Polygons of exactly the ovals' areas, counter-clockwise from an end of the first semi-axis, in the array's frame.

    patches: `Patches`. Raises PointLimitError before memory is taken for more points than `point_limit`.
    """
    regions, device, count = ovals.regions, ovals.oval.device, ovals.there.shape[0]
    size = wp.zeros(count + 1, dtype=wp.int64, device=device)
    pose, patch = (wp.empty(count, dtype=wp.int32, device=device) for _ in range(2))
    where = [regions.region_start, regions.region_line, regions.line_pose, regions.line_patch]
    launch(_describe_ovals, count, [ovals.there, corners, *where], [size, pose, patch])
    start = offsets_of(size)
    total = last_of(start)
    if point_limit is not None and total > point_limit:
        raise PointLimitError(total, point_limit)
    flat = wp.empty(total, dtype=wp.vec2d, device=device)
    bulge = math.sqrt(2 * math.pi / (corners * math.sin(2 * math.pi / corners)))
    turns = _turns(corners, str(device))
    launch(_draw_ovals, (count, corners), [ovals.oval, turns, wp.float64(bulge), start], [flat])
    closed = wp.full(count, 1, dtype=wp.uint8, device=device)
    lines = (flat, start, pose, patch, closed)
    return lift_polylines(*lines, patches, pose_count, height=ovals.height, point_limit=point_limit)
