"""A region of skin as half-edges: where a curve on it goes on, where searches begin, and how its rim runs."""

from typing import Any

import numpy as np
import warp as wp

from ..section.half_edges import OPEN, forest_by_order, spatial_order, twins_of
from .refine import refine_faces

UNSCANNED = 2**31 - 1  # key of an edge that no search begins at
MIX = 2654435761  # odd, near 2^32 / golden ratio: neighbours' keys lie far apart


@wp.struct
class Skin:
    """A region of skin on a device. Half-edge h = 3 face + corner runs from that corner to the face's next."""

    source: wp.array[wp.vec3i]  # vertices of the hand that a vertex is a sum of, -1 for none; empty: one each, in order
    weight: wp.array[wp.vec3]
    vertex_count: wp.int32
    half: wp.array[wp.vec4i]  # vertex where it starts, twin or OPEN, key, and on the rim: the half-edge before it there
    scan: wp.array[wp.vec3i]  # in order of keys, on the rim and then within: half-edge, and vertices at its ends
    rim_count: wp.int32  # of scan, how many are on the rim
    rim: wp.array[wp.vec2i]  # each closed rim: one half-edge, and how many it has


class SkinEdges:
    """Topology of a region of skin on the host, refined to a step.

    vertices: [m], shape [pose, vertex, 3], one row for a rigid hand; faces: the region's, int, shape [face, 3],
    counter-clockwise seen from outside the hand, each edge in at most two of them, in opposite directions.
    step: longest edge [m]; None leaves the triangles as they are. Raises ValueError for too small a step.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, *, step: float | None = None) -> None:
        faces = np.asarray(faces, np.int64).reshape(-1, 3)
        self.used, faces = by_appearance(faces[spatial_order(vertices[0], faces)])
        """Vertices of the hand that the region has, in the order in which kernels get them, int64, shape [used]."""
        vertices = vertices[:, self.used]
        place = vertices[0].astype(np.float64)
        self.source, self.weight = np.zeros((0, 3), np.int64), np.zeros((0, 3), np.float32)
        refined = None if step is None else refine_faces(vertices, faces, step)
        if refined is not None and len(refined.faces) > len(faces):
            place = (place[np.maximum(refined.source, 0)] * refined.weight[..., None]).sum(axis=1)
            order, faces = by_appearance(refined.faces[spatial_order(place, refined.faces)])
            place, self.source, self.weight = place[order], refined.source[order], refined.weight[order]
        self.faces = faces
        """int64, shape [face, 3], of refined vertices."""
        self.twin = twins_of(faces)
        self.vertex_count = int(faces.max(initial=-1)) + 1
        self.before = rim_before(self.twin)
        self.rim_scan, self.inner_scan = scanned_halves(self.twin)
        self.rims = rims_of(self.before)

    def half_table(self) -> np.ndarray:
        """See `Skin.half`: int32, shape [half, 4]."""
        scan = np.concatenate([self.rim_scan, self.inner_scan])
        key = np.full(len(self.twin), UNSCANNED, np.int64)
        key[scan] = np.arange(len(scan))
        inner = self.inner_scan
        key[self.twin[inner]] = key[inner]
        return np.stack([self.faces.ravel(), self.twin, key, self.before], axis=1).astype(np.int32)


def by_appearance(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that faces have in order of appearance, and the faces renumbered so."""
    vertex, first, number = np.unique(faces.ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return vertex[order], rank[number.reshape(faces.shape)]


def rim_before(twin: np.ndarray) -> np.ndarray:
    """For a half-edge on the rim the one there that ends where it starts, found around that vertex; else OPEN."""
    half = np.arange(len(twin))
    prior = half - 1 + 3 * (half % 3 == 0)
    before = np.full(len(twin), OPEN, np.int64)
    own = half[twin == OPEN]
    at = prior[own]
    while len(own):
        there = twin[at] == OPEN
        before[own[there]] = at[there]
        own, at = own[~there], prior[twin[at[~there]]]
    return before


def scanned_halves(twin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half-edges that a search must look at, in the order of their keys: those on the rim, and those within.

    A curve within the region that closes leaves every forest over the faces, see `HalfEdges.scanned`. Keys are mixed,
    so that walking from a crossing to the next of a lower key takes few steps.
    """
    joined = forest_by_order(twin)
    scanned = twin > np.arange(len(twin))  # the lower of two
    scanned[joined] = False
    scanned[np.maximum(twin[joined], 0)] = False
    return shuffle_halves(np.flatnonzero(twin == OPEN)), shuffle_halves(np.flatnonzero(scanned))


def shuffle_halves(half: np.ndarray) -> np.ndarray:
    """The same in an order without pattern, fixed for ever."""
    return half[np.argsort(np.arange(len(half), dtype=np.uint64) * np.uint64(MIX) % np.uint64(2**32), kind="stable")]


def rims_of(before: np.ndarray) -> np.ndarray:
    """Closed rims, in order of their lowest half-edges: that, and how many half-edges; shape [rim, 2]."""
    left = set(np.flatnonzero(before != OPEN).tolist())
    rims = []
    for first in sorted(left):
        if first not in left:
            continue
        at, count = first, 0
        while at in left:
            left.remove(at)
            at, count = int(before[at]), count + 1
        rims.append((first, count))
    return np.array(rims, np.int64).reshape(-1, 2)


def upload_skin(edges: SkinEdges, device: str) -> Any:
    """Put a region of skin on a device, a Skin; its vertices travel apart, those named in `edges.used`."""
    out = Skin()
    out.source = wp.array(edges.source.astype(np.int32), dtype=wp.vec3i, device=device)
    out.weight = wp.array(edges.weight, dtype=wp.vec3, device=device)
    out.vertex_count = edges.vertex_count
    out.half = wp.array(edges.half_table(), dtype=wp.vec4i, device=device)
    scan = np.concatenate([edges.rim_scan, edges.inner_scan])
    ends = edges.faces.ravel()[scan], np.roll(edges.faces, -1, axis=1).ravel()[scan]
    out.scan = wp.array(np.stack([scan, *ends], axis=1).astype(np.int32), dtype=wp.vec3i, device=device)
    out.rim_count = len(edges.rim_scan)
    out.rim = wp.array(edges.rims.astype(np.int32), dtype=wp.vec2i, device=device)
    return out
