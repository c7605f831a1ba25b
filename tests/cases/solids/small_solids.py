"""Closed solids of at most 12 vertices, of every kind that has a table of loops."""

from functools import cache

import numpy as np
from mesh_cases import MIDDLE, built_in, flipped, merged, moved, placed
from scipy.spatial import ConvexHull

from palpate.kernels.patterns.loop_table import upload_loop_table
from palpate.kernels.section.half_edges import HalfEdges

SIZE = 0.09  # [m], about


def hull_of(points):
    """The convex hull of points, which may lie on its faces and edges."""
    solid = ConvexHull(points)
    faces = solid.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), solid.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return placed(points, faces)


def hull(count, seed, *, round_=False):
    """The convex hull of random points; round_: of points on a sphere, which are all its vertices."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    if round_:
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return hull_of(points * SIZE / np.ptp(points, axis=0).max() + MIDDLE)


def tetrahedron(size=SIZE, at=(0, 0, 0)):
    points = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * size / 2
    return placed(points + MIDDLE + at, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])


def tetrahedra_apart():
    return merged(*(tetrahedron(0.04, at) for at in ((-0.03, 0, 0), (0.03, 0.01, 0), (0, -0.005, 0.05))))


def tetrahedra_nested():
    return merged(tetrahedron(0.12), flipped(tetrahedron(0.05)))


def tetrahedra_sharing_an_edge():
    """Four triangles around one edge: closed, and no manifold."""
    x = np.array([[0, 0, -1], [0, 0, 1], [1, 0.5, 0], [1, -0.5, 0], [-1, 0.5, 0], [-1, -0.5, 0]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [0, 5, 1], [0, 1, 4], [0, 4, 5], [1, 5, 4]]
    return placed(x * SIZE / 2 + MIDDLE, faces)


def prism(outline, triangles):
    """A prism over an outline, counter-clockwise from above, shape [corner, 2], with the triangles of its ends."""
    outline, triangles, count = np.asarray(outline, float), np.asarray(triangles), len(outline)
    outline -= (outline.min(axis=0) + outline.max(axis=0)) / 2
    outline *= SIZE / np.ptp(outline, axis=0).max()
    ends = [np.column_stack([outline, np.full(count, z)]) for z in (-0.03, 0.035)]
    k = np.arange(count)
    after = (k + 1) % count
    sides = [np.stack([k, after, after + count], axis=1), np.stack([k, after + count, k + count], axis=1)]
    return placed(np.concatenate(ends) + MIDDLE, np.concatenate([triangles[:, ::-1], triangles + count, *sides]))


def angle():
    """An L-shaped prism of 12 vertices."""
    outline = [[0, 0], [2, 0], [2, 0.6], [0.5, 0.5], [0.6, 2], [0, 2]]
    return prism(outline, [[3, 4, 5], [3, 5, 0], [3, 0, 1], [3, 1, 2]])


def arrow():
    """A prism over an outline with two notches."""
    outline = [[0, 0], [1, 0.8], [2, 0], [1.3, 1], [2, 2], [0.7, 1.2]]
    return prism(outline, [[0, 1, 5], [1, 2, 3], [1, 3, 5], [3, 4, 5]])


def ring():
    """A torus of 9 vertices: a triangle swept around a triangle."""
    turn = np.arange(3) * 2 * np.pi / 3
    across = np.array([[0.018, -0.02], [0.06, 0.0], [0.02, 0.022]])  # radius and height [m]
    points = [[r * np.cos(t), r * np.sin(t), z] for t in turn for r, z in across]
    faces = []
    for i in range(3):
        for j in range(3):
            a, b = 3 * i + j, 3 * i + (j + 1) % 3
            c, d = 3 * ((i + 1) % 3) + (j + 1) % 3, 3 * ((i + 1) % 3) + j
            faces += [[a, d, c], [a, c, b]]
    return placed(np.array(points) + MIDDLE, faces)


def leaf():
    """Two triangles back to back: closed, without a volume."""
    points = np.array([[-0.05, -0.03, 0.0], [0.05, -0.02, 0.01], [0.0, 0.06, -0.02]])
    return placed(points + MIDDLE, [[0, 1, 2], [0, 2, 1]])


SOLIDS = {
    "cube": lambda: built_in("cube"),
    "small cube": lambda: moved(built_in("cube"), scale=0.4),
    "tetrahedron": tetrahedron,
    "tetrahedra apart": tetrahedra_apart,
    "tetrahedra nested": tetrahedra_nested,
    "tetrahedra sharing an edge": tetrahedra_sharing_an_edge,
    "angle": angle,
    "arrow": arrow,
    "ring": ring,
    "leaf": leaf,
    "round": lambda: hull(12, 3, round_=True),
} | {f"hull of {count}": lambda count=count: hull(count, count) for count in range(4, 13)}


@cache
def table_on(name, device):
    """The LoopTable of a solid on a device."""
    return upload_loop_table(HalfEdges(*SOLIDS[name]()), device)
