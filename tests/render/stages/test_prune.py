"""Prune stages: what each removes, against slow oracles and by what must hold of the rest."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from contour_random import kinds_agree, random_batch
from prune_cases import FOCAL_WIDTH, a_setting, circle, flat_frames, lines_at, pruned
from scipy.spatial.transform import Rotation
from thinning_oracle import SlowThinning

from palpate.kernels.stages.cut import divide_segments
from palpate.kernels.stages.prune_crowded import Beside, thin_contours
from palpate.render import ContourBatch
from palpate.render.hands.hand import PatchFrames

STAGES = ["off-skin", "close-together", "small", "turned-away", "hidden"]
OPTIONS = {"small": {"perimeter": 0.4, "length": 0.2}}  # random polylines are long


def random_frames(rng, pose_count, patch_count=3):
    turn = Rotation.random(pose_count * patch_count, random_state=int(rng.integers(2**31))).as_matrix()
    u, v, n = (turn[:, :, k].reshape(pose_count, patch_count, 3) for k in range(3))
    origin = rng.normal(size=(pose_count, patch_count, 3)) * 0.04 + [0, 0, 0.2]
    return PatchFrames(origin, u, v, n, rng.uniform(0.01, 0.04, (patch_count, 2)))


# ---- what holds of every stage -------------------------------------------------------------------------------------


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", STAGES)
def test_what_is_kept_and_what_is_removed_are_all_and_once_is_enough(name, device, rng):
    batch = random_batch(rng, 30)
    setting = a_setting(random_frames(rng, 30), device)
    options = OPTIONS.get(name, {})
    out, removed = pruned(batch, setting, name, **options)
    np.testing.assert_allclose(out.length() + removed, batch.length(), atol=2e-6)
    assert removed.sum() > 0.01
    assert out.length().sum() > 0.01
    kinds_agree(out, batch)
    again, more = pruned(out, setting, name, **options)
    assert more.sum() <= 0.002 * removed.sum()
    if name in ("off-skin", "small", "turned-away"):
        assert not more.any()
        for field, value in again.by_name().items():
            np.testing.assert_array_equal(value, out.by_name()[field])


# ---- off-skin ------------------------------------------------------------------------------------------------------


def skin_distance(x, frames, pose):
    """Distance of points from the nearest patch [m], x of shape [point, 3]."""
    best = np.full(len(x), np.inf)
    for k in range(frames.origin.shape[1]):
        d = x - frames.origin[pose, k]
        u = np.maximum(np.abs(d @ frames.u[pose, k]) - frames.half[k, 0], 0)
        v = np.maximum(np.abs(d @ frames.v[pose, k]) - frames.half[k, 1], 0)
        best = np.fmin(best, np.sqrt(u**2 + v**2 + (d @ frames.n[pose, k]) ** 2))
    return best


def test_off_skin_keeps_what_dense_samples_find_near(device, rng):
    batch, frames = random_batch(rng, 15), random_frames(rng, 15)
    frames.origin[3, 1] = np.nan
    out, removed = pruned(batch, a_setting(frames, device), "off-skin", radius=0.012)
    share = (np.arange(400) + 0.5)[:, None] / 400
    for pose in range(15):
        far, longest = 0.0, 0.0
        for line in batch.polylines_of(pose):
            for a, b in zip(line[:-1].astype(float), line[1:].astype(float), strict=True):
                length = np.linalg.norm(b - a)
                far += length * np.mean(skin_distance(a + share * (b - a), frames, pose) > 0.012)
                longest += length / 400
        assert removed[pose] == pytest.approx(far, abs=3 * longest)
        for line in out.polylines_of(pose):
            for a, b in zip(line[:-1].astype(float), line[1:].astype(float), strict=True):
                assert skin_distance(a + share * (b - a), frames, pose).max() <= 0.012 + 2e-6


def test_pauses_stay_at_the_vertices_that_stay_and_cuts_have_none(device, rng):
    batch, frames = random_batch(rng, 15), random_frames(rng, 15)
    batch = replace(batch, dwell=rng.uniform(0.01, 0.02, batch.point_count).astype(np.float32))
    pause = {tuple(point): dwell for point, dwell in zip(batch.points.tolist(), batch.dwell, strict=True)}
    out, _ = pruned(batch, a_setting(frames, device), "off-skin", radius=0.012)
    expected = [pause.get(tuple(point), 0.0) for point in out.points.tolist()]
    np.testing.assert_array_equal(out.dwell, np.array(expected, np.float32))
    assert 10 < np.count_nonzero(out.dwell) < out.point_count - 10


# ---- close-together ------------------------------------------------------------------------------------------------


@pytest.mark.exhaustive
@pytest.mark.parametrize("across", [False, True])
def test_close_together_judges_every_part_as_the_slow_way_does(device, rng, across):
    batch = random_batch(rng, 12, spread=0.015, line_most=3, point_most=7, patch_count=2)
    rule = {"distance": 0.01, "angle": 0.6, "apart": 0.02, "across": across}
    fast = Beside()
    fast.distance, fast.parallel = wp.float64(0.01), wp.float64(np.cos(0.6))
    fast.apart, fast.patches = wp.float64(0.02), int(across)
    on = batch.to(device)
    parts = divide_segments(on.struct, 0.004)
    keep = thin_contours(on.struct, parts, fast).numpy()
    slow = [kept for pose in range(12) for kept in SlowThinning(batch, pose, 0.004, **rule).run()]
    np.testing.assert_array_equal(keep, slow)
    assert 0.02 < np.mean(keep == 0) < 0.9


def test_of_two_parallel_lines_the_shorter_one_goes(device):
    frames = flat_frames([(0, 0, 0.2)])
    short = [(-0.03, 0.012, 0.2), (0.03, 0.012, 0.2)]
    long = [(0.04, 0, 0.2), (-0.04, 0, 0.2)]  # the other way round is parallel too
    out, removed = pruned(lines_at(short, long), a_setting(frames, device), "close-together")
    np.testing.assert_array_equal(out.points, np.array(long, np.float32))
    assert removed[0] == pytest.approx(0.06, abs=1e-6)


def test_contours_on_different_patches_are_compared_only_if_asked(device):
    both = lines_at([(-0.04, 0, 0.2), (0.04, 0, 0.2)], [(-0.03, 0.01, 0.2), (0.03, 0.01, 0.2)], patches=[0, 1])
    setting = a_setting(flat_frames([(0, 0, 0.2), (0, 0, 0.3)], [(0.1, 0.1)] * 2), device)
    assert pruned(both, setting, "close-together")[1].tolist() == [0]
    assert pruned(both, setting, "close-together", across=True)[1][0] == pytest.approx(0.06, abs=1e-6)


# ---- small, turned-away, hidden ------------------------------------------------------------------------------------


def test_small_goes_by_the_focus_own_circumference(device):
    setting = a_setting(flat_frames([(0, 0, 0.2)]), device)
    for radius, stays in ((0.5 * FOCAL_WIDTH * 1.01, True), (0.5 * FOCAL_WIDTH * 0.99, False)):
        _, removed = pruned(lines_at(circle(radius, count=400), closed=True), setting, "small")
        assert (removed[0] == 0) == stays
    for length, stays in ((0.0102, True), (0.0100, False)):
        _, removed = pruned(lines_at([(0, 0, 0.2), (length, 0, 0.2)]), setting, "small")
        assert (removed[0] == 0) == stays
    _, removed = pruned(lines_at([(0, 0, 0.2), (0.02, 0, 0.2)]), setting, "small", length=0.03)
    assert removed[0] == pytest.approx(0.02)


@pytest.mark.parametrize(("tilt", "stays"), [(0, True), (59.9, True), (60.1, False), (180, False)])
def test_a_patch_turned_away_by_60_degrees_loses_its_contours(tilt, stays, device):
    turn = Rotation.from_euler("x", tilt, degrees=True).as_matrix()
    axes = [np.array([[turn[:, k], np.eye(3)[k]]]) for k in range(3)]
    origin = np.array([[(0, 0, 0.2), (0, 0, 0.2)]], float)
    frames = PatchFrames(origin, *axes, np.full((2, 2), 0.04))
    both = lines_at([(0, 0, 0.2), (0.02, 0, 0.2)], [(0, 0, 0.2), (0, 0.03, 0.2)], patches=[0, 1])
    _, removed = pruned(both, a_setting(frames, device), "turned-away")
    assert removed[0] == pytest.approx(0 if stays else 0.02)


def seen_share(x, frames, side=0.168, count=8):
    """Share of sight lines from a point to the array's face that no other patch blocks, for one pose."""
    at = (np.arange(count) - (count - 1) / 2) * side / count
    free = 0
    for p in at:
        for q in at:
            way = np.array([p, q, 0.0]) - x
            blocked = False
            for k in range(frames.origin.shape[1]):
                o, u, v, n = (value[0, k] for value in frames[:4])
                t = (n @ (o - x)) / (n @ way)
                y = x + t * way - o
                inside = abs(u @ y) < frames.half[k, 0] and abs(v @ y) < frames.half[k, 1]
                blocked |= t * np.linalg.norm(way) > 1e-3 and t < 1 and inside
            free += not blocked
    return free / count**2


