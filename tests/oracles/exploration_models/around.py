"""The exploration around an object as it was first written: one motion, stroke by stroke, each by itself."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

INTERVAL = 0.15  # between control points [s]: a hand changes its mind no faster
MARGIN = 0.06  # the palm's centre stays within the bounds grown by this [m] ...
FLOOR = 0.06  # ... and this high above the array [m]
STANDOFF = 0.045  # from the bounds, before a visit [m]: half a palm
SPEED_RANGE = (0.08, 0.4)  # mean speed of one stroke [m/s]; its peak is 1.875 times that
TURN_SPEED = 1.6  # mean angular speed of one stroke at most [rad/s]
TILT = np.radians(15.0)  # how far the skin strays from facing the object, one sigma [rad]
TREMOR = 0.0015  # of each control point, one sigma [m], cut off at two
_NEXT, _AFTER_NEXT = np.array([1, 2, 0]), np.array([2, 0, 1])  # of each axis


class _Space(NamedTuple):
    """The object's box and the box that the palm's centre keeps to [m]."""

    centre: Array
    half: Array
    low: Array
    high: Array


class Stroke(NamedTuple):
    """Control points of one stroke: positions [m], shape [control, 3], and quaternions xyzw, shape [control, 4]."""

    position: Array
    quaternion: Array


def exploration_path(bounds: Array, time: Array, seed: int) -> Array:
    """Poses at the given times [s] of the exploration that `bounds` ([2, 3] [m]) and `seed` define; shape [pose, 7].

    render/motions/explorations/control_points.py describes the model.
    """
    return spline(control_points(bounds, np.random.default_rng(seed), int(time[-1] / INTERVAL) + 4), time)


def _space(bounds: Array) -> _Space:
    low, high = bounds[0] - MARGIN, bounds[1] + MARGIN
    low[2] = max(low[2], FLOOR)
    return _Space(bounds.mean(axis=0), (bounds[1] - bounds[0]) / 2.0, low, high)


def control_points(bounds: Array, rng: np.random.Generator, count: int) -> Stroke:
    """At least the first `count` control points of all visits, within the workspace."""
    space = _space(bounds)
    position: list[Array] = []
    quaternion: list[Array] = []
    found = 0
    for stroke in _strokes(space, rng):
        position.append(stroke.position)
        quaternion.append(stroke.quaternion)
        found += len(stroke.position)
        if found >= count:
            break
    # Clipping to a box never lengthens a step, so the limit on speed holds.
    return Stroke(np.clip(np.concatenate(position), space.low, space.high), np.concatenate(quaternion))


def _strokes(space: _Space, rng: np.random.Generator) -> Iterator[Stroke]:
    direction = _octant_direction(int(rng.integers(8)), rng)
    here = space.centre + _reach(space, direction, STANDOFF)
    turn = _facing(direction, rng)
    yield Stroke(here[None, :], turn[None, :])
    for octant in itertools.chain.from_iterable(rng.permutation(8) for _ in itertools.count()):
        direction = _octant_direction(int(octant), rng)
        for stroke in _visit(space, direction, here, turn, rng):
            here, turn = stroke.position[-1], stroke.quaternion[-1]
            tremor = np.clip(rng.normal(0.0, TREMOR, stroke.position.shape), -2.0 * TREMOR, 2.0 * TREMOR)
            yield stroke._replace(position=stroke.position + tremor)


def _visit(space: _Space, direction: Array, here: Array, turn: Array, rng: np.random.Generator) -> Iterator[Stroke]:
    """One visit from a direction, beginning at `here` with the orientation `turn`."""
    stroke = _stroke(_arc_around(space, here, direction), turn, _facing(direction, rng), _speed(rng, 0.32))
    yield stroke
    deep = _reach(space, direction, 0.0)
    depths = [rng.uniform(0.8, 1.1), *rng.uniform(-0.25, 1.1, int(rng.integers(2, 5)))]  # 0 middle, 1 surface
    for index, depth in enumerate(depths):
        there = space.centre + depth * deep + _sideways(space, direction, rng)
        stroke = _straight(stroke, there, _facing(direction, rng), _speed(rng, 0.25 if index == 0 else 0.18))
        yield stroke
        if index > 0 and rng.random() < 0.5:
            count = max(1, round(rng.uniform(0.2, 0.7) / INTERVAL))
            yield Stroke(*(np.tile(rows[-1], (count, 1)) for rows in stroke))
    back = stroke.position[-1] + (1.0 - depths[-1]) * deep + direction * rng.uniform(0.01, STANDOFF)
    yield _straight(stroke, back, _facing(direction, rng), _speed(rng, 0.25))


def _straight(before: Stroke, there: Array, goal: Array, speed: float) -> Stroke:
    return _stroke(np.stack([before.position[-1], there]), before.quaternion[-1], goal, speed)


def _stroke(path: Array, turn: Array, goal: Array, speed: float) -> Stroke:
    """Control points along a polyline, first one left out, with the minimum-jerk profile.

    The quaternions go on from `turn` without a change of sign, and so does the whole path.
    """
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    rotation = _logarithm(_product(_conjugate(turn), goal))
    seconds = max(length[-1] / speed, _length(rotation).item() / TURN_SPEED)
    count = max(1, int(np.ceil(seconds / INTERVAL)))
    s = np.arange(1, count + 1) / count
    s = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    columns: list[Array] = [np.interp(s * length[-1], length, path[:, axis]) for axis in range(3)]
    return Stroke(np.stack(columns, axis=1), _product(turn, _exponential(s[:, None] * rotation)))


def _arc_around(space: _Space, here: Array, direction: Array) -> Array:
    """Polyline from `here` to the stand-off in `direction`, on the great arc, keeping to grown boxes; [33, 3] [m]."""
    out = here - space.centre
    distance = _length(out).item()
    start = out / distance
    level = distance / _length(_reach(space, start, STANDOFF)).item()
    angle = float(np.arccos(np.clip((start * direction).sum(), -1.0, 1.0)))
    s = np.linspace(0.0, 1.0, 33)[:, None]
    arc = (np.sin((1.0 - s) * angle) * start + np.sin(s * angle) * direction) / max(np.sin(angle), 1e-9)
    arc /= np.linalg.norm(arc, axis=1, keepdims=True)
    return space.centre + ((1.0 - s) * level + s) * _reach(space, arc, STANDOFF)


def _reach(space: _Space, direction: Array, grown: float) -> Array:
    """From the middle along unit directions to the surface of the object's box grown by `grown` [m]."""
    return direction * ((space.half + grown) / np.maximum(np.abs(direction), 1e-9)).min(axis=-1, keepdims=True)


