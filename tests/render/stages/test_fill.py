"""Fillings on a device: hatches with the bits of NumPy, insets with the areas of manifold3d's."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from contour_random import random_batch
from hatch_oracle import hatch_lines
from inset_oracle import inset_loops, signed_area
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


def test_regions_that_wind_around_themselves_are_left_out_and_counted_whatever_batch_they_are_in(device, rng):
    angle = np.linspace(0, 4 * np.pi, 40, endpoint=False)  # a loop within a loop, in one line
    radius = 0.02 + 0.012 * np.cos(angle / 2)
    twice = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    loops = [[star(rng, np.zeros(2), 0.02)], [twice], [star(rng, np.zeros(2), 0.02)]]
    setting = a_setting(random_poses(rng, 3), device=device)
    batch = batch_of_loops(loops, setting.frames)
    with pytest.warns(PalpateWarning, match="inset: 1 of 3 regions have outlines that wind around themselves"):
        got = run_stage("inset", batch, setting, distance=0.001)
    assert_valid(got, 3)
    assert np.diff(got.pose_start).tolist()[1] == 0
    for k in (0, 2):
        alone = a_setting(setting.pose[k : k + 1], device=device)
        assert_equal(run_stage("inset", batch.select(k, k + 1), alone, distance=0.001), got.select(k, k + 1))
        assert got.select(k, k + 1).polyline_count > 0
