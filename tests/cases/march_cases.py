"""Fields to march through, as Warp functions and as NumPy ones; marching them, and marching squares cell by cell."""

from dataclasses import dataclass
from itertools import chain

import numpy as np
import warp as wp
from section_oracle import rotation

from palpate.kernels.fields.field import Field, distance_ball
from palpate.kernels.march.contours import march_patches
from palpate.render.contour_batch import ContourBatch
from palpate.render.hands.hand import Palm

CENTER = np.array([0.003, -0.002, 0.2])
FLAT = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
BOUNDS = np.array([[-0.5, -0.5, -0.3], [0.5, 0.5, 0.7]])


@wp.struct
class Shape:
    """What the shapes' functions read."""

    center: wp.vec3d
    size: wp.vec3d  # [m]


@wp.func
def ball_value(d: Shape, x: wp.vec3d):
    return wp.length(x - d.center) - d.size[0]


@wp.func
def ring_value(d: Shape, x: wp.vec3d):
    p = x - d.center
    q = wp.sqrt(p[0] * p[0] + p[1] * p[1]) - d.size[0]
    return wp.sqrt(q * q + p[2] * p[2]) - d.size[1]


@wp.func
def box_value(d: Shape, x: wp.vec3d):
    p = x - d.center
    return wp.max(wp.max(wp.abs(p[0]) - d.size[0], wp.abs(p[1]) - d.size[1]), wp.abs(p[2]) - d.size[2])


@wp.func
def step_value(d: Shape, x: wp.vec3d):
    if box_value(d, x) < wp.float64(0.0):
        return wp.float64(-1.0)
    return wp.float64(3.0)


@wp.func
def sheet_value(d: Shape, x: wp.vec3d):
    """Between two sheets of a hyperboloid; size: how far from its asymptotes, signed."""
    p = x - d.center
    return p[0] * p[1] - d.size[0]


@wp.struct
class Waves:
    """A sum of plane waves."""

    vector: wp.array[wp.vec3d]  # [rad/m]
    phase: wp.array[wp.float64]
    level: wp.float64


@wp.func
def waves_value(d: Waves, x: wp.vec3d):
    total = -d.level
    for k in range(d.vector.shape[0]):
        total += wp.sin(wp.dot(d.vector[k], x) + d.phase[k])
    return total


def shape_field(value, center, size, *, skips=True):
    d = Shape()
    d.center, d.size = wp.vec3d(*map(float, center)), wp.vec3d(*map(float, size))
    return Field(value, Shape, d, ball=distance_ball(value) if skips else None)


@dataclass
class WavesCase:
    vector: np.ndarray
    phase: np.ndarray
    level: float
    grain: float = 0.0

    def field(self, device):
        d = Waves()
        d.vector = wp.array(self.vector, dtype=wp.vec3d, device=device)
        d.phase = wp.array(self.phase, dtype=wp.float64, device=device)
        d.level = wp.float64(self.level)
        return Field(waves_value, Waves, d, grain=self.grain)

    def __call__(self, x):
        return np.sin(x @ self.vector.T + self.phase).sum(axis=-1) - self.level


def box_of(x, center, size):
    return (np.abs(x - center) - size).max(axis=-1)


@dataclass
class Squares:
    """Marching squares on one palm: points on cut edges, and which edge follows which, inside to the left.

    An edge is (i, j, axis), from node (i, j) to the next one along u (0) or v (1).
    """

    point: dict
    after: dict
    inside: np.ndarray
    """Of the nodes, shape [nu + 1, nv + 1]."""


def plane_of(pose, half, cells):
    """Function from node coordinates (i, j) to the array's frame."""
    axes = rotation(pose[3:])
    origin, u, v = np.asarray(pose[:3], np.float64), axes[:, 0], -axes[:, 2]

    def at(i, j):
        a = half[0] * (2.0 * np.asarray(i) / cells[0] - 1.0)
        b = half[1] * (2.0 * np.asarray(j) / cells[1] - 1.0)
        return origin + a[..., None] * u + b[..., None] * v

    return at


