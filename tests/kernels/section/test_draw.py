"""Contours drawn from listed steps: the bits of those drawn by walking, on every mesh, whatever is listed."""

import numpy as np
import pytest
import warp as wp
from degenerate_cases import degenerate_poses
from drawing import STRATEGIES, assert_same_bits, draw, join, patch_array, surface_on
from mesh_cases import CLOSED, MESHES, generic_poses

from palpate.kernels.section import pieces, search
from palpate.kernels.section.clip import room_for_events
from palpate.kernels.section.join import WALKED
from palpate.kernels.section.lanes import threads_for
from palpate.kernels.section.pieces import SLOTS
from palpate.render.bench.cases import random_poses

HALF = np.array([0.0425, 0.03])
SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]


@pytest.fixture(autouse=True)
def listing(monkeypatch):
    """Steps are listed on a CPU, too."""
    monkeypatch.setattr(search, "lists_steps", lambda device: True)


def assert_same(surface, poses, patch, strategy):
    sought, traced = (draw(surface, poses, patch, strategy, method) for method in ("tree", "scan"))
    assert_same_bits(sought, traced)


def joined_block(surface, poses, patch, strategy):
    """ContourPieces with lists, and the entries of their queries."""
    return join(surface, poses, patch, strategy, "scan").blocks[0]


def walked_share(surface, poses, patch, strategy):
    """Share of the queries with pieces that are drawn by walking."""
    count = joined_block(surface, poses, patch, strategy)[1].count.numpy()
    return np.mean((count[count > 0] & int(WALKED)) != 0)


def test_nearly_all_queries_are_drawn_from_lists(device):
    for name in set(CLOSED) - {"comb"}:
        surface, poses = surface_on(MESHES[name](), device), generic_poses(60, 1)
        for strategy in STRATEGIES:
            assert walked_share(surface, poses, patch_array(HALF, device), strategy) < 0.4  # long loops of the egg box


def test_queries_with_steps_of_zero_length_at_sides_are_walked(device):
    mesh = MESHES["cube"]()
    surface, patch = surface_on(mesh, device), patch_array([0.0425, 0.0425], device)
    poses = np.array(list(degenerate_poses(mesh, 20, seed=4).values()))
    assert 0 < walked_share(surface, poses, patch, "cc") < 1


def test_queries_with_more_steps_than_their_list_has_room_for_are_walked(device, monkeypatch):
    for words in (1, 3, 7):
        monkeypatch.setattr(pieces, "BOUNDED", (1000.0, words))
        monkeypatch.setattr(pieces, "UNBOUNDED", (1000.0, words))
        for name in ("tube", "shell", "torn dog"):
            surface, patch = surface_on(MESHES[name](), device), patch_array(SEVERAL, device)
            for strategy in STRATEGIES if name in CLOSED else ("raw", "oc"):
                assert_same(surface, generic_poses(20, 6), patch, strategy)
        surface = surface_on(MESHES["tube"](), device)
        assert 0.1 < walked_share(surface, random_poses(200), patch_array(HALF, device), "cc") < 1


def test_any_number_of_poses(device):
    surface, patch = surface_on(MESHES["tube"](), device), patch_array(HALF, device)
    for count in (0, 1, 31, 33, 65):
        for strategy in STRATEGIES:
            assert_same(surface, random_poses(100)[:count], patch, strategy)


def test_sections_with_many_pieces_are_walked(device):
    surface, patch = surface_on(MESHES["comb"](), device), patch_array([0.0425, 0.0425], device)
    for strategy in STRATEGIES:
        assert_same(surface, generic_poses(200, 8), patch, strategy)
    found, entries = joined_block(surface, generic_poses(200, 8), patch, "cc")
    many = found.count.numpy() > SLOTS
    assert many.any()
    assert (entries.count.numpy()[many] == 0).all()


def test_threads_are_whole_blocks_on_a_gpu():
    class Gpu:
        is_cpu = False

    assert [threads_for(Gpu, count) for count in (0, 1, 64, 65)] == [0, 64, 64, 128]
    assert threads_for(wp.get_device("cpu"), 65) == 65


def test_more_events_than_32_bits_count_are_refused(device):
    count = wp.empty(2**20, dtype=wp.int32, device=device)
    with pytest.raises(MemoryError, match=r"1048576 queries of 4096 events each exceed the limit of 4294967296 events"):
        room_for_events(count, 4095)
