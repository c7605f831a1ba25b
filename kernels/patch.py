"""Patches of skin: their frames at a pose, and the predicates for a point's side of a patch's plane and boundary.

The predicates compute in float64, as float32 would cut a plane that is tilted against a face by 1e-4 rad 0.4 mm off.
Poses and vertices are float32, so rounding moves a palm that rests on a face slightly off it. Therefore a point counts
as on the plane if it is at most `Frame.flush` below it, and as on a side if it is at most that far inside the side.
Compile modules that use these functions with `EXACT`: with fused multiply-adds two passes, or CPU and GPU, could
classify the same point differently.
"""

from typing import Any

import warp as wp

from .offsets import BLOCK
from .one_device import on_one_device

EXACT = {"fuse_fp": False, "fast_math": False, "enable_backward": False, "default_grid_stride": False}

# For modules that run once an object, or seldom: LLVM's own bound of inlining instead of Warp's, which is forty times
# as high and makes their compilation two to five times as long. It changes no bit.
SELDOM = {**EXACT, "cpu_compiler_flags": "-march=native"}

wp.set_module_options(EXACT)

# A patch's sides and corners, counter-clockwise seen from +n; corner k is where side k starts.
#
#        3 ----- side 2 ----- 2        outcode bit   set where
#        |          v         |        1  (side 0)   v <= -half v
#      side 3       +--u    side 1     2  (side 1)   u >=  half u
#        |                    |        4  (side 2)   v >=  half v
#        0 ----- side 0 ----- 1        8  (side 3)   u <= -half u
ON = wp.constant(wp.float64(1e-12))  # [m]; smallest `Frame.flush`
FLUSH_MOST = wp.constant(wp.float64(1e-3))  # [m]; largest `Frame.flush`: a larger shift could be felt
UNBOUNDED = wp.constant(wp.float64(1e30))  # [m]; half extent that stands for the unbounded plane
BOTTOM = wp.constant(1)
RIGHT = wp.constant(2)
TOP = wp.constant(4)
LEFT = wp.constant(8)


@wp.struct
class Patch:
    """A rectangle of skin in the hand's frame."""

    origin: wp.vec3d  # [m]
    u: wp.vec3d
    v: wp.vec3d
    n: wp.vec3d  # u x v, into the hand
    half: wp.vec2d  # half extents along u and v, minus ON [m]
    flush: wp.float64  # lower bound of `Frame.flush`, which lies in ON..FLUSH_MOST [m]
    flush_rate: wp.float64  # `Frame.flush` per metre of the patch's largest coordinate
    relative: wp.int32  # 1: output points are (u, v, n) coordinates from the patch's middle; 0: in the array's frame


@wp.struct
class Coarse:
    """A patch's frame in float32 and its error bound, for a fast first test; float64 decides within the bound."""

    origin: wp.vec3  # [m]
    u: wp.vec3
    v: wp.vec3
    n: wp.vec3
    distance: float  # of the plane from the array's origin, along n [m]
    half: wp.vec2  # half extents of the patch [m]
    unsure: float  # error bound (rounding plus flush): a point nearer to the plane or a side needs float64 [m]


@wp.struct
class Frame:
    """A patch's origin and axes in the array's frame, and the tolerance for lying on its plane or sides."""

    origin: wp.vec3d  # [m]
    u: wp.vec3d
    v: wp.vec3d
    n: wp.vec3d
    flush: wp.float64  # a vertex at most this far below the plane, or inside a side, counts as on it [m]
    relative: wp.int32  # as `Patch.relative`


@wp.func
def to_float64(x: wp.vec3):
    """The vector in float64."""
    return wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2]))


@wp.func
def rotate(a: wp.vec3d, w: wp.float64, x: wp.vec3d):
    """Rotate x by the quaternion (a, w) of any norm."""
    s = wp.float64(2.0) / (wp.dot(a, a) + w * w)
    t = wp.cross(a, x)
    return x + s * (w * t + wp.cross(a, t))


@wp.func
def frame_at(pose: wp.transform, patch: Patch):
    """Frame of a patch of the hand at a pose."""
    q = wp.transform_get_rotation(pose)
    a = to_float64(wp.vec3(q[0], q[1], q[2]))
    w = wp.float64(q[3])
    f = Frame()
    f.origin = to_float64(wp.transform_get_translation(pose)) + rotate(a, w, patch.origin)
    f.u = rotate(a, w, patch.u)
    f.v = rotate(a, w, patch.v)
    f.n = rotate(a, w, patch.n)
    far = wp.max(wp.max(wp.abs(f.origin[0]), wp.abs(f.origin[1])), wp.abs(f.origin[2]))
    f.flush = wp.clamp(wp.max(patch.flush, patch.flush_rate * far), ON, FLUSH_MOST)
    f.relative = patch.relative
    return f


@wp.func
def section_frame(pose: wp.array2d[wp.transform], patch: wp.array[Patch], section: int):
    """Frame of a section's patch. pose: shape [pose, 1] if patches are fixed to the hand, else [pose, patch]."""
    row = section // patch.shape[0]
    own = section % patch.shape[0]
    return frame_at(pose[row, wp.min(own, pose.shape[1] - 1)], patch[own])


