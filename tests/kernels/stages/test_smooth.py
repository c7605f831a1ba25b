"""Corners cut and vertices relaxed, against the NumPy way, polyline by polyline."""

import numpy as np
import pytest
from contour_random import random_batch, weighted_batch
from smooth_oracle import cut_corners as slow_cut_corners
from smooth_oracle import relaxed, smooth
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal, assert_valid

from palpate.kernels.stages.smooth import cut_corners, relax_points
from palpate.render import ContourBatch

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


def test_a_round_gives_what_rounds_begin_with(device, rng):
    batch = weighted_batch(rng, 10)
    there = batch.to(device)
    got = ContourBatch.from_struct(cut_corners(there.struct, reach=0.01, rounds=2)).numpy()
    assert_equal(got, slow_cut_corners(slow_cut_corners(batch, 0.01), 0.01))
    moved = relax_points(there.struct, strength=0.5, rounds=2)
    np.testing.assert_array_equal(moved.points.numpy(), relaxed(relaxed(batch, 0.5), 0.5).points)
    np.testing.assert_array_equal(there.points.numpy(), batch.points)  # they are not written into


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = random_batch(rng, 10)
    assert_limited(lambda limit: stage_result("smooth", batch, device, limit=limit, rounds=3).point_count)
