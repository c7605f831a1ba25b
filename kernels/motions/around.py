"""Explorations around objects, of many motions at once: poses on splines through given control points.

All arithmetic is in float64, of + - * / and square roots, so CPUs and GPUs make the same bits.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, to_float32
from .portable_angles import sine_cosine

wp.set_module_options(EXACT)

ZERO, HALF, ONE, TWO, THREE, FIVE, SIX = (wp.constant(wp.float64(k)) for k in (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 6.0))
ALMOST_STILL = wp.constant(wp.float64(1e-9))  # angles below this [rad] have the sine of their double


@wp.struct
class SplineControl:
    """Control points of all motions, one motion after the other."""

    position: wp.array[wp.vec3d]  # [m]
    quaternion: wp.array[wp.vec4d]  # xyzw
    turn: wp.array[wp.vec3d]  # rotation vector to the next one [rad]


@wp.struct
class SplineRange:
    """Poses of one motion."""

    control: wp.int64  # its first control point
    rate: wp.float64  # of poses [Hz]; pose k is at time k / rate
    first: wp.int64  # of the poses that are made


@wp.func
def turned_by(q: wp.vec4d, rotation: wp.vec3d):
    """A quaternion xyzw times that of a rotation vector [rad], which turns first."""
    half = HALF * wp.length(rotation)
    pair = sine_cosine(half)
    scale = HALF
    if half > ALMOST_STILL:
        scale = HALF * pair[0] / half
    axis = scale * rotation
    u = wp.vec3d(q[0], q[1], q[2])
    vector = q[3] * axis + pair[1] * u + wp.cross(u, axis)
    return wp.vec4d(vector[0], vector[1], vector[2], q[3] * pair[1] - wp.dot(u, axis))


@wp.kernel
def _place_on_splines(
    control: SplineControl,
    ranges: wp.array[SplineRange],
    pose_start: wp.array[wp.int64],  # of each motion, shape [motion + 1]
    interval: wp.float64,  # between control points [s]
    pose: wp.array[wp.transform],
):
    """Place a palm on the uniform cubic B-spline of its control points, cumulative for quaternions."""
    i = wp.int64(wp.tid())
    motion = int(wp.lower_bound(pose_start, i + wp.int64(1))) - 1
    own = ranges[motion]
    at = (wp.float64(own.first + (i - pose_start[motion])) / own.rate) / interval
    before = wp.floor(at)  # intervals
    u = at - before
    square = u * u
    cube = u * square
    weight = wp.vec3d(  # the basis of Kim, Kim and Shin (1995), which sums steps between control points
        (FIVE + THREE * u - THREE * square + cube) / SIX,
        (ONE + THREE * u + THREE * square - TWO * cube) / SIX,
        cube / SIX,
    )
    first = own.control + wp.int64(before)
    p = control.position[first]
    q = control.quaternion[first]
    for k in range(3):
        here = first + wp.int64(k)
        p += weight[k] * (control.position[here + wp.int64(1)] - control.position[here])
        q = turned_by(q, weight[k] * control.turn[here])
    q = q / wp.sqrt(wp.dot(q, q))
    turn = wp.quat(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]), wp.float32(q[3]))
    pose[i] = wp.transform(to_float32(p), turn)


def place_on_splines(
    position: np.ndarray,
    quaternion: np.ndarray,
    turn: np.ndarray,
    ranges: Sequence[tuple[int, float, int]],
    pose_start: np.ndarray,
    *,
    interval: float,
    device: str,
) -> wp.array:
    """Poses of motions, one after the other, wp.transform, shape [pose].

    position [m], quaternion xyzw and the rotation vector to the next [rad]: of control points, one motion after the
    other, four more than there are whole intervals before a motion's last pose. ranges: of each motion
    the first control point, the rate of poses [Hz], and the first pose to be made. pose_start: offsets of motions into
    the poses, shape [motion + 1]. interval: between control points [s].
    """
    control: Any = SplineControl()
    for name, value, dtype in (
        ("position", position, wp.vec3d),
        ("quaternion", quaternion, wp.vec4d),
        ("turn", turn, wp.vec3d),
    ):
        setattr(control, name, wp.array(np.ascontiguousarray(value), dtype=dtype, device=device))
    pose = wp.empty(int(pose_start[-1]), dtype=wp.transform, device=device)
    given = wp.array(np.array(ranges, SplineRange.numpy_dtype()), dtype=SplineRange, device=device)
    start = wp.array(np.asarray(pose_start, np.int64), dtype=wp.int64, device=device)
    inputs = [control, given, start, interval]
    wp.launch(_place_on_splines, len(pose), inputs=inputs, outputs=[pose], device=device, block_dim=BLOCK)
    return pose
