"""Which palms face the array: as the angles of NumPy, 1 or 0 where something is drawn, else NaN."""

import numpy as np
import warp as wp

from palpate.datasets.motions.facing import facing_angles
from palpate.kernels.metrics.facing import count_facing
from palpate.kernels.metrics.random_pose import random_poses


def test_rows_are_those_of_numpys_angles(device):
    pose = random_poses(0, 5000, seed=3, size=0.13, at=(0.0, 0.0, 0.2), device=device)
    length = np.tile(np.float32([0.1, 0.0, 2.0]), 2000)[:5000]
    out = wp.full((2, 5000), 7.0, dtype=wp.float32, device=device)
    count_facing(pose, wp.array(length, device=device), (30, 60), out)
    angle = np.degrees(facing_angles(pose.numpy()))
    assert np.abs(angle[:, None] - [30, 60]).min() > 1e-6  # no pose that rounding decides
    for row, degrees in zip(out.numpy(), (30, 60), strict=True):
        np.testing.assert_array_equal(row, np.where(length > 0, np.float32(angle <= degrees), np.nan))
