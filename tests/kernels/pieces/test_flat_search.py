"""Contours by the flat search: the same bits as by walking, on every mesh, whatever the memory for it."""

from functools import partial

import numpy as np
import pytest
import warp as wp
from degenerate_cases import degenerate_poses
from drawing import STRATEGIES, Drawn, assert_same_bits, draw, patch_array, surface_on
from mesh_cases import CLOSED, MESHES, comb, generic_poses
from tally_outputs import empty

from palpate.kernels.pieces import finding, flat_search
from palpate.kernels.pieces.finding import find_pieces
from palpate.kernels.pieces.flat_search import flat_search_pieces
from palpate.kernels.pieces.row_block import FlatSize
from palpate.kernels.section.contour_writing import draw_contours
from palpate.kernels.section.joining import join_pieces, order_pieces
from palpate.kernels.section.pieces import SLOTS, room_for_sections
from palpate.kernels.section.tally_undrawn import tally_pieces
from palpate.render import Palm, closed_contour, open_contour
from palpate.render.bench.cases import blob, random_poses
from palpate.render.hands.flat_hand import flat_hand
from palpate.render.intersection.mesh_section import intersect
from palpate.render.objects.mesh.solid_mesh import MeshObject

HALF = np.array([0.0425, 0.03])
SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]
FIELDS = [field for field in Drawn.__dataclass_fields__ if field != "length"]


def strategies_for(name):
    return STRATEGIES if name in CLOSED else ("raw", "oc")


def assert_same(surface, poses, patch, strategy):
    sought, flat = (draw(surface, poses, patch, strategy, method) for method in ("seek", "flat"))
    assert_same_bits(sought, flat)
    return flat


@pytest.mark.parametrize("name", MESHES)
def test_bits_are_those_of_walking(name, device):
    mesh = MESHES[name]()
    surface = surface_on(mesh, device)
    poses = generic_poses(150, 1)
    poses[:50, :3] = mesh[0][np.random.default_rng(1).integers(0, len(mesh[0]), 50)]  # planes through vertices
    for strategy in strategies_for(name):
        drawn = assert_same(surface, poses, patch_array(HALF, device), strategy)
        assert len(drawn.polyline_closed) > 30
        assert_same(surface, poses[:40], patch_array(SEVERAL, device), strategy)


@pytest.mark.parametrize("name", sorted(MESHES))
def test_bits_are_those_of_walking_at_degenerate_poses(name, device):
    mesh = MESHES[name]()
    surface, patch = surface_on(mesh, device), patch_array([0.0425, 0.0425], device)
    poses = np.array(list(degenerate_poses(mesh, 6, seed=4).values()))
    for strategy in strategies_for(name):
        assert_same(surface, poses, patch, strategy)


@pytest.mark.parametrize("frequency", [16, 40])
def test_bits_of_large_surfaces_are_those_of_walking(frequency, device):
    surface, patch = surface_on(blob(frequency), device), patch_array([0.0425, 0.0425], device)
    for strategy in STRATEGIES:
        drawn = assert_same(surface, random_poses(300), patch, strategy)
        assert len(drawn.points) > 300 * frequency


def test_patches_with_poses_of_their_own(device):
    surface, patch = surface_on(blob(16), device), patch_array(SEVERAL, device)
    poses = np.stack([random_poses(40, seed) for seed in range(len(SEVERAL))], axis=1)
    for strategy in STRATEGIES:
        assert_same(surface, poses, patch, strategy)


def test_sections_with_many_pieces_are_searched_again(device):
    surface, patch = surface_on(comb(), device), patch_array([0.0425, 0.0425], device)
    pose = wp.array(generic_poses(200, 8)[:, None], dtype=wp.transform, ndim=2, device=device)
    found = find_pieces(surface, pose, patch, bounded=True, closes=True, method="flat")
    assert len(found) == 2
    assert found[1].count.numpy().min() > SLOTS
    for strategy in STRATEGIES:
        assert_same(surface, generic_poses(200, 8), patch, strategy)


def test_no_poses_and_poses_that_meet_nothing(device):
    surface, patch = surface_on(blob(16), device), patch_array(HALF, device)
    away = random_poses(20) + np.array([0, 0, 5, 0, 0, 0, 0], np.float32)
    for strategy in STRATEGIES:
        for poses in (np.zeros((0, 7), np.float32), away):
            assert len(assert_same(surface, poses, patch, strategy).points) == 0


@pytest.mark.parametrize(
    "size",
    [FlatSize(1, 100.0, 2**20), FlatSize(4000, 0.01, 2**20), FlatSize(4000, 100.0, 700), FlatSize(2, 1.0, 64)],
    ids=["space", "crossings", "blocks", "all"],
)
def test_what_finds_no_space_is_searched_again(size, device, monkeypatch):
    """Too little space for a section, for a block's crossings, and blocks of a few rows."""
    sizes = []

    def search(*arguments, **options):
        sizes.append(size)
        flat_search_pieces(*arguments, size=size, **options)

    monkeypatch.setattr(finding, "flat_search_pieces", search)
    poses = generic_poses(60, 3)
    for mesh in (comb(), blob(12), MESHES["torn dog"]()):
        surface, patch = surface_on(mesh, device), patch_array([0.0425, 0.0425], device)
        for strategy in ("raw", "oc"):
            assert_same(surface, poses, patch, strategy)
    assert len(sizes) > 6  # the comb's rows with many pieces, too


