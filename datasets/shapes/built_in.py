"""The paper's objects, made by code: cube, sphere, tube, dog (coarse and smooth) and rock; and a boulder.

Each is one closed shell that does not intersect itself, oriented outwards (counter-clockwise seen from outside), inside
a 130 mm cube centred at (0, 0, 0.2) m of the array frame, and as long as that cube in its longest dimension; z is up.

| name         | triangles | what                                                                                      |
|--------------|-----------|-------------------------------------------------------------------------------------------|
| cube         | 12        | 130 mm                                                                                    |
| sphere       | 1,280     | an icosahedron divided three times, vertices at 65 mm from the centre                     |
| tube         | 256       | upright: hollow 32-gon along z, vertices at 65 and 40 mm, 130 mm long, open at both ends  |
| dog          | 136       | standing, nose towards -x: its profile faces a user who sits at -y                        |
| dog-detailed | 1,160     | the same dog, rounded                                                                     |
| rock         | 320       | the paper's: a flat slab that lies, with lobes of different sizes around it               |
| boulder      | 320       | an irregular boulder with facets, wider than high                                         |
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..errors import ShapeError, name_nothing
from ..known_names import find_name, unknown_name
from .dog import dog_cage, dog_tips
from .subdivision import bisect, quadrisect, smooth_surface

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]

SIZE = 0.13
"""Longest dimension of every shape [m]."""
CENTRE = (0.0, 0.0, 0.2)
"""Middle of every shape's bounds, array frame [m]."""

TUBE_SIDES = 32
TUBE_INNER = 0.04  # [m]
ROCK_SEED, BOULDER_SEED = 3, 7
ROCK_THICKNESS = 0.34
"""Half thickness of the rock over the mean radius of its outline."""
ROCK_LOBES = ((2, 0.14, 0.5), (3, 0.11, 2.1), (5, 0.11, 0.3))
"""Waves of the rock's outline: how many around it, amplitude over the mean radius, phase [rad]."""
ROCK_BLUNTNESS = 3.0
"""Exponent of the rock's profile: 2 is an ellipse, more is a slab with a blunter edge."""
BOULDER_CUTS = 14


def shape_names() -> tuple[str, ...]:
    """Names of the built-in shapes, as `shape`, `MeshObject.load` and the command line take them.

    >>> from palpate.render import shape_names
    >>> shape_names()
    ('cube', 'sphere', 'tube', 'dog', 'dog-detailed', 'rock', 'boulder')
    """
    return tuple(_SHAPES)


def shape_name(name: object) -> str | None:
    """The built-in shape that is written so, in any case; None if there is none."""
    return find_name(name, _SHAPES)


