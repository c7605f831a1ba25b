"""Random poses: bits that depend on seed and number only, and how they are spread."""

import numpy as np
import pytest
import warp as wp
from scipy import stats

from palpate.datasets.rigid import rotate
from palpate.kernels.metrics.random_pose import random_poses

WORD = (1 << 64) - 1
AT, SIZE = (0.01, -0.02, 0.2), 0.13


def mixed(x):
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & WORD
    return x ^ (x >> 31)


def pose_of(seed, number):
    """One pose with Python's integers and floats."""
    golden = 0x9E3779B97F4A7C15
    stream = mixed(mixed((seed + golden) & WORD) ^ mixed((number + golden) & WORD))
    draws = ((mixed((stream + k * golden) & WORD) >> 11) * 2.0**-53 for k in range(1, 1000))
    place = [AT[axis] + SIZE * (next(draws) - 0.5) for axis in range(3)]

    def pair(may_be_zero):
        while True:
            x, y = (2.0 * next(draws) - 1.0 for _ in range(2))
            if x * x + y * y < 1 and (may_be_zero or x * x + y * y > 0):
                return x, y

    a, b = pair(True)
    c, d = pair(False)
    share = np.sqrt((1.0 - (a * a + b * b)) / (c * c + d * d))
    return np.array([*place, a, b, share * c, share * d], np.float32)


def made(first, stop, seed, device, **options):
    return random_poses(first, stop, seed=seed, size=SIZE, at=AT, device=device, **options)


@pytest.mark.parametrize(("seed", "first"), [(0, 0), (1, 5), (2**63 - 1, 2**40), (7, 2**63 - 60)])
def test_every_bit_is_that_of_the_oracle(seed, first, device):
    wanted = [pose_of(seed, first + k) for k in range(50)]
    np.testing.assert_array_equal(made(first, first + 50, seed, device).numpy(), wanted)
    room = wp.empty(50, dtype=wp.transform, device=device)
    for a, b in ((20, 50), (0, 20)):  # in parts, in another order
        made(first + a, first + b, seed, device, out=room[a:b])
    np.testing.assert_array_equal(room.numpy(), wanted)


def test_poses_are_uniform_in_the_cube_and_in_orientation(device):
    pose = made(0, 40_000, 3, device).numpy().astype(np.float64)
    unit = (pose[:, :3] - AT) / SIZE + 0.5
    assert unit.min() >= 0
    assert unit.max() < 1
    turned = [rotate(pose[:, 3:], np.eye(3)[axis]) for axis in range(3)]  # each coordinate is uniform on a sphere
    samples = [*unit.T, *(0.5 + 0.5 * x for axes in turned for x in axes.T)]
    assert min(stats.kstest(x, "uniform").pvalue for x in samples) > 1e-4
    angle = 2 * np.arccos(np.clip(np.abs(pose[:, 6]), 0, 1))
    assert stats.kstest(angle, lambda t: (t - np.sin(t)) / np.pi).pvalue > 1e-4  # of Haar's measure
    np.testing.assert_allclose(np.linalg.norm(pose[:, 3:], axis=1), 1, atol=2e-7)
    many = np.concatenate([unit, pose[:, 3:]], axis=1)
    many = np.concatenate([many[:-1], many[1:]], axis=1)  # with the next pose
    off = np.corrcoef(many.T) - np.eye(14)
    assert np.abs(off).max() < 5 / np.sqrt(len(many))


@pytest.mark.parametrize(
    ("first", "stop", "seed", "size"),
    [(-1, 2, 0, 0.1), (3, 2, 0, 0.1), (0, 1, -1, 0.1), (0, 1, 0, -0.1), (0, 2**63, 0, 1)],
)
def test_what_cannot_be_counted_is_refused(first, stop, seed, size):
    with pytest.raises(ValueError, match=r"must lie in|must be finite"):
        random_poses(first, stop, seed=seed, size=size, at=AT, device="cpu")


def test_room_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"shape \[3\]"):
        made(0, 3, 0, "cpu", out=wp.empty(4, dtype=wp.transform, device="cpu"))
