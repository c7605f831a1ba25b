"""Outputs of a tally, filled with 7: a test sees what a kernel left unwritten."""

import numpy as np
import warp as wp

from palpate.kernels.metrics.tally import METRICS


def empty(pose_count, device):
    value = wp.full((len(METRICS) + 1, pose_count), 7.0, dtype=wp.float32, device=device)
    return value, wp.full(pose_count, 7.0, dtype=wp.float64, device=device)


def assert_same_numbers(one, two):
    """Arrays on a device have the same bits, signs of zeros too; what does not apply is NaN, of whichever sign."""
    for want, got in zip((a.numpy() for a in one), (a.numpy() for a in two), strict=True):
        np.testing.assert_array_equal(np.isnan(got), np.isnan(want))
        assert got[~np.isnan(got)].tobytes() == want[~np.isnan(want)].tobytes()
