"""Numbers of text, polygons, strips and fans of mesh files as the arrays that every format becomes.

Numbers are read all, or refused with the line that is wrong; line ends of every system become LF.
"""

import re
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .....datasets.bounded_file import require_bytes
from ....errors import MeshError

_MARK = b"\xef\xbb\xbf"  # UTF-8's byte order mark
_SHOWN = 80


def plain_text(content: bytes) -> bytes:
    """Text without a byte order mark, each line ended by LF; raises MeshError for what is no text."""
    if b"\0" in content:
        raise MeshError("is no text: it holds NUL bytes")
    return content.removeprefix(_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def shown(line: bytes) -> str:
    """The begin of a line for a message."""
    return repr(" ".join(line.decode("utf-8", "replace").split())[:_SHOWN])


def numbers_of(lines: Sequence[bytes], kind: type = np.float64) -> np.ndarray:
    """All numbers of lines, one after the other, shape [number]; `kind` is float64 or int64.

    Raises MeshError, which shows the first line with anything else.
    """
    try:
        return _parsed(b" ".join(lines), kind)
    except (ValueError, DeprecationWarning):  # the latter by NumPy before 2.3, which then leaves out the rest
        for line in lines:
            try:
                _parsed(line, kind)
            except (ValueError, DeprecationWarning):
                raise wrong_line(line, "whole numbers" if kind is np.int64 else "numbers") from None
        raise


def wrong_line(line: bytes, wanted: str) -> MeshError:
    """The error for a line that does not hold what is wanted; names decimal commas where it has such."""
    if re.search(rb"\d,\d", line):
        wanted += " with decimal points, not commas"
    return MeshError(f"the line {shown(line)} must hold {wanted}")


def _parsed(text: bytes, kind: type) -> np.ndarray:
    if not text or text.isspace():  # NumPy reads a number of nothing but blanks
        return np.empty(0, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        return np.fromstring(text, kind, sep=" ")


VERTEX_BYTES = FACE_BYTES = 24  # of the arrays that every format becomes: float64 and int64
FOLDED = 1e-9  # share of a polygon's squared area below which a triangle that faces the other way is rounding
AREA_ROUNDING = 1e-6


class FileMesh(NamedTuple):
    """What a mesh file holds, in the file's units and axes."""

    vertices: np.ndarray
    """float64, shape [vertex, 3]."""
    faces: np.ndarray
    """int64, shape [face, 3]."""
    nodes: dict[str, np.ndarray] = {}  # noqa: RUF012 - never changed
    """Node -> file, by the name of the node: matrices [4, 4]; only glTF has nodes."""


def united(meshes: Sequence[FileMesh]) -> FileMesh:
    """All triangles of several meshes; of two nodes with one name the first counts."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    nodes: dict[str, np.ndarray] = {}
    for mesh in reversed(meshes):
        nodes |= mesh.nodes
    return FileMesh(
        np.concatenate([np.empty((0, 3)), *(mesh.vertices for mesh in meshes)]),
        np.concatenate([np.empty((0, 3), np.int64), *(mesh.faces + k for mesh, k in zip(meshes, first, strict=False))]),
        nodes,
    )


def polygon_triangles(corners: np.ndarray, counts: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Triangles of polygons, which may have corners that point inwards; as `fan_triangles` but for those."""
    faces = fan_triangles(corners, counts)
    counts = np.asarray(counts, np.int64)
    return faces if (counts <= 3).all() else unfolded(faces, np.asarray(corners, np.int64), counts, vertices)


def fan_triangles(corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Triangles of polygons, each a fan around its first corner; int64, shape [triangle, 3].

    corners: vertices of all polygons, one polygon after the other; counts: corners of each, shape [polygon]. A polygon
    of one or two corners has no area, and gives no triangle. Raises FileBoundError beyond the budget of a file.
    """
    counts, corners = np.asarray(counts, np.int64), np.asarray(corners, np.int64)
    triangles = np.maximum(counts - 2, 0)
    require_bytes(FACE_BYTES * int(triangles.sum()), "what its polygons become")
    if (counts == 3).all():
        return corners.reshape(-1, 3)
    polygon = np.repeat(np.arange(len(counts)), triangles)
    second = 1 + np.arange(len(polygon)) + (np.cumsum(counts) - counts - np.cumsum(triangles) + triangles)[polygon]
    out = np.empty((len(polygon), 3), np.int64)
    out[:, 0] = corners[(np.cumsum(counts) - counts)[polygon]]
    out[:, 1], out[:, 2] = corners[second], corners[second + 1]
    return out


def strip_triangles(corners: np.ndarray) -> np.ndarray:
    """Triangles of a strip, every second one turned; -1 ends a strip and begins the next; int64, shape [triangle, 3].

    Triangles with a corner twice, by which writers join strips, are left out.
    """
    corners = np.concatenate([[-1], np.asarray(corners, np.int64)])
    place = np.arange(len(corners))
    begin = np.maximum.accumulate(np.where(corners < 0, place, 0)) + 1
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    is_odd = (place - begin)[:-2] % 2 == 1
    triangles[is_odd] = triangles[is_odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(triangles >= 0).all(axis=1) & (a != b) & (b != c) & (c != a)]


def require_corners(faces: np.ndarray, vertex_count: int, what: str = "faces") -> None:
    """Raise MeshError for corners that are none of the vertices 0 to vertex_count - 1."""
    if faces.size and not (faces.min() >= 0 and faces.max() < vertex_count):
        raise MeshError(f"{what} name vertices {faces.min()} to {faces.max()}, but there are {vertex_count}, from 0 on")


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
