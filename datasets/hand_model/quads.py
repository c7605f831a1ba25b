"""Smooth surfaces from a few quadrilaterals: Catmull and Clark's subdivision; an open boundary becomes a spline."""

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Quads = NDArray[np.int32]


def subdivide(values: Values, quads: Quads) -> tuple[Values, Quads]:
    """Split each quad into four (E. Catmull, J. Clark 1978; open edges by the cubic spline's rule).

    values: whatever vertices carry (positions, weights), all smoothed alike, shape [vertex, k]. quads: [quad, 4], an
    oriented surface. A new quad starts at an old corner, so quad 4 i + c lies at corner c of quad i.
    """
    # Undirected edges [edge, 2], the edge from each corner to the next [quad, 4], and the number of quads at each edge.
    directed = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)
    edge, index, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    edge, index = edge.astype(np.int32), index.reshape(-1, 4).astype(np.int32)
    face = values[quads].mean(axis=1)
    middle = values[edge].mean(axis=1)
    beside = np.zeros_like(middle)
    for corner in range(4):
        np.add.at(beside, index[:, corner], face)
    inner = count == 2
    edge_point = middle + inner[:, None] * (beside / 4.0 - middle / 2.0)
    kept = _old_vertices(values, quads, face, middle, edge[inner], inner, edge)
    first, second = len(values), len(values) + len(edge)
    centre = np.arange(second, second + len(quads))
    parts = [np.stack([quads[:, c], first + index[:, c], centre, first + index[:, c - 1]], axis=1) for c in range(4)]
    return np.concatenate([kept, edge_point, face]), np.stack(parts, axis=1).reshape(-1, 4).astype(np.int32)


def triangulate(quads: Quads) -> NDArray[np.int32]:
    """Two triangles a quad, shape [2 quad, 3]; triangles 2 i and 2 i + 1 are quad i."""
    return np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)


def _old_vertices(
    values: Values,
    quads: Quads,
    face: Values,
    middle: Values,
    inner_edge: Quads,
    inner: NDArray[np.bool_],
    edge: Quads,
) -> Values:
    """Old vertices at their new places."""
    count = len(values)
    valence = np.bincount(quads.ravel(), minlength=count)[:, None]
    faces, edges = np.zeros_like(values), np.zeros_like(values)
    for corner in range(4):
        np.add.at(faces, quads[:, corner], face)
    for end in range(2):
        np.add.at(edges, inner_edge[:, end], middle[inner])
    smooth = (faces / valence + 2.0 * edges / valence + (valence - 3.0) * values) / valence
    rim, rim_edge = np.zeros_like(values), edge[~inner]
    for end in range(2):
        np.add.at(rim, rim_edge[:, end], middle[~inner])
    on_rim = np.isin(np.arange(count), rim_edge)[:, None]
    return np.where(on_rim, values / 2.0 + rim / 4.0, smooth)
