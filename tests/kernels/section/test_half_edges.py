"""Half-edges on the host: twins, order, what a search must look at, boxes."""

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_cases import BODIES, CLOSED, GENUS, MESHES, generic_poses, soup
from section_oracle import in_palm, section_steps, walk

from palpate.kernels.section import half_edges as surface_module
from palpate.kernels.section.half_edges import LEAF, OPEN, HalfEdges, boxes_of, spatial_order, twins_of, upload_surface

every_mesh = pytest.mark.parametrize("name", MESHES)
triangles = st.lists(st.permutations(range(6)).map(lambda p: p[:3]), min_size=1, max_size=14)


def directed_edges(faces):
    """Start and end vertex of each half-edge."""
    return [(a, b) for face in np.asarray(faces).tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)]


@given(faces=triangles)
def test_twins_are_paired_in_the_order_of_the_faces(faces):
    edges, twin = directed_edges(faces), twins_of(np.array(faces))
    by_direction = defaultdict(list)
    for half, edge in enumerate(edges):
        by_direction[edge].append(half)
    for half, (a, b) in enumerate(edges):
        rank, others = by_direction[a, b].index(half), by_direction[b, a]
        assert twin[half] == (others[rank] if rank < len(others) else OPEN)


@every_mesh
def test_spatial_order_keeps_faces_edges_and_bounds(name):
    vertices, faces = MESHES[name]()
    edges = HalfEdges(vertices, faces)
    assert sorted(spatial_order(vertices, faces)) == list(range(len(faces)))
    assert sorted(map(tuple, edges.faces)) == sorted(map(tuple, faces))
    assert (edges.open_count == 0) == (name in CLOSED or name == "cubes sharing an edge")
    reach = upload_surface(edges, "cpu").reach
    assert np.abs(edges.vertices.astype(np.float64)).sum(axis=1).max() <= reach * (1 + 1e-6)


def test_spatial_order_keeps_neighbours_together():
    vertices, faces = MESHES["sphere"]()
    shuffled = np.random.default_rng(2).permutation(faces)
    middle = vertices[HalfEdges(vertices, shuffled).faces].mean(axis=1)
    before = vertices[shuffled].mean(axis=1)
    assert (
        np.linalg.norm(np.diff(middle, axis=0), axis=1).mean()
        < 0.25 * np.linalg.norm(np.diff(before, axis=0), axis=1).mean()
    )


def test_spatial_order_takes_faces_that_all_lie_in_one_place():
    assert spatial_order(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]] * 5)).tolist() == [0, 1, 2, 3, 4]


def edge_of(edges, half):
    """One number for both half-edges of an edge."""
    twin = edges.twin[half]
    return np.where(twin == OPEN, half, np.minimum(half, twin))


@pytest.fixture(params=["off paths", "by order"])
def forest(request, monkeypatch):
    """Both ways to choose what is scanned: that of small meshes and that of meshes too large for a trail."""
    if request.param == "by order":
        monkeypatch.setattr(surface_module, "SCAN_FACES_MOST", 0)
    return request.param


@pytest.mark.exhaustive(after=1)
@every_mesh
def test_every_contour_crosses_a_scanned_edge(name, forest):
    """Loops and chains of random planes, and of planes through vertices."""
    edges = HalfEdges(*MESHES[name]())
    poses = generic_poses(60, 3)
    poses[40:, :3] = edges.vertices[np.arange(20) % len(edges.vertices)]
    contours = 0
    for pose in poses:
        height = in_palm(edges.vertices, pose)[:, 2]
        for chain, _ in walk(section_steps(edges, height)):
            assert edges.scanned[np.array(chain)].any()
            contours += 1
    assert contours > 20