def _sideways(space: _Space, direction: Array, rng: np.random.Generator) -> Array:
    """Across the direction, up to most of the box [m], shape [3]."""
    across = rng.uniform(-0.7, 0.7, 3) * space.half
    return across - (across * direction).sum() * direction


def _speed(rng: np.random.Generator, median: float) -> float:
    return float(np.clip(median * np.exp(0.4 * rng.normal()), *SPEED_RANGE))


def _octant_direction(octant: int, rng: np.random.Generator) -> Array:
    """A unit direction, uniform in one octant: bits 0, 1, 2 set make x, y, z negative."""
    direction = np.abs(rng.normal(size=3))
    return direction / _length(direction) * [-1.0 if octant >> axis & 1 else 1.0 for axis in range(3)]


def _facing(direction: Array, rng: np.random.Generator) -> Array:
    """Quaternion of a hand on the `direction` side of the object, skin towards it, tilted a little; [4]."""
    ahead = np.array([0.0, 1.0, 0.0] if abs(direction[1]) < 0.75 else [0.0, 0.0, 1.0])
    back = direction
    wrist = -(ahead - (ahead * back).sum() * back)
    wrist /= _length(wrist)
    level = _from_axes(np.stack([_cross(back, wrist), back, wrist], axis=1))
    return _product(level, _exponential(rng.normal(0.0, TILT, 3)))


