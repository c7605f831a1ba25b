"""The closed surfaces of a mesh: which way each faces, which lie in which, and which of them bound the solid."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....kernels.section.half_edges import OPEN
from ....kernels.solids.nesting import wind_bodies
from .sheets import components, edges_of

SAMPLES = 64  # triangles of a body that are asked whether they lie in one that it touches


def agree_faces(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Turn triangles over until the two at every edge of two run along it in opposite directions.

    Each triangle appears twice in a graph, as it is and turned over; edges join copies that agree, so its components
    are the possible orientations of each patch. That in which more of the area is as it was is taken.
    Returns the faces, which were turned, and at how many edges nothing can agree.
    """
    count = len(faces)
    edges = edges_of(faces)
    by_edge = np.argsort(edges.of_half, kind="stable")
    plain = (np.cumsum(edges.face_count) - edges.face_count)[edges.face_count == 2]
    one, two = by_edge[plain] // 3, by_edge[plain + 1] // 3
    differ = (edges.balance[edges.of_half[by_edge[plain]]] != 0).astype(np.int64)
    label = components(
        np.concatenate([one, one + count]),
        np.concatenate([two + count * differ, two + count * (1 - differ)]),
        2 * count,
    )
    as_is, over = label[:count], label[count:]
    crossed = as_is == over
    area = np.bincount(as_is, areas_of(vertices, faces), minlength=int(label.max()) + 1)
    turned = ~crossed & ((area[over] > area[as_is]) | ((area[over] == area[as_is]) & (over < as_is)))
    out = faces.copy()
    out[turned] = out[turned][:, ::-1]
    return out, turned, int(np.count_nonzero(crossed[one] & (differ == 1)))


def normals_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals as long as twice the area, outwards of triangles that run counter-clockwise, shape [face, 3]."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def faces_front(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces' normals point to where their largest coordinate is positive: one of a sheet's two sides."""
    normal = normals_of(vertices, faces)
    return np.take_along_axis(normal, np.abs(normal).argmax(axis=1)[:, None], axis=1)[:, 0] > 0