@pytest.mark.exhaustive
def test_hidden_removes_what_less_than_half_of_the_array_sees(device):
    places = [(0, 0, 0.2), (0.02, 0.01, 0.16), (0, 0, -0.01)]  # a palm, a finger below it, one behind the array
    finger = flat_frames(places, [(0.0425, 0.0425), (0.03, 0.01), (0.2, 0.2)])
    line = lines_at(*[[(-0.04, y, 0.2), (0.04, y, 0.2)] for y in np.linspace(-0.04, 0.04, 9)])
    out, removed = pruned(line, a_setting(finger, device), "hidden")
    grain = FOCAL_WIDTH / 4
    for row in line.points[::2].astype(float):
        x = np.linspace(0, 0.08, 33)
        share = np.array([seen_share(row + np.array([a, 0, 0]), finger) for a in x])
        own = out.points[np.isclose(out.points[:, 1], row[1])].reshape(-1, 2, 3)
        kept = np.any([(a[0] + 0.04 <= x + 1e-6) & (x - 1e-6 <= b[0] + 0.04) for a, b in own], axis=0)
        edge = np.convolve(share < 0.5, [1, 1, 1], mode="same") % 3 > 0  # within a sample of where it changes
        assert grain < x[1] + 1e-4
        np.testing.assert_array_equal(kept[~edge], share[~edge] >= 0.5)
    assert 0.03 < removed[0] < 0.4