def test_a_section_with_too_many_crossings_is_searched_by_walking(device, monkeypatch):
    monkeypatch.setattr(flat_search, "CROSSINGS_MOST", 20)
    surface, patch = surface_on(blob(16), device), patch_array([0.0425, 0.0425], device)
    size = FlatSize(2, 1.0, 64)
    pose = wp.array(random_poses(20)[:, None], dtype=wp.transform, ndim=2, device=device)
    pieces = room_for_sections(20, device)
    with pytest.raises(flat_search.CrossingLimitError, match=r"a section has \d+ crossings; a flat search links 20"):
        flat_search_pieces(surface, pose, patch, pieces, bounded=True, closes=True, size=size)
    monkeypatch.setattr(finding, "flat_search_pieces", partial(flat_search_pieces, size=size))
    for strategy in STRATEGIES:
        assert_same(surface, random_poses(50), patch, strategy)


@pytest.mark.parametrize("name", ["comb", "dog", "shell"])
def test_sums_without_points_are_those_of_pieces_found_by_walking(name, device):
    surface, patch = surface_on(MESHES[name](), device), patch_array(SEVERAL, device)
    pose = wp.array(generic_poses(100, 2)[:, None], dtype=wp.transform, ndim=2, device=device)
    for bounded, closes in STRATEGIES.values():
        sums = []
        for method in ("seek", "flat"):
            found = find_pieces(surface, pose, patch, bounded=bounded, closes=closes, method=method)
            ordered = order_pieces(surface, found, pose, patch, closes=closes)
            value, length = empty(100, device)
            tally_pieces(surface, pose, patch, ordered, value, length, bounded=bounded, closes=closes)
            sums.append(value.numpy().tobytes() + length.numpy().tobytes())
        assert sums[0] == sums[1]


def test_sections_drawn_in_several_turns_of_few_groups(device, monkeypatch):
    monkeypatch.setattr("palpate.kernels.section.contour_writing.GROUPS_MOST", 7)
    surface, patch = surface_on(comb(), device), patch_array(HALF, device)
    assert_same(surface, generic_poses(60, 5), patch, "cc")


@pytest.mark.parametrize("strategy", [open_contour(), closed_contour()], ids=["oc", "cc"])
@pytest.mark.parametrize("hand", [Palm(), flat_hand()], ids=["palm", "hand"])
def test_meshes_and_hands_are_intersected_alike(hand, strategy, device):
    """Relative points and a flush, too, which the objects and hands bring."""
    pose = wp.array(random_poses(60), dtype=wp.transform, device=device)
    for mesh in (MeshObject(*blob(16)), MeshObject.load("dog")):
        for relative in (False, True):
            batches = [
                intersect(mesh, hand, pose, strategy, method=method, relative=relative)[0].numpy()
                for method in ("seek", "flat")
            ]
            for field in ("points", "kind", "polyline_start", "polyline_patch", "polyline_closed", "pose_start"):
                one, two = (getattr(batch, field) for batch in batches)
                assert one.tobytes() == two.tobytes(), field


def test_slots_may_come_in_any_order(device):
    """Lanes store a section's pieces in the order in which they come: nothing that is drawn depends on it."""
    surface, patch = surface_on(comb(), device), patch_array([0.0425, 0.0425], device)
    pose = wp.array(generic_poses(80, 8)[:, None], dtype=wp.transform, ndim=2, device=device)
    drawn = []
    for turned in (False, True):
        found = find_pieces(surface, pose, patch, bounded=True, closes=True, method="flat")
        if turned:
            for pieces in found:
                turn_slots(pieces)
        joined = join_pieces(surface, found, pose, patch, closes=True)
        drawn.append(draw_contours(surface, pose, patch, joined, bounded=True, closes=True))
    for one, two in zip(*drawn, strict=True):
        assert one.numpy().tobytes() == two.numpy().tobytes()


def turn_slots(pieces):
    """Reverse the slots of each row."""
    count = pieces.count.numpy()
    start = pieces.start.numpy() if pieces.start.shape[0] else np.arange(len(count))
    room = pieces.room.numpy() if pieces.room.shape[0] else np.full(len(count), SLOTS)
    for field in ("half", "out", "key", "side", "steps", "begin"):
        array = getattr(pieces, field)
        values = array.numpy().copy()
        for row, stored in enumerate(np.minimum(count, room)):
            slots = start[row] + np.arange(stored) * pieces.stride
            values[slots] = values[slots[::-1]]
        array.assign(values)
