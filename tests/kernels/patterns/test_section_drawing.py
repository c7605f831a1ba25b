"""Contours from the table of loops: the same bits as by the searches, for every small solid, pose and strategy."""

from functools import cache

import numpy as np
import pytest
from degenerate_cases import degenerate_poses
from drawing import METHODS, STRATEGIES, assert_same_bits, draw, drawn_of, exact_poses, patch_array, pose_array
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import generic_poses
from small_solids import SOLIDS, hull, hull_of
from stage_cases import assert_limited

from palpate.kernels.flush import FLUSH_RATE, resolve_flush
from palpate.kernels.patterns.loop_table import upload_loop_table
from palpate.kernels.patterns.section_cutting import cut_sections
from palpate.kernels.patterns.section_drawing import draw_sections
from palpate.kernels.section.half_edges import HalfEdges, upload_surface

HALF = [0.0425, 0.03]
SQUARE = [0.0425, 0.0425]
SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]
"""The second goes around all solids, the third is inside most of them at some poses."""


class Solid:
    """A small closed solid on a device, for the searches and with its table of loops."""

    def __init__(self, mesh, device):
        edges = HalfEdges(*mesh)
        self.mesh, self.surface, self.table = mesh, upload_surface(edges, device), upload_loop_table(edges, device)

    def draw_by_table(self, poses, patch, strategy, *, limit=None, split=None):
        """As `drawing.draw`, from the table; split: as `cut_sections`."""
        bounded, closes = STRATEGIES[strategy]
        pose = pose_array(poses, patch.device)
        cut = cut_sections(self.table, pose, patch, bounded=bounded, closes=closes, split=split)
        return drawn_of(draw_sections(self.table, pose, patch, cut, bounded=bounded, closes=closes, limit=limit))


@cache
def solid_on(name, device):
    return Solid(SOLIDS[name](), device)


def assert_same(solid, poses, patch, methods=("trace",)):
    """Compare by all strategies; returns how many polylines there were."""
    count = 0
    for strategy in STRATEGIES:
        drawn = solid.draw_by_table(poses, patch, strategy)
        for method in methods:
            assert_same_bits(draw(solid.surface, poses, patch, strategy, method), drawn)
        for split in (True, False):
            assert_same_bits(solid.draw_by_table(poses, patch, strategy, split=split), drawn)
        count += len(drawn.polyline_closed)
    return count


