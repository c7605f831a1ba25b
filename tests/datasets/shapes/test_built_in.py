"""The built-in shapes: whole, simple, oriented, placed, and the same every time."""

import manifold3d
import numpy as np
import pytest
import trimesh

from palpate.datasets.shapes.built_in import CENTRE, SIZE, shape, shape_names
from palpate.datasets.shapes.subdivision import bisect, quadrisect, smooth_surface

FACE_COUNT = {"cube": 12, "sphere": 1280, "tube": 256, "dog": 136, "dog-detailed": 1160, "rock": 320, "boulder": 320}
HANDLES = {"tube": 1}


@pytest.fixture(params=FACE_COUNT)
def name(request):
    return request.param


def mesh(name):
    vertices, faces = shape(name)
    return trimesh.Trimesh(vertices.astype(float), faces, process=False)


def pierced_pairs(vertices, faces):
    """Edges (start, end) and faces that meet although they share no vertex, by brute force; coplanar ones left out."""
    points = vertices.astype(float)
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    a, b, c = (points[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    found = []
    for start, end in edges:
        p, q = points[start], points[end]
        below, above = ((p - a) * normal).sum(1), ((q - a) * normal).sum(1)
        crossing = (below * above <= 0) & (below != above) & ~np.isin(faces, (start, end)).any(axis=1)
        t = below / np.where(below == above, 1.0, below - above)
        x = p + t[:, None] * (q - p)
        sides = [(np.cross(v - u, x - u) * normal).sum(1) >= 0 for u, v in ((a, b), (b, c), (c, a))]
        found += [(int(start), int(end), int(f)) for f in np.flatnonzero(crossing & np.logical_and.reduce(sides))]
    return found


def test_face_counts_and_types():
    assert set(shape_names()) == set(FACE_COUNT)
    for name, count in FACE_COUNT.items():
        vertices, faces = shape(name)
        assert (len(faces), vertices.dtype, faces.dtype) == (count, np.float32, np.int32)


def test_is_one_closed_shell_oriented_outwards(name):
    body = mesh(name)
    assert body.is_watertight
    assert body.is_winding_consistent
    assert body.volume > 0
    assert body.body_count == 1
    assert body.euler_number == 2 - 2 * HANDLES.get(name, 0)
    assert len(np.unique(body.faces)) == len(body.vertices)  # no vertex without a face
    assert len(np.unique(body.vertices, axis=0)) == len(body.vertices)  # none twice: welding changes nothing


@pytest.mark.exhaustive(after=1)
def test_does_not_intersect_itself(name):
    vertices, faces = shape(name)
    assert pierced_pairs(vertices, faces) == []
    body = mesh(name)
    neighbours = body.face_normals[body.face_adjacency]
    assert (neighbours[:, 0] * neighbours[:, 1]).sum(axis=1).min() > -0.97  # no face folded back onto the next


def test_self_intersection_is_found_where_there_is_one():
    vertices, faces = shape("dog")
    pushed = vertices.copy()
    pushed[vertices[:, 2].argmax()] -= (0, 0, 0.09)  # an ear through the chest
    assert pierced_pairs(pushed, faces)


def test_a_solid_modeller_agrees(name):
    vertices, faces = shape(name)
    solid = manifold3d.Manifold(manifold3d.Mesh(vertices, faces.astype(np.uint32)))
    assert solid.status() == manifold3d.Error.NoError
    assert solid.volume() == pytest.approx(mesh(name).volume, rel=1e-5)
    union = solid + manifold3d.Manifold.cube((1e-3,) * 3).translate(
        (9.0, 0, 0)
    )  # a union keeps a simple solid as it is
    assert union.volume() == pytest.approx(mesh(name).volume + 1e-9, rel=1e-5)


def test_fills_the_130_mm_cube_20_cm_above_the_array(name):
    vertices, _ = shape(name)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert (low + high) / 2 == pytest.approx(CENTRE, abs=1e-7)
    assert (high - low).max() == pytest.approx(SIZE, abs=1e-7)


def test_has_no_needles(name):
    sharpest = 3.0 if name == "tube" else 8.0  # degrees; the tube's sides are 130 mm long by design
    assert np.degrees(mesh(name).face_angles.min()) > sharpest


def test_sphere_has_its_vertices_at_65_mm():
    vertices, _ = shape("sphere")
    assert np.linalg.norm(vertices.astype(float) - CENTRE, axis=1) == pytest.approx(0.065, abs=1e-7)


def test_tube_stands_upright_and_is_hollow():
    vertices, _ = shape("tube")
    radius = np.hypot(vertices[:, 0], vertices[:, 1])
    assert sorted(set(np.round(radius.astype(float), 6))) == [0.04, 0.065]
    assert set(np.round(vertices[:, 2].astype(float), 6)) == {0.135, 0.265}
    polygon = 32 / 2 * np.sin(2 * np.pi / 32)
    assert mesh("tube").volume == pytest.approx(polygon * (0.065**2 - 0.04**2) * 0.13, rel=1e-5)


def test_rock_is_a_flat_lobed_slab_that_lies():
    vertices, faces = shape("rock")
    length, width, thickness = np.ptp(vertices, axis=0)
    assert 0.75 < width / length < 0.95
    assert 0.25 < thickness / width < 0.45
    middle = mesh("rock").section((0, 0, 1), CENTRE).to_2D()[0].polygons_full[0]
    assert middle.area < 0.95 * middle.convex_hull.area  # drawn in between the lobes
    assert mesh("rock").volume > 0.72 * middle.area * thickness  # flat: of an ellipsoid it would be two thirds
    corner = vertices.astype(float)[faces] - CENTRE
    assert np.linalg.det(corner).min() > 0.0  # every triangle faces out, seen from the middle: star-shaped


def test_boulder_is_no_ball():
    vertices, _ = shape("boulder")
    radius = np.linalg.norm(vertices - CENTRE, axis=1)
    assert radius.std() / radius.mean() > 0.08
    extents = np.ptp(vertices, axis=0)
    assert extents[2] == extents.min()


def test_dog_has_four_paws_two_ears_a_snout_and_a_tail():
    body = mesh("dog")
    low, high = body.bounds
    height = high[2] - low[2]
    cut = [body.section((0, 0, 1), (0, 0, low[2] + share * height)) for share in (0.1, 0.97)]
    assert [len(section.entities) for section in cut] == [4, 2]
    side = body.section((1, 0, 0), (low[0] + 0.1 * (high[0] - low[0]), 0, 0))
    assert len(side.entities) == 1  # the snout
    assert np.ptp(side.vertices, axis=0).max() < 0.25 * height
    tail = body.section((1, 0, 0), (high[0] - 0.04 * (high[0] - low[0]), 0, 0))
    assert np.abs(tail.vertices[:, 1]).max() < 0.006
    assert tail.vertices[:, 2].min() > low[2] + 0.5 * height


@pytest.mark.exhaustive
def test_both_dogs_are_the_same_dog():
    coarse, fine = mesh("dog"), mesh("dog-detailed")
    distance = trimesh.proximity.closest_point_naive(coarse, fine.vertices)[1]
    assert distance.max() < 0.003
    assert fine.volume == pytest.approx(coarse.volume, rel=0.05)


def test_dog_is_symmetric():
    vertices, _ = shape("dog")
    rows = {tuple(row) for row in vertices.tolist()}
    assert rows == {(x, -y, z) for x, y, z in rows}
    assert abs(mesh("dog-detailed").center_mass[1]) < 2e-4


def test_bisection_splits_the_longest_edge_and_keeps_the_surface():
    vertices, faces = shape("cube")
    points, triangles = bisect(vertices.astype(float), faces, count=40)
    body = trimesh.Trimesh(points, triangles, process=False)
    assert len(triangles) == 40
    assert body.is_watertight
    assert body.volume == pytest.approx(0.13**3)
    assert body.edges_unique_length.max() < 0.131  # every diagonal is gone


def test_subdivision_makes_four_of_each_and_smoothing_shrinks():
    vertices, faces = shape("dog")
    volume = mesh("dog").volume
    flat, smooth = (
        trimesh.Trimesh(*divide(vertices.astype(float), faces), process=False)
        for divide in (quadrisect, smooth_surface)
    )
    assert len(flat.faces) == len(smooth.faces) == 4 * len(faces)
    assert flat.volume == pytest.approx(volume)
    assert 0.7 * volume < smooth.volume < volume
    assert smooth.is_watertight


def test_smoothing_of_an_octahedron_has_loops_weights():
    """At valence 4 a point keeps 1 - 4 * 3/32 of itself; an edge's middle is 3/8 of its ends, 1/8 of the corners."""
    points = np.vstack([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    smooth, triangles = smooth_surface(points, faces.astype(np.int32))
    assert len(triangles) == 32
    np.testing.assert_allclose(smooth[:6], 0.625 * points, atol=1e-15)
    np.testing.assert_allclose(np.sort(np.abs(smooth[6:]), axis=1), [[0, 0.375, 0.375]] * 12, atol=1e-15)
