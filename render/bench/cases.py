"""Objects and poses of `palpate bench`: built-in ones, blobs of any number of triangles, random palms."""

import re

import numpy as np

from ...datasets.known_names import likely_name
from ...datasets.shapes.built_in import CENTRE, SIZE, shape_name, shape_names
from ..errors import StrategyError
from ..objects.mesh.solid_mesh import MeshObject

BLOB_FREQUENCY_MOST = 1000  # 20 million triangles
BLOB_SEED = 11
BLOB_OCTAVES = ((3.0, 5, 0.10), (6.0, 7, 0.055), (12.0, 9, 0.022), (24.0, 11, 0.008))  # wave number, waves, amplitude
BLOB_WELLS = 9  # concavities
BLOB_WELL_DEPTH = (0.35, 0.55)  # of the radius
BLOB_WELL_SHARPNESS = (14.0, 40.0)  # of exp(sharpness x (cosine - 1)): wells 20 to 35 degrees wide
BLOB_RADIUS_LEAST = 0.12  # of the mean: keeps the surface away from its own centre

_BLOB_NAME = re.compile(r"blob-(\d+)([kmKM]?)")


def bench_object(name: str) -> MeshObject:
    """An object to measure on: a built-in name, or `blob-N` with about N triangles (blob-5000, blob-100k, blob-1m).

    Raises StrategyError for another name.
    """
    if shape_name(name) is not None:
        return MeshObject.load(name)
    match = _BLOB_NAME.fullmatch(name)
    frequency = 0
    if match:
        wanted = int(match[1]) * {"": 1, "k": 1_000, "m": 1_000_000}[match[2].lower()]
        frequency = round(np.sqrt(wanted / 20.0))
    if not 1 <= frequency <= BLOB_FREQUENCY_MOST:
        raise StrategyError(
            f"unknown benchmark object {name!r}{likely_name(name, shape_names())}; known: {', '.join(shape_names())}, "
            f"and blob-N for N from 20 to {20 * BLOB_FREQUENCY_MOST**2} triangles (blob-5000, blob-100k, blob-1m)"
        )
    return blob_object(frequency)


def blob_object(frequency: int) -> MeshObject:
    """The blob of 20 x frequency^2 triangles, as an object."""
    vertices, faces = blob(frequency)
    return MeshObject(vertices, faces, name=f"blob-{len(faces)}")


def blob(frequency: int) -> tuple[np.ndarray, np.ndarray]:
    """An organic body: vertices [m], float32, shape [vertex, 3], array frame; triangles, int32, shape [face, 3].

    A geodesic sphere (icosahedron, every side cut in `frequency`) of 20 x frequency^2 triangles whose radius is a
    smooth function of direction, the same at every frequency: so it is star-shaped and cannot meet itself. It has deep
    concavities, lies inside the 130 mm cube centred at (0, 0, 0.2) m and is watertight, counter-clockwise from outside.
    """
    direction, faces = geodesic_sphere(frequency)
    step = np.arange(40_000)  # along a spiral that covers the sphere evenly
    height = 1.0 - (2.0 * step + 1.0) / len(step)
    turn = step * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - height**2)
    reference = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    points = reference * _blob_radius(reference)[:, None]
    low, high = points.min(axis=0), points.max(axis=0)
    scale = 0.995 * SIZE / (high - low).max()  # the reference misses the very tips
    placed = (direction * _blob_radius(direction)[:, None] - (low + high) / 2.0) * scale + CENTRE
    return placed.astype(np.float32), faces


