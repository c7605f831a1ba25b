"""Explorations around objects, of many motions at once: poses on the splines of datasets/motions/exploration.py.

Sines are computed another way than on the host, and so the numbers in float64 differ in their last bits. Rounded to
float32 they are the same but where a number is nearly halfway between two; those poses, a few in a million, are listed
as doubtful, for the caller to make on the host.
"""

from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK, last_of
from ..patch import EXACT
from .portable_angles import sine_cosine

wp.set_module_options(EXACT)

INTERVAL = wp.constant(wp.float64(0.15))  # between control points [s], as in the model
ZERO, HALF, ONE, TWO, THREE, FIVE, SIX = (wp.constant(wp.float64(k)) for k in (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 6.0))
ALMOST_STILL = wp.constant(wp.float64(1e-9))  # angles below this [rad] have the sine of their double
DOUBT = wp.constant(wp.float64(4e-15))  # as a share of the numbers that a position is the sum of
DOUBT_OF_TURN = wp.constant(wp.float64(1e-14))  # of numbers of a unit quaternion


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
def is_doubtful(x: wp.float64, doubt: wp.float64):
    """Whether a number so near to another may round to another float32 number."""
    return wp.float32(x - doubt) != wp.float32(x + doubt)


@wp.func
def turned_by(q: wp.vec4d, rotation: wp.vec3d):
    """A quaternion xyzw times that of a rotation vector [rad], which turns first."""
    half = HALF * wp.sqrt((rotation[0] * rotation[0] + rotation[1] * rotation[1]) + rotation[2] * rotation[2])
    pair = sine_cosine(half)
    scale = HALF
    if half > ALMOST_STILL:
        scale = HALF * pair[0] / half
    axis = scale * rotation
    s = pair[1]
    u = wp.vec3d(q[0], q[1], q[2])
    w = q[3]
    vector = w * axis + s * u + wp.cross(u, axis)
    return wp.vec4d(vector[0], vector[1], vector[2], w * s - wp.dot(u, axis))


@wp.kernel
def _place_on_splines(
    # In:
    control: SplineControl,
    ranges: wp.array[SplineRange],
    pose_start: wp.array[wp.int64],  # of each motion, shape [motion + 1]
    # Out:
    pose: wp.array[wp.transform],
    doubtful: wp.array[wp.int32],  # shape [pose + 1]; their count comes last
):
    """Place a palm on the uniform cubic B-spline of its control points, cumulative for quaternions."""
    i = wp.int64(wp.tid())
    motion = int(wp.lower_bound(pose_start, i + wp.int64(1))) - 1
    own = ranges[motion]
    at = (wp.float64(own.first + (i - pose_start[motion])) / own.rate) / INTERVAL
    step = wp.floor(at)
    u = at - step
    row = own.control + wp.int64(step)
    square = u * u
    cube = u * square
    weight = wp.vec3d(
        (FIVE + THREE * u - THREE * square + cube) / SIX,
        (ONE + THREE * u + THREE * square - TWO * cube) / SIX,
        cube / SIX,
    )
    p = control.position[row]
    q = control.quaternion[row]
    size = wp.vec3d(wp.abs(p[0]), wp.abs(p[1]), wp.abs(p[2]))
    for k in range(3):
        here = row + wp.int64(k)
        move = control.position[here + wp.int64(1)] - control.position[here]
        p += weight[k] * move
        size += wp.vec3d(wp.abs(move[0]), wp.abs(move[1]), wp.abs(move[2]))
        q = turned_by(q, weight[k] * control.turn[here])
    q = q / wp.sqrt(wp.dot(q, q))
    doubts = bool(False)
    for k in range(3):
        doubts = doubts or is_doubtful(p[k], DOUBT * size[k])
    for k in range(4):
        doubts = doubts or is_doubtful(q[k], DOUBT_OF_TURN)
    if doubts:
        doubtful[wp.atomic_add(doubtful, doubtful.shape[0] - 1, 1)] = wp.int32(i)
    place = wp.vec3(wp.float32(p[0]), wp.float32(p[1]), wp.float32(p[2]))
    pose[i] = wp.transform(place, wp.quat(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]), wp.float32(q[3])))


def spline_ranges(control_start: np.ndarray, rate: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Ranges of poses as `place_on_splines` takes them, a structured array, shape [motion]."""
    out = np.zeros(len(rate), SplineRange.numpy_dtype())
    out["control"], out["rate"], out["first"] = control_start, rate, first
    return out


def place_on_splines(
    position: np.ndarray,
    quaternion: np.ndarray,
    turn: np.ndarray,
    ranges: np.ndarray,
    pose_start: np.ndarray,
    *,
    device: str,
) -> tuple[wp.array, wp.array]:
    """Poses of motions, one after the other, wp.transform [pose], and numbers of the doubtful ones, int32.

    position [m], quaternion xyzw and the rotation vector to the next [rad]: of control points, one motion after the
    other, four more than there are whole intervals before a motion's last pose. ranges: see `spline_ranges`.
    pose_start: offsets of motions into the poses, shape [motion + 1].
    """
    control: Any = SplineControl()
    for name, value, dtype in (
        ("position", position, wp.vec3d),
        ("quaternion", quaternion, wp.vec4d),
        ("turn", turn, wp.vec3d),
    ):
        setattr(control, name, wp.array(np.ascontiguousarray(value), dtype=dtype, device=device))
    count = int(pose_start[-1])
    pose = wp.empty(count, dtype=wp.transform, device=device)
    doubtful = wp.zeros(count + 1, dtype=wp.int32, device=device)
    given = wp.array(ranges, dtype=SplineRange, device=device)
    start = wp.array(np.asarray(pose_start, np.int64), dtype=wp.int64, device=device)
    inputs = [control, given, start]
    wp.launch(_place_on_splines, count, inputs=inputs, outputs=[pose, doubtful], device=device, block_dim=BLOCK)
    return pose, doubtful[: last_of(doubtful)]
