"""Contours by the flat search: the same bits as by walking, on every mesh, whatever the memory for it."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from drawing import STRATEGIES, assert_same_bits, draw, drawn_of, join, patch_array, surface_on
from mesh_cases import CLOSED, MESHES, comb, generic_poses

from palpate.kernels import compile_kernels
from palpate.kernels.offsets import BLOCK
from palpate.kernels.section import flat_ranks, flat_search
from palpate.kernels.section.draw import draw_contours
from palpate.kernels.section.flat_search import FlatSearch
from palpate.kernels.section.flat_space import FlatSize
from palpate.kernels.section.pieces import SLOTS
from palpate.render.bench.cases import blob, random_poses

HALF = np.array([0.0425, 0.03])


def strategies_for(name):
    return STRATEGIES if name in CLOSED else ("raw", "oc")


def assert_same(surface, poses, patch, strategy):
    sought, flat = (draw(surface, poses, patch, strategy, method) for method in ("tree", "flat"))
    assert_same_bits(sought, flat)
    return flat


def test_bits_of_large_surfaces_are_those_of_walking(device):
    for frequency, count in ((16, 150), (40, 60)):
        surface, patch = surface_on(blob(frequency), device), patch_array([0.0425, 0.0425], device)
        for strategy in STRATEGIES:
            drawn = assert_same(surface, random_poses(count), patch, strategy)
            assert len(drawn.points) > count * frequency


def test_no_poses_and_poses_that_meet_nothing(device):
    surface, patch = surface_on(blob(16), device), patch_array(HALF, device)
    away = random_poses(20) + np.array([0, 0, 5, 0, 0, 0, 0], np.float32)
    for strategy in STRATEGIES:
        for poses in (np.zeros((0, 7), np.float32), away):
            assert len(assert_same(surface, poses, patch, strategy).points) == 0


def assert_found(surface, poses, patch, strategy, size):
    """Blocks hold all sections in order, each has pieces in one place only, and the bits are those of walking.

    Returns the ContourPieces of blocks, and those of sections that were searched again.
    """
    count = len(poses)
    with pytest.MonkeyPatch.context() as there:
        there.setattr(FlatSize, "for_surface", lambda *_: size)
        joined = join(surface, poses, patch, strategy, "flat")
    assert_same_bits(draw(surface, poses, patch, strategy, "tree"), drawn_of(draw_contours(joined)))
    found = [pieces for pieces, _ in joined.blocks]
    blocks = [pieces for pieces in found if not pieces.section]
    again = [pieces for pieces in found if pieces.section]
    sections = [pieces.first + np.arange(pieces.count.shape[0]) for pieces in blocks]
    np.testing.assert_array_equal(np.concatenate(sections), np.arange(count))
    holders = np.zeros(count, int)
    for pieces, section in [*zip(blocks, sections, strict=True), *((own, own.section.numpy()) for own in again)]:
        counted, room = pieces.count.numpy(), pieces.room.numpy() if pieces.room.shape[0] else SLOTS
        np.add.at(holders, section[(counted > 0) & (counted <= room)], 1)
    assert holders.max() == 1
    return blocks, again


def test_each_query_takes_as_many_slots_as_it_has_pieces(device):
    surface, patch = surface_on(comb(), device), patch_array([0.0425, 0.0425], device)
    for listed in (400.0, 600.0):  # few lanes, and many
        size = FlatSize(4000, listed, 2**20, 20.0)
        (pieces,), again = assert_found(surface, generic_poses(100, 8), patch, "oc", size)
        count, start = pieces.count.numpy(), pieces.start.numpy()
        assert not again
        assert count.max() > SLOTS
        taken = np.concatenate([np.arange(first, first + own) for first, own in zip(start, count, strict=True) if own])
        np.testing.assert_array_equal(np.sort(taken), np.arange(count.sum()))


@pytest.mark.parametrize(
    "size",
    [
        FlatSize(1, 100.0, 2**20),
        FlatSize(300, 0.01, 2**20),
        FlatSize(300, 400.0, 2**20, 0.01),
        FlatSize(2, 1.0, 2**20, 0.1),
    ],
    ids=["space", "crossings", "slots", "all"],
)
def test_only_queries_without_room_are_searched_again(size, device):
    """Too little space for a section, for all queries' crossings, and for their pieces."""
    poses = generic_poses(120, 3)
    poses[::3, 2] += np.float32(1.0)  # away from the solid
    for name in ("comb", "sphere", "torn dog"):
        surface, patch = surface_on(MESHES[name](), device), patch_array([0.0425, 0.0425], device)
        for strategy in strategies_for(name):
            blocks, again = assert_found(surface, poses, patch, strategy, size)
            assert len(blocks) == 1
            searched = np.concatenate([pieces.section.numpy() for pieces in again])
            assert 0 < len(np.unique(searched)) <= (80 if strategy == "oc" else 119)  # patches elsewhere need no room


