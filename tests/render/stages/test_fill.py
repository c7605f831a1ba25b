"""Hatches as a stage on a device: the same bits as region by region in NumPy, over any contours."""

from dataclasses import replace

import numpy as np
import pytest
from contour_random import random_batch
from hatch_oracle import hatch_lines
from regions_oracle import FlatLines, Stroke, batch_of_strokes
from transform_cases import (
    a_setting,
    assert_equal,
    assert_valid,
    batch_of_loops,
    random_poses,
    random_regions,
    run_stage,
    star,
)

from palpate.kernels.offsets import PointLimitError
from palpate.render import MeshObject, Palm, render
from palpate.render.errors import PalpateWarning
from palpate.render.hands.flat_hand import flat_hand

PATCHES = flat_hand().patch_count


def hatched(batch, setting, *, spacing=0.01, angle=0.0, connect="boundary"):
    """What "hatch" makes of a batch on the host, by the oracles; and how many polylines are open."""
    flat, strokes = FlatLines(batch, setting), []
    for group in flat.groups("region"):
        if flat.closed[group].all() and flat.areas[group, 0].sum() > 0:
            pose, patch = int(flat.pose[group[0]]), int(batch.polyline_patch[group[0]])
            loops = [flat.loop(int(line)) for line in group]
            for line in hatch_lines(loops, spacing, angle, connected=connect == "boundary"):
                strokes.append(Stroke(pose, patch, flat.lifted(pose, patch, line, 0.0), False))
    return batch_of_strokes(strokes, batch.pose_count), int((~flat.closed).sum())


def assert_hatched(batch, setting, **options):
    """The stage's batch is the oracle's, bit by bit; its number of polylines."""
    want, open_count = hatched(batch, setting, **options)
    if open_count:
        with pytest.warns(PalpateWarning, match=rf"hatch: {open_count} of {batch.polyline_count} contours are open"):
            got = run_stage("hatch", batch, setting, **options)
    else:
        got = run_stage("hatch", batch, setting, **options)
    assert_equal(got, want)
    assert_valid(got, batch.pose_count)
    return got.polyline_count


@pytest.mark.parametrize("connect", ["boundary", "jump"])
@pytest.mark.parametrize(("spacing", "angle"), [(0.004, 0.0), (0.002, 0.7), (0.5, -1.0)])
def test_random_contours_have_the_hatch_of_the_oracle(spacing, angle, connect, device, rng):
    batch, setting, _ = random_regions(rng, 20)
    options = {"spacing": spacing, "angle": angle, "connect": connect}
    assert assert_hatched(batch, a_setting(setting.pose, device=device), **options) >= 20
    hand = flat_hand()  # of several patches, with contours off their planes that cross themselves, open ones among them
    tangled = random_batch(rng, 30, patch_count=hand.patch_count)
    assert assert_hatched(tangled, a_setting(random_poses(rng, 30), hand=hand, device=device), **options) > 10


@pytest.mark.parametrize("name", ["tube", "dog"])
def test_rendered_contours_have_the_hatch_of_the_oracle(name, device, rng):
    pose = random_poses(rng, 60)
    batch = render(MeshObject.load(name), Palm(), pose, "cc", device=device).numpy()
    assert assert_hatched(batch, a_setting(pose, device=device), spacing=0.007, angle=0.4) > 20


def test_batches_of_nothing_have_no_hatch(device, rng):
    batch, setting, _ = random_regions(rng, 6)
    for first in (0, 3):  # pose 0 and pose 3 have no contours
        assert assert_hatched(batch.select(first, first), a_setting(setting.pose[:0], device=device)) == 0
        pose = setting.pose[first : first + 1]
        assert assert_hatched(batch.select(first, first + 1), a_setting(pose, device=device)) == 0
    lone = batch_of_loops([[star(rng, np.zeros(2), 0.01)[::-1]]], setting.frames)  # a hole without a loop around it
    assert assert_hatched(lone, a_setting(setting.pose[:1], device=device)) == 0


def test_intensity_and_dwell_of_what_is_filled_are_left_out(device, rng):
    batch, setting, _ = random_regions(rng, 6)
    there = a_setting(setting.pose, device=device)
    plain = run_stage("hatch", batch, there)
    ones = np.ones(batch.point_count, np.float32)
    assert plain.point_count > 0
    assert_equal(run_stage("hatch", replace(batch, intensity=0.5 * ones, dwell=ones), there), plain)


def test_more_points_than_the_limit_are_refused(device, rng):
    batch, setting, _ = random_regions(rng, 6)
    there = a_setting(setting.pose, device=device)
    count = run_stage("hatch", batch, there, spacing=0.002).point_count
    run_stage("hatch", batch, replace(there, point_limit=count + 10), spacing=0.002)
    with pytest.raises(PointLimitError):
        run_stage("hatch", batch, replace(there, point_limit=count - 10), spacing=0.002)
