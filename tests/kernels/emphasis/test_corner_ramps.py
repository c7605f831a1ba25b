"""Ramps of intensity at corners and pauses there, against the NumPy way."""

import numpy as np
import pytest
from contour_random import random_batch
from contour_shapes import batch_of
from emphasis_oracle import emphasise_corners
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal

from palpate.kernels.emphasis.corner_ramps import pause_at_corners, ramp_rows, weigh_corners
from palpate.kernels.emphasis.corners import find_corners
from palpate.kernels.stages.insertion import insert_points

OPTIONS = [
    {},
    {"window": 0.001, "reach": 0.08, "level": 0.1, "dwell": 0.5},  # ramps that go around loops several times
    {"angle": 0.0, "window": 0.002, "reach": 0.003, "level": 0.0},
    {"angle": 2.0, "window": 0.03, "reach": 0.02, "level": 1.0, "dwell": 0.02},
    {"angle": np.pi, "level": 0.25, "dwell": 0.01},  # no corner at all
]


@pytest.mark.parametrize("options", OPTIONS)
def test_corners_are_emphasised_as_the_oracle_does(options, device, rng):
    for batch in stage_batches(rng):
        assert_equal(stage_result("corners", batch, device, **options), emphasise_corners(batch, **options))


def test_an_open_corner_has_its_ramps_and_its_pause(device):
    """A right angle with sides of 20 mm: full intensity for 5 mm from the corner, then 5 mm of ramp."""
    there = batch_of([[([[0.02, 0, 0], [0, 0, 0], [0, 0.02, 0]], False)]]).to(device)
    lines = (there.polyline_start, there.polyline_closed)
    corners = find_corners(there.points, *lines, angle=1.0, window=0.005)
    rows = ramp_rows(corners, 0.01)
    new = insert_points(there.points, there.kind, there.polyline_start, *rows)
    way = [0.02, 0.01, 0.005, 0, 0.005, 0.01, 0.02]
    np.testing.assert_allclose(new.points.numpy().sum(axis=1), way, atol=1e-8)
    intensity = weigh_corners(new, corners, reach=0.01, level=0.2).numpy()
    np.testing.assert_allclose(intensity, [0.2, 0.2, 1, 1, 1, 0.2, 0.2], atol=1e-6)
    assert pause_at_corners(new, corners, 0.5).numpy().tolist() == [0, 0, 0, 0.5, 0, 0, 0]


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = random_batch(rng, 10)
    assert stage_result("corners", batch, device).point_count > batch.point_count
    assert_limited(lambda limit: stage_result("corners", batch, device, limit=limit).point_count)
