"""Random solids of voxels as triangles: with inner walls, other diagonals, cubes inside out; and their sections."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

CORNER = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
# the corners of each face counter-clockwise from outside, and the way out
FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
OUT = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])


@dataclass(frozen=True)
class Complex:
    """Some voxels and how their faces are written down."""

    filled: np.ndarray
    walls: int
    """How often faces between two filled voxels are there: 0, 1 or 2."""
    diagonals: bool
    """Whether each face has a diagonal of its own; else the two sides of a wall have the same."""
    turned: bool
    """Whether some cubes are inside out."""

    def is_exact(self):
        """Whether the triangles say what is solid: a cavity within walls or beside turned cubes can be either."""
        return not has_cavity(self.filled) or (self.walls != 1 and not self.turned)


def has_cavity(filled):
    """Whether empty voxels cannot be left through faces."""
    label, _ = ndimage.label(np.pad(~filled, 1, constant_values=True))
    return bool((label > 1).any())


def random_complex(rng, side=4):
    shape = rng.integers(2, side + 1, 3)
    filled = rng.random(shape) < rng.choice([0.25, 0.5, 0.75, 1.0])
    filled[tuple(rng.integers(0, shape))] = True
    walls = int(rng.integers(0, 3))
    return Complex(filled, walls, bool(rng.integers(2)), walls == 2 and bool(rng.integers(2)))


def quads_of(complex_, rng):
    """Corners of the squares, int, shape [square, 4, 3], counter-clockwise from where they look."""
    filled = np.pad(complex_.filled, 1)
    quads = []
    for voxel in np.argwhere(complex_.filled):
        flip = complex_.turned and rng.random() < 0.3
        for face, out in zip(FACES, OUT, strict=True):
            is_wall = filled[tuple(voxel + out + 1)]
            if is_wall and (complex_.walls == 0 or (complex_.walls == 1 and out.sum() < 0)):
                continue
            quad = voxel + CORNER[face]
            quads.append(quad[::-1] if flip or (is_wall and complex_.walls == 1 and rng.random() < 0.5) else quad)
    return np.array(quads)


def triangles_of(complex_, rng):
    """Corners of the triangles, float64, shape [triangle, 3, 3], in any order and from any corner on."""
    quads = quads_of(complex_, rng)
    even = np.roll(quads, 1, axis=1)
    swap = rng.random(len(quads)) < 0.5
    if not complex_.diagonals:  # the same for both sides of a wall: from the corner with the lowest coordinates
        order = np.array([min(range(4), key=lambda k, q=quad: tuple(q[k])) for quad in quads])
        swap = order % 2 == 1
    quads = np.where(swap[:, None, None], even, quads)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(float)
    turn = (rng.integers(0, 3, len(triangles))[:, None] + np.arange(3)) % 3
    return np.take_along_axis(triangles, turn[:, :, None], axis=1)[rng.permutation(len(triangles))]


def with_slivers(triangles, rng):
    """Some triangles cut in two from a corner to a point of a side, and a triangle of no area along that side."""
    out = []
    for a, b, c in triangles:
        if rng.random() < 0.2:
            point = a + (b - a) * rng.choice([0.25, 0.5, 0.75])
            out += [[a, point, c], [point, b, c], [a, b, point]]
        else:
            out.append([a, b, c])
    return rng.permutation(np.array(out))


def layer_outline(filled, axis, layer):
    """Area and length of the boundary of the section through the middles of a layer of voxels, in voxels."""
    flat = np.pad(np.take(filled, layer, axis=axis), 1)
    return int(flat.sum()), int((flat[1:] != flat[:-1]).sum() + (flat[:, 1:] != flat[:, :-1]).sum())


def mesh_outline(vertices, faces, axis, height):
    """Area and length of the section of a mesh by a plane through none of its vertices."""
    x = np.roll(vertices, -1 - axis, axis=1)[faces]  # the axis comes last
    above = x[:, :, 2] > height
    x, above = x[above.any(axis=1) != above.all(axis=1)], above[above.any(axis=1) != above.all(axis=1)]
    ends = []
    for down in (True, False):
        leaves = (above if down else ~above) & np.roll(~above if down else above, -1, axis=1)
        p, q = x[leaves], np.roll(x, -1, axis=1)[leaves]
        ends.append(p[:, :2] + ((height - p[:, 2]) / (q[:, 2] - p[:, 2]))[:, None] * (q - p)[:, :2])
    start, end = ends
    area = 0.5 * (start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]).sum()
    return area, np.linalg.norm(end - start, axis=1).sum()


def volume_of(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces] - vertices.mean(axis=0), 1, 0)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def as_soup(triangles):
    """Every triangle with corners of its own."""
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def as_indexed(triangles, rng):
    """Every place one vertex, in any order."""
    vertices, number = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    place = rng.permutation(len(vertices))
    return vertices[place], np.argsort(place)[number.reshape(-1, 3)]
