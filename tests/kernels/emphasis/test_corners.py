"""Corners of polylines, against the NumPy way, which compares every corner with all others."""

import numpy as np
import pytest
from contour_random import random_batch
from contour_shapes import batch_of
from emphasis_oracle import find_corners as slow_find_corners
from polyline_oracle import Lines
from stage_cases import stage_batches

from palpate.kernels.emphasis.corners import find_corners

RULES = [
    {"angle": np.pi / 6, "window": 0.005},
    {"angle": 0.0, "window": 0.001},
    {"angle": 1.5, "window": 0.03},
    {"angle": np.pi, "window": 0.01},
]


def found(batch, device, **rule):
    there = batch.to(device)
    return find_corners(there.points, there.polyline_start, there.polyline_closed, **rule)


def assert_same_corners(batch, device, **rule):
    """Corners are those of the oracle; returns how many."""
    lines = Lines.of(batch)
    at, line = slow_find_corners(lines, **rule)
    got = found(batch, device, **rule)
    np.testing.assert_array_equal(got.point.numpy(), at)
    np.testing.assert_array_equal(got.start.numpy(), np.searchsorted(line, np.arange(batch.polyline_count + 1)))
    np.testing.assert_array_equal(got.arc.numpy(), lines.arc[at])
    return len(at)


@pytest.mark.parametrize("rule", RULES)
def test_corners_are_those_of_the_oracle(rule, device, rng):
    batches = [*stage_batches(rng), random_batch(rng, 30, point_most=100, spread=0.005)]
    count = sum(assert_same_corners(batch, device, **rule) for batch in batches)
    assert (count > 100) == (rule["angle"] < np.pi)


def test_corners_of_a_jagged_line_of_many_points_are_those_of_the_oracle(device, rng):
    points = np.cumsum(rng.normal(size=(800, 3)) * 0.001, axis=0)
    for closed in (False, True):
        assert assert_same_corners(batch_of([[(points, closed)]]), device, angle=0.5, window=0.004) > 60


def test_of_equally_sharp_points_the_first_is_a_corner(device):
    """A zigzag turns by as much at every point within the window; its ends see less."""
    x = 0.001 * np.arange(41)
    batch = batch_of([[(np.stack([x, 0.001 * (np.arange(41) % 2), 0 * x], axis=1), False)]])
    step = np.sqrt(2) * 0.001
    got = found(batch, device, angle=0.5, window=0.9 * step)
    assert got.point.numpy().tolist() == list(range(1, 40))
    got = found(batch, device, angle=0.5, window=1.0001 * step)  # neighbours are within the window now
    assert got.point.numpy().tolist() == list(range(1, 40, 2))
