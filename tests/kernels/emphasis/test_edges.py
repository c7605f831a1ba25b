"""Intensity of segments by kind, against the NumPy way."""

import pytest
import warp as wp
from contour_random import degenerate_batch, random_batch
from emphasis_oracle import RAMP, emphasise_edges
from polyline_oracle import levelled
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal

from palpate.kernels.emphasis.edges import ramp_between_levels
from palpate.render import ContourBatch


@pytest.mark.parametrize("options", [{}, {"on_object": 0.0, "on_hand": 1.0, "on_made": 0.2}])
def test_edges_are_emphasised_as_the_oracle_does(options, device, rng):
    for batch in stage_batches(rng):
        assert_equal(stage_result("edges", batch, device, **options), emphasise_edges(batch, **options))


def test_any_levels_are_joined_by_ramps_as_the_oracle_joins_them(device, rng):
    batch = degenerate_batch(rng, 100)
    level = rng.random(batch.point_count).round(1)
    levels = wp.array(level, dtype=wp.float64, device=device)
    new = ContourBatch.from_struct(ramp_between_levels(batch.to(device).struct, levels, ramp=RAMP)).numpy()
    assert_equal(new, levelled(batch, level, RAMP))
    assert new.point_count > batch.point_count + 100


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = random_batch(rng, 10)
    assert stage_result("edges", batch, device).point_count > batch.point_count
    assert_limited(lambda limit: stage_result("edges", batch, device, limit=limit).point_count)
