"""Finer triangles from coarser ones: bisection of long edges, quadrisection, Loop's smooth subdivision.

All take and give vertices, shape [vertex, 3], and triangles, shape [face, 3], of a closed mesh; orientation is kept.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Triangles = NDArray[np.int32]


def bisect(points: Points, triangles: Triangles, *, count: int) -> tuple[Points, Triangles]:
    """Split the longest edge in its middle until the mesh has `count` triangles (two more each time)."""
    point = [tuple(row) for row in points.tolist()]
    rows: list[list[int]] = triangles.tolist()
    # Directed edge -> the corner opposite to it; a triangle is three of these.
    third = {(row[i], row[i - 2]): row[i - 1] for row in rows for i in range(3)}

    def entry(a: int, b: int) -> tuple[float, int, int]:
        # Rounded: edges that mirror each other are equally long, and the order of equals must not hang on a last bit.
        return -round(float(np.linalg.norm(np.subtract(point[a], point[b]))), 9), min(a, b), max(a, b)

    queue = [entry(a, b) for a, b in third if a < b]
    heapq.heapify(queue)
    face_count = len(triangles)
    while face_count < count:
        _, a, b = heapq.heappop(queue)
        middle = len(point)
        point.append(tuple(np.add(point[a], point[b]) / 2.0))
        for start, end in ((a, b), (b, a)):
            corner = third.pop((start, end))
            for edge, opposite in (
                ((start, middle), corner), ((middle, corner), start), ((corner, start), middle),
                ((middle, end), corner), ((end, corner), middle), ((corner, middle), end),
            ):  # fmt: skip
                third[edge] = opposite
            heapq.heappush(queue, entry(middle, corner))
        heapq.heappush(queue, entry(a, middle))
        heapq.heappush(queue, entry(middle, b))
        face_count += 2
    faces = sorted((a, b, c) for (a, b), c in third.items() if a < b and a < c)
    return np.array(point), np.array(faces, dtype=np.int32)


def quadrisect(points: Points, triangles: Triangles) -> tuple[Points, Triangles]:
    """Split each triangle into four by the middles of its edges; the old points come first."""
    edge, index = _edges(triangles)
    return np.concatenate([points, points[edge].mean(axis=1)]), _four_parts(triangles, index + len(points))


def smooth_surface(points: Points, triangles: Triangles) -> tuple[Points, Triangles]:
    """Split each triangle into four with Loop's weights (C. Loop 1987, Warren's simple vertex rule)."""
    edge, index = _edges(triangles)
    opposite = np.zeros((len(edge), 3))
    ring = np.zeros_like(points)
    for corner in range(3):
        np.add.at(opposite, index[:, corner], points[triangles[:, (corner + 2) % 3]])
    for a, b in ((0, 1), (1, 0)):
        np.add.at(ring, edge[:, a], points[edge[:, b]])
    valence = np.bincount(edge.ravel(), minlength=len(points))[:, None]
    weight = np.where(valence == 3, 3.0 / 16.0, 3.0 / (8.0 * valence))
    kept = (1.0 - valence * weight) * points + weight * ring
    middle = 0.375 * points[edge].sum(axis=1) + 0.125 * opposite
    return np.concatenate([kept, middle]), _four_parts(triangles, index + len(points))


def _edges(triangles: Triangles) -> tuple[Triangles, Triangles]:
    """Undirected edges, shape [edge, 2], and the edge from each corner to the next, shape [face, 3]."""
    directed = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    edge, index = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    return edge, index.reshape(-1, 3).astype(np.int32)


def _four_parts(triangles: Triangles, middle: Triangles) -> Triangles:
    a, b, c = triangles.T
    ab, bc, ca = middle.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3).astype(np.int32)
