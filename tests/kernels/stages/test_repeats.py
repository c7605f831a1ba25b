"""Points that repeat the one before, and polylines without length, are left out."""

import numpy as np
import warp as wp
from polyline_oracle import without_repeats
from stage_cases import stage_batches
from transform_cases import assert_equal, assert_valid

from palpate.kernels.stages.repeats import find_distinct, match_ends
from palpate.render import ContourBatch
from palpate.render.stages.curves import drop_repeats


def test_repeats_are_left_out_as_the_oracle_leaves_them_out(device, rng):
    for batch in stage_batches(rng):
        got, want = drop_repeats(batch.to(device)).numpy(), without_repeats(batch)
        assert_equal(got, want)
        assert_valid(got, batch.pose_count)


def test_the_numbers_of_what_is_left_are_those_of_what_there_was(device):
    x = np.array([0, 0, 1, 1, 7, 2, 2, 3, 4], np.float32)  # polylines: 0 0 1 1 | 7 | 2 2 | (none) | 3 4
    points = wp.array(np.stack([x, 0 * x, 0 * x], axis=1), dtype=wp.vec3, device=device)
    start, poses = (wp.array(v, dtype=wp.int64, device=device) for v in ([0, 4, 5, 7, 7, 9], [0, 2, 4, 4, 5]))
    left = find_distinct(points, start, poses)
    got = [values.numpy().tolist() for values in left]
    assert got == [[0, 2, 7, 8], [0, 4], [0, 2, 4], [0, 1, 1, 1, 2]]


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
    got = drop_repeats(batch.to(device)).numpy()
    assert got.kind.tolist() == [0, 0, 0, 0, 0, 0]
    assert got.intensity.tolist() == np.array([0.5, 1, 1, 0.5, 0.1, 0.2], np.float32).tolist()
    assert got.dwell.tolist() == np.array([0.1, 0, 0, 0.1, 0, 0.3], np.float32).tolist()


def test_ends_match_in_place_and_without_weights_kinds_alone(device):
    start, closed = (
        wp.array([0, 3, 4, 4], dtype=wp.int64, device=device),
        wp.array([1, 1, 0], dtype=wp.uint8, device=device),
    )
    kind = wp.array([0, 1, 2, 2], dtype=wp.uint8, device=device)
    match_ends(start, closed, kind)
    assert kind.numpy().tolist() == [0, 1, 1, 2]