@pytest.mark.parametrize("posed", [False, True])
def test_a_hand_mesh_hides_as_patches_do(device, posed, rng):
    count = 4
    origin = rng.uniform(-0.02, 0.02, (count, 2, 3)) + np.array([[0, 0, 0.2], [0, 0, 0.15]])
    origin = origin if posed else np.repeat(origin[:1], count, axis=0)
    one = flat_frames([(0, 0, 0)] * 2, [(0.0425, 0.0425), (0.03, 0.02)])
    frames = PatchFrames(origin, *(np.repeat(axis, count, axis=0) for axis in one[1:4]), one.half)
    corners = frames.corners() - [0, 0, 0.2]  # the hand's frame is at (0, 0, 0.2)
    vertices = corners.reshape(count, 8, 3).astype(np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    batch = random_batch(rng, count, patch_count=1)
    flat = np.array(batch.points)
    rows = np.repeat(np.arange(count), np.diff(batch.polyline_start[batch.pose_start]))
    flat[:, 2] = origin[rows, 0, 2]  # on the upper patch's plane
    batch = ContourBatch(**{**batch.by_name(), "points": flat})
    by_patches, removed = pruned(batch, a_setting(frames, device), "hidden")
    rows = np.concatenate([np.zeros((3, 8, 3)), vertices]) if posed else vertices[:1]  # the batch begins at row 3
    mesh = {"skin_on": None, "vertices": rows, "faces": faces, "pose_count": len(rows) if posed else None}
    setting = replace(a_setting(frames, device, **mesh), first=3)
    by_mesh, mesh_removed = pruned(batch, setting, "hidden")
    np.testing.assert_allclose(mesh_removed, removed, atol=0.02 * max(removed.max(), 0.01))
    assert removed.sum() > 0.05
    assert by_mesh.length().sum() == pytest.approx(by_patches.length().sum(), rel=0.02)
