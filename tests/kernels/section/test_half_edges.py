"""Half-edges against oracles: pairing across shared edges, scanned edges, paths, boxes."""

from collections import Counter, defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_cases import BODIES, CLOSED, GENUS, MESHES, generic_poses, soup
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
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


# Directions across an edge, by growing angle: integers, so that equal directions are equal whatever the radius
ROUND = np.array(
    [[2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [-1, 1], [-2, 0], [-2, -1], [-1, -1], [0, -2], [1, -1], [2, -1]]
)
UP, DOWN = True, False


def fan(places, upward, rng):
    """Triangles around the edge from vertex 0 to vertex 1: at which of ROUND, and whether each runs up the edge."""
    radius = rng.choice([0.5, 1.0, 3.0], len(places))
    third = np.column_stack([radius[:, None] * ROUND[places], rng.uniform(-1, 2, len(places))])
    vertices = np.concatenate([[[0, 0, 0], [0, 0, 1]], third]).astype(float)
    tip = np.arange(len(places)) + 2
    return vertices, np.where(
        upward[:, None], np.stack([0 * tip, 0 * tip + 1, tip], 1), np.stack([0 * tip + 1, 0 * tip, tip], 1)
    )


def pairs_by_place(faces, twin, named):
    """How often triangles at two places are paired; named: a place of each face. Only one half-edge of each may be."""
    assert (twin[twin != OPEN] // 3 != np.flatnonzero(twin != OPEN) // 3).all()
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    out = Counter()
    for half in np.flatnonzero(twin != OPEN):
        other = twin[half]
        assert twin[other] == half
        assert (tail[half], head[half]) == (head[other], tail[other])
        if half < other:
            out[tuple(sorted((named[half // 3], named[other // 3])))] += 1
    return out


def matched_brackets(places, upward):
    """The same by brackets: going round, a triangle that runs down opens, one that runs up closes; next to next."""
    left = sorted(zip(places.tolist(), upward.tolist(), strict=True))  # False, down, comes before True
    out = Counter()
    while True:
        for k in range(len(left)):
            one, two = left[k], left[(k + 1) % len(left)]
            if one[1] == DOWN and two[1] == UP:
                out[tuple(sorted((one, two)))] += 1
                left = [item for i, item in enumerate(left) if i not in (k, (k + 1) % len(left))]
                break
        else:
            return out


def random_fans(count=150):
    rng = np.random.default_rng(12)
    for _ in range(count):
        size = int(rng.integers(3, 11))
        places = rng.integers(0, len(ROUND), size)
        yield places, rng.random(size) < rng.choice([0.3, 0.5, 0.7]), rng


def turned(vertices, rng):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return vertices @ (rotation * np.linalg.det(rotation)).T


@pytest.mark.parametrize("jitter", [0.0, 1e-7])
def test_pairs_are_matched_brackets_whatever_changes_no_angle(jitter):
    """Fans are turned, moved and rounded; faces, their corners and vertices come in any order."""
    total = 0
    for places, upward, rng in random_fans():
        vertices, faces = fan(places, upward, rng)
        named = list(zip(places.tolist(), upward.tolist(), strict=True))
        want = matched_brackets(places, upward)
        total += sum(want.values())
        vertices = turned(vertices, rng) + rng.normal(size=3) + rng.uniform(-jitter, jitter, vertices.shape)
        if rng.random() < 0.5:
            vertices = vertices.astype(np.float32).astype(float)
        order = rng.permutation(len(vertices))
        vertices, faces = vertices[order], np.argsort(order)[faces]
        faces = np.take_along_axis(faces, (rng.integers(0, 3, len(faces))[:, None] + np.arange(3)) % 3, axis=1)
        if rng.random() < 0.5:  # seen in a mirror, what ran up still does
            vertices, faces = vertices * [-1, 1, 1], faces[:, ::-1]
        row = rng.permutation(len(faces))
        assert pairs_by_place(faces[row], twins_of(faces[row], vertices, 2e-6), [named[k] for k in row]) == want
    assert total > 200


def prism(corners, height=1.0):
    """A closed prism over corners counter-clockwise, from z = 0 up."""
    count = len(corners)
    k = np.arange(count)
    after = (k + 1) % count
    sides = np.concatenate([np.stack([k, after, after + count], 1), np.stack([k, after + count, k + count], 1)])
    k = np.arange(1, count - 1)
    ends = np.concatenate([np.stack([0 * k, k + 1, k], 1), np.stack([0 * k, k, k + 1], 1) + count])
    flat = np.column_stack([corners, np.zeros(count)])
    return np.concatenate([flat, flat + np.array([0, 0, height])]), np.concatenate([sides, ends])


def test_bodies_with_a_common_edge_stay_apart_however_they_cross():
    """Wedges of random angles around one upright edge, some inside out: every pair stays within its wedge."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        vertices, faces, owner = [np.array([[0, 0, 0], [0, 0, 1.0]])], [], []
        for body in range(int(rng.integers(2, 7))):
            start, width = rng.integers(0, 12), rng.integers(1, 6)
            corners = np.array([[0, 0], ROUND[start], ROUND[(start + width) % 12] * rng.choice([1, 2])]) * rng.uniform(
                0.5, 2
            )
            own, own_faces = prism(corners)
            number = np.array([0, 2, 3, 1, 4, 5])  # corners 0 and 3 are the common edge's ends
            number[number > 1] += 4 * body
            own_faces = number[own_faces][rng.permutation(len(own_faces))]
            faces.append(own_faces[:, ::-1] if rng.random() < 0.5 else own_faces)
            vertices.append(own[[1, 2, 4, 5]])
            owner += [body] * len(own_faces)
        vertices, faces = turned(np.concatenate(vertices), rng), np.concatenate(faces)
        row = rng.permutation(len(faces))
        twin = twins_of(faces[row], vertices, 1e-9)
        body = np.array(owner)[row]
        assert (twin != OPEN).all()
        assert (body[twin // 3] == np.repeat(body, 3)).all()


def test_bodies_in_one_place_stay_apart():
    """Each edge has four triangles or more, two and two of which coincide; every body has each wall once."""
    rng = np.random.default_rng(6)
    vertices, faces = prism(ROUND[::2])
    for count in (2, 3):
        own = np.tile(faces, (count, 1))[rng.permutation(count * len(faces))]
        twin = twins_of(own, vertices, 1e-9)
        assert (twin != OPEN).all()
        joined = coo_matrix((np.ones(len(twin)), (np.arange(len(twin)) // 3, twin // 3)), shape=(len(own), len(own)))
        bodies, body = connected_components(joined)
        assert bodies == count
        for k in range(count):
            assert sorted(map(tuple, own[body == k])) == sorted(map(tuple, faces))


def test_edges_of_two_need_no_angles():
    vertices, faces = prism(np.array([[0, 0], [1, 0], [0, 1.0]]))
    assert (twins_of(faces) == twins_of(faces, vertices, 1e-9)).all()
    assert (twins_of(faces) != OPEN).all()
    assert (twins_of(faces[1:]) == OPEN).sum() == 3
    assert len(twins_of(np.zeros((0, 3), int))) == 0


def test_triangles_that_run_the_same_way_are_never_paired():
    same = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    vertices = np.random.default_rng(1).normal(size=(5, 3))
    assert (twins_of(same, vertices, 1e-9) == OPEN).all()
    assert (twins_of(same[:2]) == OPEN).all()
