"""Regions on a device: the same bits as polyline by polyline in NumPy, and the same polylines together."""

from itertools import pairwise

import numpy as np
import pytest
from regions_oracle import FlatLines, holds
from transform_cases import a_setting, batch_of_loops, random_poses, random_regions, region_batches, star

from palpate.kernels.stages.region_moments import sum_moments
from palpate.kernels.stages.regions import find_local_points, measure_areas
from palpate.render import Palm
from palpate.render.contour_batch import join_batches
from palpate.render.stages.patch_regions import regions_of


def found(batch, setting, per="region"):
    return regions_of(batch.to(setting.device), setting, per)


def groups_of(regions):
    start, line = regions.region_start.numpy(), regions.region_line.numpy()
    return [line[a:b].tolist() for a, b in pairwise(start)]


@pytest.mark.parametrize("per", ["region", "patch"])
def test_regions_are_those_of_the_oracle(per, device, rng):
    for batch, setting in region_batches(rng, device):
        flat, regions = FlatLines(batch, setting), found(batch, setting, per)
        assert groups_of(regions) == [group.tolist() for group in flat.groups(per)]
        np.testing.assert_array_equal(regions.line_pose.numpy(), flat.pose)


def test_local_points_areas_and_moments_have_the_bits_of_the_oracle(device, rng):
    for batch, setting in region_batches(rng, device):
        flat, regions = FlatLines(batch, setting), found(batch, setting)
        np.testing.assert_array_equal(regions.local.numpy().reshape(-1, 3), flat.local)
        np.testing.assert_array_equal(regions.area.numpy().reshape(-1, 6), flat.areas)
        there = batch.to(device)
        lines = (there.polyline_start, regions.line_pose, regions.line_patch)
        local = find_local_points(there.points, *lines, setting.patches)
        area = measure_areas(local, there.polyline_start, there.polyline_closed)
        np.testing.assert_array_equal(area.numpy(), regions.area.numpy())
        sums = sum_moments(regions)
        stroke = sums.stroke.numpy().reshape(-1, 7)
        np.testing.assert_array_equal(stroke, np.column_stack([flat.strokes, flat.heights]).reshape(-1, 7))
        assert sums.area.ptr == regions.area.ptr


def test_polylines_of_one_point_or_none_are_regions_without_area(device, rng):
    batch, setting, _ = random_regions(rng, 3)
    short = type(batch)(
        points=batch.points[:1], kind=batch.kind[:1], polyline_start=np.array([0, 0, 1]),
        polyline_patch=np.zeros(2, np.int32), polyline_closed=np.zeros(2, np.uint8), pose_start=np.array([0, 2]),
    )  # fmt: skip
    both = join_batches([batch, short])
    pose = np.concatenate([setting.pose, setting.pose[:1]])
    regions = found(both, a_setting(pose, hand=Palm(), device=device))
    before = batch.polyline_count
    assert groups_of(regions)[-2:] == [[before], [before + 1]]
    assert (regions.area.numpy()[before:] == 0).all()


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
    flat = FlatLines(batch, setting)
    held = [holds(flat.loop(2 * k), flat.loop(2 * k + 1)) for k in range(60)]
    assert 5 < sum(held) < 55
    groups = groups_of(found(batch, setting))
    assert groups == [
        group for k in range(60) for group in ([[2 * k, 2 * k + 1]] if held[k] else [[2 * k], [2 * k + 1]])
    ]