@pytest.mark.parametrize("name", CLOSED)
def test_scanned_edges_are_as_few_as_the_genus_allows_and_the_path_is_little_longer(name):
    edges = HalfEdges(*MESHES[name]())
    vertices, bodies = len(np.unique(edges.faces)), BODIES.get(name, 1)
    assert edges.scanned.sum() == 2 * (vertices - bodies + 2 * GENUS.get(name, 0))
    assert len(edges.scan_path[0]) < 1.15 * np.count_nonzero(edges.scanned) / 2 + 2


@every_mesh
def test_both_sides_of_an_edge_agree_and_ranks_tell_scanned_edges_apart(name, forest):
    edges = HalfEdges(*MESHES[name]())
    paired = np.flatnonzero(edges.twin != OPEN)
    assert (edges.scanned[paired] == edges.scanned[edges.twin[paired]]).all()
    assert (edges.rank[paired] == edges.rank[edges.twin[paired]])[edges.scanned[paired]].all()
    assert edges.scanned[edges.twin == OPEN].all()
    assert (edges.link[edges.twin == OPEN] == OPEN).all()
    assert (edges.link[paired] >> 1 == edges.twin[paired]).all()
    assert ((edges.link[paired] & 1) == edges.scanned[paired]).all()
    half = np.flatnonzero(edges.scanned)
    one_each = half[edge_of(edges, half) == half]
    assert len(np.unique(edges.rank[one_each])) == len(one_each)
    if forest == "off paths":
        assert sorted(edges.rank[one_each]) == list(range(len(one_each)))


@every_mesh
def test_the_scan_path_covers_each_scanned_edge_once_and_knows_its_half_edge_each_way(name, device):
    edges = HalfEdges(*MESHES[name]())
    vertices, halves = edges.scan_path
    walked = np.flatnonzero(halves != OPEN)
    covered = edge_of(edges, halves[walked])
    assert len(np.unique(covered)) == len(covered)
    assert set(covered) == set(edge_of(edges, np.flatnonzero(edges.scanned)))
    steps = np.sort(np.stack([vertices[:-1], vertices[1:]], axis=1), axis=1)
    np.testing.assert_array_equal(steps[walked], np.sort(edges.ends[halves[walked]], axis=1))
    assert (edges.rank[halves[walked]] == np.arange(len(walked))).all()
    uploaded = upload_surface(edges, device)
    np.testing.assert_array_equal(uploaded.scan_path.numpy()[:, :3], edges.vertices[vertices])
    for step, (along, back) in enumerate(uploaded.scan_path_half.numpy()):
        if step == 0 or halves[step - 1] == OPEN:
            assert (along, back) == (OPEN, OPEN)
            continue
        one, two = vertices[step - 1], vertices[step]
        assert {along, back} == {halves[step - 1], edges.twin[halves[step - 1]]}
        assert along == OPEN or tuple(edges.ends[along]) == (one, two)
        assert back == OPEN or tuple(edges.ends[back]) == (two, one)


def test_no_trail_is_made_of_a_mesh_that_is_too_large_for_one(device):
    edges = HalfEdges(*soup(surface_module.SCAN_FACES_MOST + 1))
    uploaded = upload_surface(edges, device)
    assert uploaded.scan_path.shape[0] == 0
    assert uploaded.rank.shape[0] == 3 * len(edges.faces)


@pytest.mark.parametrize("count", [1, 2, LEAF, LEAF + 1, 60, 133])
def test_boxes_hold_their_faces_and_their_children(count):
    edges = HalfEdges(*soup(count))
    centre, half = boxes_of(edges)
    first = edges.boxes.leaf_first
    low, high = centre.astype(np.float64) - half, centre.astype(np.float64) + half
    assert len(centre) == 2 * first >= 2 * count / LEAF
    corners = edges.vertices[edges.faces].astype(np.float64)
    for face in range(count):
        node = first + face // LEAF
        while node:
            assert (low[node] <= corners[face]).all()
            assert (corners[face] <= high[node]).all()
            node //= 2
    used = -(-count // LEAF)
    assert (half[first + used :] < 0).all()  # an empty leaf is never met
    assert (half[first : first + used] >= 0).all()
