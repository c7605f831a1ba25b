"""Simplifying and smoothing, emphasis by corners, kinds and depth."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from polyline_oracle import Lines
from transform_cases import (
    a_setting,
    assert_equal,
    assert_valid,
    batch_of_loops,
    flattened,
    random_regions,
    run_stage,
    with_weights,
)

from palpate.kernels.section.piece_walker import OBJECT
from palpate.render import (
    ContourBatch,
    HandPatch,
    PlaneHand,
)
from palpate.render.stages.curves import divide_batch

SQUARE = 0.02 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


class Block:
    """A cube of 60 mm around (0, 0, 0.2) as an object."""

    bounds = np.array([[-0.03, -0.03, 0.17], [0.03, 0.03, 0.23]])

    def described(self):
        return {"hash": "block of the tests"}

    def outline_mesh(self):
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
        return (self.bounds[0] + np.float32(0.06) * corners).astype(np.float32), faces


def one_loop(loop, rng=None, *, closed=True):
    pose = np.array([[0, 0, 0.2, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], np.float32)
    setting = a_setting(pose, thing=Block())
    return batch_of_loops([[loop]], setting.frames, rng, closed), setting


# Slow and obvious: which points Douglas and Peucker keep, by recursion.


def excess(p, level, a, b, i, tolerance):
    d = p[b] - p[a]
    square = d @ d
    part = np.clip((p[i] - p[a]) @ d / square, 0, 1) if square > 0 else 0.0
    out = np.linalg.norm(p[i] - p[a] - part * d) / tolerance
    return out if level is None else max(out, abs(level[i] - (level[a] + part * (level[b] - level[a]))) / 0.05)


def kept(p, kind, closed, tolerance, level=None, dwell=None):
    n = len(p)
    keep = np.zeros(n, bool)
    keep[[0, -1]] = True
    keep[1:-1] |= kind[1:-1] != kind[:-2]
    if dwell is not None:
        keep[1:-1] |= dwell[1:-1] > 0

    def farthest(a, b, low, high):
        best = max(range(low, high), key=lambda i: (excess(p, level, a, b, i, tolerance), -i), default=None)
        return best, -1.0 if best is None else excess(p, level, a, b, best, tolerance)

    if closed and n > 3:
        far, _ = farthest(0, 0, 1, n - 1)
        keep[far] = True
        third = max(farthest(0, far, 1, far), farthest(far, n - 1, far + 1, n - 1), key=lambda found: found[1])
        if third[1] > 0:
            keep[third[0]] = True

    def split(a, b):
        at, e = farthest(a, b, a + 1, b)
        if e > 1:
            keep[at] = True
            split(a, at)
            split(at, b)

    for a, b in zip(np.flatnonzero(keep)[:-1], np.flatnonzero(keep)[1:], strict=True):
        split(a, b)
    return keep


@pytest.mark.parametrize("weighted", [False, True])
def test_simplified_contours_keep_the_vertices_that_the_oracle_keeps(weighted, device, rng):
    batch, setting, _ = random_regions(rng)
    batch = with_weights(batch, rng) if weighted else batch
    out = run_stage("simplify", batch, replace(setting, device=device), tolerance=0.0015)
    want = []
    for k, (a, b) in enumerate(zip(batch.polyline_start[:-1], batch.polyline_start[1:], strict=True)):
        level = None if batch.intensity is None else batch.intensity[a:b].astype(np.float64)
        dwell = None if batch.dwell is None else batch.dwell[a:b]
        p, closed = batch.points[a:b].astype(np.float64), batch.polyline_closed[k]
        want.append(a + np.flatnonzero(kept(p, batch.kind[a:b], closed, 0.0015, level, dwell)))
    for name in ("points", "kind", "intensity", "dwell") if weighted else ("points", "kind"):
        np.testing.assert_array_equal(getattr(out, name), getattr(batch, name)[np.concatenate(want)], err_msg=name)
    assert np.diff(out.polyline_start).tolist() == [len(w) for w in want]


@pytest.mark.parametrize("tolerance", [1e-5, 0.001, 0.02])
def test_simplified_contours_stay_within_the_tolerance(tolerance, rng):
    batch, setting, _ = random_regions(rng)
    out = run_stage("simplify", batch, setting, tolerance=tolerance)
    assert_valid(out, batch.pose_count)
    np.testing.assert_array_equal(out.polyline_closed, batch.polyline_closed)
    for k in range(batch.pose_count):
        for was, now in zip(batch.polylines_of(k), out.polylines_of(k), strict=True):
            line = shapely.LineString(flattened(now, setting.frames, k))
            away = [line.distance(shapely.Point(p)) for p in flattened(was, setting.frames, k)]
            assert max(away) <= tolerance + 1e-8
            assert (was[0] == now[0]).all()
            assert len(now) >= 4
    lengths, before = out.lengths(), batch.lengths()
    assert (lengths <= before + 1e-6).all()
    assert (lengths[:, OBJECT] > 0).tolist() == (before[:, OBJECT] > 0).tolist()


def test_simplifying_within_nothing_changes_nothing_and_needs_no_points(rng):
    batch, setting, _ = random_regions(rng)
    assert_equal(run_stage("simplify", batch, setting, tolerance=1e-7), batch)
    empty = batch.select(0, 1)
    assert empty.polyline_count == 0
    for name in (
        "simplify",
        "resample",
        "smooth",
        "corners",
        "edges",
        "ellipse",
        "circle",
        "centroid",
        "hatch",
        "inset",
    ):
        assert_valid(run_stage(name, empty, a_setting(setting.pose[:1])), 1)


@pytest.mark.parametrize("options", [{"method": "chaikin"}, {"method": "laplace", "rounds": 5}])
def test_smoothing_rounds_corners_and_stays_within_the_hull(options, rng):
    batch, setting, _ = random_regions(rng)
    batch = with_weights(batch, rng)
    out = run_stage("smooth", batch, setting, **options)
    assert_valid(out, batch.pose_count)
    np.testing.assert_array_equal(out.polyline_closed, batch.polyline_closed)
    assert (out.length() <= batch.length()).all()
    for k in range(batch.pose_count):
        for was, now in zip(batch.polylines_of(k), out.polylines_of(k), strict=True):
            hull = shapely.MultiPoint(flattened(was, setting.frames, k)).convex_hull.buffer(1e-7)
            assert hull.covers(shapely.LineString(flattened(now, setting.frames, k)))
            turn = [np.max(turns_of(line)) for line in (was, now)]
            assert turn[1] < turn[0]
    assert out.dwell.sum() == pytest.approx(batch.dwell.sum(), rel=0.2 if options["method"] == "chaikin" else 1e-6)


def turns_of(line):
    step = np.diff(line.astype(np.float64), axis=0)
    unit = step / np.linalg.norm(step, axis=1, keepdims=True)
    return np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1, 1))


def test_chaikin_cuts_long_sides_by_no_more_than_its_reach_and_open_ends_stay():
    batch, setting = one_loop(SQUARE, closed=False)
    out = run_stage("smooth", batch, setting, reach=0.002)
    flat = flattened(out.points, setting.frames, 0)
    np.testing.assert_allclose(flat[[0, -1]], SQUARE[[0, -1]], atol=1e-7)
    away = [shapely.LineString(SQUARE).distance(shapely.Point(p)) for p in flat]
    assert 1e-4 < max(np.linalg.norm(flat[:, None] - SQUARE[1:3], axis=2).min(axis=0)) < 0.002
    assert max(away) < 0.002


def rounded(radius, count):
    """The square with corners rounded."""
    polygon = shapely.Polygon(SQUARE).buffer(-radius).buffer(radius, quad_segs=count)
    return np.array(polygon.exterior.coords)[:-1][::-1]


@pytest.mark.parametrize("count", [1, 5, 40])
def test_corners_are_found_where_they_are_sharp_or_rounded_and_nowhere_on_arcs(count):
    for loop in (SQUARE, np.roll(np.concatenate([SQUARE, 0.5 * (SQUARE + np.roll(SQUARE, -1, axis=0))]), 1, axis=0)):
        batch, setting = one_loop(SQUARE if len(loop) == 4 else loop[np.argsort(np.arctan2(loop[:, 1], loop[:, 0]))])
        out = run_stage("corners", batch, setting, dwell=0.01)
        assert len(np.unique(out.points[out.dwell > 0], axis=0)) == 4
    for first in range(count + 1):  # wherever around a corner the seam is
        batch, setting = one_loop(np.roll(rounded(0.002, count), first, axis=0))
        out = run_stage("corners", batch, setting, dwell=0.01)
        corners = flattened(np.unique(out.points[out.dwell > 0], axis=0), setting.frames, 0)
        assert len(corners) == 4
        assert np.abs(corners) == pytest.approx(0.02, abs=0.0021)
    angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    batch, setting = one_loop(0.03 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    out = run_stage("corners", batch, setting, dwell=0.01, level=0.3)
    assert not out.dwell.any()
    assert out.intensity == pytest.approx(0.3)


@pytest.mark.parametrize("reach", [0.012, 0.027, 0.035])
def test_intensity_falls_with_the_way_from_a_corner(reach, rng):
    batch, setting = one_loop(SQUARE, rng)
    level = 0.25
    out = run_stage("corners", batch, setting, reach=reach, level=level)
    assert_valid(out, 1)
    fine = divide_batch(out, 2e-4)
    flat = flattened(fine.points, setting.frames, 0)
    away = np.abs(flat[:, None] - SQUARE).sum(axis=2).min(axis=1)  # along the sides
    want = level + (1 - level) * np.clip(2 * (1 - away / reach), 0, 1)
    np.testing.assert_allclose(fine.intensity, want, atol=1e-4)
    assert out.length() == pytest.approx(batch.length())
    near = run_stage("corners", batch, setting, reach=0.05, level=level)  # wider than a side: never down to the level
    assert near.intensity.min() > 0.99


def test_a_pause_at_the_seam_stands_at_both_of_its_points_and_intensities_multiply():
    batch, setting = one_loop(SQUARE)
    once = run_stage("corners", batch, setting, dwell=0.01)
    assert (once.dwell[[0, -1]] == np.float32(0.01)).all()
    assert np.count_nonzero(once.dwell) == 5
    twice = run_stage("corners", once, setting, dwell=0.01)
    assert twice.dwell[0] == np.float32(0.02)
    assert twice.intensity.min() == pytest.approx(0.4**2)


def test_edges_have_the_intensity_of_their_kind_and_change_within_a_millimetre(rng):
    batch, setting, _ = random_regions(rng)
    out = run_stage("edges", batch, setting, on_object=0.9, on_hand=0.2)
    assert_valid(out, batch.pose_count)
    np.testing.assert_allclose(out.lengths(), batch.lengths(), rtol=1e-5)
    lines = Lines.of(out)
    here = np.flatnonzero(lines.is_segment)
    middle = 0.5 * (out.intensity[here] + out.intensity[here + 1])
    strong = out.kind[here] == OBJECT
    assert (middle[strong] > 0.899).all()
    long = ~strong & (lines.length[here] > 0.0011)
    assert middle[long] == pytest.approx(0.2, abs=1e-6)


def test_short_runs_of_the_object_are_curved():
    batch, setting = one_loop(rounded(0.004, 8))
    out = run_stage("edges", batch, setting, shortest=0.02, curved=0.1)
    fine = divide_batch(out, 5e-4)
    flat = np.abs(flattened(fine.points, setting.frames, 0))
    straight = (flat.min(axis=1) < 0.015) & (flat.max(axis=1) > 0.0199)
    assert fine.intensity[straight].min() > 0.99
    assert fine.intensity.min() == pytest.approx(0.1)


def test_a_straight_run_goes_on_across_the_seam():
    half = 0.5 * (SQUARE[:1] + SQUARE[-1:])
    for loop in (SQUARE, np.concatenate([half, SQUARE])):
        batch, setting = one_loop(loop)
        assert run_stage("edges", batch, setting, shortest=0.039).intensity == pytest.approx(1.0)


def test_each_point_is_as_strong_as_it_is_deep(device):
    loop = 0.9 * SQUARE
    batch, setting = one_loop(loop)
    setting = a_setting(setting.pose, thing=Block(), device=device)
    out = run_stage("depth", batch, setting, at="point", shallow=0.005, deep=0.02, lowest=0.2, spacing=0.003)
    want = 0.2 + 0.8 * np.clip((0.03 - np.abs(out.points - [0, 0, 0.2]).max(axis=1) - 0.005) / 0.015, 0, 1)
    np.testing.assert_allclose(out.intensity, want, atol=1e-4)
    assert_valid(out, 1)
    assert Lines.of(out).length.max() < 0.0031


@pytest.mark.parametrize("at", ["patch", "pose"])
def test_a_patch_is_as_deep_as_its_deepest_point_wherever_the_object_has_moved(at, device):
    batch, setting = one_loop(SQUARE)
    quarter = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
    for lift, want in ((0.0, 0.03), (0.02, 0.01), (0.05, 0.0)):
        moved = np.array([[0.0, 0.0, 0.2 - lift, *quarter]], np.float32)
        placed = a_setting(setting.pose, thing=Block(), device=device, moved=moved)
        out = run_stage("depth", batch, placed, at=at, deep=0.04, lowest=0.0)
        assert out.intensity == pytest.approx(want / 0.04, abs=1e-4)


def test_depth_turns_about_the_pivot_that_contours_do(device):
    batch, setting = one_loop(SQUARE)
    half, pivot = [0.0, 1.0, 0.0, 0.0], np.array([0.0, 0.0, 0.19])
    moved = np.array([[0.0, 0.0, 0.19, *half]], np.float32)  # upside down about a point 10 mm below the middle
    placed = replace(a_setting(setting.pose, thing=Block(), device=device, moved=moved), object_centre=pivot)
    out = run_stage("depth", batch, placed, at="patch", deep=0.04, lowest=0.0)
    assert out.intensity == pytest.approx(0.25, abs=1e-4)  # the block is 20 mm lower then, the palm 10 mm deep in it


@pytest.mark.parametrize("options", [{"method": "chaikin", "rounds": 6}, {"method": "laplace", "rounds": 30}])
def test_smoothing_leaves_no_segment_without_length(options):
    batch, setting = one_loop(
        0.05 + 1e-6 * SQUARE
    )  # 40 nm broad, where coordinates are 4 nm apart: points fall together
    out = run_stage("smooth", batch, setting, **options)
    assert_valid(out, out.pose_count)
    assert 2 < out.point_count < 200 or options["method"] == "laplace"


def test_a_small_loop_has_its_corners_although_the_window_is_longer_than_it():
    batch, setting = one_loop(0.05 * SQUARE)  # 2 mm square, 8 mm around
    out = run_stage("corners", batch, setting, window=0.01, dwell=0.01)
    corners = np.unique(out.points[out.dwell > 0], axis=0)
    np.testing.assert_array_equal(corners, np.unique(batch.points, axis=0))


def test_a_pose_is_as_deep_as_its_deepest_patch():
    near, far = (HandPatch(name, 0.03, 0.03, (x, 0, 0, 0, 0, 0, 1)) for name, x in (("in", 0.0), ("out", 0.2)))
    pose = np.array([[0, 0, 0.2, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], np.float32)
    setting = a_setting(pose, thing=Block(), hand=PlaneHand((near, far)))
    loop, _ = one_loop(0.4 * SQUARE)
    both = {name: np.concatenate([getattr(loop, name)] * 2) for name in ("points", "kind", "polyline_closed")}
    batch = ContourBatch(
        **both,
        polyline_start=np.array([0, 5, 10]),
        polyline_patch=np.array([0, 1], np.int32),
        pose_start=np.array([0, 2]),
    )
    options = {"deep": 0.04, "lowest": 0.0}
    by_patch = run_stage("depth", batch, setting, at="patch", **options).intensity
    by_pose = run_stage("depth", batch, setting, at="pose", **options).intensity
    assert by_patch[:5] == pytest.approx(0.75, abs=1e-4)
    assert not by_patch[5:].any()
    assert by_pose == pytest.approx(0.75, abs=1e-4)


def test_pauses_at_ends_of_open_contours_stay_when_corners_are_cut():
    batch, setting = one_loop(SQUARE, closed=False)
    dwell = np.array([0.01, 0.0, 0.02, 0.03], np.float32)
    out = run_stage("smooth", replace(batch, dwell=dwell), setting)
    assert out.dwell[[0, -1]] == pytest.approx([0.01, 0.03])
    assert out.dwell.sum() == pytest.approx(0.06)
