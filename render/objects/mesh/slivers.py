"""Triangles of zero area with a corner on their opposite side: taken out, and their neighbours cut at that corner.

Programs that put a corner on a side close the surface with them. As they are, every triangle beside them would seem to
touch or cross the one across, and around an edge they have no angle.
"""

import numpy as np

from .bodies import areas_of
from .sheets import edges_of
from .welding import sorted_faces

ROUNDS = 64  # each cuts a side once; sides have seldom more corners on them than this


def without_slivers(vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> tuple[np.ndarray, int]:
    """Sorted faces without those whose height is at most a tolerance, and how many these were.

    Where the longest side of one has no other triangle, it is kept.
    """
    count = 0
    for _ in range(ROUNDS):
        sides = np.linalg.norm(vertices[np.roll(faces, -1, axis=1)] - vertices[faces], axis=2)
        longest = sides.argmax(axis=1)
        flat = np.flatnonzero(2 * areas_of(vertices, faces) <= tolerance * sides.max(axis=1, initial=0.0))
        if len(flat) == 0:
            break
        edges = edges_of(faces)
        by_edge = np.argsort(edges.of_half, kind="stable")
        start = np.cumsum(edges.face_count) - edges.face_count
        gone, added, taken = np.zeros(len(faces), bool), [], 0
        for face, half in zip(flat.tolist(), (3 * flat + longest[flat]).tolist(), strict=True):
            edge = edges.of_half[half]
            others = by_edge[start[edge] : start[edge] + edges.face_count[edge]]
            if len(others) == 1 or gone[others // 3].any():
                continue
            gone[others // 3] = True
            taken += 1
            tip = faces[face, (longest[face] + 2) % 3]
            for other in others[others // 3 != face].tolist():
                a, b, c = np.roll(faces[other // 3], -(other % 3))
                added += [[a, tip, c], [tip, b, c]]
        if not taken:
            break
        count += taken
        faces = sorted_faces(np.concatenate([faces[~gone], np.array(added, np.int64).reshape(-1, 3)]))
    return faces, count
