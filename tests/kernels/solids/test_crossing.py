"""Crossings of triangles against their exact intersection, worked out in fractions (triangle_oracle)."""

import numpy as np
import pytest
from mesh_cases import CLOSED
from triangle_oracle import triangles_cross

from palpate.kernels.solids import crossing as crossing_module
from palpate.kernels.solids.crossing import find_crossings

APART = 64.0  # between the middles of two pairs: a power of 2, so that grids stay grids


def crossings(vertices, faces, **options):
    """All pairs at once, the lower face first, as a set; how many there are twice, and the last count of faces done."""
    done, pairs = zip(*find_crossings(np.asarray(vertices, float), np.asarray(faces), **options), strict=True)
    pairs = np.concatenate(pairs)
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert done[-1] == len(faces)
    assert (np.diff(done) > 0).all()
    return {tuple(row) for row in pairs.tolist()}


def as_mesh(triangles):
    """Vertices and faces of triangles, shape [triangle, 3, 3], with one vertex at each place."""
    vertices, number = np.unique(triangles.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    return vertices, number.reshape(-1, 3)


def grid_pairs(rng, count, span, common):
    """Pairs of triangles with integer corners from 0 to `span`, `common` of them equal, shape [pair, 2, 3, 3]."""
    pairs = rng.integers(0, span + 1, (count, 2, 3, 3)).astype(float)
    for own in pairs:
        own[1, rng.permutation(3)[:common]] = own[0, rng.permutation(3)[:common]]
    return pairs


@pytest.mark.exhaustive
@pytest.mark.parametrize("common", [0, 1, 2, 3])
@pytest.mark.parametrize("span", [1, 2, 3, 7])
def test_pairs_on_small_grids_cross_where_fractions_say_so(span, common, device):
    pairs = grid_pairs(np.random.default_rng([span, common]), 350, span, common)
    want = {(2 * k, 2 * k + 1) for k, (s, t) in enumerate(pairs.tolist()) if triangles_cross(s, t)}
    pairs[..., 0] += APART * np.arange(len(pairs))[:, None, None]
    assert crossings(*as_mesh(pairs.reshape(-1, 3, 3)), device=device) == want
    assert 0 < len(want) < len(pairs)


@pytest.mark.exhaustive
def test_pairs_of_one_plane_cross_where_fractions_say_so(device):
    """Flat soups, seen along each axis and along none: the sides of lines decide alone."""
    rng = np.random.default_rng(8)
    flat = grid_pairs(rng, 600, 3, 0)
    for own in flat[200:]:
        own[1, 0] = own[0, 0]  # a corner in common
    flat[..., 2] = 0
    frames = np.array(
        [np.eye(3), np.roll(np.eye(3), 1, axis=0), np.roll(np.eye(3), 2, axis=0), [[1, 2, 3], [3, 1, 5], [0] * 3]]
    )
    pairs = np.einsum("kabi,kij->kabj", flat, frames[rng.integers(0, 4, len(flat))])
    want = {(2 * k, 2 * k + 1) for k, (s, t) in enumerate(pairs.tolist()) if triangles_cross(s, t)}
    pairs[..., 0] += APART * np.arange(len(pairs))[:, None, None]
    assert crossings(*as_mesh(pairs.reshape(-1, 3, 3)), device=device) == want
    assert 100 < len(want) < 500


@pytest.mark.exhaustive
def test_pairs_moved_by_a_step_of_float64_off_each_other(device):
    """A corner of one triangle within rounding of the other's plane, side or corner."""
    rng = np.random.default_rng(5)
    s = rng.normal(size=(300, 3, 3)) + 10.0
    weight = rng.dirichlet(np.ones(3), 300)
    weight[::3, 0] = 0.0
    weight[::3] /= weight[::3].sum(axis=1, keepdims=True)
    t = rng.normal(size=(300, 3, 3)) + 10.0
    t[:, 0] = np.einsum("ij,ijk->ik", weight, s)
    t[:, 0] += np.spacing(t[:, 0]) * rng.integers(-1, 2, (300, 3))
    pairs = np.stack([s, t], axis=1)
    for k, own in enumerate(pairs):
        want = {(0, 1)} if triangles_cross(*own.tolist()) else set()
        assert crossings(*as_mesh(own), device=device) == want, k


@pytest.mark.parametrize("name", [name for name in CLOSED if name != "egg box"])
def test_simple_meshes_have_no_crossings(name, device):
    assert crossings(*CLOSED[name](), device=device) == set()


def heap(count=80, span=6, seed=3):
    """Triangles on a grid, of which most cross others."""
    rng = np.random.default_rng(seed)
    return as_mesh(rng.integers(0, span, (count, 3, 3)).astype(float))


def test_order_of_faces_vertices_and_corners_is_nothing(device, rng):
    vertices, faces = heap()
    want = {frozenset(pair) for pair in crossings(vertices, faces, device=device)}
    for _ in range(20):
        row, place = rng.permutation(len(faces)), rng.permutation(len(vertices))
        shuffled = np.argsort(place)[faces[row]]
        shuffled = np.stack([rng.permutation(face) for face in shuffled])
        got = crossings(vertices[place], shuffled, device=device)
        assert {frozenset((int(row[i]), int(row[k]))) for i, k in got} == want


@pytest.mark.parametrize(("chunk", "room"), [(1, 2**24), (7, 2**24), (64, 3), (1, 1), (1000, 200)])
def test_how_many_are_looked_at_in_one_go_is_nothing(chunk, room, device, monkeypatch):
    vertices, faces = heap()
    whole = [*find_crossings(vertices, faces, device=device)]
    assert len(whole) == 1
    want = whole[0][1]
    monkeypatch.setattr(crossing_module, "CHUNK", chunk)
    monkeypatch.setattr(crossing_module, "ROOM_LARGEST", room)
    got = crossings(vertices, faces, device=device)
    most = np.bincount(want[:, 0]).max()
    if room >= most:
        assert got == {tuple(pair) for pair in want.tolist()}
    else:  # a face that has more crossings than there may be: those that there is room for
        assert got < {tuple(pair) for pair in want.tolist()}
