"""Triangles of skin made fine enough to march on: edges that are too long are halved, the same from both sides.

Which edges a round halves is asked of each edge alone, so neighbours agree and nothing gapes:

    one edge      two triangles, by its median
    two edges     the corner between them, and two triangles by the shorter of the two medians of the rest
    three edges   four triangles of half the size

A new vertex is a sum of at most three vertices of the mesh, with weights that are the same whatever pose it has.
"""

from dataclasses import dataclass

import numpy as np

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
