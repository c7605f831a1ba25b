"""How far two surfaces are from each other at most."""

import numpy as np

from ...kernels.solids.nearest import MeshDistance

TRIANGLES_MOST = 2_000_000  # pieces under way at once: about 300 MB
AT_ONCE = 500_000  # pieces that are measured in one go
ROUNDING = 1e-6  # of float32, against the size of the two: distances may be off by this

Mesh = tuple[np.ndarray, np.ndarray]


def hausdorff_distance(
    one: Mesh, other: Mesh, *, accuracy: float, limit: float | None = None, device: str = "cpu"
) -> tuple[float, float]:
    """The Hausdorff distance between two meshes, both ways: a distance that occurs, and one that none exceeds [m].

    one, other: vertices [m], shape [vertex, 3], and faces, shape [face, 3].
    The two differ by `accuracy` [m] at most, unless that would take more than `TRIANGLES_MOST` pieces.
    limit: given if all that is asked is whether this distance [m] is exceeded; then work ends as soon as that is known.
    """
    there = farthest_distance(one, other, accuracy=accuracy, limit=limit, device=device)
    if limit is not None and there[0] > limit:
        return there
    back = farthest_distance(other, one, accuracy=accuracy, limit=limit, device=device)
    return max(there[0], back[0]), max(there[1], back[1])


def farthest_distance(
    source: Mesh, target: Mesh, *, accuracy: float, limit: float | None = None, device: str = "cpu"
) -> tuple[float, float]:
    """The largest distance of a point of one surface from another: see `hausdorff_distance`.

    Each triangle has the distance of its middle and a bound for all of its points; those that may hold more than the
    largest distance found, and the accuracy, are halved across their longest side.
    """
    vertices, faces = np.asarray(source[0], np.float64), source[1]
    distance = MeshDistance(np.asarray(target[0], np.float64), target[1], device)
    triangle = vertices[faces]
    rounding = ROUNDING * float(max(np.ptp(mesh[0], axis=0).max() for mesh in (source, target)))
    corner = np.unique(faces)
    known = float(distance.bound_distances(np.repeat(vertices[corner][:, None], 3, axis=1))[0].max())
    settled = known
    while len(triangle):
        parts = [distance.bound_distances(triangle[k : k + AT_ONCE]) for k in range(0, len(triangle), AT_ONCE)]
        at, above = (np.concatenate(part) for part in zip(*parts, strict=True))
        known = max(known, float(at.max()))
        if limit is not None and known > limit:
            return known, max(settled, float(above.max())) + rounding
        still_open = above > max(known + accuracy - rounding, (limit or 0.0) - rounding)
        if 2 * np.count_nonzero(still_open) > TRIANGLES_MOST:
            return known, max(settled, float(above.max())) + rounding
        settled = max(settled, float(above[~still_open].max(initial=0.0)))
        triangle = halved(triangle[still_open])
    return known, max(known, settled) + rounding


def halved(triangle: np.ndarray) -> np.ndarray:
    """Triangles, shape [triangle, 3, 3], as two each, cut across the longest side."""
    side = np.linalg.norm(triangle - np.roll(triangle, -1, axis=1), axis=2).argmax(axis=1)
    a, b, c = (np.take_along_axis(triangle, ((side + k) % 3)[:, None, None], axis=1)[:, 0] for k in range(3))
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
