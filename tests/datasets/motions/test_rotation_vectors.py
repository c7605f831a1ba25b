"""Rotation vectors and quaternions, against scipy; each vector of many has the bits of one alone."""

import functools
import operator

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.datasets.motions.rotation_vectors import (
    conjugate,
    cross,
    dot,
    exponential,
    from_axes,
    length_of,
    logarithm,
    product,
)


def test_products_and_lengths_have_the_bits_of_numpys():
    rng = np.random.default_rng(1)
    for size in ((3,), (1000, 3), (10, 20, 4)):
        a, b = rng.normal(size=size), rng.normal(size=size)
        if size[-1] == 3:
            np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
        np.testing.assert_array_equal(length_of(a), np.linalg.norm(a, axis=-1, keepdims=True))
        rows = zip(
            dot(a, b).reshape(-1), a.reshape(-1, size[-1]).tolist(), b.reshape(-1, size[-1]).tolist(), strict=True
        )
        for value, one, other in rows:
            assert value == functools.reduce(operator.add, map(operator.mul, one, other))


def test_rotations_are_those_of_scipy():
    turns = Rotation.random(200, random_state=2)
    q = turns.as_quat()
    np.testing.assert_allclose(product(q[:100], q[100:]), (turns[:100] * turns[100:]).as_quat(False), atol=1e-14)
    np.testing.assert_allclose(logarithm(q), turns.as_rotvec(), atol=1e-13)
    np.testing.assert_allclose(logarithm(-q), turns.as_rotvec(), atol=1e-13)
    same = exponential(logarithm(q))
    np.testing.assert_allclose(np.abs((same * q).sum(axis=1)), 1.0, atol=1e-14)
    np.testing.assert_allclose(product(conjugate(q), q), np.tile([0, 0, 0, 1.0], (200, 1)), atol=1e-15)
    axes = turns.as_matrix().transpose(0, 2, 1)
    np.testing.assert_allclose(np.abs((from_axes(axes) * q).sum(axis=1)), 1.0, atol=1e-14)
    np.testing.assert_array_equal(exponential(np.zeros((1, 3))), [[0, 0, 0, 1]])
