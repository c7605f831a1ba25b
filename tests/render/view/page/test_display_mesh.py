"""Large meshes become small ones that look alike, and small ones stay what they are."""

import numpy as np
import trimesh

from palpate.render.view.page.display_mesh import simplified_for_display


def test_a_small_mesh_stays_the_same():
    ball = trimesh.creation.icosphere(2, 0.05)
    vertices, faces, tolerance = simplified_for_display(ball.vertices, ball.faces)
    assert vertices is ball.vertices
    assert faces is ball.faces
    assert tolerance == 0.0


def test_a_large_mesh_becomes_a_small_one_of_the_same_volume():
    ball = trimesh.creation.icosphere(5, 0.05)  # 20,480 triangles
    ball.apply_translation([0.1, -0.2, 0.3])
    vertices, faces, tolerance = simplified_for_display(ball.vertices.astype(np.float32), ball.faces)
    assert 100 < len(faces) <= 20_000
    small = trimesh.Trimesh(vertices, faces, process=False)
    assert small.is_watertight
    assert abs(small.volume / ball.volume - 1) < 0.01
    off = np.abs(np.linalg.norm(vertices - [0.1, -0.2, 0.3], axis=1) - 0.05)
    assert off.max() <= tolerance < 0.001


def test_an_open_surface_stays_whole():
    ball = trimesh.creation.icosphere(5, 0.05)
    faces = ball.faces[5:]
    kept = simplified_for_display(ball.vertices.astype(np.float32), faces)
    assert len(kept[1]) == len(faces)
    assert kept[2] == 0.0
