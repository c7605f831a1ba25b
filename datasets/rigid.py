"""Rigid motions in NumPy: rotations of vectors, products and inverses of poses, slerp.

A quaternion is xyzw of norm 1, a pose x y z [m] and a quaternion, shape [..., 7]; leading shapes broadcast. What is
not known is NaN, and what comes of it is NaN too.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

POSITION_FARTHEST = 1e6
"""Positions lie this near to the array [m]: float32 steps by 6 cm there, about a hand, so none farther is meant."""

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]


def rotated(quaternion: Numbers, x: Numbers) -> Numbers:
    """Vectors turned by quaternions; shapes [..., 4] and [..., 3]."""
    axis, w = quaternion[..., :3], quaternion[..., 3:]
    across = np.cross(axis, x)
    return x + 2.0 * (w * across + np.cross(axis, across))


def quaternion_product(a: Numbers, b: Numbers) -> Numbers:
    """The rotation b, then a."""
    u, s, v, t = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    return np.concatenate([s * v + t * u + np.cross(u, v), s * t - np.sum(u * v, axis=-1, keepdims=True)], axis=-1)


def conjugate(quaternion: Numbers) -> Numbers:
    """The inverse rotation."""
    return quaternion * np.array([-1.0, -1.0, -1.0, 1.0])


def pose_product(a: Numbers, b: Numbers) -> Numbers:
    """Poses b within frames that are at poses a."""
    position = a[..., :3] + rotated(a[..., 3:], b[..., :3])
    return np.concatenate([position, quaternion_product(a[..., 3:], b[..., 3:])], axis=-1)


def pose_inverse(pose: Numbers) -> Numbers:
    """What takes a pose back to the origin."""
    back = conjugate(pose[..., 3:])
    return np.concatenate([-rotated(back, pose[..., :3]), back], axis=-1)


def composed(outer: ArrayLike, inner: ArrayLike) -> Numbers:
    """The pose that is `inner` in the frame of `outer`: x y z [m] and quaternion xyzw, shapes [..., 7] broadcast.

    Quaternions of any norm. An `inner` without shift and turn gives `outer`, bit-identical.
    """
    outer, inner = np.asarray(outer, np.float64), np.asarray(inner, np.float64)
    position = outer[..., :3] + rotated(unit(outer[..., 3:]), inner[..., :3])
    turn = quaternion_product(outer[..., 3:], inner[..., 3:])
    return np.concatenate([position, turn], axis=-1)


def inverted(pose: ArrayLike) -> Numbers:
    """The pose that undoes each, shape [..., 7]; quaternions of any norm."""
    pose = np.asarray(pose, np.float64)
    return pose_inverse(np.concatenate([pose[..., :3], unit(pose[..., 3:])], axis=-1))


def matrix_of(quaternion: Numbers) -> Numbers:
    """Rotation matrices, shape [..., 3, 3]; their columns are the axes of the turned frame."""
    columns = [rotated(quaternion, axis) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def quaternion_of(matrix: Numbers) -> Numbers:
    """Quaternions of rotation matrices, shape [..., 3, 3]; w is 0 or greater. NaN where a matrix has one."""
    m = matrix
    # Four times the square of each component, by the diagonal; the largest is the safe one to divide by.
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    square = np.stack([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], axis=-1)
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    d, e, f = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    x, y, z, w = np.moveaxis(square, -1, 0)
    rows = ((x, d, e, a), (d, y, f, b), (e, f, z, c), (a, b, c, w))
    candidate = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.argmax(square, axis=-1)[..., None, None]
    quaternion: Numbers = np.take_along_axis(candidate, largest, axis=-2)[..., 0, :]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    sign: Numbers = np.where(quaternion[..., 3:] < 0.0, -1.0, 1.0)
    return quaternion * sign


def slerp(a: Numbers, b: Numbers, share: Numbers) -> Numbers:
    """Rotations between a (share 0) and b (share 1), the short way round; share: shape [..., 1]."""
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(cosine < 0.0, -b, b)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(angle)
    near = ~(sine > 1e-6)  # a straight line is as good, and nothing is divided by 0
    divisor = np.where(near, 1.0, sine)
    first = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / divisor)
    second = np.where(near, share, np.sin(share * angle) / divisor)
    between = first * a + second * b
    return between / np.linalg.norm(between, axis=-1, keepdims=True)


def is_finite(rows: Numbers) -> NDArray[np.bool_]:
    """Which rows have no NaN and no infinity; shape [..., k] -> [...]."""
    return np.asarray(np.isfinite(rows).all(axis=-1), dtype=np.bool_)


def unit(x: Numbers) -> Numbers:
    """Vectors of length 1, shape [..., 3]; NaN for those without length."""
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    return x / np.where(length > 0.0, length, np.nan)
