"""Scans and walks in float32: the bits of float64, and float64 seldom needed."""

import numpy as np
import pytest
import warp as wp
from degenerate_cases import HALF, pose_of
from drawing import STRATEGIES, assert_same_bits, draw, exact_poses, patch_array, pose_array, surface_on
from mesh_cases import CLOSED, MESHES
from scipy.spatial.transform import Rotation

from palpate.kernels.section import half_edges, scan
from palpate.kernels.section.float32_walk import room_for_scans
from palpate.kernels.section.half_edges import OPEN
from palpate.kernels.section.scan import _scan_sections

SOLIDS = ("cube", "tube", "dog", "comb", "bodies")


def unit(x):
    return x / np.linalg.norm(x)


def poses_along_edges(mesh, count, seed):
    """Planes that an edge crosses at a small angle: its ends lie 1e-7 to 1e-3 m above and below, so that where it
    crosses is uncertain by up to the edge's length. A side of the palm passes there."""
    rng = np.random.default_rng(seed)
    vertices, faces = mesh[0].astype(float), mesh[1]
    poses = []
    for _ in range(count):
        a, b = vertices[faces[rng.integers(len(faces))][rng.permutation(3)[:2]]]
        along = unit(b - a)
        low, high = 10.0 ** rng.uniform(-7, -3, 2)
        across = unit(np.cross(along, rng.normal(size=3)))
        n = across + (low + high) / np.linalg.norm(b - a) * along
        at = a + low / (low + high) * (b - a)
        poses.append(palm_with_side(at, rng.normal(size=3), n, rng, nearest=-7))
    return np.array(poses)


def poses_near_vertices(mesh, count, seed):
    """Planes that pass a vertex at 1e-9 to 1e-5 m, which a side of the palm passes, too."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        n = unit(rng.normal(size=3))
        at = mesh[0][rng.integers(len(mesh[0]))] + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, -5) * n
        poses.append(palm_with_side(at, rng.normal(size=3), n, rng, nearest=-9))
    return np.array(poses)


def poses_near_corners(mesh, count, seed):
    """Planes that cut a triangle along a line which a corner of the palm passes at 1e-9 to 1e-4 m."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        a, b, c = mesh[0][mesh[1][rng.integers(len(mesh[1]))]].astype(float)
        at = rng.dirichlet(np.ones(3)) @ [a, b, c]
        n = unit(rng.normal(size=3))
        across = unit(np.cross(n, np.cross(n, np.cross(b - a, c - a))))
        pose = pose_of(at, rng.normal(size=3), n)
        local = np.array([rng.choice([-1, 1]) * HALF[0], 0.0, rng.choice([-1, 1]) * HALF[1]])
        corner = at + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, -4) * across
        moved = corner - Rotation.from_quat(pose[3:].astype(float)).apply(local)
        poses.append(np.hstack([moved, pose[3:]]).astype(np.float32))
    return np.array(poses)


def palm_with_side(at, u, n, rng, nearest):
    """A palm's pose with a side that passes a point at 10^nearest to 1e-3 m."""
    pose = pose_of(at, u, n)
    apart = rng.choice([-1, 1]) * 10.0 ** rng.uniform(nearest, -3)
    local = np.array([rng.choice([-1, 1]) * (HALF[0] + apart), 0.0, rng.uniform(-0.9, 0.9) * HALF[1]])
    moved = at - Rotation.from_quat(pose[3:].astype(float)).apply(local)
    return np.hstack([moved, pose[3:]]).astype(np.float32)


@pytest.mark.exhaustive(but="300-cube")
@pytest.mark.parametrize("count", [300, 2000])
@pytest.mark.parametrize("poses_of", [poses_along_edges, poses_near_vertices, poses_near_corners])
@pytest.mark.parametrize("name", SOLIDS)
def test_what_float32_decides_is_what_float64_decides(name, poses_of, count, device):
    mesh = MESHES[name]()
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    poses = poses_of(mesh, count, 7)
    for strategy in STRATEGIES:
        traced, sought = (draw(surface, poses, patch, strategy, method) for method in ("scan", "tree"))
        assert_same_bits(traced, sought)
        assert len(traced.points) > count


