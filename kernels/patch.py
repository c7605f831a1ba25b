"""A patch of skin: its frame at a pose, and the predicates that decide what lies on it.

Every decision of the geometry (which side of the plane, which side of the patch, which way round a corner) is one
`wp.func` here, on float64, so that a plane tilted against a face by 1e-4 rad is not cut 0.4 mm off. Poses and vertices
are float32: a palm that rests on a face is off by their rounding, so what is below a plane, or inside a side, by
`Frame.flush` at most counts as on it. Modules that use these functions must be compiled with `EXACT`: a fused
multiply-add would give two passes, or CPU and GPU, different answers about the same number.
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
ON = wp.constant(wp.float64(1e-12))  # [m]; the least `Frame.flush`
FLUSH_MOST = wp.constant(wp.float64(1e-3))  # [m]; the largest `Frame.flush`: more would be felt
UNBOUNDED = wp.constant(wp.float64(1e30))  # [m]; half extent of a patch that cuts nothing off
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
    flush: wp.float64  # the least `Frame.flush`, which lies in ON..FLUSH_MOST [m]
    flush_rate: wp.float64  # `Frame.flush` for each metre of the patch's largest coordinate
    relative: wp.int32  # 1: points are written along u, v and n from the patch's middle, 0: in the array's frame


@wp.struct
class Coarse:
    """A patch's frame in float32, and what float32 may be wrong by: it answers first, float64 where it cannot tell."""

    origin: wp.vec3  # [m]
    u: wp.vec3
    v: wp.vec3
    n: wp.vec3
    distance: float  # of the plane from the array's origin, along n [m]
    half: wp.vec2  # half extents of the patch [m]
    unsure: float  # a coordinate this near to the plane or a side is asked in float64: its rounding, and flush [m]


@wp.struct
class Frame:
    """A patch's origin and axes in the array's frame, and what counts as on the patch's plane and sides."""

    origin: wp.vec3d  # [m]
    u: wp.vec3d
    v: wp.vec3d
    n: wp.vec3d
    flush: wp.float64  # a vertex below the plane, or a contour vertex inside a side, by this at most is on it [m]
    relative: wp.int32  # as `Patch.relative`


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
    far = wp.max(wp.max(wp.abs(f.origin[0]), wp.abs(f.origin[1])), wp.abs(f.origin[2]))
    f.flush = wp.clamp(wp.max(patch.flush, patch.flush_rate * far), ON, FLUSH_MOST)
    f.relative = patch.relative
    return f


@wp.func
def section_frame(pose: wp.array2d[wp.transform], patch: wp.array[Patch], section: int):
    """Frame of a section's patch; pose: shape [pose, 1] if patches lie in the hand's frame, else [pose, patch]."""
    row = section // patch.shape[0]
    own = section % patch.shape[0]
    return frame_at(pose[row, wp.min(own, pose.shape[1] - 1)], patch[own])


@wp.func
def placed(f: Frame, x: wp.vec3):
    """Coordinates of a vertex along u, v and n [m]; the last is exactly 0 where it counts as on the plane.

    Only a vertex below the plane is brought to it: one above is on the +n side as it is, and its contour stays exact.
    """
    d = widened(x) - f.origin
    h = wp.dot(f.n, d)
    if -f.flush <= h and h <= ON:
        h = wp.float64(0.0)
    return wp.vec3d(wp.dot(f.u, d), wp.dot(f.v, d), h)


@wp.func
def above(h: wp.float64):
    """Which side: a vertex on the plane counts as on the +n side."""
    return h >= wp.float64(0.0)


@wp.func
def narrowed(x: wp.vec3d):
    """The same vector in float32."""
    return wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))


@wp.func
def coarse_of(f: Frame, half: wp.vec2d, reach: float):
    """The frame in float32; `reach`: largest |x| + |y| + |z| of a vertex that will be asked about [m]."""
    g = Coarse()
    g.origin = narrowed(f.origin)
    g.u = narrowed(f.u)
    g.v = narrowed(f.v)
    g.n = narrowed(f.n)
    g.distance = wp.float32(wp.dot(f.n, f.origin))
    g.half = wp.vec2(wp.float32(half[0]), wp.float32(half[1]))
    # Origin, axes, difference, products and their sums: at most 7 roundings of 2^-24 each; flush and its own rounding.
    far = wp.abs(g.origin[0]) + wp.abs(g.origin[1]) + wp.abs(g.origin[2])
    g.unsure = 5.0e-7 * (reach + far) + 1.001 * wp.float32(f.flush) + 1.0e-12
    return g


@wp.func
def half_of(patch: Patch, bounded: int):
    """Half extents of a patch [m]; bounded: 0 for the whole plane."""
    if bounded == 0:
        return wp.vec2d(UNBOUNDED, UNBOUNDED)
    return patch.half


@wp.func
def is_above(f: Frame, g: Coarse, x: wp.vec3):
    """Which side of the plane a vertex is on."""
    h = wp.dot(g.n, x) - g.distance
    if wp.abs(h) > g.unsure:
        return h > 0.0
    return above(placed(f, x)[2])


@wp.func
def lifted(f: Frame, p: wp.vec2d):
    """Point of the patch's plane as it is written [m]: in the array's frame, or relative to the patch."""
    x = f.origin + p[0] * f.u + p[1] * f.v
    if f.relative == 1:
        x = wp.vec3d(p[0], p[1], wp.float64(0.0))
    return narrowed(x)


@wp.func
def brought_to_sides(p: wp.vec2d, half: wp.vec2d, flush: wp.float64):
    """A point of the patch's plane, brought to the patch's sides if it is inside and that near to them [m]."""
    x = half[0] - wp.abs(p[0])
    y = half[1] - wp.abs(p[1])
    most = flush - ON  # ON is taken off `half` already
    zero = wp.float64(0.0)
    u = wp.where(x > zero and x <= most, wp.where(p[0] < zero, -half[0], half[0]), p[0])
    v = wp.where(y > zero and y <= most, wp.where(p[1] < zero, -half[1], half[1]), p[1])
    return wp.vec2d(u, v)


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


def require_section_poses(pose: wp.array, patch: wp.array) -> None:
    """Raise ValueError unless poses are of the hand or of each of its patches, shape [pose, 1 or patch]."""
    if pose.ndim != 2 or pose.shape[1] not in (1, patch.shape[0]):
        raise ValueError(f"poses must have shape [pose, 1] or [pose, {patch.shape[0]}], not {list(pose.shape)}")
