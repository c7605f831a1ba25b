"""Contours by either method of search: the same bits, and those of the float64 oracle."""

import numpy as np
import pytest
import warp as wp
from degenerate_cases import degenerate_poses
from drawing import SEARCHES, STRATEGIES, assert_same_bits, draw, patch_array, steps_of, surface_on
from mesh_cases import CLOSED, MESHES, MIDDLE, comb, egg_box, generic_poses, moved, soup, unwelded_cubes
from scipy.spatial.transform import Rotation
from section_oracle import cut_mesh, is_degenerate, rotation, soup_length
from stage_cases import assert_limited

from palpate.kernels.section import search
from palpate.kernels.section.half_edges import MASK_WORDS, SCAN_FACES_MOST
from palpate.kernels.section.pieces import SLOTS
from palpate.kernels.section.search import search_for

HALF, SQUARE = np.array([0.0425, 0.03]), [0.0425, 0.0425]
SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]
TOLERANCE = 1e-5  # [m]
FOUR_AROUND_AN_EDGE = "cubes sharing an edge"
WATERTIGHT = [*CLOSED, FOUR_AROUND_AN_EDGE]
every_method = pytest.mark.parametrize("method", SEARCHES)


def poses_for(mesh, count, seed):
    """Generic ones, and planes exactly through vertices."""
    poses = generic_poses(count, seed)
    through = poses[: count // 3]
    through[:, :3] = mesh[0][np.random.default_rng(seed).integers(0, len(mesh[0]), len(through))]
    return poses


def drawn_in_all_ways(surface, poses, patch, strategy, monkeypatch):
    """By every method of search, and traced with listed steps, as on GPUs."""
    yield from (draw(surface, poses, patch, strategy, method) for method in (*SEARCHES, "flat"))
    with monkeypatch.context() as there:
        there.setattr(search, "lists_steps", lambda device: True)
        yield draw(surface, poses, patch, strategy, "scan")


@pytest.mark.exhaustive(but="few")
@pytest.mark.parametrize("times", [1, 5], ids=["few", "many"])
@pytest.mark.parametrize("name", MESHES)
def test_all_methods_give_the_same_bits(name, times, device, monkeypatch):
    """Through vertices, at degenerate poses, with several patches, and with patches that have poses of their own."""
    mesh = MESHES[name]()
    surface, half, several = surface_on(mesh, device), patch_array(HALF, device), patch_array(SEVERAL, device)
    own = np.stack([generic_poses(8 * times, seed) for seed in range(len(SEVERAL))], axis=1)
    degenerate = np.array(list(degenerate_poses(mesh, times, seed=4).values()))
    poses = poses_for(mesh, 36 * times, seed=1)
    cases = [(poses, half), (degenerate, patch_array(SQUARE, device)), (poses[: 10 * times], several), (own, several)]
    for strategy in STRATEGIES if name in WATERTIGHT else ("raw", "oc"):  # closed contours need a closed mesh
        for k, (rows, patch) in enumerate(cases):
            first, *others = drawn_in_all_ways(surface, rows, patch, strategy, monkeypatch)
            for other in others:
                assert_same_bits(first, other)
            last = first.polyline_start[1:] - 1  # no segment starts there, so it has the kind of the point before
            np.testing.assert_array_equal(first.kind[last], first.kind[last - 1])
            assert k or len(first.polyline_closed) > 5 * times


@pytest.mark.exhaustive(but="cube")
@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_agree_with_the_oracle(name, device):
    mesh = CLOSED[name]()
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    poses = generic_poses(25, 2)
    raw, oc, cc = (draw(surface, poses, patch, strategy, "scan") for strategy in STRATEGIES)
    compared = 0
    for i, pose in enumerate(poses):
        if is_degenerate(*mesh, pose, HALF):
            continue
        compared += 1
        cut = cut_mesh(*mesh, pose, HALF)
        assert oc.length[i].sum() == pytest.approx(cut.oc_length, abs=TOLERANCE)
        assert cc.length[i].sum() == pytest.approx(cut.cc_length, abs=TOLERANCE)
        assert cc.length[i, 0] == pytest.approx(oc.length[i, 0], abs=1e-7)
        assert (len(oc.closed_of(i)), sum(oc.closed_of(i))) == (cut.oc_lines, cut.oc_loops)
        assert cc.closed_of(i) == [True] * cut.cc_loops
        assert raw.length[i].sum() == pytest.approx(cut_mesh(*mesh, pose, (9.0, 9.0)).oc_length, abs=2 * TOLERANCE)
        assert all(raw.closed_of(i))
    assert compared >= 20


@pytest.mark.exhaustive(but="fan")
@pytest.mark.parametrize("name", sorted(set(MESHES) - set(CLOSED)))
def test_open_and_odd_meshes_give_every_triangles_part(name, device):
    mesh = MESHES[name]()
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    poses = generic_poses(60, 3)
    raw, oc = (draw(surface, poses, patch, strategy, "scan") for strategy in ("raw", "oc"))
    for i, pose in enumerate(poses):
        assert oc.length[i].sum() == pytest.approx(soup_length(*mesh, pose, HALF), abs=2 * TOLERANCE)
        assert raw.length[i].sum() == pytest.approx(soup_length(*mesh, pose, (9.0, 9.0)), abs=2 * TOLERANCE)
    assert (oc.length[:, 1:] == 0).all()
    assert not raw.polyline_closed.all() or name == FOUR_AROUND_AN_EDGE
    assert (oc.length.sum(axis=1) > 0).sum() > 10


@every_method
def test_bodies_that_share_an_edge_are_closed_like_bodies_that_do_not(method, device):
    mesh, apart = MESHES[FOUR_AROUND_AN_EDGE](), unwelded_cubes()
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    poses = generic_poses(60, 4)
    cc = draw(surface, poses, patch, "cc", method)
    assert cc.polyline_closed.all()
    for i, pose in enumerate(poses):
        assert cc.length[i].sum() == pytest.approx(cut_mesh(*apart, pose, HALF).cc_length, abs=TOLERANCE)


@every_method
def test_contours_keep_the_object_on_their_left(method, device):
    """A section's signed area, seen from +n, is that of the solid: cavities count against it."""
    mesh = MESHES["shell"]()
    poses = generic_poses(30, 5, spread=0.02)
    cc = draw(surface_on(mesh, device), poses, patch_array((0.5, 0.5), device), "cc", method)
    cavities = 0
    for i, pose in enumerate(poses):
        axes = rotation(pose[3:])
        flat = [(line - pose[:3]) @ np.stack([axes[:, 0], -axes[:, 2]]).T for line in cc.lines_of(i)]
        areas = [0.5 * np.sum(p[:-1, 0] * p[1:, 1] - p[1:, 0] * p[:-1, 1]) for p in flat]
        outer = np.argmax(np.abs(areas))
        assert areas[outer] > 0
        if len(areas) == 3:  # rock, cavity, cube
            assert sum(np.sign(areas)) == 1
            cavities += 1
    assert cavities > 5


def wide_hand(device, count=3):
    """Patches of different sizes, places and directions in one hand, and their poses relative to it."""
    turns = Rotation.from_euler("yxz", [[0, 0, 0], [40, 25, -70], [180, -60, 10]], degrees=True)[:count]
    halves, origins = (
        np.array([HALF, [0.02, 0.05], [0.03, 0.01]])[:count],
        np.array([[0, 0, 0], [0.03, 0.01, -0.05], [-0.02, 0, 0.03]]),
    )
    columns = turns.as_matrix()
    axes = np.stack([columns[:, :, 0], -columns[:, :, 2]], axis=1)
    return patch_array(halves, device, axes, origins[:count]), halves, turns, origins[:count]


@pytest.mark.exhaustive(after=1)
@every_method
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_patches_of_a_hand_are_sections_of_their_own(strategy, method, device):
    mesh = MESHES["dog"]()
    surface = surface_on(mesh, device)
    patch, halves, turns, origins = wide_hand(device)
    poses = generic_poses(40, 6)
    drawn = draw(surface, poses, patch, strategy, method)
    assert len(drawn.section_start) == 3 * len(poses) + 1
    section = np.repeat(np.arange(3 * len(poses)), np.diff(drawn.section_start))
    np.testing.assert_array_equal(drawn.polyline_patch, section % 3)
    for k in range(3):
        alone = draw(surface, poses, patch[k : k + 1], strategy, method)
        for i in range(len(poses)):
            one, two = drawn.part(3 * i + k, 3 * i + k + 1), alone.part(i, i + 1)
            assert one.points.tobytes() == two.points.tobytes()
            assert one.kind.tobytes() == two.kind.tobytes()
    for i, pose in enumerate(poses if strategy != "raw" else []):
        hand = Rotation.from_quat(pose[3:].astype(float))
        for k in range(3):
            own = np.hstack([pose[:3] + hand.apply(origins[k]), (hand * turns[k]).as_quat()])
            cut = cut_mesh(*mesh, own, halves[k])
            expected = cut.oc_length if strategy == "oc" else cut.cc_length
            assert drawn.length[3 * i + k].sum() == pytest.approx(expected, abs=TOLERANCE)


def crowded_poses(count):
    """Palms that lie nearly level in the bumps or ridges, and as many that cut next to nothing."""
    rng = np.random.default_rng(8)
    level = Rotation.from_euler("x", -90, degrees=True)  # the hand's y, out of the back of the hand, is the array's z
    lean = Rotation.from_euler("xyz", rng.uniform(-3, 3, (count, 3)) * [1, 1, 60], degrees=True)
    crowded = np.hstack([MIDDLE + rng.uniform(-0.004, 0.004, (count, 3)), (lean * level).as_quat()])
    poses = np.empty((2 * count, 7), np.float32)
    poses[::2], poses[1::2] = crowded, generic_poses(count, 9, spread=0.09)
    return poses


@pytest.mark.exhaustive
@every_method
@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("make", [comb, egg_box])
def test_sections_of_more_pieces_than_slots_lose_none(make, strategy, method, device):
    """Between poses that fit: the result is that of each pose alone, and the oracle's."""
    mesh = make()
    surface, patch, poses = surface_on(mesh, device), patch_array(HALF, device), crowded_poses(10)
    drawn = draw(surface, poses, patch, strategy, method)
    lines = np.diff(drawn.section_start)
    assert lines.max() > (2 * SLOTS if strategy != "cc" else SLOTS)
    assert lines.min() <= SLOTS
    for i, pose in enumerate(poses):
        assert_same_bits(drawn.part(i, i + 1), draw(surface, pose, patch, strategy, method))
        if strategy == "raw" or is_degenerate(*mesh, pose, HALF):
            continue
        cut = cut_mesh(*mesh, pose, HALF)
        expected, count = (cut.oc_length, cut.oc_lines) if strategy == "oc" else (cut.cc_length, cut.cc_loops)
        assert drawn.length[i].sum() == pytest.approx(expected, abs=10 * TOLERANCE)
        assert len(drawn.closed_of(i)) == count


@every_method
def test_more_points_than_the_limit_are_refused_and_as_many_are_not(method, device):
    surface, patch, poses = surface_on(MESHES["tube"](), device), patch_array(HALF, device), generic_poses(50, 10)
    assert_limited(lambda limit: len(draw(surface, poses, patch, "cc", method, limit=limit).points))


@every_method
def test_contours_of_tiny_triangles_are_chained_by_edge_not_by_place(method, device):
    """A sphere of 20 um at 0.2 m: float32 merges its points, and still every section is one closed loop."""
    mesh = moved(MESHES["sphere"](), (0.07, 0.03, 0), scale=1.5e-4)
    poses = generic_poses(60, 4)
    poses[:, :3] = mesh[0].mean(axis=0)
    raw = draw(surface_on(mesh, device), poses, patch_array(HALF, device), "raw", method)
    assert (np.diff(raw.section_start) == 1).all()
    assert raw.polyline_closed.all()
    assert all((steps_of(raw.lines_of(i)[0]) > 0).all() for i in range(60))


@every_method
def test_a_palm_inside_the_solid_is_its_outline_and_one_outside_is_nothing(method, device):
    surface, patch = surface_on(MESHES["cube"](), device), patch_array((0.02, 0.03), device)
    inside, outside = generic_poses(40, 11, spread=0.01), generic_poses(40, 11, spread=0.01)
    outside[:, 2] += 0.2
    cc = draw(surface, np.concatenate([inside, outside]), patch, "cc", method)
    assert cc.length[:40, 1] == pytest.approx(np.full(40, 0.2), abs=1e-7)
    assert (cc.length[:, 0] == 0).all()
    assert (np.diff(cc.section_start) == [1] * 40 + [0] * 40).all()


def test_surfaces_without_a_trail_are_sought_and_never_traced(device):
    """Nothing that a walk cannot tell apart is traced: too many scanned edges, or too many triangles."""
    patch, poses, most = patch_array(HALF, device), generic_poses(20, 12), 32 * MASK_WORDS // 3  # three edges each
    for count in (most + 1, SCAN_FACES_MOST + 1):
        surface = surface_on(soup(count), device)
        assert_same_bits(draw(surface, poses, patch, "oc", None), draw(surface, poses, patch, "oc", "tree"))
    surface = surface_on(soup(most), device)
    traced, sought = (draw(surface, poses, patch, "raw", method) for method in SEARCHES)
    assert_same_bits(traced, sought)
    assert len(traced.polyline_closed) > most


def test_the_search_is_the_faster_one(device):
    surface, large = surface_on(MESHES["cube"](), device), surface_on(soup(SCAN_FACES_MOST + 1), device)
    assert search_for(surface, wp.get_device(device)) == "scan"
    assert search_for(large, wp.get_device(device)) == ("tree" if wp.get_device(device).is_cpu else "flat")
