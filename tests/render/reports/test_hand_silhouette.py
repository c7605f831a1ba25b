"""Outlines of hands: areas that geometry and another library know, and a thumb on the right side."""

import numpy as np
import pytest
import shapely
import trimesh

from palpate.datasets import hand_shape, static_pose
from palpate.render import MeshHand, Palm, flat_hand
from palpate.render.reports.hand_silhouette import hand_surface, silhouette
from palpate.render.reports.scene_view import SceneView, flat

BASIS = SceneView.of("iso").basis()


def area(outline):
    """Signed area of closed outlines."""
    return sum(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) for x, y in (ring.T for ring in outline))


def test_a_ball_is_seen_as_a_disc_and_a_box_as_its_shadow():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    seen = silhouette(ball.vertices, ball.faces, BASIS)
    assert len(seen.outline) == 1
    assert area(seen.outline) == pytest.approx(np.pi * 30.0**2, rel=5e-3)
    sides = np.array([0.02, 0.03, 0.05])
    box = trimesh.creation.box(sides)
    shadow = 1e6 * np.abs(BASIS[2]) @ (np.prod(sides) / sides)  # each pair of faces as far as it faces the eye
    assert area(silhouette(box.vertices, box.faces, BASIS).outline) == pytest.approx(shadow, rel=1e-6)


def test_folds_are_the_edges_between_seen_and_unseen_triangles():
    box = trimesh.creation.box([0.02, 0.03, 0.05])
    folds = silhouette(box.vertices, box.faces, BASIS).folds
    assert len(folds) == 6  # of a box's twelve edges: its outline, a hexagon
    sides = np.linalg.norm(1e3 * np.diag([0.02, 0.03, 0.05]) @ BASIS[:2].T, axis=1)
    assert np.linalg.norm(folds[:, 1] - folds[:, 0], axis=1).sum() == pytest.approx(2 * sides.sum())


def test_a_ring_has_a_hole():
    ring = trimesh.creation.torus(0.04, 0.01)
    seen = silhouette(ring.vertices, ring.faces, SceneView.of("top").basis())
    assert len(seen.outline) == 2
    assert area(seen.outline) == pytest.approx(np.pi * (50.0**2 - 30.0**2), rel=0.02)


def test_the_hands_outline_is_the_union_of_its_triangles_as_shapely_makes_it():
    vertices, faces = hand_surface(Palm(), static_pose([0.01, 0.02, 0.2]).pose[0], 0)
    union = shapely.union_all(shapely.polygons(flat(vertices, BASIS)[faces]))
    assert area(silhouette(vertices, faces, BASIS).outline) == pytest.approx(union.area, rel=2e-3)


def test_a_palms_hand_is_a_right_one_as_broad_as_the_palm():
    pose = static_pose([0, 0, 0.2]).pose[0]
    basis = SceneView.of("palm").basis(pose)
    small, usual = (flat(hand_surface(Palm(width, 0.1), pose, 0)[0], basis) for width in (0.068, 0.085))
    assert (
        usual[:, 0].min() < -60 < 45 < usual[:, 0].max() < 55
    )  # from the back of a right hand, the thumb is at the left
    assert 100 < usual[:, 1].max() < 160
    np.testing.assert_allclose(small, 0.8 * usual, atol=0.05)


def test_meshes_are_drawn_as_they_are_and_planes_have_no_hand_around_them():
    shape = hand_shape(detail=1)
    mesh = MeshHand(shape.vertices, shape.faces, glabrous=shape.glabrous)
    pose = static_pose([0, 0, 0.2]).pose[0]
    vertices, faces = hand_surface(mesh, pose, 0)
    assert faces.shape == mesh.faces.shape
    np.testing.assert_allclose(
        np.linalg.norm(vertices - pose[:3], axis=1), np.linalg.norm(mesh.vertices[0], axis=1), atol=1e-6
    )
    assert hand_surface(flat_hand(), pose, 0) is None
