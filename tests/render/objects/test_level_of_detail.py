"""Simplified meshes: within the tolerance, measured; the Hausdorff distance itself."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from palpate.render.errors import MeshError
from palpate.render.focal_spot import focal_width
from palpate.render.objects.level_of_detail import Detail, farthest_distance, hausdorff_distance, simplify
from palpate.render.objects.mesh.solid_mesh import MeshObject

UP = np.array([0.0, 0.0, 0.2])


def cube(half, at=(0, 0, 0)):
    mesh = trimesh.creation.box(extents=[2 * half] * 3)
    return mesh.vertices + np.array(at), np.asarray(mesh.faces)


def ball(divisions, radius=0.05):
    mesh = trimesh.creation.icosphere(divisions, radius)
    return MeshObject(mesh.vertices + UP, mesh.faces, name="ball")


def sampled(vertices, faces, count, rng):
    """Points spread over a mesh, at random."""
    corner = vertices[faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    face = rng.choice(len(faces), count, p=area / area.sum())
    u, v = np.sort(rng.random((2, count)), axis=0)
    weight = np.stack([u, v - u, 1 - v], axis=1)
    return np.einsum("pk,pkx->px", weight, corner[face])


def test_cubes_in_one_another_are_as_far_as_their_corners(device):
    one, other = cube(0.05), cube(0.06)
    known, bound = hausdorff_distance(one, other, accuracy=1e-4, device=device)
    assert known == pytest.approx(0.01 * np.sqrt(3), abs=1e-7)
    assert known <= bound <= known + 1e-4
    inner, _ = farthest_distance(one, other, accuracy=1e-4, device=device)
    assert inner == pytest.approx(0.01, abs=1e-7)


def test_the_farthest_point_may_be_inside_a_face():
    """A bulge under the middle of two large triangles: all corners of both meshes but one are on both."""
    corner = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 0.3]]) * 0.1
    flat, roof = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    known, bound = farthest_distance((corner[:4], flat), (corner, roof), accuracy=1e-5)
    exact = 0.03 / np.hypot(1, 0.3)  # of the middle from a sloping side
    assert known <= exact + 1e-7
    assert exact <= bound <= known + 1e-5


@pytest.mark.parametrize("limit", [0.012, 0.02])
def test_a_question_for_a_limit_is_answered(limit):
    known, bound = hausdorff_distance(cube(0.05), cube(0.06), accuracy=1e-4, limit=limit)
    assert (known > limit) == (limit < 0.017)
    assert known <= bound
    assert bound <= limit or limit < 0.017


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["sphere", "dog-detailed", "tube"])
def test_no_point_is_farther_than_told(name, rng):
    thing = MeshObject.load(name)
    simple, detail = simplify(thing)
    assert detail.tolerance == focal_width(thing.bounds.mean(axis=0)).width / 4
    assert detail.distance <= detail.distance_bound <= detail.tolerance
    assert detail.triangles_after == len(simple.faces) < detail.triangles_before == len(thing.faces)
    simple.require_closed()
    points = [sampled(mesh.vertices, mesh.faces, 60_000, rng) for mesh in (thing, simple)]
    far = max(cKDTree(points[1]).query(points[0])[0].max(), cKDTree(points[0]).query(points[1])[0].max())
    assert far <= detail.distance_bound + 0.002  # of two clouds, so as much more as their points are apart
    assert far >= detail.distance - 0.002


def test_thin_parts_are_kept():
    """A rod thinner than the tolerance hangs on a ball: taken away, its tip would be 50 mm from the surface."""
    rod = trimesh.creation.cylinder(radius=0.001, height=0.1, sections=16)
    body = trimesh.boolean.union([trimesh.creation.icosphere(3, 0.04), rod], engine="manifold")
    thing = MeshObject(body.vertices + UP, body.faces)
    simple, detail = simplify(thing, 2.5e-3)
    assert detail.distance_bound <= 2.5e-3
    assert detail.triangles_after < detail.triangles_before
    assert np.ptp(simple.bounds, axis=0)[2] == pytest.approx(0.1, abs=0.005)


def test_what_cannot_be_simplified_stays():
    thing = MeshObject.load("cube")
    same, detail = simplify(thing)
    assert same is thing
    assert detail == Detail(detail.tolerance, 0.0, 0.0, 12, 12)
    assert detail.described()["triangles_after"] == 12


@pytest.mark.filterwarnings("ignore:.*open edges")
def test_bad_input_is_named():
    thing = ball(2)
    for tolerance in (0, -1, float("nan"), float("inf")):
        with pytest.raises(MeshError, match="ball: tolerance must be a positive length in metres"):
            simplify(thing, tolerance)
    with pytest.raises(MeshError, match="only a closed surface can be simplified, but it has 3 open edges"):
        simplify(MeshObject(thing.vertices, thing.faces[1:]), 1e-3)
