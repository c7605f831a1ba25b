"""Regions on a device, and contours made of lines in their planes: the same bits as polyline by polyline in NumPy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from contour_random import random_batch
from regions_oracle import FlatLines as SlowLines
from regions_oracle import Stroke, batch_of_strokes, holds
from stage_cases import assert_limited
from transform_cases import a_setting, assert_equal, batch_of_loops, random_poses, region_batches, star

from palpate.kernels.stages.ovals import measure_strokes
from palpate.kernels.stages.regions import FlatLines, Regions, find_filled, find_regions, lift_polylines
from palpate.render import ContourBatch
from palpate.render.contour_batch import join_batches
from palpate.render.hands.plane_hand import flat_hand

HAND = flat_hand()


def found(batch, setting, per="region"):
    return find_regions(batch.to(setting.device).struct, setting.patches, per=per)


def groups_of(regions):
    start, line = regions.region_start.numpy(), regions.region_line.numpy()
    return [line[a:b].tolist() for a, b in pairwise(start)]


@pytest.mark.parametrize("per", ["region", "patch"])
def test_regions_are_those_of_the_oracle(per, device, rng):
    for batch, setting in region_batches(rng, device):
        flat, regions = SlowLines(batch, setting), found(batch, setting, per)
        assert groups_of(regions) == [group.tolist() for group in flat.groups(per)]
        np.testing.assert_array_equal(regions.line_pose.numpy(), flat.pose)


def test_local_points_areas_and_moments_have_the_bits_of_the_oracle(device, rng):
    for batch, setting in region_batches(rng, device):
        flat, regions = SlowLines(batch, setting), found(batch, setting)
        np.testing.assert_array_equal(regions.local.numpy().reshape(-1, 3), flat.local)
        np.testing.assert_array_equal(regions.area.numpy().reshape(-1, 6), flat.areas)
        stroke = measure_strokes(regions).numpy().reshape(-1, 7)
        np.testing.assert_array_equal(stroke, np.column_stack([flat.strokes, flat.heights]).reshape(-1, 7))


def test_a_hole_goes_to_the_smallest_loop_around_it_and_to_the_earlier_of_equals(device, rng):
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    setting = a_setting(random_poses(rng, 1), device=device)
    hole, small, large = 0.01 * square[::-1], 0.02 * square, 0.03 * square
    beside = 0.005 * square[::-1] + [0.1, 0.0]
    batch = batch_of_loops([[large, hole, small, small, beside]], setting.frames)
    assert groups_of(found(batch, setting)) == [[0], [1, 2], [3], [4]]


def test_a_loop_that_shares_vertices_holds_by_the_majority_of_them(device, rng):
    """A hole that crosses its loop counts as held while more of its vertices are inside than not."""
    setting = a_setting(random_poses(rng, 60), device=device)
    poses = [[star(rng, np.zeros(2), 0.02), star(rng, shift, 0.012)[::-1]] for shift in rng.normal(0, 0.01, (60, 2))]
    batch = batch_of_loops(poses, setting.frames)
    flat = SlowLines(batch, setting)
    held = [holds(flat.loop(2 * k), flat.loop(2 * k + 1)) for k in range(60)]
    assert 5 < sum(held) < 55
    groups = groups_of(found(batch, setting))
    assert groups == [
        group for k in range(60) for group in ([[2 * k, 2 * k + 1]] if held[k] else [[2 * k], [2 * k + 1]])
    ]


def test_regions_of_closed_polylines_with_an_area_are_filled(device, rng):
    setting = a_setting(random_poses(rng, 40))
    tangled = random_batch(rng, 20, patch_count=1)
    lone = batch_of_loops([[star(rng, np.zeros(2), 0.01)[::-1]]] * 20, setting.frames)  # holes without a loop
    batch = join_batches([replace(tangled, intensity=None), lone])
    flat, on = SlowLines(batch, setting), a_setting(setting.pose, hand=setting.hand, device=device)
    for per in ("region", "patch"):  # of a patch, loops may be together with open polylines
        filled, open_count = find_filled(found(batch, on, per))
        groups = flat.groups(per)
        want = [flat.closed[group].all() and flat.areas[group, 0].sum() > 0 for group in groups]
        np.testing.assert_array_equal(filled.numpy(), np.array(want, np.uint8))
        assert 0 < sum(want) < len(want) - 20
        assert open_count == np.count_nonzero(batch.polyline_closed == 0) > 0


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
            rows.append((pose, patch, flat, rng.normal(0, 0.01)))
    return rows


def lifted(rows, setting, *, closed=True, flat_only=False, **options):
    """Contours of strokes, each the line of a region of its own."""
    pose, patch, flat, height = zip(*rows, strict=True) if rows else [()] * 4
    on, own = {"device": setting.device}, np.arange(len(rows), dtype=np.int32)
    regions = Regions()
    regions.line_pose, regions.line_patch = (wp.array(np.array(v, np.int32), **on) for v in (pose, patch))
    regions.region_start, regions.region_line = wp.array(np.arange(len(rows) + 1), **on), wp.array(own, **on)
    lines = FlatLines(
        wp.array(np.concatenate([np.zeros((0, 2)), *flat]), dtype=wp.vec2d, **on),
        wp.array(np.concatenate([[0], np.cumsum([len(one) for one in flat])]).astype(np.int64), **on),
        wp.array(own, **on),
    )
    options["height"] = None if flat_only else wp.array(np.array(height, np.float64), **on)
    contours = lift_polylines(lines, regions, setting.patches, len(setting.pose), closed=closed, **options)
    return ContourBatch.from_struct(contours).numpy()


@pytest.mark.parametrize(("flat_only", "closed"), [(False, False), (False, True), (True, True)])
@pytest.mark.parametrize("count", [0, 1, 50])
def test_lifted_polylines_are_the_batch_of_the_oracle(count, flat_only, closed, device, rng):
    setting = a_setting(random_poses(rng, count), hand=HAND, device=device)
    rows, frames = random_strokes(rng, count), SlowLines(None, setting)
    strokes = [
        Stroke(pose, patch, frames.lifted(pose, patch, flat, 0.0 if flat_only else height), closed)
        for pose, patch, flat, height in rows
    ]
    want = batch_of_strokes(strokes, count)
    assert_equal(lifted(rows, setting, closed=closed, flat_only=flat_only), want)
    assert count < 50 or 20 < want.polyline_count < len(rows)


def test_more_points_than_the_limit_are_refused(device, rng):
    setting = a_setting(random_poses(rng, 9), hand=HAND, device=device)
    rows = random_strokes(rng, 9)
    assert_limited(lambda limit: lifted(rows, setting, point_limit=limit).point_count)
