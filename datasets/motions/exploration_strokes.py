"""Control points of explorations around objects, of many at once: the next stroke of each, together.

Each operation on the strokes of all is that on the stroke of one: numbers do not depend on what else is made.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .exploration_draws import (
    AROUND,
    ASIDE,
    BACK,
    DEPTH,
    DIRECTION,
    HASTE,
    INTERVAL,
    INTO,
    KIND,
    OCTANT,
    SPEED,
    STANDOFF,
    TURN,
    stroke_draws,
)
from .rotation_vectors import conjugate, cross, dot, exponential, from_axes, length_of, logarithm, product

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

MARGIN = 0.06  # the palm's centre stays within the bounds grown by this [m] ...
FLOOR = 0.06  # ... and this high above the array [m]
SPEED_RANGE = (0.08, 0.4)  # mean speed of one stroke [m/s]; its peak is 1.875 times that
TURN_SPEED = 1.6  # mean angular speed of one stroke at most [rad/s]
TREMOR = 0.0015  # of each control point, one sigma [m], cut off at two
TILT = np.radians(15.0)  # how far the skin strays from facing the object, one sigma [rad]
_ARC = np.linspace(0.0, 1.0, 33)[:, None]  # where the points of a way around the object are
_Y, _Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
_BITS = np.arange(3)
_STROKES_TOLD = 1 << 8  # strokes between two words about progress: a tenth of a second

Progress = Callable[[int, int], None]
"""Takes how much is done and how much there is."""


def unheard(done: int, total: int) -> None:
    """A `Progress` that does nothing."""
    del done, total


class ControlPoints(NamedTuple):
    """Of one exploration after the other."""

    position: Array
    """[m], shape [control, 3]."""
    quaternion: Array
    """Xyzw, without a change of sign from one to the next, shape [control, 4]."""
    start: Integers
    """Offsets of explorations into control points, shape [exploration + 1]."""


class _Explorers(NamedTuple):
    """Hands under way, and the boxes of their objects [m]; a row each."""

    centre: Array
    half: Array  # of the box's sides
    direction: Array  # from which the visit comes
    depth: Array  # of the last stroke into the object: 0 middle, 1 surface; shape [explorer, 1]
    here: Array  # where the last stroke ended [m]
    turn: Array  # with which orientation, xyzw


class _Strokes(NamedTuple):
    """Control points of one stroke of each explorer, one stroke after the other."""

    counts: Integers
    position: Array
    quaternion: Array


def control_points(
    boxes: Array, seeds: Sequence[int], counts: Sequence[int], progress: Progress = unheard
) -> ControlPoints:
    """At least so many control points of each exploration, kept in the workspace.

    boxes: lowest and highest x y z of each object [m], shape [exploration, 2, 3]. progress: takes how many control
    points there are of the exploration that has fewest.
    """
    draws = [stroke_draws(seed) for seed in seeds]
    explorers, strokes = _begin(boxes, np.array([next(own)[1] for own in draws]))
    number = np.arange(len(draws))  # of the explorations that are not yet long enough
    found, wanted = np.zeros(len(draws), np.int64), np.asarray(counts, np.int64)
    parts: list[tuple[Integers, Array, Array]] = []
    while True:
        drawn = [draws[k].send(count) for k, count in zip(number.tolist(), strokes.counts.tolist(), strict=True)]
        owner, position, quaternion = _trembling(strokes, [tremor for tremor, _ in drawn])
        parts.append((number[owner], position, quaternion))
        found += np.bincount(parts[-1][0], minlength=len(draws))
        if len(parts) % _STROKES_TOLD == 0:
            progress(int(min(found.min(), wanted.max())), int(wanted.max()))
        left = (found < wanted)[number].nonzero()[0]
        if not len(left):
            return _ordered(parts, boxes)
        if len(left) < len(number):
            number, explorers = number[left], _Explorers(*(values[left] for values in explorers))
        explorers, strokes = _move(explorers, np.array([drawn[k][1] for k in left.tolist()]))


def _begin(boxes: Array, rows: Array) -> tuple[_Explorers, _Strokes]:
    """Where hands begin: at the stand-off."""
    centre, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2.0
    direction = _octant_direction(rows)
    here = centre + _reach(half, direction, STANDOFF)
    turn = _facing(direction, rows)
    explorers = _Explorers(centre, half, direction, np.zeros((len(boxes), 1)), here, turn)
    return explorers, _Strokes(np.ones(len(boxes), np.int64), here, turn)


def _move(explorers: _Explorers, rows: Array) -> tuple[_Explorers, _Strokes]:
    """One stroke of each, by numbers drawn for it: control points along its way, with the minimum-jerk profile."""
    kind = rows[:, KIND]
    around = (kind == AROUND).nonzero()[0]
    direction = explorers.direction
    if len(around):
        direction = direction.copy()
        direction[around] = _octant_direction(rows[around])
        explorers = explorers._replace(direction=direction)
    speed = np.clip(rows[:, SPEED] * np.exp(0.4 * rows[:, HASTE]), *SPEED_RANGE)
    goal = _facing(direction, rows)
    ways, marks, length = _ways(explorers, rows, around)
    rotation = logarithm(product(conjugate(explorers.turn), goal))
    seconds = np.maximum(length / speed, length_of(rotation)[:, 0] / TURN_SPEED)
    count = np.maximum(1, np.ceil(seconds / INTERVAL)).astype(np.int64)
    share = np.concatenate([_profile(number) for number in count.tolist()])
    owner = np.repeat(np.arange(len(count)), count)
    along, stop = share * length[owner], np.cumsum(count)
    position = np.empty((len(share), 3))
    for way, mark, first, end in zip(ways, marks, (stop - count).tolist(), stop.tolist(), strict=True):
        own, place = along[first:end], position[first:end]
        for axis in range(3):
            place[:, axis] = np.interp(own, mark, way[:, axis])
    quaternion = product(explorers.turn[owner], exponential(share[:, None] * rotation[owner]))
    depth = np.where(kind[:, None] == INTO, rows[:, DEPTH, None], explorers.depth)
    moved = explorers._replace(depth=depth, here=position[stop - 1], turn=quaternion[stop - 1])
    return moved, _Strokes(count, position, quaternion)


def _ways(explorers: _Explorers, rows: Array, around: Integers) -> tuple[list[Array], list[Array], Array]:
    """Ways of strokes as polylines [point, 3], how far along them each point is [m], and their lengths [m]."""
    centre, half, direction, depth, here, _ = explorers
    deep = _reach(half, direction, 0.0)
    across = rows[:, ASIDE] * half
    into = centre + rows[:, DEPTH, None] * deep + (across - dot(across, direction) * direction)
    back = here + (1.0 - depth) * deep + direction * rows[:, DEPTH, None]
    there = np.where(rows[:, KIND, None] == BACK, back, into)
    length = length_of(there - here)
    ways: list[Array] = list(np.stack([here, there], axis=1))
    ends: Array = np.concatenate([np.zeros((len(length), 1)), length], axis=1)
    marks = list(ends)
    length = length[:, 0]
    if len(around):
        arcs = _ways_around(centre[around], half[around], here[around], direction[around])
        steps = length_of(np.diff(arcs, axis=1))[..., 0]
        along = np.concatenate([np.zeros((len(arcs), 1)), np.cumsum(steps, axis=1)], axis=1)
        length[around] = along[:, -1]
        for k, way, mark in zip(around.tolist(), arcs, along, strict=True):
            ways[k], marks[k] = way, mark
    return ways, marks, length


@lru_cache(maxsize=1024)
def _profile(count: int) -> Array:
    """The minimum-jerk profile at so many control points, the first one left out."""
    s = np.arange(1, count + 1) / count
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def _ways_around(centre: Array, half: Array, here: Array, direction: Array) -> Array:
    """Polylines to the stand-off in a direction, on the great arc, keeping to grown boxes; [way, 33, 3] [m]."""
    out = here - centre
    distance = length_of(out)
    start = out / distance
    level = distance / length_of(_reach(half, start, STANDOFF))
    angle = np.arccos(np.clip(dot(start, direction), -1.0, 1.0))[:, None]
    s = _ARC
    arc = np.sin((1.0 - s) * angle) * start[:, None] + np.sin(s * angle) * direction[:, None]
    arc = arc / np.maximum(np.sin(angle), 1e-9)
    arc /= length_of(arc)
    return centre[:, None] + ((1.0 - s) * level[:, None] + s) * _reach(half[:, None], arc, STANDOFF)


def _reach(half: Array, direction: Array, grown: float) -> Array:
    """From the middle along unit directions to the surface of the object's box grown by `grown` [m]."""
    return direction * ((half + grown) / np.maximum(np.abs(direction), 1e-9)).min(axis=-1, keepdims=True)


