"""Corners cut and vertices relaxed, against the NumPy way, polyline by polyline."""

from dataclasses import replace

import numpy as np
import pytest
from contour_random import bare, degenerate_batch, random_batch, weighted_batch
from smooth_oracle import cut_corners as slow_cut_corners
from smooth_oracle import relaxed, smooth
from transform_cases import a_setting, assert_equal, assert_valid, random_poses, run_stage

from palpate.kernels.offsets import PointLimitError
from palpate.kernels.stages.smooth import cut_corners, relax_points
from palpate.render import MeshObject, Palm, exploration, render

METHODS = [
    {"method": "chaikin", "rounds": 1},
    {"method": "chaikin", "rounds": 4, "reach": 0.002},
    {"method": "laplace", "rounds": 1, "strength": 1.0},
    {"method": "laplace", "rounds": 20, "strength": 0.3},
]


def smoothed(batch, device, **options):
    """The stage's result for a batch, whose poses do not matter."""
    setting = a_setting(random_poses(np.random.default_rng(0), batch.pose_count), device=device)
    return run_stage("smooth", batch, setting, **options)


@pytest.mark.parametrize("options", METHODS)
def test_polylines_are_smoothed_as_the_oracle_smooths_them(options, device, rng):
    for batch in (weighted_batch(rng, 30), bare(random_batch(rng, 30)), random_batch(rng, 0)):
        got = smoothed(batch, device, **options)
        assert_equal(got, smooth(batch, **options))
        assert_valid(got, batch.pose_count)


@pytest.mark.parametrize("options", METHODS)
def test_polylines_without_length_go_and_the_rest_is_smoothed(options, device, rng):
    for weighted in (True, False):
        batch = degenerate_batch(rng, 100, weighted=weighted)
        got = smoothed(batch, device, **options)
        assert_equal(got, smooth(batch, **options))
        assert_valid(got, batch.pose_count)
        assert 0 < got.polyline_count < batch.polyline_count


@pytest.mark.parametrize("options", METHODS)
def test_real_contours_are_smoothed_as_the_oracle_smooths_them(options, device):
    dog = MeshObject.load("dog")
    batch = replace(render(dog, Palm(), exploration(dog, duration=2.0, rate=20.0, seed=1), "cc"), raw_error=None)
    assert_equal(smoothed(batch, device, **options), smooth(batch, **options))


@pytest.mark.parametrize("options", METHODS)
def test_polylines_are_smoothed_alike_wherever_a_batch_is_split(options, device, rng):
    batch = degenerate_batch(rng, 40)
    whole = smoothed(batch, device, **options)
    for first, stop in ((0, 13), (13, 14), (14, 40)):
        assert_equal(smoothed(batch.select(first, stop), device, **options), whole.select(first, stop))


def test_a_round_gives_what_rounds_begin_with(device, rng):
    batch = weighted_batch(rng, 10)
    there = batch.to(device)
    lines, weights = (there.polyline_start, there.polyline_closed), {"intensity": there.intensity, "dwell": there.dwell}
    got = cut_corners(there.points, there.kind, *lines, reach=0.01, rounds=2, **weights)
    want = slow_cut_corners(slow_cut_corners(batch, 0.01), 0.01)
    for values, name in zip(got, ("points", "kind", "polyline_start", "intensity", "dwell"), strict=True):
        np.testing.assert_array_equal(values.numpy(), getattr(want, name), err_msg=name)
    moved = relax_points(there.points, *lines, strength=0.5, rounds=2)
    np.testing.assert_array_equal(moved.numpy(), relaxed(relaxed(batch, 0.5), 0.5).points)
    np.testing.assert_array_equal(there.points.numpy(), batch.points)  # they are not written into


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = bare(random_batch(rng, 10))
    setting = a_setting(random_poses(rng, 10), device=device)
    count = run_stage("smooth", batch, setting, rounds=3).point_count
    enough = replace(setting, point_limit=count)
    assert run_stage("smooth", batch, enough, rounds=3).point_count == count
    with pytest.raises(PointLimitError) as refused:
        run_stage("smooth", batch, replace(setting, point_limit=count - 1), rounds=3)
    assert refused.value.count == count
