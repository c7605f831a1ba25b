"""Ellipses, circles, centroids, hatches and insets against shapely's polygons."""

import numpy as np
import pytest
import shapely
from polyline_oracle import divided
from transform_cases import (
    FOCAL_WIDTH,
    a_setting,
    assert_equal,
    assert_valid,
    batch_of_loops,
    flattened,
    random_poses,
    random_regions,
    run_stage,
)

from palpate.kernels.section.draw import MADE
from palpate.render.errors import PalpateWarning, StrategyError
from palpate.render.stages.fill import inset_loops

OVALS = ("ellipse", "circle", "centroid")
MAKERS = (*OVALS, "hatch", "inset")


def loops_of(batch, setting, pose):
    return [flattened(line, setting.frames, pose) for line in batch.polylines_of(pose)]


def polygons_of(loops):
    """What loops of either orientation enclose."""
    rings = [shapely.Polygon(loop) for loop in loops]
    outer = [r for r, loop in zip(rings, loops, strict=True) if shapely.LinearRing(loop).is_ccw]
    holes = [r for r, loop in zip(rings, loops, strict=True) if not shapely.LinearRing(loop).is_ccw]
    return shapely.union_all(outer).difference(shapely.union_all(holes))


@pytest.mark.parametrize("name", MAKERS)
def test_what_is_made_is_a_batch_of_kind_made_with_empty_poses_kept(name, rng):
    batch, setting, polygons = random_regions(rng)
    out = run_stage(name, batch, setting)
    assert_valid(out, batch.pose_count)
    assert (out.kind == MADE).all()
    assert [n > 0 for n in np.diff(out.pose_start)] == [len(p) > 0 for p in polygons]


@pytest.mark.parametrize("name", MAKERS)
def test_what_is_made_does_not_depend_on_the_batch_a_pose_is_in(name, rng):
    batch, setting, _ = random_regions(rng)
    whole = run_stage(name, batch, setting)
    assert_equal(run_stage(name, batch, setting), whole)
    for k in range(batch.pose_count):
        alone = run_stage(name, batch.select(k, k + 1), a_setting(setting.pose[k : k + 1]))
        assert_equal(alone, whole.select(k, k + 1))


@pytest.mark.parametrize("name", ["ellipse", "circle"])
def test_area_and_middle_are_those_of_the_region_with_its_holes(name, rng):
    batch, setting, polygons = random_regions(rng)
    out = run_stage(name, batch, setting)
    for k, regions in enumerate(polygons):
        ovals = [shapely.Polygon(loop) for loop in loops_of(out, setting, k)]
        assert len(ovals) == len(regions)
        for oval, region in zip(ovals, regions, strict=True):
            assert oval.area == pytest.approx(region.area, rel=1e-5)
            assert oval.centroid.distance(region.centroid) < 1e-7
            assert oval.exterior.is_ccw


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


@pytest.mark.parametrize("connect", ["boundary", "jump"])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_hatch_draws_all_of_each_line_inside_the_region_once_and_nothing_outside(connect, angle, rng):
    batch, setting, polygons = random_regions(rng)
    spacing = 0.003
    out = run_stage("hatch", batch, setting, spacing=spacing, angle=angle, connect=connect)
    across = np.array([-np.sin(angle), np.cos(angle)])
    along = np.array([np.cos(angle), np.sin(angle)])
    for k, regions in enumerate(polygons):
        lines = loops_of(out, setting, k)
        region = shapely.union_all(regions)
        for line in lines:
            assert region.buffer(1e-6).covers(shapely.LineString(line))
        ends = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines] or [np.zeros((0, 2, 2))])
        height = ends @ across
        row = np.rint(height / spacing)
        on_row = (np.abs(height - spacing * row) < 1e-7).all(axis=1) & (row[:, 0] == row[:, 1])
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        assert connect == "boundary" or on_row.all()
        for number in range(-20, 21):
            wire = shapely.LineString([number * spacing * across - along, number * spacing * across + along])
            drawn = length[on_row & (row[:, 0] == number)].sum()
            assert drawn == pytest.approx(region.intersection(wire).length, abs=2e-6)


def test_connected_hatch_needs_fewer_jumps(rng):
    batch, setting, _ = random_regions(rng)
    apart, joined = (run_stage("hatch", batch, setting, spacing=0.003, connect=c) for c in ("jump", "boundary"))
    assert joined.polyline_count < 0.5 * apart.polyline_count


@pytest.mark.parametrize("distance", [0.001, 0.004, 0.03])
def test_inset_is_what_lies_so_far_inside(distance, rng):
    batch, setting, polygons = random_regions(rng)
    out = run_stage("inset", batch, setting, distance=distance)
    for k, regions in enumerate(polygons):
        region = shapely.union_all(regions)
        want = region.buffer(-distance, quad_segs=64)
        got = polygons_of(loops_of(out, setting, k))
        assert got.symmetric_difference(want).area <= 1e-3 * region.area
        for loop in loops_of(out, setting, k):
            away = [region.boundary.distance(shapely.Point(p)) for p in loop]
            assert min(away) > 0.998 * distance - 1e-7


def test_inset_parts_at_a_waist():
    bone = np.array([[-3, -1], [-1, -1], [-1, -0.2], [1, -0.2], [1, -1], [3, -1], [3, 1], [1, 1], [1, 0.2], [-1, 0.2]])
    bone = 0.01 * np.vstack([bone, [[-1, 1], [-3, 1]]])
    assert len(inset_loops([bone], 0.003)) == 2
    assert len(inset_loops([bone], 0.001)) == 1
    assert inset_loops([bone], 0.011) == []


def test_of_an_outline_that_crosses_itself_only_what_it_goes_around_counter_clockwise_is_inset():
    """An eight goes around its left triangle counter-clockwise, and around the right one clockwise."""
    eight = 0.01 * np.array([[-2, -1], [2, 1], [2, -1], [-2, 1.0]])
    left = shapely.Polygon(0.01 * np.array([[0, 0], [-2, 1], [-2, -1.0]]))
    (loop,) = inset_loops([eight], 0.001)
    assert shapely.Polygon(loop).symmetric_difference(left.buffer(-0.001)).area < 1e-9


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
