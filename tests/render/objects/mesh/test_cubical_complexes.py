"""Solids of random voxels and boxes, loaded in many disguises, against the voxels: exact volumes, areas and lengths."""

import warnings

import numpy as np
import pytest
from voxel_complexes import (
    Complex,
    as_indexed,
    as_soup,
    layer_outline,
    mesh_outline,
    random_complex,
    triangles_of,
    volume_of,
    with_slivers,
)

from palpate.render import MeshObject, Palm, closed_contour, open_contour, render
from palpate.render.objects.mesh.repair import repair_mesh

SETS = 8  # of complexes, so that one that fails is found soon


def rotation(rng):
    out = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return out * np.linalg.det(out)


def assert_is_solid(vertices, faces, filled, off, note):
    """Whether a mesh is the boundary of these voxels: its volume, and its section through each layer of voxels."""
    assert volume_of(vertices, faces) == pytest.approx(filled.sum(), abs=off), note
    for axis in range(3):
        for layer in range(filled.shape[axis]):
            got = mesh_outline(vertices, faces, axis, layer + 0.5)
            assert got == pytest.approx(layer_outline(filled, axis, layer), abs=off), (note, axis, layer)


def disguised(triangles, rng, turn, grid):
    """Triangles as a file has them: turned or not, in float32 or not, with common vertices or not; and the turn."""
    rotated = rotation(rng) if turn else np.eye(3)
    triangles = triangles @ rotated.T
    if grid:
        triangles = triangles.astype(np.float32).astype(float)
    return (as_soup(triangles) if rng.random() < 0.5 else as_indexed(triangles, rng)), rotated


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("kind", ["as it is", "turned", "turned float32"])
@pytest.mark.parametrize("number", range(SETS))
def test_random_complexes_load_as_their_union(number, kind):
    exact, disguises = 0, set()
    for seed in range(16):
        rng = np.random.default_rng([number, len(kind), seed])
        complex_ = random_complex(rng, 4 if seed % 8 == 0 else 3)
        if not complex_.is_exact():
            continue
        exact += 1
        disguises.add((complex_.walls, complex_.diagonals, complex_.turned))
        mesh, rotated = disguised(triangles_of(complex_, rng), rng, "turned" in kind, "float32" in kind)
        mended = repair_mesh(*mesh)
        assert mended.solid_count == len(mended.faces)
        assert (mended.report.crossings, mended.report.bodies_united, mended.report.open_edges) == (0, 0, 0), seed
        off = 1e-4 if "float32" in kind else 1e-9
        assert_is_solid(mended.vertices @ rotated, mended.faces, complex_.filled, off, (number, seed))
    assert exact > 8
    assert len(disguises) >= 4


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", ["as it is", "turned", "turned float32"])
def test_corners_on_sides_closed_by_slivers_change_nothing(kind):
    """Triangles of no area, as programs write them, also along edges of many triangles."""
    taken = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        complex_ = random_complex(rng, 3)
        if not complex_.is_exact() or complex_.turned:
            continue
        triangles = with_slivers(triangles_of(complex_, rng), rng)
        mesh, rotated = disguised(triangles, rng, "turned" in kind, "float32" in kind)
        mended = repair_mesh(*mesh)
        assert mended.solid_count == len(mended.faces)
        assert (mended.report.crossings, mended.report.open_edges) == (0, 0), seed
        assert mended.report.faces_dropped >= 0
        taken += mended.report.faces_flat
        assert_is_solid(
            mended.vertices @ rotated, mended.faces, complex_.filled, 1e-4 if "float32" in kind else 1e-9, seed
        )
    assert taken > 200


def random_boxes(rng, span=5):
    """Boxes with integer corners that overlap, touch and nest; the voxels they fill, and their triangles."""
    filled, triangles = np.zeros((span,) * 3, bool), []
    for _ in range(int(rng.integers(2, 7))):
        low = rng.integers(0, span - 1, 3)
        high = np.minimum(low + 1 + rng.integers(0, span - low), span)
        filled[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
        cube = triangles_of(Complex(np.ones((1, 1, 1), bool), 0, True, False), rng)
        triangles.append(cube * (high - low) + low)
    return filled, np.concatenate(triangles)


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", ["as it is", "turned", "turned float32"])
@pytest.mark.parametrize("number", range(3))
def test_boxes_that_overlap_touch_and_nest_load_as_their_union(number, kind):
    """Turned, they touch within rounding only: then that is told, or the union has no inner walls."""
    simple = 0
    for seed in range(60):
        rng = np.random.default_rng([number, seed])
        filled, triangles = random_boxes(rng)
        mesh, rotated = disguised(rng.permutation(triangles), rng, "turned" in kind, "float32" in kind)
        mended = repair_mesh(*mesh)
        if mended.report.crossings == 0 or kind == "as it is":
            off = 1e-4 if "float32" in kind else 1e-9
            assert_is_solid(mended.vertices @ rotated, mended.faces, filled, off, seed)
        simple += mended.report.crossings == 0
    assert simple > {"as it is": 40, "turned": 10, "turned float32": 2}[kind]


def level_pose(height):
    """A palm parallel to the array, its middle 0.3 m to each side: a section of coordinates x and y."""
    return np.array([[0.3, 0.3, height, -np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], np.float32)


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", range(6))
def test_contours_of_random_complexes_are_those_of_their_layers(number, device):
    """All the way from arrays to contours, cubes of 0.1 m, which float32 holds to 1e-8 m."""
    for seed in range(6):
        rng = np.random.default_rng([7, number, seed])
        complex_ = random_complex(rng)
        if not complex_.is_exact():
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            thing = MeshObject(*as_soup(0.1 * triangles_of(complex_, rng)))
        heights = 0.1 * (np.arange(complex_.filled.shape[2]) + 0.5)
        poses = np.concatenate([level_pose(height) for height in heights])
        want = [0.1 * layer_outline(complex_.filled, 2, layer)[1] for layer in range(len(heights))]
        for strategy in (closed_contour(), open_contour()):
            batch = render(thing, Palm(0.9, 0.9), poses, strategy, device=device)
            assert batch.length() == pytest.approx(want, abs=1e-5)
            assert batch.polyline_closed.all()