def shape(name: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Make a built-in shape: vertices [m], shape [vertex, 3], array frame, and triangles, shape [face, 3].

    The same arrays every time; name: in any case. Raises ShapeError for an unknown name, listing the known ones.

    >>> from palpate.datasets import shape
    >>> vertices, triangles = shape("cube")
    >>> vertices.max(axis=0), triangles.shape
    (array([0.065, 0.065, 0.265], dtype=float32), (12, 3))
    """
    found = shape_name(name)
    if found is None:
        raise name_nothing(ShapeError(unknown_name("shape", name, _SHAPES)))
    points, triangles = _SHAPES[found]()
    low, high = points.min(axis=0), points.max(axis=0)
    placed = (points - (low + high) / 2.0) * (SIZE / (high - low).max()) + CENTRE
    return placed.astype(np.float32), triangles


def _cube() -> Mesh:
    points = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return points, _triangles(quads)


def _sphere(divisions: int = 3) -> Mesh:
    points, triangles = _icosahedron()
    for _ in range(divisions):
        points, triangles = quadrisect(points, triangles)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, triangles


def _icosahedron() -> Mesh:
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corner = [(0.0, s, t * golden) for s in (-1.0, 1.0) for t in (-1.0, 1.0)]
    points = np.array([np.roll(row, turn) for turn in range(3) for row in corner])
    length = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.abs(length - 2.0) < 1e-9
    triples = [
        (a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[c, a]
    ]
    outwards = [t if np.linalg.det(points[list(t)]) > 0.0 else t[::-1] for t in triples]
    return points / np.linalg.norm(points[0]), np.array(outwards, dtype=np.int32)


def _tube() -> Mesh:
    angle = np.arange(TUBE_SIDES) * (2.0 * np.pi / TUBE_SIDES)
    outline = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = [(SIZE / 2.0, -1.0), (SIZE / 2.0, 1.0), (TUBE_INNER, 1.0), (TUBE_INNER, -1.0)]  # radius, end
    points = [np.column_stack([radius * outline, np.full(TUBE_SIDES, end * SIZE / 2.0)]) for radius, end in rings]
    quads: list[tuple[int, ...]] = []
    for ring in range(4):
        a, b = ring * TUBE_SIDES, (ring + 1) % 4 * TUBE_SIDES
        for i in range(TUBE_SIDES):
            j = (i + 1) % TUBE_SIDES
            quads.append((a + i, a + j, b + j, b + i))
    return np.concatenate(points), _triangles(quads)


def _dog_detailed() -> Mesh:
    coarse, triangles = bisect(*dog_cage(), count=290)
    # Smoothing shrinks a body: start from a cage that overshoots by most of what it will lose.
    cage = coarse + 0.8 * (coarse - smooth_surface(coarse, triangles)[0][: len(coarse)])
    points, triangles = smooth_surface(cage, triangles)
    points[:, 2] = np.maximum(points[:, 2], 0.0)  # flat paws
    tips = (coarse[:, None] == dog_tips()).all(axis=2).any(axis=1)
    points[: len(coarse)][tips] = coarse[tips]  # pointed ears: both dogs fill the same bounds
    return points, triangles


def _rock() -> Mesh:
    """A slab: a blunt ball pressed flat, its outline drawn in and out by lobes, its surface a little rough.

    Star-shaped, so it cannot meet itself.
    """
    direction, triangles = _sphere(divisions=2)
    across = np.hypot(direction[:, 0], direction[:, 1])
    blunt = (across**ROCK_BLUNTNESS + np.abs(direction[:, 2]) ** ROCK_BLUNTNESS) ** (-1.0 / ROCK_BLUNTNESS)
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    outline = 1.0 + sum(size * np.cos(count * angle + phase) for count, size, phase in ROCK_LOBES)
    rough = 1.0 + 0.025 * (2.0 * _random(ROCK_SEED, len(direction)) - 1.0)
    points = direction * (blunt * rough)[:, None]
    return points * np.stack([outline, outline, np.full_like(outline, ROCK_THICKNESS)], axis=1), triangles


def _boulder() -> Mesh:
    """A boulder: a ball cut by planes at random, its facets roughened. Star-shaped, so it cannot meet itself."""
    direction, triangles = _sphere(divisions=2)
    random = _random(BOULDER_SEED, 3 * BOULDER_CUTS + len(direction))
    height, turn, depth = random[: 3 * BOULDER_CUTS].reshape(3, BOULDER_CUTS)
    flat = np.sqrt(1.0 - (2.0 * height - 1.0) ** 2)
    normal = np.stack([flat * np.cos(2.0 * np.pi * turn), flat * np.sin(2.0 * np.pi * turn), 2.0 * height - 1.0])
    cut = (0.62 + 0.3 * depth) / np.maximum(direction @ normal, 1e-3)
    radius = np.minimum(1.0, cut.min(axis=1)) * (1.0 + 0.05 * (2.0 * random[3 * BOULDER_CUTS :] - 1.0))
    return direction * radius[:, None] * (1.0, 0.85, 0.7), triangles


def _random(seed: int, count: int) -> NDArray[np.float64]:
    """Numbers of 0 to 1, shape [count]: raw bits are the one stream of NumPy that no version may change."""
    return np.random.PCG64(seed).random_raw(count) / 2.0**64


def _triangles(quads: list[tuple[int, ...]]) -> NDArray[np.int32]:
    return np.array([half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))], dtype=np.int32)


_SHAPES: dict[str, Callable[[], Mesh]] = {
    "cube": _cube,
    "sphere": _sphere,
    "tube": _tube,
    "dog": dog_cage,
    "dog-detailed": _dog_detailed,
    "rock": _rock,
    "boulder": _boulder,
}