def geodesic_sphere(frequency: int) -> tuple[np.ndarray, np.ndarray]:
    """An icosahedron whose sides are cut in `frequency`, on the unit sphere: directions [vertex, 3], triangles."""
    corner, side = _icosahedron()
    ends = np.sort(side[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    line_of = np.unique(ends, axis=0, return_inverse=True)[1].reshape(-1, 3)  # which of the 30, shape [side, 3]
    i, j = (index.ravel() for index in np.meshgrid(np.arange(frequency + 1), np.arange(frequency + 1), indexing="ij"))
    i, j = i[i + j <= frequency], j[i + j <= frequency]
    weight = np.stack([frequency - i - j, i, j], axis=1)  # of the side's three corners, shape [lattice, 3]
    inside = (weight > 0).all(axis=1)
    index = np.empty((20, len(weight)), np.int64)
    index[:, inside] = 12 + 30 * (frequency - 1) + np.arange(20 * inside.sum()).reshape(20, -1)
    for k in range(3):  # the line from corner k to corner k + 1, numbered from its lower corner
        on = weight[:, (k + 2) % 3] == 0
        a, b = side[:, k, None], side[:, (k + 1) % 3, None]
        step = np.where(a < b, weight[on, (k + 1) % 3], weight[on, k])
        index[:, on] = 12 + line_of[:, k, None] * (frequency - 1) + step - 1
    for k in range(3):
        index[:, weight[:, k] == frequency] = side[:, k, None]
    direction = np.empty((10 * frequency**2 + 2, 3))
    direction[index] = weight @ corner[side]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction, index[:, _lattice_triangles(frequency, i, j)].reshape(-1, 3).astype(np.int32)


def _lattice_triangles(frequency: int, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Triangles of one side as places in its lattice, shape [frequency^2, 3]."""
    place = np.full((frequency + 2, frequency + 2), -1)
    place[i, j] = np.arange(len(i))
    upright = i + j < frequency
    hanging = i + j < frequency - 1
    first = np.stack([place[i, j], place[i + 1, j], place[i, j + 1]], axis=1)[upright]
    second = np.stack([place[i + 1, j], place[i + 1, j + 1], place[i, j + 1]], axis=1)[hanging]
    return np.concatenate([first, second])


def _icosahedron() -> tuple[np.ndarray, np.ndarray]:
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corner = np.array([np.roll((0.0, s, t * golden), turn) for turn in range(3) for s in (-1, 1) for t in (-1, 1)])
    near = np.abs(np.linalg.norm(corner[:, None] - corner[None], axis=2) - 2.0) < 1e-9
    triples = [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] & near[b, c] & near[c, a]]
    side = np.array([t if np.linalg.det(corner[list(t)]) > 0.0 else t[::-1] for t in triples])
    return corner / np.linalg.norm(corner[0]), side


def _blob_radius(direction: np.ndarray) -> np.ndarray:
    """Radius over direction, mean about 1, shape [direction]: octaves of plane waves, less some wells."""
    # Raw bits are the one stream of numpy that no version may change.
    stream = np.random.PCG64(BLOB_SEED)

    def draw(count: int, low: float, high: float) -> np.ndarray:
        return low + (high - low) * stream.random_raw(count) / 2.0**64

    def draw_directions(count: int) -> np.ndarray:
        height, turn = draw(count, -1.0, 1.0), draw(count, 0.0, 2.0 * np.pi)
        flat = np.sqrt(1.0 - height**2)
        return np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)

    radius = np.ones(len(direction))
    for wave_number, count, amplitude in BLOB_OCTAVES:
        for wave, phase in zip(draw_directions(count), draw(count, 0.0, 2.0 * np.pi), strict=True):
            radius += amplitude * np.cos(wave_number * (direction @ wave) + phase)
    wells = draw_directions(BLOB_WELLS), draw(BLOB_WELLS, *BLOB_WELL_DEPTH), draw(BLOB_WELLS, *BLOB_WELL_SHARPNESS)
    for well, depth, sharpness in zip(*wells, strict=True):
        radius -= depth * np.exp(sharpness * (direction @ well - 1.0))
    # A smooth floor: wells that meet would reach the centre.
    return BLOB_RADIUS_LEAST + np.logaddexp(0.0, 12.0 * (radius - BLOB_RADIUS_LEAST)) / 12.0


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    """Independent palms, float32, shape [pose, 7]: x y z [m], qx qy qz qw.

    Centres uniform in the objects' 130 mm cube at (0, 0, 0.2) m, orientations uniform on SO(3); a count and a seed give
    the same poses every time, another count gives others.
    """
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-SIZE / 2, SIZE / 2, size=(count, 3)) + np.array(CENTRE)
    turn = rng.normal(size=(count, 4))
    return np.concatenate([centre, turn / np.linalg.norm(turn, axis=1, keepdims=True)], axis=1).astype(np.float32)
