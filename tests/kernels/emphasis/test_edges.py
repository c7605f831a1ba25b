"""Intensity of segments by kind and by straight runs, against the NumPy way."""

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from contour_random import bare, degenerate_batch, random_batch, weighted_batch
from emphasis_oracle import RAMP, STRAIGHT, emphasise_edges, straight_runs
from polyline_oracle import Lines, levelled
from transform_cases import a_setting, assert_equal, random_poses, run_stage

from palpate.kernels.emphasis.edges import KindLevels, level_by_kind, measure_runs, ramp_between_levels
from palpate.kernels.offsets import PointLimitError
from palpate.render import ContourBatch, MeshObject, Palm, exploration, render

OPTIONS = [
    {},
    {"shortest": 0.003},
    {"shortest": 0.012, "on_object": 0.3, "curved": 0.9},
    {"shortest": 0.03, "on_object": 0.0, "on_hand": 1.0, "on_made": 0.2, "curved": 0.0},
]


def emphasised(batch, device, **options):
    setting = a_setting(random_poses(np.random.default_rng(0), batch.pose_count), device=device)
    return run_stage("edges", batch, setting, **options)


def runs_of(batch, device):
    there = batch.to(device)
    lines = (there.points, there.kind, there.polyline_start, there.polyline_closed)
    return measure_runs(*lines, math.cos(STRAIGHT)).numpy()


@pytest.mark.parametrize("options", OPTIONS)
def test_edges_are_emphasised_as_the_oracle_does(options, device, rng):
    for batch in (
        weighted_batch(rng, 40),
        bare(random_batch(rng, 40)),
        degenerate_batch(rng, 150),
        degenerate_batch(rng, 150, weighted=False),
        random_batch(rng, 0),
    ):
        assert_equal(emphasised(batch, device, **options), emphasise_edges(batch, **options))


@pytest.mark.parametrize("options", OPTIONS)
def test_edges_of_real_contours_are_emphasised_as_the_oracle_does(options, device):
    tube = MeshObject.load("tube")
    batch = render(tube, Palm(), exploration(tube, duration=5.0, rate=50.0, seed=2), "cc")
    assert_equal(emphasised(batch, device, **options), emphasise_edges(batch, **options))


def test_edges_are_emphasised_alike_wherever_a_batch_is_split(device, rng):
    batch = degenerate_batch(rng, 40)
    whole = emphasised(batch, device, **OPTIONS[2])
    for first, stop in ((0, 13), (13, 14), (14, 40)):
        assert_equal(emphasised(batch.select(first, stop), device, **OPTIONS[2]), whole.select(first, stop))


def test_straight_runs_are_as_long_as_the_oracle_measures_them(device, rng):
    tube = MeshObject.load("tube")
    real = render(tube, Palm(), exploration(tube, duration=5.0, rate=50.0, seed=2), "cc")
    for batch in (degenerate_batch(rng, 200), real):
        want = straight_runs(Lines.of(batch))
        np.testing.assert_array_equal(runs_of(batch, device), want)
        assert len(np.unique(want)) > 10


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


def test_levels_are_those_of_kinds_and_of_short_runs(device):
    kind = wp.array([0, 1, 2, 0, 1], dtype=wp.uint8, device=device)
    run = wp.array([0.2, 0.05, 0.05, 0.05, 0.2], dtype=wp.float64, device=device)
    levels = KindLevels(0.9, 0.5, 0.7, 0.1)
    assert level_by_kind(kind, levels).numpy().tolist() == [0.9, 0.5, 0.7, 0.9, 0.5]
    assert level_by_kind(kind, levels, run, 0.1).numpy().tolist() == [0.9, 0.5, 0.7, 0.1, 0.5]


def test_any_levels_are_joined_by_ramps_as_the_oracle_joins_them(device, rng):
    batch = degenerate_batch(rng, 100)
    level = rng.random(batch.point_count).round(1)
    there = batch.to(device)
    lines = (there.points, there.kind, there.polyline_start, there.polyline_closed)
    levels = wp.array(level, dtype=wp.float64, device=device)
    new = ramp_between_levels(*lines, level=levels, ramp=RAMP, intensity=there.intensity, dwell=there.dwell)
    want = levelled(batch, level, RAMP)
    for name in ("points", "kind", "polyline_start", "intensity", "dwell"):
        np.testing.assert_array_equal(
            getattr(new, name).numpy().reshape(getattr(want, name).shape), getattr(want, name)
        )
    assert new.points.shape[0] > batch.point_count + 100


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = bare(random_batch(rng, 10))
    setting = a_setting(random_poses(rng, 10), device=device)
    count = run_stage("edges", batch, setting).point_count
    assert count > batch.point_count
    enough = replace(setting, point_limit=count)
    assert run_stage("edges", batch, enough).point_count == count
    with pytest.raises(PointLimitError) as refused:
        run_stage("edges", batch, replace(setting, point_limit=count - 1))
    assert refused.value.count == count
