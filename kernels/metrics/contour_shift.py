"""Whether contours move farther from a pose to the next than a focal point may step.

A point's shift is its distance from the nearest point of the next pose's contours. Contours that appear there do not
count; those that disappear do, as the focal point that draws them must continue elsewhere.
"""

import warp as wp

from ..contours import Contours
from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float64

wp.set_module_options(EXACT)


INNER = wp.constant(wp.float64(1.0 - 1e-9))  # share of a distance within which rounding decides nothing


@wp.func
def square_to_segment(p: wp.vec3d, c: Contours, i: wp.int64):
    """Square of a point's distance from the segment that begins at point i."""
    a = to_float64(c.points[i])
    along = to_float64(c.points[i + wp.int64(1)]) - a
    share = wp.dot(p - a, along) / wp.max(wp.dot(along, along), wp.float64(1.0e-30))
    off = p - a - wp.clamp(share, wp.float64(0.0), wp.float64(1.0)) * along
    return wp.dot(off, off)


@wp.func
def find_near(p: wp.vec3d, c: Contours, begin: wp.int64, end: wp.int64, after: wp.int64, limit: wp.float64):
    """A segment of polylines begin..end - 1 that is within a distance of a point; -1: there is none.

    The first one of those after a segment, or the first of all: along a contour, segments follow each other.
    """
    line = begin
    while line < end:
        stop = c.polyline_start[line + wp.int64(1)] - wp.int64(1)
        i = c.polyline_start[line]
        if i <= after:
            i = wp.min(after, stop)
        while i < stop:
            if square_to_segment(p, c, i) <= limit * limit:
                return i
            i += wp.int64(1)
        line += wp.int64(1)
    line = begin
    while line < end and c.polyline_start[line] < after:
        i = c.polyline_start[line]
        while i < wp.min(after, c.polyline_start[line + wp.int64(1)] - wp.int64(1)):
            if square_to_segment(p, c, i) <= limit * limit:
                return i
            i += wp.int64(1)
        line += wp.int64(1)
    return wp.int64(-1)


@wp.kernel
def _find_shifts(
    # In:
    c: Contours,
    compared: wp.array[wp.uint8],  # whether a pose is compared with the next, shape [pose]
    limit: wp.float64,  # [m]
    spacing: wp.float64,  # of the tested points [m]
    # Out:
    far: wp.array[wp.uint8],
):
    """Look from points along a polyline for the next pose's contours; one thread a polyline.

    What is near a segment is convex: where a segment of the polyline has both ends there, its points need no test.
    """
    line = wp.int64(wp.tid())
    pose = int(wp.lower_bound(c.pose_start, line + wp.int64(1))) - 1
    if pose + 2 >= c.pose_start.shape[0] or compared[pose] == wp.uint8(0):
        return
    begin = c.pose_start[pose + 1]
    end = c.pose_start[pose + 2]
    if begin == end:  # nothing is drawn at the next pose
        return
    inner = INNER * limit * limit
    found = wp.int64(-1)
    i = c.polyline_start[line]
    while i + wp.int64(1) < c.polyline_start[line + wp.int64(1)] and far[pose] == wp.uint8(0):
        a = to_float64(c.points[i])
        step = to_float64(c.points[i + wp.int64(1)]) - a
        count = int(wp.ceil(wp.length(step) / spacing))
        k = int(0)
        while k <= count:
            p = a + wp.float64(k) / wp.max(wp.float64(count), wp.float64(1.0)) * step
            square = limit * limit + wp.float64(1.0)
            if found >= wp.int64(0):  # where the point before was near, this one mostly is
                square = square_to_segment(p, c, found)
            if square > limit * limit:
                found = find_near(p, c, begin, end, found, limit)
                if found < wp.int64(0):
                    far[pose] = wp.uint8(1)
                    return
                square = square_to_segment(p, c, found)
            k += 1
            if k < count and square < inner and square_to_segment(a + step, c, found) < inner:
                k = count
        i += wp.int64(1)


@on_one_device
def find_shifts(contours: Contours, compared: wp.array, far: wp.array, *, limit: float, spacing: float) -> None:
    """Set to 1 where contours have a point that is farther than `limit` from those of the next pose.

    compared: for which poses, uint8, shape [pose]; the last has no next one. far: uint8, shape [pose], of zeros.
    limit [m]; spacing: of the tested points along contours [m]; shifts up to half of it may be missed.
    """
    inputs = [contours, compared, float(limit), float(spacing)]
    launch(_find_shifts, contours.polyline_closed.shape[0], inputs, [far])
