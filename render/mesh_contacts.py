"""Surfaces of a solid that lie within rounding of each other: bodies that rest on each other are cut as one.

Boxes of different size that touch share no vertices. Turned, their faces no longer lie in one plane: rounding leaves
gaps here and overlaps there, and what uniting leaves of them would be drawn as inner walls.
"""

import numpy as np

from ..kernels.crossing import find_crossings
from ..kernels.edge_pairing import twins_of
from .mesh_bodies import body_labels, normals_of
from .mesh_union import CROSSINGS_MOST

GROWTH = 4.0  # roundings by which surfaces are moved outwards


def count_contacts(vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> int:
    """Pairs of triangles without a common vertex that would cross if all surfaces were a few roundings farther out.

    vertices: shape [vertex, 3]; faces: of closed surfaces, int, shape [face, 3]; tolerance: of rounding, in their unit.
    Bodies that touch along common edges have none: there triangles have common vertices.
    """
    label = body_labels(twins_of(faces, vertices, tolerance))
    key, index = np.unique(label[:, None] * len(vertices) + faces, return_inverse=True)
    own = index.reshape(-1, 3)
    moved = vertices[key % len(vertices)] + GROWTH * tolerance * outward_ways(vertices, faces, own, len(key))
    count = 0
    for _, pairs in find_crossings(moved, own):
        one, two = faces[pairs[:, 0]], faces[pairs[:, 1]]
        count += int(np.count_nonzero(~(one[:, :, None] == two[:, None, :]).any(axis=(1, 2))))
        if count >= CROSSINGS_MOST:
            break
    return count


def outward_ways(vertices: np.ndarray, faces: np.ndarray, own: np.ndarray, count: int) -> np.ndarray:
    """Unit vectors outwards at the vertices of bodies: of the normals around each, weighted by their angles there.

    own: numbers of the faces' vertices among `count` that each body has for itself, shape [face, 3].
    """
    normal = normals_of(vertices, faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    out = np.zeros((count, 3))
    for corner in range(3):
        at, one, two = (vertices[faces[:, (corner + k) % 3]] for k in range(3))
        cosine = np.einsum("ij,ij->i", one - at, two - at)
        angle = np.arctan2(np.linalg.norm(np.cross(one - at, two - at), axis=1), cosine)
        for axis in range(3):
            out[:, axis] += np.bincount(own[:, corner], angle * normal[:, axis], minlength=count)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), np.finfo(float).tiny)