def areas_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area of each triangle, shape [face]."""
    return np.linalg.norm(normals_of(vertices, faces), axis=1) / 2


def body_labels(twin: np.ndarray) -> np.ndarray:
    """Number of the body of each triangle: those joined through an edge's two sides (see `twins_of`)."""
    inner = np.flatnonzero(twin != OPEN)
    return components(inner // 3, twin[inner] // 3, len(twin) // 3)


def signed_volumes(vertices: np.ndarray, faces: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Volume of each body [m^3], negative if it faces inwards; measured from its own middle."""
    count = np.maximum(np.bincount(label), 1)
    middles = vertices[faces].mean(axis=1)
    middle = np.stack([np.bincount(label, middles[:, k]) / count for k in range(3)], axis=1)[label]
    a, b, c = (vertices[faces[:, k]] - middle for k in range(3))
    return np.bincount(label, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def flat_bodies(vertices: np.ndarray, faces: np.ndarray, label: np.ndarray, tolerance: float) -> np.ndarray:
    """Which bodies lie in a plane, within a tolerance, and enclose nothing: bool, shape [body]."""
    area = areas_of(vertices, faces)
    largest = largest_faces(area, label)
    normal = normals_of(vertices, faces)[largest]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    origin = vertices[faces[largest, 0]]
    out = np.ones(len(largest), bool)
    for corner in range(3):
        height = np.einsum("ij,ij->i", vertices[faces[:, corner]] - origin[label], normal[label])
        out[label[np.abs(height) > tolerance]] = False
    return out


def largest_faces(area: np.ndarray, label: np.ndarray) -> np.ndarray:
    """The face of each body that has the largest area, the first of several."""
    order = np.lexsort((-area, label))
    return order[np.unique(label[order], return_index=True)[1]]


def points_behind(
    vertices: np.ndarray, faces: np.ndarray, rows: np.ndarray, distance: float | np.ndarray
) -> np.ndarray:
    """Points this far behind the middles of some faces, on the side that their normals point away from."""
    normal = normals_of(vertices, faces[rows])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    return vertices[faces[rows]].mean(axis=1) - distance * normal


class Nest(NamedTuple):
    """What lies in what."""

    around: list[set[int]]
    """For each body those that it lies in wholly; they may touch."""
    outside: np.ndarray
    """For each body those around it that it does not touch, as rows of (body, other), int64, shape [pair, 2]."""


def nest_bodies(
    vertices: np.ndarray, faces: np.ndarray, label: np.ndarray, volume: np.ndarray, touching: np.ndarray, depth: float
) -> Nest:
    """Find for each body those that it lies in, by winding numbers at points just inside it.

    touching: pairs of bodies that cross or touch, the lower first, sorted, shape [pair, 2]; depth: how far inside the
    points lie. One point decides where bodies do not touch; where they do, `SAMPLES` of them must agree, which is asked
    only where one of the two faces inwards: a cavity may touch the body that it lies in.
    """
    body_count = len(volume)
    outward = np.where((volume < 0)[label][:, None], faces[:, ::-1], faces)
    rows = largest_faces(areas_of(vertices, faces), label)
    point, other, _ = wind_bodies(vertices, outward, label, points_behind(vertices, outward, rows, depth))
    own = point != other
    pair = np.stack([point[own], other[own]], axis=1)
    touches = np.isin(pair.min(axis=1) * body_count + pair.max(axis=1), touching @ [body_count, 1])
    around: list[set[int]] = [set() for _ in volume]
    for body, holder in pair[~touches].tolist():
        around[body].add(holder)
    asked = pair[touches & (volume[pair] < 0).any(axis=1)]
    parts = rows_of(label) if len(asked) else []
    for body, holder in asked.tolist():
        rows = parts[body][:: max(1, len(parts[body]) // SAMPLES)]
        points = points_behind(vertices, outward, rows, depth)
        held = outward[parts[holder]]
        if len(wind_bodies(vertices, held, np.zeros(len(held), np.int64), points)[0]) == len(points):
            around[body].add(holder)
    return Nest(around, pair[~touches])


def rows_of(label: np.ndarray) -> list[np.ndarray]:
    """The faces of each body."""
    return np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label))[:-1])


def resolve_signs(volume: np.ndarray, around: list[set[int]]) -> np.ndarray:
    """Which way each body should face: +1 a solid, -1 a cavity; from the outermost inwards.

    solid around it   faces     outermost body turned   becomes
    no                outward   either                  solid
    no                inward    either                  solid (turned)
    yes               inward    either                  cavity
    yes               outward   no                      solid (overlaps: to be united)
    yes               outward   yes                     cavity (turned: the whole nest was inside out)
    """
    sign = np.ones(len(volume), int)
    for body in sorted(range(len(volume)), key=lambda k: len(around[k])):
        solid_around = sum(sign[k] for k in around[body]) > 0
        outermost = [k for k in around[body] if not around[k]]
        turned = any(volume[k] < 0 for k in outermost)
        if solid_around and (volume[body] < 0 or turned):
            sign[body] = -1
    return sign


def alternating_signs(around: list[set[int]]) -> np.ndarray:
    """Which way each body should face under the even-odd rule: a cavity has an odd number of bodies around it."""
    return np.array([-1 if len(holders) % 2 else 1 for holders in around])


@dataclass(frozen=True)
class Bodies:
    """Bodies that face as they should."""

    rows: list[np.ndarray]
    """The faces of each."""
    sign: np.ndarray
    """+1 for a solid, -1 for a cavity."""
    around: list[set[int]]
    """For each those that it lies in."""
    outside: np.ndarray
    """Those around each that it does not touch, as sorted rows of (body, other)."""

    def level(self, members: np.ndarray) -> np.ndarray:
        """Winding number that bodies around each of these add, without those that it touches and these themselves."""
        first, last = (np.searchsorted(self.outside[:, 0], members, side=side) for side in ("left", "right"))
        own = np.repeat(np.arange(len(members)), last - first)
        rows = np.arange(len(own)) + np.repeat(first - (np.cumsum(last - first) - (last - first)), last - first)
        other = self.outside[rows, 1]
        weight = np.where(np.isin(other, members), 0, self.sign[other])
        return np.bincount(own, weight, minlength=len(members)).astype(np.int64)
