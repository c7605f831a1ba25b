"""Corners of polylines, against the NumPy way, which compares every corner with all others."""

import numpy as np
import pytest
from contour_random import degenerate_batch, random_batch, weighted_batch
from emphasis_oracle import find_corners as slow_find_corners
from polyline_oracle import Lines

from palpate.kernels.emphasis.corners import find_corners
from palpate.render import ContourBatch, MeshObject, Palm, exploration, render

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
    batches = (weighted_batch(rng, 40), degenerate_batch(rng, 150), random_batch(rng, 30, point_most=100, spread=0.005))
    count = sum(assert_same_corners(batch, device, **rule) for batch in batches)
    assert (count > 0) == (rule["angle"] < np.pi)
    assert assert_same_corners(random_batch(rng, 0), device, **rule) == 0


@pytest.mark.parametrize("rule", RULES)
def test_corners_of_real_contours_are_those_of_the_oracle(rule, device):
    tube = MeshObject.load("tube")
    batch = render(tube, Palm(), exploration(tube, duration=5.0, rate=50.0, seed=2), "cc")
    assert assert_same_corners(batch, device, **rule) > 100 or rule["angle"] > 1


def test_corners_of_a_jagged_line_of_many_points_are_those_of_the_oracle(device, rng):
    points = np.cumsum(rng.normal(size=(6000, 3)) * 0.001, axis=0)
    for closed in (0, 1):
        own = np.vstack([points, points[:1]]) if closed else points
        batch = ContourBatch(
            own.astype(np.float32), np.zeros(len(own), np.uint8), np.array([0, len(own)]), np.zeros(1, np.int32),
            np.array([closed], np.uint8), np.array([0, 1]),
        )  # fmt: skip
        assert assert_same_corners(batch, device, angle=0.5, window=0.004) > 500


def test_of_equally_sharp_points_the_first_is_a_corner(device):
    """A zigzag turns by as much at every point within the window; its ends see less."""
    x = 0.001 * np.arange(41)
    points = np.stack([x, 0.001 * (np.arange(41) % 2), 0 * x], axis=1)
    batch = ContourBatch(
        points.astype(np.float32), np.zeros(41, np.uint8), np.array([0, 41]), np.zeros(1, np.int32),
        np.zeros(1, np.uint8), np.array([0, 1]),
    )  # fmt: skip
    step = np.sqrt(2) * 0.001
    got = found(batch, device, angle=0.5, window=0.9 * step)
    assert got.point.numpy().tolist() == list(range(1, 40))
    got = found(batch, device, angle=0.5, window=1.0001 * step)  # neighbours are within the window now
    assert got.point.numpy().tolist() == list(range(1, 40, 2))


def test_corners_are_alike_wherever_a_batch_is_split(device, rng):
    batch = degenerate_batch(rng, 40)
    whole = found(batch, device, **RULES[0]).point.numpy()
    for first, stop in ((0, 13), (13, 14), (14, 40)):
        base = batch.polyline_start[batch.pose_start[first]]
        part = found(batch.select(first, stop), device, **RULES[0]).point.numpy() + base
        end = batch.polyline_start[batch.pose_start[stop]]
        np.testing.assert_array_equal(part, whole[(whole >= base) & (whole < end)])