def _octant_direction(rows: Array) -> Array:
    """Unit directions, each uniform in an octant: bits 0, 1, 2 set make x, y, z negative."""
    direction = np.abs(rows[:, DIRECTION])
    octant = rows[:, OCTANT, None].astype(np.int64)
    return direction / length_of(direction) * np.where(octant >> _BITS & 1, -1.0, 1.0)


def _facing(direction: Array, rows: Array) -> Array:
    """Quaternions of hands on the `direction` side of the object, skin towards it, tilted a little."""
    is_flat = np.abs(direction[:, 1:2]) < 0.75
    ahead = np.where(is_flat, _Y, _Z)
    wrist = -(ahead - np.where(is_flat, direction[:, 1:2], direction[:, 2:]) * direction)
    wrist /= length_of(wrist)
    axes = np.stack([cross(direction, wrist), direction, wrist], axis=1)
    return product(from_axes(axes), exponential(TILT * rows[:, TURN]))


def _trembling(strokes: _Strokes, tremor: Sequence[Array]) -> tuple[Integers, Array, Array]:
    """Control points of strokes and the rests after them: whose each is, its position and its quaternion."""
    count = np.array([len(own) for own in tremor])
    owner = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    shift = np.clip(TREMOR * np.concatenate(tremor), -2.0 * TREMOR, 2.0 * TREMOR)
    row = np.minimum(within, (strokes.counts - 1)[owner]) + (np.cumsum(strokes.counts) - strokes.counts)[owner]
    return owner, strokes.position[row] + shift, strokes.quaternion[row]


def _ordered(parts: Sequence[tuple[Integers, Array, Array]], boxes: Array) -> ControlPoints:
    """The control points of one exploration after the other."""
    number, position, quaternion = (np.concatenate(values) for values in zip(*parts, strict=True))
    order = np.argsort(number, kind="stable")
    number = number[order]
    low, high = boxes[:, 0] - MARGIN, boxes[:, 1] + MARGIN
    low[:, 2] = np.maximum(low[:, 2], FLOOR)
    # Clipping to a box never lengthens a step, so the limit on speed holds.
    kept = np.clip(position[order], low[number], high[number])
    start = np.concatenate([[0], np.cumsum(np.bincount(number, minlength=len(boxes)))])
    return ControlPoints(kept, quaternion[order], start)