@pytest.mark.exhaustive(but="few")
@pytest.mark.parametrize("times", [1, 6], ids=["few", "many"])
@pytest.mark.parametrize("name", SOLIDS)
def test_bits_are_those_of_the_searches(name, times, device):
    """At any poses, through vertices and at degenerate ones; of several patches, also with poses of their own."""
    solid, count = solid_on(name, device), 50 * times
    mesh = solid.mesh
    poses = generic_poses(count, 1)
    through = poses[: count // 4]
    through[:, :3] = mesh[0][np.random.default_rng(1).integers(0, len(mesh[0]), len(through))]
    several, degenerate = patch_array(SEVERAL, device), np.array(list(degenerate_poses(mesh, 2 * times, 4).values()))
    assert assert_same(solid, poses, patch_array(HALF, device), METHODS) > count // 4
    assert assert_same(solid, poses[: count // 2], several) > count // 2
    assert assert_same(solid, np.stack([exact_poses(10 * times, seed) for seed in range(4)], axis=1), several) > 10
    assert assert_same(solid, degenerate, patch_array(SQUARE, device), METHODS) > 8 * times


@pytest.mark.exhaustive(but="few")
@pytest.mark.parametrize("times", [1, 6], ids=["few", "many"])
@pytest.mark.parametrize("relative", [False, True])
def test_bits_with_a_flush_and_in_the_frame_of_the_patch(relative, times, device):
    for name in [name for name in SOLIDS if "hull" not in name or times > 1]:
        solid = solid_on(name, device)
        poses = np.array(list(degenerate_poses(solid.mesh, times, seed=5).values()))
        poses[:, :3] += np.random.default_rng(2).normal(size=(len(poses), 3)).astype(np.float32) * np.float32(3e-8)
        for flush, rate in ((0.0, FLUSH_RATE), (1e-3, 0.0)):
            patch = resolve_flush(patch_array([SQUARE, HALF], device), flush=flush, flush_rate=rate, relative=relative)
            assert assert_same(solid, poses, patch) > 8 * times, name


@pytest.mark.exhaustive(but="few")
@pytest.mark.parametrize("count", [100, 600], ids=["few", "many"])
def test_sections_of_many_pieces_are_joined_alike(count, device):
    """A patch through a ring or a notched prism is entered and left again and again, also by the same side."""
    patch = patch_array([[0.03, 0.004], [0.002, 0.05], [0.02, 0.02]], device)
    for name, most in (("ring", 4), ("angle", 3), ("arrow", 3), ("tetrahedra nested", 4)):
        solid, poses = solid_on(name, device), generic_poses(count, 7, spread=0.03)
        assert assert_same(solid, poses, patch) > count
        assert np.diff(solid.draw_by_table(poses, patch, "oc").section_start).max() >= most


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(12))
def test_bits_of_random_hulls(seed, device):
    mesh = hull(4 + seed % 9, 100 + seed)
    rng = np.random.default_rng(seed)
    patch = patch_array(rng.uniform(0.002, 0.06, (2, 2)), device)
    poses = np.concatenate([exact_poses(500, seed), np.array(list(degenerate_poses(mesh, 6, seed).values()))])
    assert assert_same(Solid(mesh, device), poses, patch) > 500


@pytest.mark.exhaustive
@settings(max_examples=40, deadline=None)
@given(cells=st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=5, max_size=12, unique=True), seed=st.integers(0))
def test_bits_of_solids_whose_vertices_stand_on_a_grid(cells, seed):
    """Palms on the same grid: planes through vertices and faces, sides and corners on crossings."""
    points = np.array(cells)
    if np.linalg.matrix_rank(points - points[0]) < 3:
        return
    check_on_grid(hull_of(points / 64.0 + [0, 0, 0.1875]), seed, 60)


def test_bits_of_a_box_whose_vertices_stand_on_a_grid():
    corners = np.stack(np.meshgrid([-2, 1], [-1, 3], [-3, 1]), axis=-1).reshape(-1, 3)
    assert check_on_grid(hull_of(corners / 64.0 + [0, 0, 0.1875]), 1, 60) > 60


def check_on_grid(mesh, seed, count):
    rng = np.random.default_rng(seed)
    turns = np.array([[0, 0, 0, 1], [1, 0, 0, 0], [1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [1, 1, 1, 1], [0, 1, 2, 1]])
    place = rng.integers(-3, 4, (count, 3)) / 64.0 + [0, 0, 0.1875]
    poses = np.hstack([place, turns[rng.integers(0, len(turns), count)]])
    return assert_same(Solid(mesh, "cpu"), poses, patch_array([[1 / 64, 1 / 32], [3 / 64, 1 / 128]], "cpu"))


def test_more_points_than_the_limit_are_refused_and_as_many_are_not(device):
    solid, patch, poses = solid_on("cube", device), patch_array(HALF, device), generic_poses(50, 10)
    assert_limited(lambda limit: len(solid.draw_by_table(poses, patch, "cc", limit=limit).points))


def test_no_poses_and_no_contours_are_empty(device):
    solid, patch, away = solid_on("cube", device), patch_array(HALF, device), generic_poses(10, 1)
    away[:, 2] += 1
    for poses in (np.zeros((0, 7)), away):
        drawn = solid.draw_by_table(poses, patch, "cc")
        assert drawn.section_start.tolist() == [0] * (len(poses) + 1)
        assert drawn.polyline_start.tolist() == [0]


def test_poses_of_another_shape_are_refused(device):
    with pytest.raises(ValueError, match=r"poses must have shape \[pose, 1\] or \[pose, 2\]"):
        solid_on("cube", device).draw_by_table(np.zeros((4, 3, 7)), patch_array([HALF, HALF], device), "cc")
