"""A triangle soup as a mesh: equal or close vertices are one, and the order of the file is forgotten."""

import numpy as np

from ....kernels.section.half_edges import group_starts, order_of
from ...errors import MeshError

ROUNDING = 2.0**-22  # of a mesh's size: two steps of float32, in which meshes are stored and cut


def check_soup(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse what is not a mesh at all, naming the row."""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"vertices must be [vertex, 3] and faces [face, 3], not {vertices.shape} and {faces.shape}")
    if len(faces) == 0:
        raise MeshError("the mesh has no triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        row = int(np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))[0])
        raise MeshError(f"face {row} names vertex {faces[row].tolist()}, but there are {len(vertices)} vertices")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{len(bad)} vertices are not finite, the first is vertex {bad[0]}: {vertices[bad[0]].tolist()}"
        )


def rounding_of(vertices: np.ndarray) -> float:
    """Distance within which float32 cannot tell a mesh's places apart, in its own unit.

    float32 coordinates are rounded by their distance from the origin, others as if the mesh lay around it.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = float(np.max(high - low))
    if np.array_equal(vertices, vertices.astype(np.float32)):
        size = max(size, float(np.abs(vertices).max()))
    return ROUNDING * size


def weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices of equal coordinates, sorted by them; vertices that no face has disappear."""
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    rows = np.flatnonzero(used)
    points = vertices[rows] + 0.0  # -0 is 0
    order = coordinate_order(points)
    points = points[order]
    fresh = group_starts(*points.T)
    number = np.empty(len(vertices), np.int64)
    number[rows[order]] = np.repeat(np.arange(len(fresh)), np.diff(fresh, append=len(points)))
    return points[fresh], number[faces]


def coordinate_order(points: np.ndarray) -> np.ndarray:
    """Order of points by x, then y, then z; that of equal ones is anything.

    Few points of a scan share their x, and only those are sorted by the others.
    """
    x = points[:, 0]
    order = np.arange(len(x)) if (x[1:] >= x[:-1]).all() else np.argsort(x)
    x = x[order]
    same = x[1:] == x[:-1]
    tied = np.zeros(len(x), bool)
    tied[1:] |= same
    tied[:-1] |= same
    rows = order[tied]
    order[tied] = rows[np.lexsort(points[rows].T[::-1])]
    return order


def weld_close(vertices: np.ndarray, faces: np.ndarray, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices that a chain of steps of at most `distance` joins, each into the first of them by coordinates."""
    from scipy.sparse import coo_matrix  # a tenth of a second that only this costs
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    tree = KDTree(vertices, balanced_tree=False, compact_nodes=False)
    one, two = tree.query_pairs(distance, output_type="ndarray").T
    if len(one) == 0:
        return vertices, faces
    graph = coo_matrix((np.ones(len(one), bool), (one, two)), shape=(len(vertices), len(vertices)))
    label = connected_components(graph, directed=False)[1]
    _, first = np.unique(label, return_index=True)
    return weld(vertices[first[label]], faces)


def sorted_faces(faces: np.ndarray) -> np.ndarray:
    """Faces without those that have a corner twice, each from its lowest corner on, in the order of their corners."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    first = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return faces[order_of(*faces.T[::-1])]
