"""Simplifying and smoothing, emphasis by corners, kinds and depth."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from polyline_oracle import Lines
from transform_cases import (
    a_setting,
    assert_valid,
    batch_of_loops,
    flattened,
    random_regions,
    run_stage,
    with_weights,
)

from palpate.kernels.section.draw import OBJECT

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
    setting = a_setting(pose, solid=Block())
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


def test_a_pause_at_the_seam_stands_at_both_of_its_points_and_intensities_multiply():
    batch, setting = one_loop(SQUARE)
    once = run_stage("corners", batch, setting, dwell=0.01)
    assert (once.dwell[[0, -1]] == np.float32(0.01)).all()
    assert np.count_nonzero(once.dwell) == 5
    twice = run_stage("corners", once, setting, dwell=0.01)
    assert twice.dwell[0] == np.float32(0.02)
    assert twice.intensity.min() == pytest.approx(0.4**2)


def test_each_point_is_as_strong_as_it_is_deep(device):
    loop = 0.9 * SQUARE
    batch, setting = one_loop(loop)
    setting = a_setting(setting.pose, solid=Block(), device=device)
    out = run_stage("depth", batch, setting, at="point", shallow=0.005, deep=0.02, lowest=0.2, spacing=0.003)
    want = 0.2 + 0.8 * np.clip((0.03 - np.abs(out.points - [0, 0, 0.2]).max(axis=1) - 0.005) / 0.015, 0, 1)
    np.testing.assert_allclose(out.intensity, want, atol=1e-4)
    assert_valid(out, 1)
    assert Lines.of(out).length.max() < 0.0031


def test_depth_turns_about_the_centre_that_contours_do(device):
    batch, setting = one_loop(SQUARE)
    half, centre = [0.0, 1.0, 0.0, 0.0], np.array([0.0, 0.0, 0.19])
    object_pose = np.array([[0.0, 0.0, 0.19, *half]], np.float32)  # upside down about a point 10 mm below the middle
    placed = replace(
        a_setting(setting.pose, solid=Block(), device=device, object_pose=object_pose), object_centre=centre
    )
    out = run_stage("depth", batch, placed, at="patch", deep=0.04, lowest=0.0)
    assert out.intensity == pytest.approx(0.25, abs=1e-4)  # the block is 20 mm lower then, the palm 10 mm deep in it


def test_smoothing_leaves_no_segment_without_length():
    batch, setting = one_loop(0.05 + 1e-6 * SQUARE)  # 40 nm broad, where coordinates are 4 nm apart: points coincide
    out = run_stage("smooth", batch, setting, rounds=6)
    assert_valid(out, out.pose_count)
    assert 2 < out.point_count < 200
