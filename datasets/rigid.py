"""Rigid motions in NumPy: rotations of vectors, products and inverses of poses, slerp.

A quaternion is x y z w with norm 1, except where a function allows any norm; a pose is x y z [m] and a quaternion,
shape [..., 7]. Leading shapes broadcast. Unknown values are NaN, and every result that depends on one is NaN.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

POSITION_FARTHEST = 1e6
"""Largest coordinate of a position [m]; the float32 spacing there is 6 cm, so farther positions count as mistakes."""

NORM_TOLERANCE = 1e-3
"""Largest difference of a quaternion's norm from 1 in poses that are given or read; larger ones are refused."""

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]


def rotate(quaternion: Numbers, x: Numbers) -> Numbers:
    """Rotate vectors, shape [..., 3], by quaternions, shape [..., 4]."""
    axis, w = quaternion[..., :3], quaternion[..., 3:]
    across = np.cross(axis, x)
    return x + 2.0 * (w * across + np.cross(axis, across))


def quaternion_product(a: Numbers, b: Numbers) -> Numbers:
    """Quaternions of the rotation b followed by a, shape [..., 4]."""
    u, s, v, t = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    return np.concatenate([s * v + t * u + np.cross(u, v), s * t - np.sum(u * v, axis=-1, keepdims=True)], axis=-1)


def conjugate(quaternion: Numbers) -> Numbers:
    """Quaternions of the inverse rotations, shape [..., 4]."""
    return quaternion * np.array([-1.0, -1.0, -1.0, 1.0])


def pose_product(a: Numbers, b: Numbers) -> Numbers:
    """Poses b, given in frames that are at poses a, in the frame of a; shape [..., 7]."""
    position = a[..., :3] + rotate(a[..., 3:], b[..., :3])
    return np.concatenate([position, quaternion_product(a[..., 3:], b[..., 3:])], axis=-1)


def pose_inverse(pose: Numbers) -> Numbers:
    """Inverse poses: `pose_product(pose_inverse(p), p)` is the identity; shape [..., 7]."""
    back = conjugate(pose[..., 3:])
    return np.concatenate([-rotate(back, pose[..., :3]), back], axis=-1)


def compose(outer: ArrayLike, inner: ArrayLike) -> Numbers:
    """`pose_product` for quaternions of any norm: poses `inner`, given in frames `outer`, in the frame of `outer`.

    Poses are x y z [m] and a quaternion xyzw, shape [..., 7]. An identity `inner` gives `outer` bit-identical.
    """
    outer, inner = np.asarray(outer, np.float64), np.asarray(inner, np.float64)
    position = outer[..., :3] + rotate(unit(outer[..., 3:]), inner[..., :3])
    turn = quaternion_product(outer[..., 3:], inner[..., 3:])
    return np.concatenate([position, turn], axis=-1)


def invert(pose: ArrayLike) -> Numbers:
    """`pose_inverse` for quaternions of any norm, shape [..., 7]."""
    pose = np.asarray(pose, np.float64)
    return pose_inverse(np.concatenate([pose[..., :3], unit(pose[..., 3:])], axis=-1))


def matrix_of(quaternion: Numbers) -> Numbers:
    """Rotation matrices of quaternions, shape [..., 3, 3]; their columns are the axes of the rotated frame."""
    columns = [rotate(quaternion, axis) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def quaternion_of(matrix: Numbers) -> Numbers:
    """Quaternions, w >= 0, of rotation matrices of shape [..., 3, 3]; NaN where a matrix has a NaN."""
    m = matrix
    # From the diagonal: four times the square of each component. Dividing by the largest is the most exact.
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
    """Rotations between a (share 0) and b (share 1) by the smaller angle; share: shape [..., 1]."""
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(cosine < 0.0, -b, b)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(angle)
    near = ~(sine > 1e-6)  # linear interpolation is as exact there, and avoids a division by 0
    divisor = np.where(near, 1.0, sine)
    first = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / divisor)
    second = np.where(near, share, np.sin(share * angle) / divisor)
    between = first * a + second * b
    return between / np.linalg.norm(between, axis=-1, keepdims=True)


def is_finite(rows: Numbers) -> NDArray[np.bool_]:
    """Whether each row has only finite values; shape [..., k] -> [...]."""
    return np.asarray(np.isfinite(rows).all(axis=-1), dtype=np.bool_)


def unit(x: Numbers) -> Numbers:
    """Vectors divided by their lengths along the last axis; NaN for zero vectors."""
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    return x / np.where(length > 0.0, length, np.nan)