def test_patches_inside_a_solid_whose_winding_numbers_find_no_space(device):
    """Nothing crosses these patches, but the lines of their sides meet more boxes than there is space for."""
    surface, patch = surface_on(blob(12), device), patch_array([0.001, 0.001], device)
    (block,), again = assert_found(surface, generic_poses(100, 5), patch, "cc", FlatSize(1, 100.0, 2**20))
    inside = [section for pieces in again for section in pieces.section.numpy()[pieces.winding.numpy() > 0]]
    assert len(inside) > 10
    assert (block.winding.numpy()[inside] == 0).all()


def test_blocks_of_a_few_queries(device):
    surface, patch = surface_on(blob(12), device), patch_array([0.0425, 0.0425], device)
    for strategy in STRATEGIES:
        blocks, again = assert_found(surface, generic_poses(60, 3), patch, strategy, FlatSize(4000, 100.0, 700))
        assert len(blocks) > 1
        assert not again
        blocks, again = assert_found(surface, generic_poses(60, 3), patch, strategy, FlatSize(2, 1.0, 8, 0.01))
        assert len(blocks) > 1
        assert len(again) > len(blocks)


def test_a_section_with_too_many_crossings_is_searched_by_walking(device, monkeypatch):
    monkeypatch.setattr(flat_search, "CROSSINGS_MOST", 60)
    for mesh in (blob(16), comb()):
        surface, patch = surface_on(mesh, device), patch_array([0.0425, 0.0425], device)
        for strategy in STRATEGIES:
            _, again = assert_found(surface, random_poses(50), patch, strategy, FlatSize(2, 1.0, 2**20))
            assert again[-1].listed is None  # found by walking


def test_sections_drawn_in_several_turns_of_few_groups(device, monkeypatch):
    monkeypatch.setattr("palpate.kernels.section.draw.GROUPS_MOST", 7)
    surface, patch = surface_on(comb(), device), patch_array(HALF, device)
    assert_same(surface, generic_poses(60, 5), patch, "cc")


def test_slots_may_come_in_any_order(device, monkeypatch):
    """Lanes store a section's pieces in the order in which they come: nothing that is drawn depends on it."""
    surface, patch = surface_on(comb(), device), patch_array([0.0425, 0.0425], device)
    drawn, launch = [draw(surface, generic_poses(80, 8), patch, "cc", "flat")], FlatSearch.launch

    def launch_turned(search):
        pieces = launch(search)
        turn_slots(pieces)
        return pieces

    monkeypatch.setattr(FlatSearch, "launch", launch_turned)
    assert_same_bits(*drawn, draw(surface, generic_poses(80, 8), patch, "cc", "flat"))


def turn_slots(pieces):
    """Reverse the slots of each query."""
    count, start = pieces.count.numpy(), pieces.start.numpy()
    for field in ("half", "out", "key", "side", "steps", "begin"):
        array = getattr(pieces, field)
        values = array.numpy().copy()
        for query, stored in enumerate(count):
            slots = start[query] + np.arange(stored)
            values[slots] = values[slots[::-1]]
        array.assign(values)


def test_both_kernels_are_compiled_ahead_for_blocks_of_their_size(monkeypatch):
    compiled = {}
    monkeypatch.setattr(wp, "get_device", lambda device: SimpleNamespace(is_cpu=False))
    monkeypatch.setattr(
        wp, "force_load", lambda device, modules, *, block_dim, **_: compiled.update({block_dim: modules})
    )
    compile_kernels("cuda", ("section.flat_ranks",))
    few, many = flat_ranks._rank_few_crossings, flat_ranks._rank_many_crossings
    assert compiled == {BLOCK: [few.module], flat_ranks.MANY_LANES: [many.module]}
    assert BLOCK < flat_ranks.MANY_LANES
    assert few.module.options == many.module.options
