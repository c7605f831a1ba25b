"""Counts of bins are those of NumPy's histogram, on each device; what is not finite is not counted."""

import numpy as np
import warp as wp

from palpate.kernels.metrics.histogram import count_bins


def test_counts_are_those_of_numpy(device, rng):
    value = np.concatenate([10.0 ** rng.uniform(-5, 3, 5000), np.zeros(40), [np.nan, np.inf, 0.25, 0.5, 1.0, 2.0]])
    value = rng.permutation(value).astype(np.float32)
    spans, start = np.array([[0, 700], [700, 300], [1000, len(value) - 1000]]), np.array([0, 1, 3])
    arrays = [wp.array(own, dtype=wp.int64, device=device) for own in (*spans.T, start)]
    count = count_bins(wp.array(value, device=device), *arrays, lowest=-2, highest=3, bits=3).numpy()
    octaves = [np.arange(8) / 8 * 2.0**power + 2.0**power for power in range(-2, 3)]
    edges = np.concatenate([[-1.0, 1e-30], *octaves, [8.0, 1e30]])
    assert count.shape == (2, 5 * 8 + 3)
    for own, part in zip(count, (value[:700], value[700:]), strict=True):
        np.testing.assert_array_equal(own, np.histogram(part[np.isfinite(part)].astype(np.float64), edges)[0])
