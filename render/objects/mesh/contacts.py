"""Surfaces of a solid that lie within rounding of each other: bodies that rest on each other are cut as one.

Boxes of different size that touch share no vertices. Turned, their faces no longer lie in one plane: rounding leaves
gaps here and overlaps there, and what uniting leaves of them would be drawn as inner walls.
"""

import numpy as np

from ....kernels.section.half_edges import twins_of
from ....kernels.solids.crossing import find_crossings
from ...runtime.loading_progress import Watch
from .bodies import body_labels, normals_of
from .union import CROSSINGS_MOST

GROWTH = 4.0  # roundings by which surfaces are moved outwards


def count_contacts(vertices: np.ndarray, faces: np.ndarray, tolerance: float, watch: Watch) -> int:
    """Pairs of triangles that would cross if all surfaces were a few roundings farther out, and folds.

    vertices: shape [vertex, 3]; faces: of closed surfaces, int, shape [face, 3]; tolerance: of rounding, in their unit.
    Pairs with a common vertex do not count, as where bodies touch along edges.
    """
    twin = twins_of(faces, vertices, tolerance)
    label = body_labels(twin)
    key, index = np.unique(label[:, None] * len(vertices) + faces, return_inverse=True)
    own = index.reshape(-1, 3)
    moved = vertices[key % len(vertices)] + GROWTH * tolerance * outward_ways(vertices, faces, own, len(key))
    count = count_folds(vertices, faces, twin, tolerance)
    for done, pairs in find_crossings(moved, own):
        watch("contacts", done, len(faces))
        one, two = faces[pairs[:, 0]], faces[pairs[:, 1]]
        count += int(np.count_nonzero(~(one[:, :, None] == two[:, None, :]).any(axis=(1, 2))))
        if count >= CROSSINGS_MOST:
            break
    return count


def count_folds(vertices: np.ndarray, faces: np.ndarray, twin: np.ndarray, tolerance: float) -> int:
    """Pairs of triangles that lie on each other, on one side of the edge that joins them: where a gap ends.

    Triangles whose corners lie within a few roundings of that edge, which look either way, do not count.
    """
    half = np.flatnonzero(twin > np.arange(len(twin)))
    at, along = vertices[faces.ravel()[half]], vertices[np.roll(faces, -1, axis=1).ravel()[half]]
    along = (along - at) / np.maximum(np.linalg.norm(along - at, axis=1, keepdims=True), np.finfo(float).tiny)
    tip = np.roll(faces, -2, axis=1).ravel()
    one, two = vertices[tip[half]] - at, vertices[tip[twin[half]]] - at
    one, two = (x - np.einsum("ij,ij->i", x, along)[:, None] * along for x in (one, two))
    one_far, two_far = np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=1)
    apart = np.linalg.norm(np.cross(one, two), axis=1) / np.maximum(np.maximum(one_far, two_far), np.finfo(float).tiny)
    folds = (np.einsum("ij,ij->i", one, two) > 0) & (apart <= tolerance)
    return int(np.count_nonzero(folds & (np.minimum(one_far, two_far) > GROWTH * tolerance)))


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
