"""A triangle soup as a mesh: close vertices are one, flat triangles go, repeats have the same triangles.

The order of the file is forgotten: vertices are sorted by coordinates, faces by their corners.

Triangles of zero area with a corner on their opposite side (`without_slivers`) are taken out, and their neighbours cut
at that corner. Programs that put a corner on a side close the surface with them. As they are, every triangle beside
them would seem to touch or cross the one across, and around an edge they have no angle.

Two cubes that share a side need not share its diagonal. What is there twice is recognised by its triangles (`sheets`),
so both sides get the same ones; else which of them belongs to which cube would be a guess where one is inside out.
A triangle that is there twice in the same direction is no wall if two bodies on one side of it end there.
"""

import numpy as np

from ....kernels.section.half_edges import group_starts, order_of, twins_of
from ...errors import MeshError
from .bodies import areas_of, body_labels, largest_faces, normals_of, signed_volumes
from .sheets import edges_of, joined_by_edges, joined_by_pairs

ROUNDING = 2.0**-22  # of a mesh's size: two steps of float32, in which meshes are stored and cut


def check_soup(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse what is not a mesh at all, naming the row."""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"vertices must be [vertex, 3] and faces [face, 3], not {vertices.shape} and {faces.shape}")
    if len(faces) == 0:
        raise MeshError("the mesh has no triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        row = int(np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))[0])
        raise MeshError(f"face {row} names vertex {faces[row].tolist()}, but there are {len(vertices)} vertices")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{len(bad)} vertices are not finite, the first is vertex {bad[0]}: {vertices[bad[0]].tolist()}"
        )


def rounding_of(vertices: np.ndarray) -> float:
    """Distance within which float32 cannot tell a mesh's places apart, in its own unit.

    float32 coordinates are rounded by their distance from the origin, others as if the mesh lay around it.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = float(np.max(high - low))
    if np.array_equal(vertices, vertices.astype(np.float32)):
        size = max(size, float(np.abs(vertices).max()))
    return ROUNDING * size


def weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices of equal coordinates, sorted by them; vertices that no face has disappear."""
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    rows = np.flatnonzero(used)
    points = vertices[rows] + 0.0  # -0 is 0
    order = coordinate_order(points)
    points = points[order]
    fresh = group_starts(*points.T)
    number = np.empty(len(vertices), np.int64)
    number[rows[order]] = np.repeat(np.arange(len(fresh)), np.diff(fresh, append=len(points)))
    return points[fresh], number[faces]


def coordinate_order(points: np.ndarray) -> np.ndarray:
    """Order of points by x, then y, then z; that of equal ones is anything.

    Few points of a scan share their x, and only those are sorted by the others.
    """
    x = points[:, 0]
    order = np.arange(len(x)) if (x[1:] >= x[:-1]).all() else np.argsort(x)
    x = x[order]
    same = x[1:] == x[:-1]
    tied = np.zeros(len(x), bool)
    tied[1:] |= same
    tied[:-1] |= same
    rows = order[tied]
    order[tied] = rows[np.lexsort(points[rows].T[::-1])]
    return order


def weld_close(vertices: np.ndarray, faces: np.ndarray, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices that a chain of steps of at most `distance` joins, each into the first of them by coordinates."""
    from scipy.sparse import coo_matrix  # a tenth of a second that only this costs
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    tree = KDTree(vertices, balanced_tree=False, compact_nodes=False)
    one, two = tree.query_pairs(distance, output_type="ndarray").T
    if len(one) == 0:
        return vertices, faces
    graph = coo_matrix((np.ones(len(one), bool), (one, two)), shape=(len(vertices), len(vertices)))
    label = connected_components(graph, directed=False)[1]
    _, first = np.unique(label, return_index=True)
    return weld(vertices[first[label]], faces)


def sorted_faces(faces: np.ndarray) -> np.ndarray:
    """Faces without those that have a corner twice, each from its lowest corner on, in the order of their corners."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    first = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return faces[order_of(*faces.T[::-1])]


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
