"""Contours from the table of loops: the same bits as by the searches, for every small solid, pose and strategy."""

import numpy as np
import pytest
from degenerate_cases import degenerate_poses
from drawing import METHODS, STRATEGIES, assert_same_bits, draw, draw_by_table, exact_poses, patch_array, surface_on
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import generic_poses
from small_solids import SOLIDS, hull, hull_of

from palpate.kernels.flush import FLUSH_RATE, resolve_flush
from palpate.kernels.offsets import PointLimitError

HALF = [0.0425, 0.03]
SQUARE = [0.0425, 0.0425]
SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]
"""The second goes around all solids, the third is inside most of them at some poses."""
every_solid = pytest.mark.parametrize("name", SOLIDS)


def assert_same(mesh, poses, patch, methods=METHODS):
    """Compare by all strategies; returns how many polylines there were."""
    surface, count = surface_on(mesh, str(patch.device)), 0
    for strategy in STRATEGIES:
        drawn = draw_by_table(mesh, poses, patch, strategy)
        for method in methods:
            assert_same_bits(draw(surface, poses, patch, strategy, method), drawn)
        assert_same_bits(draw_by_table(mesh, poses, patch, strategy, split=True), drawn)
        assert_same_bits(draw_by_table(mesh, poses, patch, strategy, split=False), drawn)
        count += len(drawn.polyline_closed)
    return count


@every_solid
def test_bits_are_those_of_the_searches(name, device):
    mesh = SOLIDS[name]()
    poses = generic_poses(400, 1)
    through = poses[:100]
    through[:, :3] = mesh[0][np.random.default_rng(1).integers(0, len(mesh[0]), len(through))]
    assert assert_same(mesh, poses, patch_array(HALF, device)) > 100
    assert assert_same(mesh, poses[:200], patch_array(SEVERAL, device), ("trace",)) > 200


@every_solid
def test_bits_are_those_of_the_searches_at_degenerate_poses(name, device):
    mesh = SOLIDS[name]()
    poses = np.array(list(degenerate_poses(mesh, 12, seed=4).values()))
    assert assert_same(mesh, poses, patch_array(SQUARE, device)) > 50


@every_solid
@pytest.mark.parametrize("relative", [False, True])
def test_bits_with_a_flush_and_in_the_frame_of_the_patch(name, relative, device):
    mesh = SOLIDS[name]()
    poses = np.array(list(degenerate_poses(mesh, 6, seed=5).values()))
    poses[:, :3] += np.random.default_rng(2).normal(size=(len(poses), 3)).astype(np.float32) * np.float32(3e-8)
    for flush, rate in ((0.0, FLUSH_RATE), (1e-3, 0.0)):
        patch = resolve_flush(patch_array([SQUARE, HALF], device), flush=flush, flush_rate=rate, relative=relative)
        assert assert_same(mesh, poses, patch, ("trace",)) > 50


def test_patches_with_poses_of_their_own(device):
    patch = patch_array(SEVERAL, device)
    poses = np.stack([exact_poses(100, seed) for seed in range(len(SEVERAL))], axis=1)
    for name in ("cube", "ring", "tetrahedra apart"):
        assert assert_same(SOLIDS[name](), poses, patch, ("trace",)) > 100


def test_sections_of_many_pieces_are_joined_alike(device):
    """A patch through a ring or a notched prism is entered and left again and again, also by the same side."""
    patch = patch_array([[0.03, 0.004], [0.002, 0.05], [0.02, 0.02]], device)
    for name, most in (("ring", 4), ("angle", 3), ("arrow", 3), ("tetrahedra nested", 4)):
        mesh, poses = SOLIDS[name](), generic_poses(600, 7, spread=0.03)
        assert assert_same(mesh, poses, patch, ("trace",)) > 600
        assert np.diff(draw_by_table(mesh, poses, patch, "oc").section_start).max() >= most


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("seed", range(12))
def test_bits_of_random_hulls(seed, device):
    mesh = hull(4 + seed % 9, 100 + seed)
    rng = np.random.default_rng(seed)
    patch = patch_array(rng.uniform(0.002, 0.06, (2, 2)), device)
    poses = np.concatenate([exact_poses(500, seed), np.array(list(degenerate_poses(mesh, 6, seed).values()))])
    assert assert_same(mesh, poses, patch, ("trace",)) > 500


@settings(max_examples=40, deadline=None)
@given(cells=st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=5, max_size=12, unique=True), seed=st.integers(0))
def test_bits_of_solids_whose_vertices_stand_on_a_grid(cells, seed):
    """Palms on the same grid: planes through vertices and faces, sides and corners on crossings."""
    points = np.array(cells)
    if np.linalg.matrix_rank(points - points[0]) < 3:
        return
    mesh = hull_of(points / 64.0 + [0, 0, 0.1875])
    rng = np.random.default_rng(seed)
    turns = np.array([[0, 0, 0, 1], [1, 0, 0, 0], [1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [1, 1, 1, 1], [0, 1, 2, 1]])
    place = rng.integers(-3, 4, (60, 3)) / 64.0 + [0, 0, 0.1875]
    poses = np.hstack([place, turns[rng.integers(0, len(turns), 60)]])
    assert_same(mesh, poses, patch_array([[1 / 64, 1 / 32], [3 / 64, 1 / 128]], "cpu"), ("trace",))


def test_more_points_than_the_limit_are_refused_and_as_many_are_not(device):
    mesh, patch, poses = SOLIDS["cube"](), patch_array(HALF, device), generic_poses(50, 10)
    total = len(draw_by_table(mesh, poses, patch, "cc").points)
    assert len(draw_by_table(mesh, poses, patch, "cc", limit=total).points) == total
    with pytest.raises(PointLimitError, match=f"{total} points.*limit of {total - 1}"):
        draw_by_table(mesh, poses, patch, "cc", limit=total - 1)


def test_no_poses_and_no_contours_are_empty(device):
    mesh, patch = SOLIDS["cube"](), patch_array(HALF, device)
    drawn = draw_by_table(mesh, np.zeros((0, 7)), patch, "cc")
    assert drawn.section_start.tolist() == [0]
    assert drawn.polyline_start.tolist() == [0]
    away = generic_poses(10, 1)
    away[:, 2] += 1
    drawn = draw_by_table(mesh, away, patch, "cc")
    assert drawn.polyline_start.tolist() == [0]
    assert drawn.section_start.tolist() == [0] * 11


def test_poses_of_another_shape_are_refused(device):
    with pytest.raises(ValueError, match=r"poses must have shape \[pose, 1\] or \[pose, 2\]"):
        draw_by_table(SOLIDS["cube"](), np.zeros((4, 3, 7)), patch_array([HALF, HALF], device), "cc")
