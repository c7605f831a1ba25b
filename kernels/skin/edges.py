"""A region of skin as half-edges, refined: where a curve on it goes on, where searches begin, how its rim runs.

Triangles are made fine enough to march on: edges that are too long are halved, the same from both sides. Which edges a
round halves is asked of each edge alone, so neighbours agree and nothing gapes:

    one edge      two triangles, by its median
    two edges     the corner between them, and two triangles by the shorter of the two medians of the rest
    three edges   four triangles of half the size

A new vertex is a sum of at most three vertices of the mesh, with weights that are the same whatever pose it has.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..section.half_edges import OPEN, forest_by_order, spatial_order, twins_of

FACES_MOST = 2**22  # triangles that a skin may be refined to


@dataclass(frozen=True)
class Refined:
    """A refined mesh: vertices as weighted sums of the coarse mesh's."""

    faces: np.ndarray
    """int64, shape [face, 3]."""
    source: np.ndarray
    """Coarse vertices that each vertex is a sum of, int64, shape [vertex, 3]; in order, -1 for none."""
    weight: np.ndarray
    """Their weights, float32, exact, shape [vertex, 3]."""


@dataclass(frozen=True)
class Sized:
    """Triangles with the squares of their sides: side k from corner k to the next."""

    faces: np.ndarray
    longest: np.ndarray
    """Over all poses, or a bound of it [m^2], shape [face, 3]."""
    shortest: np.ndarray


def refine_faces(vertices: np.ndarray, faces: np.ndarray, step: float) -> Refined:
    """Refine triangles until no side is longer than `step` [m] at any pose.

    vertices: [m], float, shape [pose, vertex, 3] (one row for a rigid mesh); faces: int, shape [face, 3].
    With several poses a median's length is bounded by the sides', so it may be halved once more than it need be.
    Raises ValueError where more than FACES_MOST triangles would be needed.
    """
    faces = np.asarray(faces, np.int64).reshape(-1, 3)
    longest, shortest = side_squares(vertices, faces)
    if areas_of(shortest).sum() > FACES_MOST * np.sqrt(3) / 4 * step * step:  # of equilateral ones
        raise ValueError(f"a step of {step:g} m asks for more than {FACES_MOST} triangles")
    mesh = Sized(faces, longest, shortest)
    count = vertices.shape[1]
    source = np.stack([np.arange(count), np.full(count, -1), np.full(count, -1)], axis=1)
    weight = np.tile(np.float32([1, 0, 0]), (count, 1))
    while True:
        long = mesh.longest > step * step
        if not long.any():
            return Refined(mesh.faces, source, weight)
        if len(mesh.faces) + 3 * np.count_nonzero(long.any(axis=1)) > FACES_MOST:
            raise ValueError(f"a step of {step:g} m asks for more than {FACES_MOST} triangles")
        ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1)[long], axis=1)
        pair, number = np.unique(ends[:, 0] * len(source) + ends[:, 1], return_inverse=True)
        middle = np.full(long.shape, -1)
        middle[long] = len(source) + number.reshape(-1)
        added = halfway(source, weight, pair // len(source), pair % len(source))
        source, weight = np.vstack([source, added[0]]), np.vstack([weight, added[1]])
        mesh = split_sides(mesh, middle)


def side_squares(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greatest and least squares of the triangles' sides over all poses [m^2], each of shape [face, 3]."""
    longest, shortest = np.zeros(faces.shape), np.full(faces.shape, np.inf)
    for row in vertices:
        corner = row[faces].astype(np.float64)
        square = ((np.roll(corner, -1, axis=1) - corner) ** 2).sum(axis=2)
        np.maximum(longest, square, out=longest)
        np.minimum(shortest, square, out=shortest)
    return longest, shortest


def areas_of(square: np.ndarray) -> np.ndarray:
    """Areas of triangles by the squares of their sides [m^2], shape [face]; 0 where these make no triangle."""
    return np.sqrt(np.maximum(square.sum(axis=1) ** 2 - 2 * (square**2).sum(axis=1), 0.0)) / 4


def halfway(source: np.ndarray, weight: np.ndarray, one: np.ndarray, two: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sources and weights of the middles of pairs of vertices that lie in one coarse triangle."""
    idx = np.hstack([source[one], source[two]])
    share = 0.5 * np.hstack([weight[one], weight[two]])
    order = np.argsort(idx, axis=1, kind="stable")
    idx, share = np.take_along_axis(idx, order, axis=1), np.take_along_axis(share, order, axis=1)
    for k in range(1, 6):
        same = idx[:, k] == idx[:, k - 1]
        share[same, k] += share[same, k - 1]
        share[same, k - 1] = 0
    used = np.argsort(share == 0, axis=1, kind="stable")[:, :3]
    idx, share = np.take_along_axis(idx, used, axis=1), np.take_along_axis(share, used, axis=1)
    return np.where(share > 0, idx, -1), share.astype(np.float32)


def split_sides(mesh: Sized, middle: np.ndarray) -> Sized:
    """One round: each side with a middle (-1 for none) is halved there."""
    count = (middle >= 0).sum(axis=1)
    turn = np.select([count == 1, count == 2], [(middle >= 0).argmax(axis=1), (middle < 0).argmax(axis=1) + 1], 0) % 3
    around = (np.arange(3) + turn[:, None]) % 3  # one: it is side 0; two: side 2 is the whole one
    f, m, hi, lo = (np.take_along_axis(x, around, axis=1) for x in (mesh.faces, middle, mesh.longest, mesh.shortest))
    median = np.stack([(2 * hi[:, 2] + 2 * hi[:, 1] - lo[:, 0]) / 4, (2 * lo[:, 2] + 2 * lo[:, 1] - hi[:, 0]) / 4])
    other = np.stack([(2 * hi[:, 0] + 2 * hi[:, 2] - lo[:, 1]) / 4, (2 * lo[:, 0] + 2 * lo[:, 2] - hi[:, 1]) / 4])
    a, b, c, ab, bc, ca = *f.T, *m.T
    by_c = median[0] <= other[0]
    s, (h0, h1, h2), d, e = np.stack([hi, lo]), np.stack([hi, lo]).transpose(2, 0, 1) / 4, median, other
    cases = [
        (count == 0, (a, b, c), (s[:, :, 0], s[:, :, 1], s[:, :, 2])),
        (count == 1, (a, ab, c), (h0, d, s[:, :, 2])),
        (count == 1, (ab, b, c), (h0, s[:, :, 1], d)),
        (count == 2, (ab, b, bc), (h0, h1, h2)),
        ((count == 2) & by_c, (a, ab, c), (h0, d, s[:, :, 2])),
        ((count == 2) & by_c, (ab, bc, c), (h2, h1, d)),
        ((count == 2) & ~by_c, (a, ab, bc), (h0, h2, e)),
        ((count == 2) & ~by_c, (a, bc, c), (e, h1, s[:, :, 2])),
        (count == 3, (a, ab, ca), (h0, h1, h2)),
        (count == 3, (ab, b, bc), (h0, h1, h2)),
        (count == 3, (ca, bc, c), (h0, h1, h2)),
        (count == 3, (ab, bc, ca), (h2, h0, h1)),
    ]
    faces = np.vstack([np.stack([x[here] for x in corners], axis=1) for here, corners, _ in cases])
    sides = np.concatenate([np.stack([x[:, here] for x in side], axis=2) for here, _, side in cases], axis=1)
    return Sized(faces, sides[0], np.maximum(sides[1], 0.0))


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
