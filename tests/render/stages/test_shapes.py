"""Ellipses, circles, centroids, hatches and insets against shapely's polygons."""

import numpy as np
import pytest
import shapely
from polyline_oracle import divided
from transform_cases import (
    FOCAL_WIDTH,
    a_setting,
    batch_of_loops,
    flattened,
    random_poses,
    random_regions,
    run_stage,
)

from palpate.render.errors import PalpateWarning, StrategyError


def loops_of(batch, setting, pose):
    return [flattened(line, setting.frames, pose) for line in batch.polylines_of(pose)]


def test_the_ellipse_of_an_ellipse_is_that_ellipse(rng):
    pose = random_poses(rng, 1)
    setting = a_setting(pose)
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    c, s = np.cos(0.7), np.sin(0.7)
    flat = np.stack([0.03 * np.cos(angle), 0.01 * np.sin(angle)], axis=1) @ np.array([[c, s], [-s, c]])
    shift = np.array([0.004, -0.002])
    batch = batch_of_loops([[flat + shift]], setting.frames)
    for of in ("area", "moments"):
        loop = loops_of(run_stage("ellipse", batch, setting, of=of, points=720), setting, 0)[0]
        assert shapely.hausdorff_distance(shapely.Polygon(loop), shapely.Polygon(flat + shift)) < 2e-6
    ring = batch_of_loops([[0.02 * flat / np.linalg.norm(flat, axis=1)[:, None]]], setting.frames)
    for of in ("area", "moments", "line"):
        loop = loops_of(run_stage("ellipse", ring, setting, of=of), setting, 0)[0]
        assert np.linalg.norm(loop, axis=1) == pytest.approx(0.02, rel=2e-3)


def test_open_contours_are_taken_as_lines(rng):
    setting = a_setting(random_poses(rng, 2))
    arc = 0.03 * np.stack([np.cos(np.linspace(0, 2, 50)), np.sin(np.linspace(0, 2, 50))], axis=1)
    straight = np.array([[-0.02, 0.0], [0.0, 0.0], [0.02, 0.0]])
    batch = batch_of_loops([[arc], [straight]], setting.frames, closed=False)
    circle = run_stage("circle", batch, setting)
    assert np.linalg.norm(loops_of(circle, setting, 0)[0], axis=1) == pytest.approx(0.03, rel=2e-3)
    for count in (5, 9):  # a circle's corners alone lie farther out than its chords
        few = batch_of_loops([[arc[:: 49 // (count - 1)]], [straight]], setting.frames, closed=False)
        coarse, fine = (run_stage("circle", b, setting).length()[0] for b in (few, divided(few, 1e-4)))
        assert coarse == pytest.approx(fine, rel=1e-3)
    ellipse = loops_of(run_stage("ellipse", batch, setting), setting, 1)[0]
    assert np.ptp(ellipse, axis=0) == pytest.approx([2 * np.sqrt(2 / 3) * 0.02, 0.25 * FOCAL_WIDTH * 2], rel=0.01)


def test_per_patch_makes_one_shape_of_all_regions(rng):
    batch, setting, polygons = random_regions(rng)
    out = run_stage("circle", batch, setting, per="patch")
    for k, regions in enumerate(polygons):
        loops = loops_of(out, setting, k)
        assert len(loops) == min(len(regions), 1)
        if loops:
            union = shapely.union_all(regions)
            assert shapely.Polygon(loops[0]).area == pytest.approx(union.area, rel=1e-5)
            assert shapely.Polygon(loops[0]).centroid.distance(union.centroid) < 1e-7


def test_centroid_is_a_small_circle_around_it(rng):
    batch, setting, polygons = random_regions(rng)
    out = run_stage("centroid", batch, setting, radius=0.002)
    for k, regions in enumerate(polygons):
        for loop in loops_of(out, setting, k):
            middle = shapely.union_all(regions).centroid.coords[0]
            assert np.linalg.norm(loop - middle, axis=1) == pytest.approx(0.002, rel=0.01)
            assert shapely.Polygon(loop).area == pytest.approx(np.pi * 0.002**2, rel=1e-4)  # area, not circumradius


@pytest.mark.parametrize("name", ["hatch", "inset"])
def test_open_contours_are_left_out_with_a_warning(name, rng):
    setting = a_setting(random_poses(rng, 1))
    batch = batch_of_loops([[0.01 * np.array([[0, 0], [1, 0], [1, 1.0]])]], setting.frames, closed=False)
    with pytest.warns(PalpateWarning, match=rf"{name}: 1 of 1 contours are open"):
        assert run_stage(name, batch, setting).polyline_count == 0


@pytest.mark.parametrize("name", ["hatch", "inset"])
def test_hand_meshes_cannot_be_filled(name, rng):
    class Skin:
        skin_on = None

    batch, setting, _ = random_regions(rng)
    with pytest.raises(StrategyError, match=f"{name}: fills planes"):
        run_stage(name, batch, a_setting(setting.pose, hand=Skin()))
