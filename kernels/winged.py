"""A mesh as a list of edges that know what lies on both sides: what slicing and chaining walk on."""

from typing import NamedTuple

import numpy as np
import warp as wp

OPEN = -1


@wp.struct
class WingedMesh:
    """Edges in ascending key; the key of an edge is its place in the list."""

    vertex: wp.array[wp.vec3]  # [m], shape [vertex]
    end: wp.array[wp.vec2i]  # lower and upper vertex, shape [edge]
    wing: wp.array2d[wp.vec3i]  # shape [edge, 2]: see WingedEdges


class WingedEdges(NamedTuple):
    """Edges of a triangle mesh on the host.

    `wing[edge, 0]` belongs to the triangle that runs along the edge from its lower to its upper vertex, `wing[edge, 1]`
    to the one that runs back. It holds the triangle's third vertex and the keys of its next and next but one edge;
    (OPEN, OPEN, OPEN) where there is no such triangle.
    """

    end: np.ndarray  # int32, shape [edge, 2]
    wing: np.ndarray  # int32, shape [edge, 2, 3]
    face: np.ndarray  # the triangles themselves, int32, shape [edge, 2]

    @property
    def open_count(self) -> int:
        """Edges with a triangle on one side only."""
        return int(np.count_nonzero(self.face.min(axis=1) == OPEN))


def wing_edges(faces: np.ndarray) -> WingedEdges:
    """Edges of a mesh, sorted by (lower vertex, upper vertex, rank).

    Where more than two triangles share an edge, the k-th of them in one direction is paired with the k-th in the
    other: the edge is listed once a pair, so that every contour through it stays a simple chain.

    faces: int, shape [face, 3], every face with three different vertices.
    """
    faces = np.asarray(faces, np.int64).reshape(-1, 3)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()  # half-edge 3 f + c runs from corner c to c + 1
    lower, upper, direction = np.minimum(tail, head), np.maximum(tail, head), (tail > head).astype(np.int64)
    order = np.lexsort((np.arange(len(tail)), direction, upper, lower))
    same = np.zeros(len(tail), bool)  # as the half-edge before it: same edge, same direction
    same[1:] = np.all(np.diff(np.stack([lower, upper, direction])[:, order], axis=1) == 0, axis=0)
    run_start = np.maximum.accumulate(np.where(same, 0, np.arange(len(tail))))
    rank = np.zeros(len(tail), np.int64)
    rank[order] = np.arange(len(tail)) - run_start
    triple, key = np.unique(np.stack([lower, upper, rank], axis=1), axis=0, return_inverse=True)
    key = key.reshape(-1, 3)
    wing = np.full((len(triple), 2, 3), OPEN, np.int32)
    third = np.roll(faces, 1, axis=1)
    content = np.stack([third, np.roll(key, -1, axis=1), np.roll(key, 1, axis=1)], axis=2).reshape(-1, 3)
    wing[key.ravel(), direction] = content
    face = np.full((len(triple), 2), OPEN, np.int32)
    face[key.ravel(), direction] = np.arange(len(tail)) // 3
    return WingedEdges(triple[:, :2].astype(np.int32), wing, face)


def upload_mesh(vertices: np.ndarray, edges: WingedEdges, device: str) -> WingedMesh:
    """Put a mesh on a device.

    vertices: [m], shape [vertex, 3], array frame.
    """
    mesh = WingedMesh()
    mesh.vertex = wp.array(np.ascontiguousarray(vertices, np.float32), dtype=wp.vec3, device=device)
    mesh.end = wp.array(edges.end, dtype=wp.vec2i, device=device)
    mesh.wing = wp.array(edges.wing, dtype=wp.vec3i, device=device)
    return mesh
