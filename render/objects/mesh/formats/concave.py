"""Polygons with corners that point inwards: their fans fold over, so that they are cut into other triangles."""

import numpy as np

FOLDED = 1e-9  # share of a polygon's squared area below which a triangle that faces the other way is rounding
AREA_ROUNDING = 1e-6


def unfolded(faces: np.ndarray, corners: np.ndarray, counts: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """The fans of polygons, those that fold over replaced by as many triangles that lie within their polygon.

    faces: fans, polygon by polygon, shape [triangle, 3]; corners: vertices of all polygons, one polygon after the
    other; counts: corners of each. A fan stays where no such triangles are found: its folds cancel out in the winding
    number.
    """
    triangles = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), triangles)
    normals = _normals(vertices[faces])
    totals = np.stack([np.bincount(polygon, normals[:, k], len(counts)) for k in range(3)], axis=1)
    along = np.einsum("ij,ij->i", normals, totals[polygon])
    folded = np.unique(polygon[along < -FOLDED * np.einsum("ij,ij->i", totals, totals)[polygon]])
    begins, firsts = np.cumsum(counts) - counts, np.cumsum(triangles) - triangles
    for index in folded:
        own = corners[begins[index] : begins[index] + counts[index]]
        if (cut := _cut(vertices[own], totals[index])) is not None:
            faces[firsts[index] : firsts[index] + triangles[index]] = own[cut]
    return faces


def _normals(corners: np.ndarray) -> np.ndarray:
    """Normals of triangles, as long as twice their area, shape [triangle, 3]."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _cut(points: np.ndarray, normal: np.ndarray) -> np.ndarray | None:
    """Triangles of one polygon, seen along its normal, shape [corner - 2, 3]; None if they would fold over, too."""
    import manifold3d  # 20 MB of geometry that most meshes never need

    drop = int(np.argmax(np.abs(normal)))
    axes = [(1, 2), (2, 0), (0, 1)][drop]
    flat = points[:, axes] if normal[drop] > 0 else points[:, axes] * (-1, 1)
    cut = np.asarray(manifold3d.triangulate([np.ascontiguousarray(flat - flat.mean(axis=0))]), np.int64)
    if len(cut) != len(points) - 2:
        return None
    normals = _normals(points[cut])
    length = np.einsum("i,i->", normal, normal)
    is_within = (np.einsum("ij,j->i", normals, normal) >= -FOLDED * length).all()
    is_whole = np.abs(normals.sum(axis=0) - normal).max() <= AREA_ROUNDING * np.abs(normal).max()
    return cut if is_within and is_whole else None
