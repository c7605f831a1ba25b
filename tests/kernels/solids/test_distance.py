"""Distance from a mesh, and the side of it that a point is on, against every triangle in NumPy."""

import numpy as np
import pytest
import trimesh
import warp as wp
from depth_oracle import depths, windings

from palpate.kernels.patch import EXACT
from palpate.kernels.solids.distance import distance_within, is_within, mesh_for_depth
from palpate.render import MeshObject

wp.set_module_options(EXACT)


@wp.kernel
def _measure(
    # In:
    mesh: wp.uint64,
    points: wp.array[wp.vec3],
    most: float,
    # Out:
    distance: wp.array[wp.float32],
    within: wp.array[wp.int32],
):
    """Ask about each point."""
    i = wp.tid()
    distance[i] = distance_within(mesh, points[i], most)
    within[i] = wp.where(is_within(mesh, points[i]), 1, 0)


def measured(vertices, faces, points, device, most=10.0):
    mesh = mesh_for_depth(vertices, faces, device)
    distance = wp.empty(len(points), dtype=wp.float32, device=device)
    within = wp.empty(len(points), dtype=wp.int32, device=device)
    x = wp.array(points.astype(np.float32), dtype=wp.vec3, device=device)
    wp.launch(_measure, len(points), inputs=[mesh.id, x, most], outputs=[distance, within], device=device)
    return distance.numpy(), within.numpy() == 1


def shells():
    """Two balls that overlap, and a ball with a hollow in it: what is wound around once or twice is inside."""
    one, other = trimesh.creation.icosphere(2, 0.03), trimesh.creation.icosphere(2, 0.02)
    other.apply_translation([0.025, 0.0, 0.0])
    hollow = trimesh.creation.icosphere(2, 0.01)
    hollow.invert()
    hollow.apply_translation([-0.012, 0.0, 0.0])
    both = trimesh.util.concatenate([one, other, hollow])
    return np.asarray(both.vertices, np.float32), np.asarray(both.faces, np.int32)


@pytest.mark.parametrize("name", ["tube", "dog", "shells"])
def test_depth_is_that_of_every_triangle(name, device, rng):
    vertices, faces = shells() if name == "shells" else MeshObject.load(name).outline_mesh()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = rng.uniform(low - 0.01, high + 0.01, (250, 3)).astype(np.float32)
    distance, within = measured(vertices, faces, points, device)
    sure = distance > 1e-6
    assert 5 < within.sum() < 245
    np.testing.assert_array_equal(within[sure], windings(vertices, faces, points.astype(np.float64))[sure] > 0.5)
    want = depths((vertices, faces), points)
    np.testing.assert_allclose(np.where(within, distance, 0.0), want, atol=1e-6)


def test_above_and_below_vertices_and_edges_nothing_leaks(device):
    """Points straight under the corners, edges and middles of a box's faces, and on them."""
    box = trimesh.creation.box((0.5, 0.5, 0.5))
    along = np.array([-0.25, -0.125, 0.0, 0.125, 0.25], np.float32)
    heights = np.array([-0.5, -0.25, -0.125, 0.125, 0.25, 0.5], np.float32)
    points = np.stack(np.meshgrid(along, along, heights, indexing="ij"), axis=-1).reshape(-1, 3)
    distance, within = measured(np.asarray(box.vertices, np.float32), np.asarray(box.faces), points, device)
    np.testing.assert_array_equal(within, (np.abs(points) < 0.25).all(axis=1))
    np.testing.assert_allclose(distance[within], (0.25 - np.abs(points[within])).min(axis=1), atol=1e-7)
