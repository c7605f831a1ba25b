"""Intensity of segments by kind and by straight runs, against the NumPy way."""

import math

import numpy as np
import pytest
import warp as wp
from contour_random import degenerate_batch, random_batch
from emphasis_oracle import RAMP, STRAIGHT, emphasise_edges
from polyline_oracle import levelled
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal

from palpate.kernels.emphasis.edges import measure_runs, ramp_between_levels
from palpate.render import ContourBatch

OPTIONS = [
    {},
    {"shortest": 0.003},
    {"shortest": 0.012, "on_object": 0.3, "curved": 0.9},
    {"shortest": 0.03, "on_object": 0.0, "on_hand": 1.0, "on_made": 0.2, "curved": 0.0},
]


def runs_of(batch, device):
    return measure_runs(batch.to(device).struct, math.cos(STRAIGHT)).numpy()


@pytest.mark.parametrize("options", OPTIONS)
def test_edges_are_emphasised_as_the_oracle_does(options, device, rng):
    for batch in stage_batches(rng):
        assert_equal(stage_result("edges", batch, device, **options), emphasise_edges(batch, **options))


def test_a_run_goes_on_over_points_across_the_seam_and_ends_where_the_kind_changes(device):
    """A rectangle of 4 by 1 that starts within a long side, whose first part is of another kind in a second loop."""
    x = np.array([[1, 0], [1, 0], [4, 0], [4, 1], [0, 1], [0, 0], [0, 0], [1, 0]], np.float32)
    points = np.concatenate([x, np.zeros((8, 1), np.float32)], axis=1)
    batch = ContourBatch(
        np.concatenate([points, points]), np.array([0] * 8 + [1] * 2 + [0] * 6, np.uint8), np.array([0, 8, 16]),
        np.zeros(2, np.int32), np.ones(2, np.uint8), np.array([0, 2]),
    )  # fmt: skip
    runs = runs_of(batch, device)
    assert runs[:8].tolist() == [0, 4, 1, 4, 1, 0, 4, 0]  # segments of no length are in no run
    assert runs[8:].tolist() == [0, 3, 1, 4, 1, 0, 1, 0]


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
