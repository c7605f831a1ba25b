"""Which triangles of a mesh can bound a solid: repeats, backs, walls and open surfaces are told apart.

A triangle that is there an even number of times is a *wall*, one that is there an odd number of times counts once. But
where triangles that are there three times or more would only be edges of a hole, they belong to the wall around them.

| surface | what becomes of it |
|---|---|
| closed without its walls | the walls are left out: they lie inside, or enclose nothing |
| walls that are closed by themselves | a body: a solid whose every triangle has its back |
| open without its walls, closed with them | the walls count once: a repeat had filled its own hole |
| has an edge of one triangle | open: set aside, and with it whatever then has such an edge |
| closed, but no sides agree | cells divided by walls: their common outside is kept |
"""

from typing import NamedTuple

import numpy as np

from ....kernels.section.half_edges import faces_around_edges, group_starts, order_of


class Edges(NamedTuple):
    """The edges of some faces."""

    of_half: np.ndarray
    """Number of each half-edge's edge, shape [3 face]."""
    face_count: np.ndarray
    """How many half-edges each edge has, shape [edge]."""
    balance: np.ndarray
    """How many more run one way than the other, shape [edge]."""


def edges_of(faces: np.ndarray) -> Edges:
    """Number the edges of faces, int, shape [face, 3]."""
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    order = order_of(high, low)
    start = group_starts(low[order], high[order])
    count = np.diff(start, append=len(order))
    of_half = np.empty(len(order), np.int64)
    of_half[order] = np.repeat(np.arange(len(count)), count)
    return Edges(of_half, count, np.bincount(of_half, np.where(tail < head, 1, -1), minlength=len(count)))


def components(one: np.ndarray, two: np.ndarray, count: int) -> np.ndarray:
    """Number of the component of each of `count` nodes, joined by edges from `one` to `two`."""
    from scipy.sparse import coo_matrix  # a tenth of a second that only meshes cost
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(one), bool), (one, two)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)  # products of int32 would overflow


def joined_by_edges(edges: Edges) -> np.ndarray:
    """Number of the component of each face, joined through any edge."""
    face_count, edge_count = len(edges.of_half) // 3, len(edges.face_count)
    face = np.arange(len(edges.of_half)) // 3
    return components(face, face_count + edges.of_half, face_count + edge_count)[:face_count]


def joined_by_pairs(edges: Edges) -> np.ndarray:
    """Number of the component of each face, joined through edges of two."""
    face = np.arange(len(edges.of_half)) // 3
    by_edge = np.argsort(edges.of_half, kind="stable")
    plain = (np.cumsum(edges.face_count) - edges.face_count)[edges.face_count == 2]
    return components(face[by_edge[plain]], face[by_edge[plain + 1]], len(face) // 3)


def is_plain(edges: Edges) -> bool:
    """Whether nothing is there twice: no edge has more than two faces, no two faces have all their edges in common."""
    if edges.face_count.max(initial=0) > 2:
        return False
    by_edge = np.argsort(edges.of_half, kind="stable")
    first = (np.cumsum(edges.face_count) - edges.face_count)[edges.face_count == 2]
    across = np.full(len(edges.of_half), -1)
    across[by_edge[first]], across[by_edge[first + 1]] = by_edge[first + 1] // 3, by_edge[first] // 3
    one, two, three = across.reshape(-1, 3).T
    return not bool(((one >= 0) & (one == two) & (two == three)).any())


def split_repeats(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One of each triangle: those that are there an odd number of times, and those that are there an even one.

    Of several the first in the order of the faces is kept.
    """
    if len(faces) == 0:
        return faces, faces
    corners = np.sort(faces, axis=1)
    order = order_of(*corners.T[::-1])
    start = group_starts(*corners[order].T)
    count = np.diff(start, append=len(order))
    odd = count % 2 == 1
    first = np.minimum.reduceat(order, start)
    if (repeated := np.flatnonzero(odd & (count > 2))).size:
        single = first[odd & (count == 1)]
        odd[repeated[_without_place(faces[single], faces[first[repeated]])]] = False
    return faces[np.sort(first[odd])], faces[np.sort(first[~odd])]


def _without_place(single: np.ndarray, repeated: np.ndarray) -> np.ndarray:
    """Which repeated triangles are no part of a surface: they have a rim, at which nothing is open without them.

    Triangles that are joined by edges go together. Bool, shape [repeated].
    """
    edges = edges_of(np.concatenate([single, repeated]))
    half = edges.of_half.reshape(-1, 3)
    own, rest = half[len(single) :], half[: len(single)]
    alone, without = (np.bincount(part.ravel(), minlength=len(edges.face_count)) % 2 == 1 for part in (own, rest))
    patch = joined_by_edges(edges_of(repeated))
    has_rim, is_open = (np.bincount(patch, odd[own].any(axis=1)) > 0 for odd in (alone, without))
    return (has_rim & ~is_open)[patch]


def closed_part(faces: np.ndarray) -> np.ndarray:
    """Which faces are left once those with an edge of their own are taken away, again and again: bool, shape [face].

    Faces joined through edges of two go together.
    """
    edges = edges_of(faces)
    face = np.arange(len(edges.of_half)) // 3
    by_edge = np.argsort(edges.of_half, kind="stable")
    start = np.concatenate([[0], np.cumsum(edges.face_count)])
    patch = joined_by_pairs(edges)
    count = edges.face_count.copy()
    gone = np.zeros(int(patch.max(initial=-1)) + 1, bool)
    shared = edges.face_count[edges.of_half] != 2
    of_patch = [[] for _ in gone]
    for owner, edge in zip(patch[face[shared]].tolist(), edges.of_half[shared].tolist(), strict=True):
        of_patch[owner].append(edge)
    waiting = np.flatnonzero(edges.face_count == 1).tolist()
    while waiting:
        edge = waiting.pop()
        for owner in set(patch[face[by_edge[start[edge] : start[edge + 1]]]].tolist()):
            if not gone[owner]:
                gone[owner] = True
                for other in of_patch[owner]:
                    count[other] -= 1
                    if count[other] == 1:
                        waiting.append(other)
    return ~gone[patch]


def outer_hull(vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> np.ndarray:
    """The faces that bound the outside of cells divided by walls, facing outwards; no edge has one face alone.

    Around every edge each two neighbouring faces share a cell. Of the cells of connected faces the outside is the one
    whose volume, measured by its walls, is negative.
    """
    half, group, upward = faces_around_edges(faces, vertices, tolerance)
    last = np.flatnonzero(np.concatenate([group[1:] != group[:-1], [True]]))
    first = np.concatenate([[0], last[:-1] + 1])
    following = np.arange(len(half)) + 1
    following[last] = first
    # side 0 of a face is its front, side 1 its back; the front of an upward half-edge's face looks along the turn
    side = 2 * (half // 3)
    cell = components(side + ~upward, (side + upward)[following], 2 * len(faces))
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    measured = np.bincount(cell, np.stack([-volume, volume], axis=1).ravel())
    connected = joined_by_edges(edges_of(faces))
    order = np.lexsort((measured[cell], np.repeat(connected, 2)))
    outside = cell[order][np.unique(np.repeat(connected, 2)[order], return_index=True)[1]]
    is_outside = np.isin(cell, outside).reshape(-1, 2)
    bounds = is_outside[:, 0] != is_outside[:, 1]
    out = faces.copy()
    out[is_outside[:, 1]] = out[is_outside[:, 1]][:, ::-1]
    return out[bounds]