def test_few_queries_are_walked_in_float64(device, monkeypatch):
    """At any poses float32 nearly always suffices, so that a GPU's lanes walk alike."""
    own, kept = scan.room_for_scans, []

    def room_for_scans(surface, query_count, counters, device):
        kept.append(counters)
        return own(surface, query_count, counters, device)

    monkeypatch.setattr(scan, "room_for_scans", room_for_scans)
    for name in SOLIDS:
        draw(surface_on(MESHES[name](), device), exact_poses(200, 3), patch_array(HALF, device), "cc", "scan")
        assert kept[-1].numpy()[2] < 20, name


def scans_of(surface, poses, device):
    """Words, listed queries with their numbers of crossings, and doubtful queries, of palms."""
    queries, counters = len(poses), wp.zeros(3, dtype=wp.int32, device=device)
    scans = room_for_scans(surface, queries, counters, wp.get_device(device))
    events, doubtful = (wp.full(queries, -1, dtype=wp.int32, device=device) for _ in range(2))
    inputs = [
        surface,
        pose_array(poses, device),
        patch_array(HALF, device),
        1,
        wp.empty(0, dtype=wp.int32, device=device),
    ]
    wp.launch(_scan_sections, queries, inputs=inputs, outputs=[scans, events, doubtful, counters[2:]], device=device)
    words = scans.word.numpy()[np.arange(queries)[:, None] * scans.stride + np.arange(surface.scan_words) * scans.step]
    listed, count = scans.listed.numpy(), counters.numpy()
    return words, dict(listed[: count[0]].tolist()), set(doubtful.numpy()[: count[2]].tolist()), events.numpy()


def crossed_bits(edges, group, pose):
    """Bits of the steps of the scan path that cross a palm's plane, and how many such steps there are."""
    vertices, halves = edges.scan_path
    normal = Rotation.from_quat(pose[3:].astype(float)).apply([0.0, 1.0, 0.0])
    above = (edges.vertices[vertices].astype(float) - pose[:3]) @ normal > 0
    step = np.flatnonzero((above[1:] != above[:-1]) & (halves != OPEN))
    return set((step // group).tolist()), len(step)


@pytest.mark.parametrize("words", [1, half_edges.SCAN_WORDS])
@pytest.mark.parametrize("name", CLOSED)
def test_a_scan_notes_the_steps_that_cross_the_plane(name, words, device, monkeypatch):
    monkeypatch.setattr(half_edges, "SCAN_WORDS", words)
    edges, poses = half_edges.HalfEdges(*MESHES[name]()), exact_poses(70, 3)
    surface = half_edges.upload_surface(edges, device)
    assert surface.scan_words <= words
    noted, listed, doubtful, events = scans_of(surface, poses, device)
    for query in set(range(len(poses))) - doubtful:
        bits, count = crossed_bits(edges, surface.scan_group, poses[query])
        assert {k for k in range(32 * surface.scan_words) if noted[query, k // 32] >> (k % 32) & 1} == bits
        assert listed.get(query, 0) == count
        assert count > 0 or events[query] == 0
    assert len(doubtful) < len(poses) // 4


@pytest.mark.parametrize("name", CLOSED)
def test_queries_whose_crossings_share_bits_keep_their_contours(name, device, monkeypatch):
    monkeypatch.setattr(half_edges, "SCAN_WORDS", 1)
    surface, poses, patch = surface_on(MESHES[name](), device), exact_poses(200, 4), patch_array(HALF, device)
    for strategy in STRATEGIES:
        traced, sought = (draw(surface, poses, patch, strategy, method) for method in ("scan", "tree"))
        assert_same_bits(traced, sought)
