"""Repeats left out, and corners cut, against the NumPy way, polyline by polyline."""

import numpy as np
import pytest
from contour_random import random_batch
from polyline_oracle import smooth, without_repeats
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal, assert_valid

from palpate.kernels.stages.curves import drop_repeats
from palpate.render import ContourBatch


def dropped(batch, device):
    return ContourBatch.from_struct(drop_repeats(batch.to(device).struct)).numpy()


def test_repeats_are_left_out_as_the_oracle_leaves_them_out(device, rng):
    for batch in stage_batches(rng):
        got, want = dropped(batch, device), without_repeats(batch)
        assert_equal(got, want)
        assert_valid(got, batch.pose_count)


def test_polylines_of_which_one_point_or_none_is_left_go(device):
    x = np.array([0, 0, 1, 1, 7, 2, 2, 3, 4], np.float32)  # polylines: 0 0 1 1 | 7 | 2 2 | (none) | 3 4
    batch = ContourBatch(
        points=np.stack([x, 0 * x, 0 * x], axis=1),
        kind=np.array([0, 1, 0, 1, 0, 0, 0, 1, 0], np.uint8),
        polyline_start=np.array([0, 4, 5, 7, 7, 9]),
        polyline_patch=np.arange(5, dtype=np.int32),
        polyline_closed=np.zeros(5, np.uint8),
        pose_start=np.array([0, 2, 4, 4, 5]),
    )
    left = dropped(batch, device)
    assert left.points[:, 0].tolist() == [0, 1, 3, 4]
    assert left.kind.tolist() == [0, 0, 1, 1]  # a last point has the kind of the one before it
    assert [left.polyline_patch.tolist(), left.polyline_start.tolist()] == [[0, 4], [0, 2, 4]]
    assert left.pose_start.tolist() == [0, 1, 1, 1, 2]


def test_what_stands_last_after_a_repeat_is_left_out_agrees_with_its_neighbours(device):
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0], [0, 0, 0]], np.float32)
    batch = ContourBatch(
        points=np.concatenate([square, square[1:3], square[2:3]]),
        kind=np.array([0, 0, 0, 1, 1, 0, 1, 1], np.uint8),
        polyline_start=np.array([0, 5, 8]),
        polyline_patch=np.zeros(2, np.int32),
        polyline_closed=np.array([1, 0], np.uint8),
        pose_start=np.array([0, 2]),
        intensity=np.array([0.5, 1, 1, 0.9, 0.5, 0.1, 0.2, 0.3], np.float32),
        dwell=np.array([0.1, 0, 0, 0.2, 0.1, 0, 0.3, 0.4], np.float32),
    )
    got = dropped(batch, device)
    assert got.kind.tolist() == [0, 0, 0, 0, 0, 0]
    assert got.intensity.tolist() == np.array([0.5, 1, 1, 0.5, 0.1, 0.2], np.float32).tolist()
    assert got.dwell.tolist() == np.array([0.1, 0, 0, 0.1, 0, 0.3], np.float32).tolist()


@pytest.mark.parametrize("options", [{"rounds": 1}, {"rounds": 4, "reach": 0.002}])
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
