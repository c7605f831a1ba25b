"""Regions that enclose an area, and where their lines belong, against the regions of the oracle."""

from dataclasses import replace

import numpy as np
import warp as wp
from contour_random import random_batch
from regions_oracle import FlatLines
from transform_cases import a_setting, batch_of_loops, random_poses, random_regions, star

from palpate.kernels.fillings.filled import find_filled, locate_lines
from palpate.render.contour_batch import join_batches
from palpate.render.stages.patch_regions import regions_of


def regions_on(batch, setting, device, per="region"):
    return regions_of(batch.to(device), a_setting(setting.pose, hand=setting.hand, device=device), per)


def test_regions_of_closed_polylines_with_an_area_are_filled(device, rng):
    setting = a_setting(random_poses(rng, 40))
    tangled = random_batch(rng, 20, patch_count=1)
    lone = batch_of_loops([[star(rng, np.zeros(2), 0.01)[::-1]]] * 20, setting.frames)  # holes without a loop
    batch = join_batches([replace(tangled, intensity=None), lone])
    flat = FlatLines(batch, setting)
    for per in ("region", "patch"):  # of a patch, loops may be together with open polylines
        filled, open_count = find_filled(regions_on(batch, setting, device, per))
        groups = flat.groups(per)
        want = [flat.closed[group].all() and flat.areas[group, 0].sum() > 0 for group in groups]
        np.testing.assert_array_equal(filled.numpy(), np.array(want, np.uint8))
        assert 0 < sum(want) < len(want) - 20
        assert open_count == np.count_nonzero(batch.polyline_closed == 0) > 0


def test_a_line_belongs_to_pose_and_patch_of_its_region(device, rng):
    batch, setting, _ = random_regions(rng, 9)
    regions = regions_on(batch, setting, device)
    flat = FlatLines(batch, setting)
    groups = flat.groups("region")
    region = rng.integers(0, len(groups), 50).astype(np.int32)
    pose, patch = locate_lines(regions, wp.array(region, dtype=wp.int32, device=device))
    np.testing.assert_array_equal(pose.numpy(), [flat.pose[groups[k][0]] for k in region])
    np.testing.assert_array_equal(patch.numpy(), [batch.polyline_patch[groups[k][0]] for k in region])


def test_a_batch_of_nothing_has_no_region_to_fill(device, rng):
    batch, setting, _ = random_regions(rng, 3)
    filled, open_count = find_filled(regions_on(batch.select(0, 0), a_setting(setting.pose[:0]), device))
    assert (filled.shape, open_count) == ((0,), 0)
