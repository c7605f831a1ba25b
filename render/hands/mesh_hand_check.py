"""What a hand mesh must be before curves are drawn on it: one skin, facing outwards, with a region that has a rim."""

from typing import NamedTuple

import numpy as np

from ...kernels.section.half_edges import OPEN, twins_of
from ..errors import MeshError
from ..user_warnings import warn_user

SIZE_LARGEST = 1.0  # [m]; a hand is 0.2 m long


class HandSurface(NamedTuple):
    """A hand mesh that was judged."""

    vertices: np.ndarray
    """[m], hand frame, float32, shape [row, vertex, 3]."""
    faces: np.ndarray
    """Counter-clockwise from outside, int32, shape [face, 3]."""
    glabrous: np.ndarray
    """Which faces curves are drawn on, bool, shape [face]."""


def checked_hand(name: str, vertices: np.ndarray, faces: np.ndarray, glabrous: np.ndarray | None) -> HandSurface:
    """Check a hand mesh and mend what can be mended, with a warning.

    vertices: [m], shape [vertex, 3] or [pose, vertex, 3]; faces: int, shape [face, 3]; glabrous: bool, shape [face], or
    None for all. Vertices in the same place at every pose become one. Raises MeshError for what is no hand mesh.
    """
    vertices = checked_vertices(name, vertices)
    faces = checked_faces(name, faces, vertices.shape[1])
    glabrous = checked_region(name, glabrous, len(faces))
    welded_from, number = welded(vertices, faces)
    vertices, faces = vertices[:, welded_from], number[faces]
    alive = living_faces(name, vertices, faces)
    faces, glabrous = faces[alive], glabrous[alive]
    used, faces = np.unique(faces, return_inverse=True)
    vertices, welded_from, faces = vertices[:, used], welded_from[used], faces.reshape(-1, 3)
    if not glabrous.any():
        raise MeshError(f"{name}: the glabrous region has no triangle: curves are drawn on it alone")
    require_manifold(name, faces, welded_from)
    twin = twins_of(faces)
    if not (twin == OPEN).any() and volume_of(vertices[0], faces) < 0:
        text = f"{name}: faces inwards; all {len(faces)} triangles were turned over"
        warn_user(text)
        faces = faces[:, ::-1]
    require_rim(name, faces[glabrous], len(faces))
    warn_of_size(name, vertices)
    return HandSurface(vertices, np.ascontiguousarray(faces, np.int32), glabrous)


def checked_vertices(name: str, vertices: np.ndarray) -> np.ndarray:
    """Vertices as float32, shape [row, vertex, 3]."""
    try:
        out = np.asarray(vertices, np.float32)
    except (TypeError, ValueError):
        raise MeshError(f"{name}: vertices must be numbers, shape [vertex, 3] or [pose, vertex, 3]") from None
    if out.ndim not in (2, 3) or out.shape[-1] != 3 or 0 in out.shape:
        raise MeshError(f"{name}: vertices must have shape [vertex, 3] or [pose, vertex, 3], not {list(out.shape)}")
    out = out.reshape(-1, *out.shape[-2:]) + np.float32(0)  # a copy; -0 is 0
    bad = np.argwhere(~np.isfinite(out).all(axis=2))
    if len(bad):
        where = f"vertex {bad[0, 1]}" + (f" at pose {bad[0, 0]}" if len(out) > 1 else "")
        raise MeshError(f"{name}: {where} is not finite ({len(bad)} such vertices in all)")
    return out


