"""Winding numbers of bodies around points: boxes and octahedra by their inequalities, others by their solid angle."""

from dataclasses import dataclass

import numpy as np
import pytest
from depth_oracle import windings
from mesh_cases import CLOSED

from palpate.kernels.solids import nesting as nesting_module
from palpate.kernels.solids.nesting import wind_bodies

OCTAHEDRON = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], float)
EIGHT_FACES = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


@dataclass
class Ball:
    """Where a norm of the way from the middle is below a size: a cube or an octahedron, perhaps inside out."""

    middle: np.ndarray
    size: float
    is_cube: bool
    sign: int
    diagonals: np.ndarray

    def mesh(self):
        turned = np.stack([np.roll(quad, k) for quad, k in zip(QUADS, self.diagonals, strict=True)])
        twelve = np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])
        faces = twelve if self.is_cube else EIGHT_FACES
        return self.middle + self.size * (CUBE if self.is_cube else OCTAHEDRON), faces[:, :: self.sign]

    def depth(self, x):
        """How far inside points lie, in that norm; 0 on the surface."""
        return self.size - np.linalg.norm(x - self.middle, np.inf if self.is_cube else 1, axis=1)


def random_balls(rng, count):
    return [
        Ball(
            rng.integers(-4, 5, 3).astype(float),
            float(rng.integers(1, 5)),
            bool(rng.integers(2)),
            int(rng.choice([-1, 1])),
            rng.integers(0, 2, 6),
        )
        for _ in range(count)
    ]


def as_bodies(meshes):
    """Vertices, faces and the body of each face; equal places are one vertex."""
    shift = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = np.concatenate([own + k for (_, own), k in zip(meshes, shift, strict=False)])
    vertices, number = np.unique(np.concatenate([vertices for vertices, _ in meshes]), axis=0, return_inverse=True)
    return vertices, number.reshape(-1)[faces], np.repeat(np.arange(len(meshes)), [len(own) for _, own in meshes])


def wound(vertices, faces, body, points, device):
    """Winding numbers as a table [point, body]."""
    out = np.zeros((len(points), body.max() + 1), int)
    point, other, number = wind_bodies(vertices, faces, body, points, device=device)
    assert (number != 0).all()
    assert (np.diff(point * (body.max() + 1) + other) > 0).all()  # sorted, none twice
    out[point, other] = number
    return out


@pytest.mark.parametrize("seed", range(4))
def test_points_under_vertices_and_edges_are_inside_what_their_inequalities_say(seed, device):
    """Integer points lie straight under vertices, edges and diagonals of nearly all the bodies."""
    rng = np.random.default_rng(seed)
    balls = random_balls(rng, 40)
    points = np.concatenate([rng.integers(-6, 7, (600, 3)), rng.integers(-12, 13, (600, 3)) / 2]).astype(float)
    depth = np.stack([ball.depth(points) for ball in balls], axis=1)
    off = (depth != 0).all(axis=1)
    points, depth = points[off], depth[off]
    want = (depth > 0) * np.array([ball.sign for ball in balls])
    assert (wound(*as_bodies([ball.mesh() for ball in balls]), points, device) == want).all()
    assert len(points) > 50
    assert len(np.unique(want.sum(axis=1))) > 4


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", [name for name in CLOSED if name not in ("egg box", "comb")])
def test_winding_numbers_are_solid_angles(name, device):
    """Random points, and points 0.1 mm straight below and above vertices and middles of edges; no wall is upright."""
    rng = np.random.default_rng(3)
    vertices, faces = (np.asarray(x) for x in CLOSED[name]())
    vertices = vertices.astype(float) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    edges = vertices[faces[:, [0, 1]]].mean(axis=1)
    near = rng.permutation(np.concatenate([vertices, edges]))[:150]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    above = np.array([0, 0, 1e-4])
    points = np.concatenate([near - above, near + above, rng.uniform(low, high, (200, 3))])
    angle = windings(vertices, faces, points)
    assert np.abs(angle - np.round(angle)).max() < 1e-6  # no point lies on the surface
    got = wound(vertices, faces, np.zeros(len(faces), int), points, device)
    assert (got[:, 0] == np.round(angle)).all()
    assert len(np.unique(got)) == 2


def test_how_many_are_looked_at_in_one_go_is_nothing(device, monkeypatch):
    rng = np.random.default_rng(11)
    mesh = as_bodies([ball.mesh() for ball in random_balls(rng, 30)])
    points = rng.uniform(-5, 5, (200, 3))
    want = wind_bodies(*mesh, points, device=device)
    assert len(want[0]) > 100
    for step, room, most in ((7, 1, 2**24), (1, 10, 2**24), (200, 3, 1), (50, 3, 10)):
        monkeypatch.setattr(nesting_module, "POINTS", step)
        monkeypatch.setattr(nesting_module, "HITS", room)
        monkeypatch.setattr(nesting_module, "HITS_LARGEST", most)
        for got, expected in zip(wind_bodies(*mesh, points, device=device), want, strict=True):
            assert (got == expected).all()


def test_no_points_and_points_far_away_have_nothing_around_them(device):
    mesh = as_bodies([ball.mesh() for ball in random_balls(np.random.default_rng(1), 5)])
    assert [len(x) for x in wind_bodies(*mesh, np.zeros((0, 3)), device=device)] == [0, 0, 0]
    far = np.array([[1e9, 0, 0], [0, -1e9, 0], [0, 0, 1e9], [0, 0, -1e9], [0.1, 0.2, -1e300]])
    assert (wound(*mesh, far, device) == 0).all()