def _from_axes(axes: Array) -> Array:
    """Quaternion xyzw of a rotation matrix [3, 3] whose columns are the hand's axes."""
    x, y, z = axes[:, 0], axes[:, 1], axes[:, 2]
    # The largest of the four squares is at least 1/4: no case divides by nearly nothing.
    outer = np.array(
        [
            [1 + x[0] - y[1] - z[2], y[0] + x[1], z[0] + x[2], y[2] - z[1]],
            [y[0] + x[1], 1 - x[0] + y[1] - z[2], z[1] + y[2], z[0] - x[2]],
            [z[0] + x[2], z[1] + y[2], 1 - x[0] - y[1] + z[2], x[1] - y[0]],
            [y[2] - z[1], z[0] - x[2], x[1] - y[0], 1 + x[0] + y[1] + z[2]],
        ]
    )
    row = outer[int(np.argmax(np.diag(outer)))]
    return row / _length(row)


def spline(control: Stroke, time: Array) -> Array:
    """Poses at times [s] on the uniform cubic B-spline, cumulative for quaternions, shape [pose, 7]."""
    first = np.floor(time / INTERVAL).astype(np.int64)
    u = (time / INTERVAL - first)[:, None]
    weight = (
        (5.0 + 3.0 * u - 3.0 * u**2 + u**3) / 6.0,
        (1.0 + 3.0 * u + 3.0 * u**2 - 2.0 * u**3) / 6.0,
        u**3 / 6.0,
    )
    position, quaternion = control.position[first].copy(), control.quaternion[first]
    move, turn = np.diff(control.position, axis=0), turns_between(control.quaternion)
    for step in range(3):
        position += weight[step] * move[first + step]
        quaternion = _product(quaternion, _exponential(weight[step] * turn[first + step]))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.hstack([position, quaternion])


def turns_between(quaternion: Array) -> Array:
    """Rotation vectors from each orientation to the next [rad], shape [control - 1, 3]."""
    return _logarithm(_product(_conjugate(quaternion[:-1]), quaternion[1:]))


def _product(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions xyzw, [..., 4]: first b, then a."""
    vector_a, scalar_a, vector_b, scalar_b = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = scalar_a * vector_b + scalar_b * vector_a + _cross(vector_a, vector_b)
    scalar = scalar_a * scalar_b - (vector_a * vector_b).sum(axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def _cross(a: Array, b: Array) -> Array:
    """Cross product, [..., 3]: the bits of np.cross, which takes ten times as long for a single vector."""
    return a[..., _NEXT] * b[..., _AFTER_NEXT] - a[..., _AFTER_NEXT] * b[..., _NEXT]


def _length(x: Array) -> Array:
    """Length of vectors, [..., 3] to [..., 1]: the bits of np.linalg.norm along an axis, without its checks."""
    return np.sqrt(np.add.reduce(x * x, axis=-1, keepdims=True))


def _conjugate(q: Array) -> Array:
    return q * [-1.0, -1.0, -1.0, 1.0]


def _exponential(rotation: Array) -> Array:
    """Quaternion xyzw of a rotation vector [rad], [..., 3]."""
    angle = _length(rotation)
    return np.concatenate([rotation * (0.5 * np.sinc(angle / (2.0 * np.pi))), np.cos(angle / 2.0)], axis=-1)


def _logarithm(q: Array) -> Array:
    """Rotation vector [rad] of a unit quaternion xyzw, the short way round; [..., 3]."""
    sine = _length(q[..., :3])
    angle = 2.0 * np.arctan2(sine, np.abs(q[..., 3:]))
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return q[..., :3] * np.where(q[..., 3:] < 0.0, -scale, scale)
