"""Flat parts of a mesh that lie in one place, cut into triangles in different ways: they are made repeats.

Two cubes that share a side need not share its diagonal. What is there twice is told by its triangles (`mesh_sheets`),
so both sides get the same ones; else which of them belongs to which cube would be a guess where one is inside out.
"""

import numpy as np

from .mesh_bodies import normals_of
from .mesh_sheets import edges_of, joined_by_pairs


def unify_patches(
    vertices: np.ndarray, faces: np.ndarray, times: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Faces of which flat patches with one rim have the same triangles, so that walls with other diagonals are repeats.

    A patch is what edges of two faces join. Of patches with the same rim that lie in one plane, within a tolerance, and
    have the same area, all get the triangles of the first.
    faces: int, shape [face, 3], each once; times: how often each is there, shape [face]. Returns both anew.
    """
    edges = edges_of(faces)
    rim = np.flatnonzero(edges.count[edges.of_half] > 2)
    if len(rim) == 0:
        return faces, times
    patch = joined_by_pairs(edges)
    order = np.lexsort((edges.of_half[rim], patch[rim // 3]))
    owner, edge = patch[rim // 3][order], edges.of_half[rim][order]
    first = np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]]))
    alike: dict[bytes, list[int]] = {}
    for number, own in zip(owner[first].tolist(), np.split(edge, first[1:]), strict=True):
        alike.setdefault(own.tobytes(), []).append(number)
    twice = [group for group in alike.values() if len(group) > 1]
    if not twice:
        return faces, times
    by_patch = np.argsort(patch, kind="stable")
    start = np.searchsorted(patch[by_patch], np.arange(int(patch.max()) + 2))
    kept, added, often = np.ones(len(faces), bool), [], []
    for group in twice:
        rows = [by_patch[start[k] : start[k + 1]] for k in group]
        sheets = [(own, *flat_patch(vertices, faces[own], tolerance)) for own in rows]
        flat = [sheet for sheet in sheets if sheet[1].any()]
        for own, normal, area in flat[1:]:
            model, model_normal, model_area = flat[0]
            if abs(area - model_area) <= 8 * tolerance * np.sqrt(area) and np.ptp(times[own]) == 0:
                kept[own] = False
                added.append(faces[model] if normal @ model_normal > 0 else faces[model][:, ::-1])
                often.append(np.full(len(model), times[own[0]]))
    return np.concatenate([faces[kept], *added]), np.concatenate([times[kept], *often])


def flat_patch(vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """The normal of a patch that lies in a plane, 0 of another one, and its area."""
    normals = normals_of(vertices, faces)
    sizes = np.linalg.norm(normals, axis=1)
    largest = normals[sizes.argmax()]
    normal = np.where((normals @ largest)[:, None] < 0, -normals, normals).sum(axis=0)
    normal /= np.linalg.norm(normal) or 1.0
    is_flat = np.ptp(vertices[faces] @ normal) <= tolerance
    return normal * is_flat, float(sizes.sum() / 2)
