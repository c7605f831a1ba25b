"""Quaternions and rotation vectors in NumPy, as the exploration around an object has always computed them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NEXT, _AFTER_NEXT = np.array([1, 2, 0]), np.array([2, 0, 1])  # of each axis
_OWN = 4 * np.arange(3)  # of nine numbers of three axes: those on the diagonal
_SIGN = np.array([[1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0]])
_ONE, _OTHER = 3 * _NEXT + _AFTER_NEXT, 3 * _AFTER_NEXT + _NEXT
_ROW = np.array([[0, 6, 5, 7], [6, 1, 4, 8], [5, 4, 2, 9], [7, 8, 9, 3]])  # of the products, those with x, y, z, w


def product(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions xyzw, [..., 4]: first b, then a."""
    vector_a, scalar_a, vector_b, scalar_b = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = scalar_a * vector_b + scalar_b * vector_a + cross(vector_a, vector_b)
    scalar = scalar_a * scalar_b - (vector_a * vector_b).sum(axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def cross(a: Array, b: Array) -> Array:
    """Cross product, [..., 3]: the bits of np.cross, which takes ten times as long for a single vector."""
    ahead = a.take(_NEXT, axis=-1) * b.take(_AFTER_NEXT, axis=-1)
    return ahead - a.take(_AFTER_NEXT, axis=-1) * b.take(_NEXT, axis=-1)


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors, [..., k] to [..., 1]: summed in order, where `a @ b` rounds by processor."""
    return np.add.reduce(a * b, axis=-1, keepdims=True)


def length_of(x: Array) -> Array:
    """Length of vectors, [..., k] to [..., 1]: the bits of np.linalg.norm along an axis, without its checks."""
    return np.sqrt(dot(x, x))


def conjugate(q: Array) -> Array:
    """Quaternions of the inverse rotations."""
    return q * [-1.0, -1.0, -1.0, 1.0]


def exponential(rotation: Array) -> Array:
    """Quaternion xyzw of a rotation vector [rad], [..., 3]."""
    angle = length_of(rotation)
    return np.concatenate([rotation * (0.5 * np.sinc(angle / (2.0 * np.pi))), np.cos(angle / 2.0)], axis=-1)


def logarithm(q: Array) -> Array:
    """Rotation vector [rad] of a unit quaternion xyzw, the short way round; [..., 3]."""
    sine = length_of(q[..., :3])
    angle = 2.0 * np.arctan2(sine, np.abs(q[..., 3:]))
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return q[..., :3] * np.where(q[..., 3:] < 0.0, -scale, scale)


def from_axes(axes: Array) -> Array:
    """Quaternions xyzw of rotations, by the axes x, y and z of the rotated frame, [turn, 3, 3]."""
    axes = axes.reshape(-1, 9)
    own = axes.take(_OWN, axis=1)
    # Four times the products of a quaternion's numbers with each other. The largest of the four squares is at least 1:
    # no case divides by nearly nothing.
    square = 1.0 + own[:, :1] * _SIGN[0] + own[:, 1:2] * _SIGN[1] + own[:, 2:] * _SIGN[2]
    one, other = axes.take(_ONE, axis=1), axes.take(_OTHER, axis=1)
    products = np.concatenate([square, one + other, one - other], axis=1)
    row = np.take_along_axis(products, _ROW[np.argmax(square, axis=1)], axis=1)
    return row / length_of(row)
