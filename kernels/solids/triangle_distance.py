"""Distance of a point from a triangle, in float64: float32 loses a tenth of a millimetre on long, thin triangles."""

import warp as wp

from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.func
def segment_distance(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d):
    """Distance of a point from a segment."""
    along = b - a
    square = wp.dot(along, along)
    share = wp.float64(0.0)
    if square > wp.float64(0.0):
        share = wp.clamp(wp.dot(p - a, along) / square, wp.float64(0.0), wp.float64(1.0))
    return wp.length(p - a - share * along)


@wp.func
def triangle_distance(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Distance of a point from a triangle."""
    n = wp.cross(b - a, c - a)
    square = wp.dot(n, n)
    if square > wp.float64(0.0):
        one = wp.dot(wp.cross(b - a, p - a), n) >= wp.float64(0.0)
        two = wp.dot(wp.cross(c - b, p - b), n) >= wp.float64(0.0)
        three = wp.dot(wp.cross(a - c, p - c), n) >= wp.float64(0.0)
        if one and two and three:
            return wp.abs(wp.dot(p - a, n)) / wp.sqrt(square)
    return wp.min(segment_distance(p, a, b), wp.min(segment_distance(p, b, c), segment_distance(p, c, a)))
