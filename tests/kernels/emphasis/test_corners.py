"""Corners of polylines, ramps of intensity there and pauses, and arc lengths, against the NumPy way."""

import numpy as np
import pytest
import warp as wp
from contour_random import random_batch
from contour_shapes import batch_of
from emphasis_oracle import emphasise_corners
from emphasis_oracle import find_corners as slow_find_corners
from polyline_oracle import Lines
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal

from palpate.kernels.emphasis.corners import (
    find_corners,
)
from palpate.kernels.patch import EXACT

wp.set_module_options(EXACT)

OPTIONS = [
    {},
    {"window": 0.001, "reach": 0.08, "level": 0.1, "dwell": 0.5},  # ramps that go around loops several times
    {"angle": 0.0, "window": 0.002, "reach": 0.003, "level": 0.0},
    {"angle": 2.0, "window": 0.03, "reach": 0.02, "level": 1.0, "dwell": 0.02},
    {"angle": np.pi, "level": 0.25, "dwell": 0.01},  # no corner at all
]
RULES = [
    {"angle": np.pi / 6, "window": 0.005},
    {"angle": 0.0, "window": 0.001},
    {"angle": 1.5, "window": 0.03},
    {"angle": np.pi, "window": 0.01},
]


def found(batch, device, **rule):
    return find_corners(batch.to(device).struct, **rule)[1]


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


def test_of_equally_sharp_points_the_first_is_a_corner(device):
    """A zigzag turns by as much at every point within the window; its ends see less."""
    x = 0.001 * np.arange(41)
    batch = batch_of([[(np.stack([x, 0.001 * (np.arange(41) % 2), 0 * x], axis=1), False)]])
    step = np.sqrt(2) * 0.001
    got = found(batch, device, angle=0.5, window=0.9 * step)
    assert got.point.numpy().tolist() == list(range(1, 40))
    got = found(batch, device, angle=0.5, window=1.0001 * step)  # neighbours are within the window now
    assert got.point.numpy().tolist() == list(range(1, 40, 2))


@pytest.mark.parametrize("options", OPTIONS)
def test_corners_are_emphasised_as_the_oracle_does(options, device, rng):
    for batch in stage_batches(rng):
        assert_equal(stage_result("corners", batch, device, **options), emphasise_corners(batch, **options))


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = random_batch(rng, 10)
    assert stage_result("corners", batch, device).point_count > batch.point_count
    assert_limited(lambda limit: stage_result("corners", batch, device, limit=limit).point_count)
