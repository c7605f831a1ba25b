"""Fillings on a device: hatches with the bits of NumPy, insets with those of manifold3d where kernels find none."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from contour_random import random_batch
from hatch_oracle import hatch_lines
from regions_oracle import FlatLines, Stroke, batch_of_strokes
from transform_cases import (
    a_setting,
    assert_equal,
    assert_valid,
    batch_of_loops,
    flattened,
    random_poses,
    random_regions,
    run_stage,
    star,
)

from palpate.kernels.offsets import PointLimitError
from palpate.render import MeshObject, Palm, render
from palpate.render.errors import PalpateWarning
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.stages.fill import inset_loops, signed_area


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


@pytest.mark.parametrize(("name", "options"), [("hatch", {"spacing": 0.002}), ("inset", {"distance": 0.001})])
def test_more_points_than_the_limit_are_refused(name, options, device, rng):
    batch, setting, _ = random_regions(rng, 6)
    there = a_setting(setting.pose, device=device)
    count = run_stage(name, batch, there, **options).point_count
    run_stage(name, batch, replace(there, point_limit=count + 10), **options)
    with pytest.raises(PointLimitError):
        run_stage(name, batch, replace(there, point_limit=count // 2), **options)


def inset_on_host(batch, setting, distance):
    """What "inset" makes of a batch on the host, by manifold3d alone."""
    flat, strokes = FlatLines(batch, setting), []
    for group in flat.groups("region"):
        if flat.closed[group].all() and flat.areas[group, 0].sum() > 0:
            pose, patch = int(flat.pose[group[0]]), int(batch.polyline_patch[group[0]])
            for loop in inset_loops([flat.loop(int(line)) for line in group], distance):
                strokes.append(Stroke(pose, patch, flat.lifted(pose, patch, loop, 0.0), True))
    return batch_of_strokes(strokes, batch.pose_count)


def enclosed_at(batch, setting, pose):
    """Polygons of a pose's loops, and their number."""
    loops = [flattened(line, setting.frames, pose)[:-1] for line in batch.polylines_of(pose)]
    inside = [shapely.Polygon(loop) for loop in loops if signed_area(loop) > 0]
    holes = [shapely.Polygon(loop) for loop in loops if signed_area(loop) < 0]
    return shapely.union_all(inside).difference(shapely.union_all(holes)), len(loops)


@pytest.mark.parametrize(("name", "distance"), [("tube", 0.005), ("tube", 0.0005), ("dog", 0.002)])
def test_rendered_contours_have_the_inset_of_manifold(name, distance, device, rng):
    pose = random_poses(rng, 150)
    batch = render(MeshObject.load(name), Palm(), pose, "cc", device=device).numpy()
    setting = a_setting(pose, device=device)
    got, want = run_stage("inset", batch, setting, distance=distance), inset_on_host(batch, setting, distance)
    assert_valid(got, 150)
    np.testing.assert_array_equal(np.diff(got.pose_start) > 0, np.diff(want.pose_start) > 0)
    for k in np.flatnonzero(np.diff(want.pose_start)):
        (one, count), (other, wanted) = enclosed_at(got, setting, k), enclosed_at(want, setting, k)
        assert count == wanted
        assert shapely.hausdorff_distance(one.boundary, other.boundary) < 1e-4  # a hundredth of the focal width
        assert one.symmetric_difference(other).area < 1e-8
    assert got.polyline_count > 40


def crossed_loops(rng):
    """An eight, loops that cross themselves at random, and a simple one, by pose."""
    eight = 0.02 * np.array([[-1, -1], [1, 0.8], [1, -1], [-1, 1.0]])
    tangle = rng.normal(0, 0.02, (9, 2))
    tangle = tangle if signed_area(tangle) > 0 else tangle[::-1]
    return [[eight + np.array([0.04, 0])], [tangle], [star(rng, np.zeros(2), 0.02)], [eight], []]


def test_outlines_that_cross_have_the_inset_of_manifold_whatever_batch_they_are_in(device, rng):
    setting = a_setting(random_poses(rng, 15), device=device)
    loops = [own for _ in range(3) for own in crossed_loops(rng)]
    batch = batch_of_loops(loops, setting.frames)
    got, want = run_stage("inset", batch, setting, distance=0.001), inset_on_host(batch, setting, 0.001)
    assert_valid(got, 15)
    crossing = [k for k in range(15) if want.pose_start[k] < want.pose_start[k + 1] and k % 5 != 2]
    assert len(crossing) > 6
    for k in range(15):
        alone = run_stage(
            "inset", batch.select(k, k + 1), a_setting(setting.pose[k : k + 1], device=device), distance=0.001
        )
        assert_equal(alone, got.select(k, k + 1))
        if k in crossing:
            assert_equal(got.select(k, k + 1), want.select(k, k + 1))
    assert (np.diff(got.pose_start)[2::5] > 0).all()


def test_batches_of_nothing_have_no_inset(device, rng):
    batch, setting, _ = random_regions(rng, 6)
    empty = run_stage("inset", batch.select(3, 3), a_setting(setting.pose[:0], device=device))
    assert (empty.pose_count, empty.point_count) == (0, 0)
    for distance, there in ((0.001, True), (0.1, False)):
        got = run_stage("inset", batch, a_setting(setting.pose, device=device), distance=distance)
        assert_valid(got, 6)
        assert (got.polyline_count > 0) == there
    assert run_stage("inset", batch.select(0, 1), a_setting(setting.pose[:1], device=device)).point_count == 0
