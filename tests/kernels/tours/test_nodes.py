"""Nodes of patches inside an object, by its contours or by a field, and thinned by their steps."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from tour_oracle import thinned

from palpate.kernels.tours.nodes import inside_nodes, list_nodes, thin_nodes
from palpate.render.bench.cases import random_poses
from palpate.render.hands.hand import Palm
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.intersection import contact_tour as contact
from palpate.render.objects.mesh.solid_mesh import MeshObject


def points_of(nodes):
    """Points of each pose."""
    point, start = (x.numpy() for x in list_nodes(nodes))
    return [point[a:b] for a, b in pairwise(start)]


def sampled(skin, pose):
    """Nodes inside the object by its field: signed crossings of a ray from each node, which know no contours."""
    section = wp.array(skin.hand.section_poses(pose, 0), dtype=wp.transform, ndim=2, device=skin.device)
    field = skin.solid.field_on(skin.device)
    return inside_nodes(field, section, skin.patch, step=skin.step, bounds=skin.solid.bounds)


@pytest.mark.parametrize("hand", [Palm(), flat_hand()], ids=["palm", "planes"])
@pytest.mark.parametrize("name", ["cube", "tube", "dog"])
def test_nodes_within_contours_are_those_inside_the_object(name, hand, device):
    pose = np.asarray(random_poses(50), np.float32)
    skin = contact._Skin(MeshObject.load(name), hand, device, 0.0025)
    apart = total = 0
    for found, known in zip(points_of(skin.nodes(pose, 0)), points_of(sampled(skin, pose)), strict=True):
        apart += len({x.tobytes() for x in found} ^ {x.tobytes() for x in known})
        total += len(known)
    assert total > 400
    assert apart <= 3 + 1e-4 * total  # nodes on a patch's boundary, where the surface passes within 2.5 um


def two_cubes(second, faces, solid):
    """The cube, and another body beside or in it."""
    cube = MeshObject.load("cube")
    vertices = np.concatenate([cube.vertices, second])
    return MeshObject(vertices, np.concatenate([cube.faces, faces + len(cube.vertices)]), name="two", solid=solid)


@pytest.mark.filterwarnings("ignore:two")
@pytest.mark.parametrize("solid", ["winding", "even-odd"])
def test_nodes_of_two_bodies_follow_the_rule_of_what_is_inside(solid, device):
    """Bodies that cross under the even-odd rule are sampled: contours of those are regularised on the host."""
    cube = MeshObject.load("cube")
    small = 0.5 * (cube.vertices - [0, 0, 0.2]) + [0, 0, 0.2]
    moved = cube.vertices + np.array([0.01, 0.013, 0.017])
    bodies = [(small, cube.faces), (small, cube.faces[:, ::-1]), (moved, cube.faces)]
    pose = np.asarray(random_poses(20), np.float32)
    for second, faces in bodies:
        thing = two_cubes(second, faces, solid)
        assert contact.is_outlined(thing) == (solid == "winding" or second is small)
        skin = contact._Skin(thing, Palm(), device, 0.003)
        found, known = (sum(map(len, points_of(nodes))) for nodes in (skin.nodes(pose, 0), sampled(skin, pose)))
        assert abs(found - known) <= 1


@pytest.mark.parametrize("separation", [0.004, 0.0083, 0.0217, 0.3])
def test_nodes_are_thinned_one_after_the_other(separation, device):
    pose = np.asarray(random_poses(4), np.float32)
    skin = contact._Skin(MeshObject.load("sphere"), Palm(), device, 0.0031)
    nodes = skin.nodes(pose, 0)
    kept, count = thin_nodes(nodes, separation=separation)
    for points, own, total in zip(points_of(nodes), points_of(kept), count.numpy(), strict=True):
        known = thinned(points, separation).astype(np.float32)
        assert len(own) == total
        if len(known) == 2:  # of points that are equally far from the first, any may be the second
            far = np.linalg.norm(np.diff(np.stack([own, known]).astype(float), axis=1), axis=2)
            np.testing.assert_allclose(far[0], far[1], atol=1e-7)
        else:
            np.testing.assert_array_equal(own, known)


def test_nodes_that_lie_a_separation_apart_by_their_steps_are_kept(device):
    """A palm 80 mm wide, in steps of 4 mm: every other node of every other row, whatever rounds."""
    pose = np.array([[0.001, -0.002, 0.2, 0.1, 0.2, 0.3, 0.9]], np.float32)
    skin = contact._Skin(MeshObject.load("sphere"), Palm(0.08, 0.08), device, 0.004)
    _, start = skin.thinned_inside(pose, 0, 0.008)
    assert start.numpy().tolist() == [0, 121]
