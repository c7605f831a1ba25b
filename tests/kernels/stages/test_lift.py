"""Polylines of planes in the array's frame: the batch that NumPy makes of them, to the bit."""

import numpy as np
import pytest
import warp as wp
from regions_oracle import FlatLines, Stroke, batch_of_strokes
from stage_cases import assert_limited
from transform_cases import a_setting, assert_equal, random_poses

from palpate.kernels.stages.lift import lift_polylines
from palpate.render.hands.flat_hand import flat_hand
from palpate.render.stages.patch_regions import batch_of_lifted

HAND = flat_hand()


def random_strokes(rng, pose_count):
    """Polylines by pose and patch: many of points that float32 makes equal, of one point, of none."""
    rows = []
    for pose in range(pose_count):
        for patch in sorted(rng.integers(0, HAND.patch_count, rng.integers(0, 5)).tolist()):
            flat = rng.normal(0, 0.02, (rng.integers(0, 9), 2))
            if len(flat) and rng.random() < 0.5:
                flat = flat[np.sort(rng.integers(0, len(flat), 12))] + rng.normal(0, 1e-12, (12, 2))
            if len(flat) and rng.random() < 0.2:
                flat[:] = flat[0]
            rows.append((pose, patch, flat, rng.normal(0, 0.01), bool(rng.random() < 0.5)))
    return rows


def lifted(rows, setting, *, flat_only=False, **options):
    pose, patch, flat, height, closed = zip(*rows, strict=True) if rows else [()] * 5
    on = {"device": setting.device}
    return lift_polylines(
        wp.array(np.concatenate([np.zeros((0, 2)), *flat]), dtype=wp.vec2d, **on),
        wp.array(np.concatenate([[0], np.cumsum([len(one) for one in flat])]).astype(np.int64), **on),
        wp.array(np.array(pose, np.int32), **on),
        wp.array(np.array(patch, np.int32), **on),
        wp.array(np.array(closed, np.uint8), **on),
        setting.patches,
        len(setting.pose),
        height=None if flat_only else wp.array(np.array(height, np.float64), **on),
        **options,
    )


@pytest.mark.parametrize("flat_only", [False, True])
@pytest.mark.parametrize("count", [0, 1, 50])
def test_lifted_polylines_are_the_batch_of_the_oracle(count, flat_only, device, rng):
    setting = a_setting(random_poses(rng, count), hand=HAND, device=device)
    rows, frames = random_strokes(rng, count), FlatLines(None, setting)
    strokes = [
        Stroke(pose, patch, frames.lifted(pose, patch, flat, 0.0 if flat_only else height), closed)
        for pose, patch, flat, height, closed in rows
    ]
    want = batch_of_strokes(strokes, count)
    got = lifted(rows, setting, flat_only=flat_only)
    assert_equal(batch_of_lifted(got).numpy(), want)
    assert count < 50 or 20 < want.polyline_count < len(rows)


def test_more_points_than_the_limit_are_refused(device, rng):
    setting = a_setting(random_poses(rng, 9), hand=HAND, device=device)
    rows = random_strokes(rng, 9)
    assert_limited(lambda limit: lifted(rows, setting, point_limit=limit).points.shape[0])