def squares(function, pose, half, cells):
    """Cell by cell, roots by halving; function: x [..., 3] -> values."""
    at = plane_of(pose, half, cells)
    i, j = np.meshgrid(np.arange(cells[0] + 1), np.arange(cells[1] + 1), indexing="ij")
    inside = function(at(i, j)) < 0
    point, after = {}, {}
    for i, j in np.ndindex(cells[0], cells[1]):
        corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        sides = [(i, j, 0), (i + 1, j, 1), (i, j + 1, 0), (i, j, 1)]  # side k runs from corner k to k + 1
        state = [bool(inside[c]) for c in corners]
        ends = [k for k in range(4) if state[k] and not state[(k + 1) % 4]]  # seen from within, it comes in there
        starts = [k for k in range(4) if not state[k] and state[(k + 1) % 4]]
        if len(ends) == 2:  # around each outside corner if the middle is inside, else around each inside corner
            middle = function(at(np.array(i + 0.5), np.array(j + 0.5))) < 0
            step = 1 if middle else 3
            links = [(k, (k + step) % 4) for k in ends]
        else:
            links = list(zip(ends, starts, strict=True))
        for enter, leave in links:
            after[sides[enter]] = sides[leave]
            for side in (sides[enter], sides[leave]):
                point[side] = edge_root(function, at, side)
    return Squares(point, after, inside)


def edge_root(function, at, side):
    i, j, axis = side
    low, high = 0.0, 1.0
    place = lambda t: at(np.array(i + t * (axis == 0)), np.array(j + t * (axis == 1)))  # noqa: E731  four lines above
    start = function(place(0.0)) < 0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if (function(place(middle)) < 0) == start:
            low = middle
        else:
            high = middle
    return place(high)


def area_of(points, pose):
    """Signed area of a closed polyline in the palm's plane [m2]."""
    axes = rotation(pose[3:])
    p = (np.asarray(points, np.float64) - np.asarray(pose[:3], np.float64)) @ np.stack([axes[:, 0], -axes[:, 2]]).T
    return 0.5 * float((p[:-1, 0] * p[1:, 1] - p[1:, 0] * p[:-1, 1]).sum())


def random_poses(count, seed=3, spread=0.03):
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=(count, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return np.concatenate([CENTER + rng.uniform(-spread, spread, (count, 3)), turn], axis=1).astype(np.float32)


def marched(field, pose, device, *, hand=None, step=0.005, bounded=True, closes=True, bounds=BOUNDS, limit=None):
    """Contours on the host; pose: [pose, 7] or [pose, patch, 7]."""
    pose = np.asarray(pose, np.float32)
    pose = pose[:, None] if pose.ndim == 2 else pose
    patch = hand if isinstance(hand, wp.array) else (hand or Palm()).on(device)
    on_device = wp.array(np.ascontiguousarray(pose), dtype=wp.transform, ndim=2, device=device)
    options = {"bounds": bounds, "bounded": bounded, "closes": closes, "limit": limit}
    contours = march_patches(field, on_device, patch, step=step, **options)
    return ContourBatch.of_sections(contours, patch.shape[0]).numpy()


def lines_of(batch):
    """(points, kinds, closed, patch) of each polyline, pose by pose."""
    out = []
    for pose in range(batch.pose_count):
        lines = []
        for line in range(batch.pose_start[pose], batch.pose_start[pose + 1]):
            part = slice(batch.polyline_start[line], batch.polyline_start[line + 1])
            row = (batch.points[part], batch.kind[part], batch.polyline_closed[line], batch.polyline_patch[line])
            lines.append(row)
        out.append(lines)
    return out


def assert_sound(batch):
    """What holds for all contours."""
    assert batch.polyline_start[0] == 0
    assert batch.polyline_start[-1] == batch.point_count
    for points, kind, closed, _ in chain.from_iterable(lines_of(batch)):
        assert len(points) >= 2
        assert not (points[1:] == points[:-1]).all(axis=1).any()
        assert kind[-1] == kind[-2]
        assert (points[0] == points[-1]).all() or not closed


def random_waves(seed, count=4, level=0.3, grain=0.0):
    rng = np.random.default_rng(seed)
    return WavesCase(rng.normal(0, 120, (count, 3)), rng.uniform(0, 6.3, count), level, grain)
