"""Corners cut and vertices relaxed, against the NumPy way, polyline by polyline."""

import pytest
from contour_random import random_batch
from smooth_oracle import smooth
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal, assert_valid

METHODS = [
    {"method": "chaikin", "rounds": 1},
    {"method": "chaikin", "rounds": 4, "reach": 0.002},
    {"method": "laplace", "rounds": 1, "strength": 1.0},
    {"method": "laplace", "rounds": 20, "strength": 0.3},
]


@pytest.mark.parametrize("options", METHODS)
def test_polylines_are_smoothed_as_the_oracle_smooths_them(options, device, rng):
    """Bit by bit; polylines without length go."""
    for batch in stage_batches(rng):
        got = stage_result("smooth", batch, device, **options)
        assert_equal(got, smooth(batch, **options))
        assert_valid(got, batch.pose_count)
        assert got.polyline_count > 0 or batch.polyline_count == 0


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = random_batch(rng, 10)
    assert_limited(lambda limit: stage_result("smooth", batch, device, limit=limit, rounds=3).point_count)