def checked_faces(name: str, faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Faces as int64, shape [face, 3]."""
    try:
        out = np.asarray(faces)
    except ValueError:  # rows of several lengths
        raise MeshError(f"{name}: faces must be integers of shape [face, 3]") from None
    if out.ndim != 2 or out.shape[1] != 3 or out.dtype.kind not in "iu" or not len(out):
        raise MeshError(f"{name}: faces must be integers of shape [face, 3], not {out.dtype} {list(out.shape)}")
    out = out.astype(np.int64)
    if out.min() < 0 or out.max() >= vertex_count:
        bad = int(np.argwhere((out < 0) | (out >= vertex_count))[0, 0])
        raise MeshError(f"{name}: face {bad} names vertices {out[bad].tolist()}, but there are {vertex_count}")
    return out


def checked_region(name: str, glabrous: np.ndarray | None, face_count: int) -> np.ndarray:
    """The mask of the glabrous region."""
    if glabrous is None:
        return np.ones(face_count, bool)
    try:
        out = np.asarray(glabrous)
    except ValueError:
        raise MeshError(f"{name}: glabrous must be a mask of the {face_count} faces") from None
    if out.shape != (face_count,) or out.dtype.kind not in "biu" or not np.isin(out, (0, 1)).all():
        raise MeshError(
            f"{name}: glabrous must be a mask of the {face_count} faces, bool of shape [{face_count}], "
            f"not {out.dtype} {list(out.shape)}"
        )
    return out.astype(bool)


def welded(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the vertices that stay, and which of these each vertex has become; unused ones disappear."""
    used = np.unique(faces)
    rows = np.ascontiguousarray(vertices[:, used].transpose(1, 0, 2)).reshape(len(used), -1)
    _, first, same = np.unique(rows.view(f"V{rows.shape[1] * 4}").ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    number = np.full(vertices.shape[1], -1)
    number[used] = rank[same.ravel()]
    return used[first[order]], number


def living_faces(name: str, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces that are triangles, bool, shape [face]: no corner twice, no repeat, some area or two neighbours."""
    a, b, c = faces.T
    alive = (a != b) & (b != c) & (c != a)
    order = np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    first = np.zeros(len(faces), bool)
    first[np.unique(order, axis=0, return_index=True)[1]] = True
    alive &= first
    flat = np.ones(len(faces), bool)
    for row in vertices:
        corner = row[faces[flat]].astype(np.float64)
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        flat[flat] = area == 0
    while (flat & alive).any():  # one that falls can leave another at the rim
        index = np.flatnonzero(alive)
        inner = (twins_of(faces[index]) != OPEN).reshape(-1, 3).sum(axis=1)
        falls = flat[index] & (inner < 2)  # with more neighbours the surface closes through it
        if not falls.any():
            break
        alive[index[falls]] = False
    if not alive.all():
        count = len(faces) - int(alive.sum())
        warn_user(
            f"{name}: {count} of {len(faces)} triangles were dropped: a corner twice, no area, or a repeat of another"
        )
    return alive


def require_manifold(name: str, faces: np.ndarray, original: np.ndarray) -> None:
    """Raise MeshError, naming the vertices, for an edge of three triangles and for neighbours that disagree."""
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    pair = np.stack([np.minimum(tail, head), np.maximum(tail, head)], axis=1)
    edge, number, count = np.unique(pair, axis=0, return_inverse=True, return_counts=True)
    if (count > 2).any():
        one, two = original[edge[count > 2][0]]
        raise MeshError(
            f"{name}: the edge between vertices {one} and {two} is shared by {count[count > 2][0]} triangles "
            f"({(count > 2).sum()} such edges in all): a skin has one side there and one behind, no more"
        )
    along = np.bincount(number.ravel(), weights=tail < head)
    wrong = (count == 2) & (along != 1)
    if wrong.any():
        one, two = original[edge[wrong][0]]
        raise MeshError(
            f"{name}: the two triangles at the edge between vertices {one} and {two} are wound against each other "
            f"({wrong.sum()} such edges in all): turn one over (trimesh.repair.fix_winding)"
        )


def require_rim(name: str, region: np.ndarray, face_count: int) -> None:
    """Raise MeshError for a region without boundary."""
    if (twins_of(region) == OPEN).any():
        return
    what = "all of a closed mesh" if len(region) == face_count else "a closed surface of its own"
    raise MeshError(
        f"{name}: the glabrous region is {what} ({len(region)} triangles) and has no boundary to close contours along: "
        "name the skin that feels, as glabrous=facing_palm(vertices, faces)"
    )


def volume_of(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume [m^3], negative if a closed mesh faces inwards."""
    a, b, c = (vertices[faces[:, k]].astype(np.float64) - vertices.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def warn_of_size(name: str, vertices: np.ndarray) -> None:
    """Warn of a hand that is in millimetres by its looks."""
    size = np.ptp(vertices.reshape(-1, 3), axis=0)
    if size.max() > SIZE_LARGEST:
        warn_user(
            f"{name}: is {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} m; a size like this suggests millimetres: "
            "use scale=0.001"
        )
