"""From arrays to contours under permutations: the order of triangles, vertices, bodies and corners changes no byte.

Lengths of the solids that are made of boxes are known from their rectangles, whose union is shapely's.
"""

import warnings
from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely
from mesh_cases import CLOSED, MESHES, MIDDLE, generic_poses
from scipy.spatial.transform import Rotation
from section_oracle import in_palm
from voxel_complexes import Complex, as_indexed, as_soup, triangles_of

from palpate.render import MeshObject, Palm, closed_contour, open_contour, render

HALF = (0.2, 0.15)  # of the palm [m]
ONE = np.ones((1, 1, 1), bool)


@dataclass
class Case:
    """Triangles [m], shape [triangle, 3, 3], and the boxes that they are, by lowest and highest corner."""

    triangles: np.ndarray
    boxes: list[tuple[np.ndarray, np.ndarray]]
    sheets: list[np.ndarray] = field(default_factory=list)
    """Open rectangles, as corners in order: drawn by OC."""
    looked_at: np.ndarray = field(default_factory=lambda: MIDDLE)
    """Where the palms are, about."""
    spread: float = 0.04


def box(low, high, seed=0, turned=False):
    """Triangles of a box with random diagonals."""
    rng = np.random.default_rng(seed)
    cube = triangles_of(Complex(ONE, 0, True, False), rng) * (np.subtract(high, low)) + np.asarray(low)
    return cube[:, ::-1] if turned else cube


def of_boxes(*boxes, turned=(), **more):
    """A case of some boxes, given by their corners [m], relative to MIDDLE."""
    placed = [(np.add(low, MIDDLE), np.add(high, MIDDLE)) for low, high in boxes]
    parts = [box(low, high, 7 + k, k in turned) for k, (low, high) in enumerate(placed)]
    return Case(np.concatenate(parts), placed, **more)


def of_voxels(filled, size, walls, diagonals=True):
    """A case of voxels [m], their faces between two filled ones 0, 1 or 2 times there."""
    rng = np.random.default_rng(5)
    low = MIDDLE - 0.5 * size * np.array(filled.shape)
    triangles = triangles_of(Complex(filled, walls, diagonals, False), rng) * size + low
    return Case(triangles, [(low + size * at, low + size * (at + 1)) for at in np.argwhere(filled)])


def sheet(corners, fan):
    """A rectangle of two triangles, from corner `fan` on."""
    corners = np.roll(corners, -fan, axis=0)
    return corners[[[0, 1, 2], [0, 2, 3]]]


def upright(x, y0, y1, z0, z1):
    return MIDDLE + np.array([[x, y0, z0], [x, y1, z0], [x, y1, z1], [x, y0, z1]])


def sharing_a_face():
    return of_boxes(((-0.05, -0.03, -0.03), (0, 0.03, 0.03)), ((0, -0.03, -0.03), (0.05, 0.03, 0.03)))


def twice_with_other_diagonals():
    low, high = (-0.03,) * 3, (0.03,) * 3
    case = of_boxes((low, high))
    return Case(np.concatenate([case.triangles, box(*case.boxes[0], seed=11)]), case.boxes)


def voxels_with_walls(walls):
    return lambda: of_voxels(np.ones((4, 4, 4), bool), 0.025, walls)


def checkerboard():
    return of_voxels(np.indices((3, 3, 3)).sum(axis=0) % 2 == 0, 0.03, 2)


def sheets_with_backs():
    """A box, and beside it sheets of two triangles a side, the back with the other diagonal; one hangs on the box."""
    case = of_boxes(((-0.03,) * 3, (0.03,) * 3))
    parts = [case.triangles]
    for corners in (upright(0.05, -0.02, 0.02, -0.02, 0.02), upright(0.06, -0.02, 0.02, -0.02, 0.02)):
        parts += [sheet(corners, 0), sheet(corners, 1)[:, ::-1]]
    fin = MIDDLE + np.array([[0.03, 0.03, -0.03], [0.05, 0.05, -0.03], [0.05, 0.05, 0.03], [0.03, 0.03, 0.03]])
    return Case(np.concatenate([*parts, sheet(fin, 0), sheet(fin, 1)[:, ::-1]]), case.boxes)


def overlapping_beside_a_sheet():
    case = of_boxes(((-0.05, -0.03, -0.03), (0.01, 0.03, 0.03)), ((-0.01, -0.02, -0.02), (0.05, 0.02, 0.035)))
    corners = upright(0.07, -0.02, 0.03, -0.05, 0.05)
    return Case(np.concatenate([case.triangles, sheet(corners, 0)]), case.boxes, [corners])


def jittered_soup():
    """Three boxes apart, each corner of each triangle off by up to 1e-9 m."""
    case = of_boxes(*(((x, -0.02, -0.02), (x + 0.03, 0.02, 0.02)) for x in (-0.07, -0.02, 0.03)))
    noise = np.random.default_rng(3).uniform(-1e-9, 1e-9, case.triangles.shape)
    return Case(case.triangles + noise, case.boxes)


