"""A patch of skin: its frame at a pose, and the predicates that decide what lies on it.

Every decision of the geometry (which side of the plane, which side of the patch, which way round a corner) is one
`wp.func` here, on float64: poses and vertices are float32, so a palm that is flush with a face is off by rounding of
1e-17 m, far below ON, and a plane tilted against a face by 1e-4 rad is not cut 0.4 mm off. Modules that use them must
be compiled with `EXACT`: a fused multiply-add would give two passes, or CPU and GPU, different answers about the same
number.
"""

import warp as wp

EXACT = {"fuse_fp": False, "fast_math": False, "enable_backward": False, "default_grid_stride": False}

# A patch's sides and corners, counter-clockwise seen from +n; corner k is where side k starts.
#
#        3 ----- side 2 ----- 2        outcode bit   set where
#        |          v         |        1  (side 0)   v <= -half v
#      side 3       +--u    side 1     2  (side 1)   u >=  half u
#        |                    |        4  (side 2)   v >=  half v
#        0 ----- side 0 ----- 1        8  (side 3)   u <= -half u
ON = wp.constant(wp.float64(1e-12))  # [m]; what is this near to a plane or side counts as on it
BOTTOM = wp.constant(1)
RIGHT = wp.constant(2)
TOP = wp.constant(4)
LEFT = wp.constant(8)


@wp.struct
class Patch:
    """A bounded plane of skin in the hand's frame."""

    origin: wp.vec3d  # [m]
    u: wp.vec3d
    v: wp.vec3d
    n: wp.vec3d  # u x v, into the hand
    half: wp.vec2d  # half extents along u and v, less ON [m]


@wp.struct
class Frame:
    """A patch's origin and axes in the array's frame."""

    origin: wp.vec3d  # [m]
    u: wp.vec3d
    v: wp.vec3d
    n: wp.vec3d


@wp.func
def widened(x: wp.vec3):
    """The same vector in float64."""
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def rotated(a: wp.vec3d, w: wp.float64, x: wp.vec3d):
    """Rotate x by the quaternion (a, w) of any norm."""
    s = wp.float64(2.0) / (wp.dot(a, a) + w * w)
    t = wp.cross(a, x)
    return x + s * (w * t + wp.cross(a, t))


@wp.func
def frame_at(pose: wp.transform, patch: Patch):
    """Frame of a patch of the hand at a pose."""
    q = wp.transform_get_rotation(pose)
    a = widened(wp.vec3(q[0], q[1], q[2]))
    w = wp.float64(q[3])
    f = Frame()
    f.origin = widened(wp.transform_get_translation(pose)) + rotated(a, w, patch.origin)
    f.u = rotated(a, w, patch.u)
    f.v = rotated(a, w, patch.v)
    f.n = rotated(a, w, patch.n)
    return f


@wp.func
def height(f: Frame, x: wp.vec3):
    """Signed height above the patch's plane [m]; exactly 0 where a vertex counts as on it."""
    h = wp.dot(f.n, widened(x) - f.origin)
    if wp.abs(h) <= ON:
        return wp.float64(0.0)
    return h


@wp.func
def above(h: wp.float64):
    """Which side: a vertex on the plane counts as on the +n side."""
    return h >= wp.float64(0.0)


@wp.func
def flat(f: Frame, x: wp.vec3):
    """Coordinates along u and v [m]."""
    d = widened(x) - f.origin
    return wp.vec2d(wp.dot(f.u, d), wp.dot(f.v, d))


@wp.func
def lifted(f: Frame, p: wp.vec2d):
    """Point of the patch's plane in the array's frame [m]."""
    x = f.origin + p[0] * f.u + p[1] * f.v
    return wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))


@wp.func
def outcode(p: wp.vec2d, half: wp.vec2d):
    """Sides of the patch that p lies on or beyond; 0 is strictly inside."""
    code = int(0)
    if p[1] <= -half[1]:
        code = code | BOTTOM
    if p[0] >= half[0]:
        code = code | RIGHT
    if p[1] >= half[1]:
        code = code | TOP
    if p[0] <= -half[0]:
        code = code | LEFT
    return code


@wp.func
def corner(k: int, half: wp.vec2d):
    """Corner k of the patch, 0..3 [m]."""
    x = half[0]
    y = half[1]
    if k == 0 or k == 3:
        x = -x
    if k == 0 or k == 1:
        y = -y
    return wp.vec2d(x, y)


@wp.func
def left_of(p: wp.vec2d, q: wp.vec2d, c: wp.vec2d):
    """Whether corner c lies to the left of p -> q or on it.

    Monotone in each coordinate of c however it rounds, so the answers at a patch's four corners always fit one line.
    """
    return (q[0] - p[0]) * (c[1] - p[1]) - (q[1] - p[1]) * (c[0] - p[0]) >= wp.float64(0.0)


@wp.func
def crosses(k: int, p: wp.vec2d, q: wp.vec2d, code_p: int, code_q: int, half: wp.vec2d):
    """Whether p -> q crosses side k of the patch: 1 outward, -1 inward, 0 not.

    A segment that passes a corner asks `left_of` about it once for both sides, so it crosses exactly one of them, or
    cuts the corner off by crossing both, or misses both:

        corner between p and q (both sides' bits differ)   side ending in it      side starting in it
        outward                                            crossed if left        crossed if not left
        inward                                             crossed if not left    crossed if left
    """
    side = 1 << k
    if (code_p & side) == (code_q & side):
        return 0
    outward = (code_q & side) != 0
    after = 1 << ((k + 1) % 4)
    before = 1 << ((k + 3) % 4)
    if (code_p & after) != (code_q & after):
        if left_of(p, q, corner((k + 1) % 4, half)) != outward:
            return 0
    elif (code_p & after) != 0:
        return 0
    if (code_p & before) != (code_q & before):
        if left_of(p, q, corner(k, half)) == outward:
            return 0
    elif (code_p & before) != 0:
        return 0
    if outward:
        return 1
    return -1


@wp.func
def blend(x: wp.float64, y: wp.float64, a: wp.float64, b: wp.float64):
    """Value between x and y where the one that runs from a to b is 0, from the nearer end: exact at both ends."""
    if wp.abs(a) <= wp.abs(b):
        return x + (a / (a - b)) * (y - x)
    return y + (b / (b - a)) * (x - y)


@wp.func
def side_point(k: int, p: wp.vec2d, q: wp.vec2d, half: wp.vec2d):
    """Where p -> q crosses side k, never beyond its corners [m]."""
    if k == 1 or k == 3:
        x = half[0]
        if k == 3:
            x = -x
        return wp.vec2d(x, wp.clamp(blend(p[1], q[1], p[0] - x, q[0] - x), -half[1], half[1]))
    y = half[1]
    if k == 0:
        y = -y
    return wp.vec2d(wp.clamp(blend(p[0], q[0], p[1] - y, q[1] - y), -half[0], half[0]), y)


@wp.func
def side_position(k: int, p: wp.vec2d):
    """How far along side k a point of it lies, counter-clockwise."""
    if k == 0:
        return p[0]
    if k == 1:
        return p[1]
    if k == 2:
        return -p[0]
    return -p[1]
