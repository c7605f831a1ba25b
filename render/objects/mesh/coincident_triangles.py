"""Triangles of a mesh that lie in one place: told by their directions, and made equal where they are cut differently.

Two cubes that share a side need not share its diagonal. What is there twice is told by its triangles (`mesh_sheets`),
so both sides get the same ones; else which of them belongs to which cube would be a guess where one is inside out.
A triangle that is there twice in the same direction is no wall if two bodies on one side of it end there.
"""

import numpy as np

from ....kernels.section.half_edges import twins_of
from .bodies import body_labels, largest_faces, normals_of, signed_volumes
from .sheets import edges_of, joined_by_edges, joined_by_pairs


def count_repeats(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle once, in the direction that it has most often, and how often it has that one and the other.

    Returns faces, int, shape [face, 3], and counts, shape [face, 2]. faces: each from its lowest corner on.
    """
    corners = np.sort(faces, axis=1)
    forward = faces[:, 1] < faces[:, 2]
    once, index = np.unique(corners, axis=0, return_inverse=True)
    counts = np.stack(
        [np.bincount(index.ravel(), forward == way, minlength=len(once)) for way in (True, False)], axis=1
    )
    back = counts[:, 0] < counts[:, 1]
    once[back] = once[back][:, ::-1]
    return once, np.sort(counts.astype(np.int64), axis=1)[:, ::-1]


def repeated(faces: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The reverse of `count_repeats`, in another order."""
    return np.concatenate([np.repeat(faces, counts[:, 0], axis=0), np.repeat(faces[:, ::-1], counts[:, 1], axis=0)])


def unify_patches(
    vertices: np.ndarray, faces: np.ndarray, counts: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Faces of which flat patches with one rim have the same triangles, so that walls with other diagonals are repeats.

    A patch is what edges of two faces join. Of patches with the same rim that lie in one plane, within a tolerance, and
    have the same area, all get the triangles of the first. Takes and returns what `count_repeats` does.
    """
    edges = edges_of(faces)
    rim = np.flatnonzero(edges.face_count[edges.of_half] > 2)
    if len(rim) == 0:
        return faces, counts
    patch = joined_by_pairs(edges)
    order = np.lexsort((edges.of_half[rim], patch[rim // 3]))
    owner, edge = patch[rim // 3][order], edges.of_half[rim][order]
    first = np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]]))
    alike: dict[bytes, list[int]] = {}
    for number, own in zip(owner[first].tolist(), np.split(edge, first[1:]), strict=True):
        alike.setdefault(own.tobytes(), []).append(number)
    twice = [group for group in alike.values() if len(group) > 1]
    if not twice:
        return faces, counts
    by_patch = np.argsort(patch, kind="stable")
    start = np.searchsorted(patch[by_patch], np.arange(int(patch.max()) + 2))
    normal, area, flat = patch_planes(vertices, faces, patch, tolerance)
    kept, added, often = np.ones(len(faces), bool), [], []
    for group in twice:
        sheets = [number for number in group if flat[number]]
        for number in sheets[1:]:
            own, model = (by_patch[start[k] : start[k + 1]] for k in (number, sheets[0]))
            alike_area = abs(area[number] - area[sheets[0]]) <= 8 * tolerance * np.sqrt(area[number])
            if alike_area and (counts[own] == counts[own[0]]).all():
                kept[own] = False
                added.append(faces[model] if normal[number] @ normal[sheets[0]] > 0 else faces[model][:, ::-1])
                often.append(np.tile(counts[own[0]], (len(model), 1)))
    return np.concatenate([faces[kept], *added]), np.concatenate([counts[kept], *often])


def patch_planes(
    vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The normal of each patch, looking as its largest triangle does, its area, and whether it lies in a plane."""
    normals = normals_of(vertices, faces)
    size = np.linalg.norm(normals, axis=1)
    count = int(patch.max()) + 1
    ahead = np.sign(np.einsum("ij,ij->i", normals, normals[largest_faces(size, patch)][patch]))
    normal = np.stack([np.bincount(patch, ahead * normals[:, k], minlength=count) for k in range(3)], axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    height = np.einsum("ijk,ik->ij", vertices[faces], normal[patch])
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, patch, height.min(axis=1))
    np.maximum.at(high, patch, height.max(axis=1))
    return normal, np.bincount(patch, size / 2, minlength=count), high - low <= tolerance


def split_shared(
    vertices: np.ndarray, faces: np.ndarray, tolerance: float, turn: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Faces where a repeat is a repeat, and those of surfaces where it is a side of two bodies, which need it twice.

    The latter are surfaces (all that edges join) along whose every edge as many faces run one way as the other, and
    not so once repeats are left out. Bodies of theirs that are inside out are turned first: what both had is then a
    wall between them.
    """
    once, counts = count_repeats(faces)
    net = counts[:, 0] - counts[:, 1]
    edges = edges_of(once)
    ahead = np.where(once < np.roll(once, -1, axis=1), 1, -1)
    surface = joined_by_edges(edges)
    uneven = []
    for times in (net, np.minimum(net, 1)):
        balance = np.bincount(edges.of_half, (ahead * times[:, None]).ravel())
        uneven.append(np.isin(surface, surface[np.flatnonzero(balance[edges.of_half]) // 3]))
    shared = ~uneven[0] & uneven[1]
    if not shared.any():
        return faces, faces[:0]
    rest = repeated(once[~shared], counts[~shared])
    owned = np.repeat(net[shared], net[shared])
    out = np.repeat(once[shared], net[shared], axis=0)
    label = body_labels(twins_of(out, vertices, tolerance))
    inverted = (signed_volumes(vertices, out, label) < 0) & (np.bincount(label, owned > 1) > 0)
    if not (turn and inverted.any()):
        return rest, out
    out[inverted[label]] = out[inverted[label]][:, ::-1]
    more, out = split_shared(vertices, out, tolerance, turn=False)
    return np.concatenate([rest, more]), out