@wp.func
def patch_coordinates(f: Frame, x: wp.vec3):
    """Coordinates of a vertex along u, v and n [m]; n is exactly 0 if the vertex counts as on the plane.

    Vertices above the plane are not moved to it: they are on the +n side already, and their contour stays exact.
    """
    d = to_float64(x) - f.origin
    h = wp.dot(f.n, d)
    if -f.flush <= h and h <= ON:
        h = wp.float64(0.0)
    return wp.vec3d(wp.dot(f.u, d), wp.dot(f.v, d), h)


@wp.func
def above(h: wp.float64):
    """Whether height h [m] is on the +n side of the plane; the plane itself counts as the +n side."""
    return h >= wp.float64(0.0)


@wp.func
def to_float32(x: wp.vec3d):
    """The vector rounded to float32."""
    return wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))


@wp.func
def coarse_frame(f: Frame, half: wp.vec2d, reach: float):
    """The frame in float32. reach: largest |x| + |y| + |z| of any vertex that will be tested [m]."""
    g = Coarse()
    g.origin = to_float32(f.origin)
    g.u = to_float32(f.u)
    g.v = to_float32(f.v)
    g.n = to_float32(f.n)
    g.distance = wp.float32(wp.dot(f.n, f.origin))
    g.half = wp.vec2(wp.float32(half[0]), wp.float32(half[1]))
    # Origin, axes, difference, products and sums: at most 7 roundings of 2^-24 each. Added: flush with its rounding.
    far = wp.abs(g.origin[0]) + wp.abs(g.origin[1]) + wp.abs(g.origin[2])
    g.unsure = 5.0e-7 * (reach + far) + 1.001 * wp.float32(f.flush) + 1.0e-12
    return g


@wp.func
def half_extents(patch: Patch, bounded: int):
    """Half extents of a patch [m]; bounded = 0: UNBOUNDED, for the whole plane."""
    if bounded == 0:
        return wp.vec2d(UNBOUNDED, UNBOUNDED)
    return patch.half


@wp.func
def is_above(f: Frame, g: Coarse, x: wp.vec3):
    """Whether a vertex is on the +n side of the plane: float32 first, float64 where float32 is too inexact."""
    h = wp.dot(g.n, x) - g.distance
    if wp.abs(h) > g.unsure:
        return h > 0.0
    return above(patch_coordinates(f, x)[2])


@wp.func
def output_point(f: Frame, p: wp.vec2d):
    """The output point of plane coordinates p [m]: in the array's frame, or in the patch's if `Frame.relative`."""
    x = f.origin + p[0] * f.u + p[1] * f.v
    if f.relative == 1:
        x = wp.vec3d(p[0], p[1], wp.float64(0.0))
    return to_float32(x)


@wp.func
def snap_to_sides(p: wp.vec2d, half: wp.vec2d, flush: wp.float64):
    """A point of the patch's plane, moved onto each side that it is inside of by at most `flush` [m]."""
    x = half[0] - wp.abs(p[0])
    y = half[1] - wp.abs(p[1])
    most = flush - ON  # `half` is smaller by ON already
    zero = wp.float64(0.0)
    u = wp.where(x > zero and x <= most, wp.where(p[0] < zero, -half[0], half[0]), p[0])
    v = wp.where(y > zero and y <= most, wp.where(p[1] < zero, -half[1], half[1]), p[1])
    return wp.vec2d(u, v)


@wp.func
def outcode(p: wp.vec2d, half: wp.vec2d):
    """Bits of the sides that p lies on or beyond; 0: p is strictly inside."""
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


@on_one_device
def require_section_poses(pose: wp.array, patch: wp.array) -> None:
    """Raise ValueError unless poses have shape [pose, 1] (of the hand) or [pose, patch] (of each patch)."""
    if pose.ndim != 2 or pose.shape[1] not in (1, patch.shape[0]):
        raise ValueError(f"poses must have shape [pose, 1] or [pose, {patch.shape[0]}], not {list(pose.shape)}")


FLUSH_RATE = 3.0 * 2.0**-23
"""Default flush for each metre of the largest coordinate: three float32 spacings.
Measured (docs/measured/performance.md): a resting palm needs 1.4, that of an object that moves 2.1."""


@wp.kernel
def _resolve_flush(
    patch: wp.array[Patch], flush: wp.float64, flush_rate: wp.float64, relative: wp.int32, resolved: wp.array[Patch]
):
    """Copy each patch with its flush and its frame of output points."""
    i = wp.tid()
    own = patch[i]
    own.flush = flush
    own.flush_rate = flush_rate
    own.relative = relative
    resolved[i] = own


def resolve_flush(patch: wp.array, *, flush: float, flush_rate: float = 0.0, relative: bool = False) -> Any:
    """Copies of patches with another flush, and with output points in the array's frame or relative to the patch.

    patch: Patch, shape [patch]. At a pose, the flush is the larger of `flush` [m] and `flush_rate` times the patch's
    largest coordinate [m], at most FLUSH_MOST; a vertex at most that far below the plane counts as on it.
    Returns Patch, shape [patch], on the same device.
    """
    resolved = wp.empty_like(patch)
    inputs = [patch, wp.float64(flush), wp.float64(flush_rate), int(relative)]
    wp.launch(_resolve_flush, patch.shape[0], inputs=inputs, outputs=[resolved], device=patch.device, block_dim=BLOCK)
    return resolved