def speck_in_a_face():
    """A box of 4 m and a cube of 0.1 mm, half in its face."""
    at = np.array([0.0, 0.0, 2.0])
    boxes = [((-2, -2, -2), (2, 2, 2)), (at - 5e-5, at + 5e-5)]
    return of_boxes(*boxes, looked_at=MIDDLE + at, spread=3e-5)


def inside_and_flush():
    """A box within another that reaches its end: they have that side in common."""
    case = of_boxes(((-0.05, -0.03, -0.03), (0.05, 0.03, 0.03)))
    end = np.array([[0.02, -0.03, -0.03], [0.05, 0.03, 0.03]]) + MIDDLE
    return Case(np.concatenate([case.triangles, box(*end, seed=7)]), case.boxes)


CASES = {
    "two boxes sharing a face": sharing_a_face,
    "the same cube twice with other diagonals": twice_with_other_diagonals,
    "64 voxels with walls once": voxels_with_walls(1),
    "64 voxels with walls twice": voxels_with_walls(2),
    "checkerboard": checkerboard,
    "sheets with backs": sheets_with_backs,
    "overlapping boxes beside an open sheet": overlapping_beside_a_sheet,
    "jittered soup": jittered_soup,
    "speck in a face": speck_in_a_face,
    "box in a box, flush": inside_and_flush,
}


def poses_around(case, count=9):
    """Palms across each of the axes, their middles anywhere, shape [pose, 7], float64."""
    rng = np.random.default_rng(9)
    turns = [Rotation.from_quat([0.5, 0.5, 0.5, 0.5]) ** k for k in range(3)]  # axes to axes, all exact
    at = case.looked_at + rng.uniform(-case.spread, case.spread, (count, 3))
    return np.array([[*x, *turns[k % 3].as_quat()] for k, x in enumerate(at)])


def lengths_of(case, pose):
    """CC and OC [m] of a palm across an axis: of the union of rectangles, cut by the palm's."""
    palm = shapely.box(-HALF[0], -HALF[1], HALF[0], HALF[1])
    flat = []
    for corners in case.boxes:
        low, high = np.sort(in_palm(np.array(corners), pose), axis=0)
        if low[2] < 0 < high[2]:
            flat.append(shapely.box(*low[:2], *high[:2]))
    solid = shapely.union_all(flat, grid_size=1e-12)
    closed = solid.intersection(palm).length if flat else 0.0
    rings = solid.boundary.intersection(palm).difference(palm.boundary).length if flat else 0.0
    for corners in case.sheets:
        local = in_palm(corners, pose)
        if local[:, 2].min() < 0 < local[:, 2].max():
            cut = [
                a + (b - a) * a[2] / (a[2] - b[2])
                for a, b in zip(local, np.roll(local, -1, axis=0), strict=True)
                if a[2] * b[2] < 0
            ]
            rings += shapely.LineString([x[:2] for x in cut]).intersection(palm).length
    return closed, rings


def loaded(vertices, faces):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return MeshObject(vertices, faces)


def content(batch):
    host = batch.numpy()
    return tuple(getattr(host, name).tobytes() for name in ("points", "kind", "polyline_start", "pose_start"))


def permuted(triangles, rng):
    """The same triangles in another order, from other corners on, with common vertices or not."""
    turn = (rng.integers(0, 3, len(triangles))[:, None] + np.arange(3)) % 3
    triangles = np.take_along_axis(triangles, turn[:, :, None], axis=1)[rng.permutation(len(triangles))]
    return as_soup(triangles) if rng.random() < 0.5 else as_indexed(triangles, rng)


def drawn(case, triangles, poses, rng, device):
    """Contours by CC and OC of triangles in some order."""
    thing = loaded(*permuted(triangles, rng))
    return [
        render(thing, Palm(2 * HALF[0], 2 * HALF[1]), poses, strategy, device=device)
        for strategy in (closed_contour(), open_contour())
    ]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", CASES)
def test_order_changes_nothing_and_lengths_are_those_of_rectangles(name, device):
    case = CASES[name]()
    poses = poses_around(case)
    want = np.array([lengths_of(case, pose) for pose in poses.astype(np.float32).astype(float)])
    assert (want[:, 0] > 0).sum() >= 4
    rng = np.random.default_rng(2)
    first = None
    for _ in range(5):
        batches = drawn(case, case.triangles, poses.astype(np.float32), rng, device)
        for batch, column in zip(batches, want.T, strict=True):
            assert batch.length() == pytest.approx(column, abs=1e-5)
        first = first or [content(batch) for batch in batches]
        assert [content(batch) for batch in batches] == first


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", MESHES)
def test_order_changes_no_byte_of_the_meshes_of_the_tests(name, device):
    vertices, faces = MESHES[name]()
    poses = generic_poses(12, seed=4)
    strategies = [open_contour()] + [closed_contour()] * (name in CLOSED)
    rng = np.random.default_rng(6)
    first = None
    for _ in range(4):
        thing = loaded(*permuted(np.asarray(vertices, float)[faces], rng))
        assert thing.is_simple
        batches = [render(thing, Palm(), poses, strategy, device=device) for strategy in strategies]
        assert sum(batch.length().sum() for batch in batches) > 0
        first = first or [content(batch) for batch in batches]
        assert [content(batch) for batch in batches] == first
