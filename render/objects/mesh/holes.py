"""The rims of a mesh's holes, and lids over those that are small."""

import numpy as np

from ....kernels.section.half_edges import OPEN
from .sheets import closed_part, components
from .welding import sorted_faces, weld, weld_close

WELD_SHARES = (1e-6, 1e-5, 1e-4, 1e-3)  # of a mesh's size, within which merging vertices is tried to close it


def rims_of(faces: np.ndarray, twin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The open half-edges, the one that follows each along its rim (as a row of them), and the number of its rim.

    faces: int, shape [face, 3]; twin: as `twins_of` gives it.
    """
    rim = np.flatnonzero(twin == OPEN)
    row = np.full(len(twin), -1)
    row[rim] = np.arange(len(rim))
    at = 3 * (rim // 3) + (rim + 1) % 3
    while True:
        inner = np.flatnonzero(twin[at] != OPEN)
        if len(inner) == 0:
            break
        across = twin[at[inner]].astype(np.int64)
        at[inner] = 3 * (across // 3) + (across + 1) % 3
    following = row[at]
    return rim, following, components(np.arange(len(rim)), following, len(rim))


def rim_lengths(vertices: np.ndarray, faces: np.ndarray, rim: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Length of each rim, in the mesh's unit."""
    tail, head = faces.ravel()[rim], np.roll(faces, -1, axis=1).ravel()[rim]
    return np.bincount(number, np.linalg.norm(vertices[head] - vertices[tail], axis=1))


def fill_holes(
    vertices: np.ndarray, faces: np.ndarray, twin: np.ndarray, length: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Close every hole whose rim is at most `length` long by triangles from its rim to the middle of its corners.

    Returns vertices and faces with those of the lids after them, and how many holes were closed.
    """
    rim, _, number = rims_of(faces, twin)
    if len(rim) == 0:
        return vertices, faces, 0
    small = rim_lengths(vertices, faces, rim, number) <= length
    middle_of = np.cumsum(small) - 1 + len(vertices)
    kept = small[number]
    tail, head = faces.ravel()[rim][kept], np.roll(faces, -1, axis=1).ravel()[rim][kept]
    number = number[kept]
    count = np.bincount(number, minlength=len(small))[:, None]
    sums = np.stack([np.bincount(number, vertices[tail][:, k], minlength=len(small)) for k in range(3)], axis=1)
    lids = np.stack([head, tail, middle_of[number]], axis=1)
    middles = (sums / np.maximum(count, 1))[small]
    return np.vstack([vertices, middles]), np.vstack([faces, lids]), int(small.sum())


def closing_distance(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The least of some distances within which merging vertices leaves no open edge, in the mesh's unit; 0 for none."""
    for share in WELD_SHARES:
        distance = float(share * np.ptp(vertices, axis=0).max())
        joined = sorted_faces(weld_close(*weld(vertices, faces), distance)[1])
        if len(joined) and closed_part(joined).all():
            return distance
    return 0.0
