"""Control points of explorations around objects, of many at once: the next stroke of each, together.

Each operation on the strokes of all is that on the stroke of one: numbers do not depend on what else is made. All are
+ - * / and square roots, and functions of these alone, as libraries round sines and exponentials by the processor. One
logarithm of the C library is left: in NumPy's generator, for normal numbers beyond 3.65, which are one in 4,000.

The model. A person feels an object in visits. Each visit comes from one direction; every eight visits in a row take the
eight octants in random order, at random inside the octant. Fingers point away from the user (+y), or up where the hand
comes from the front or the back. A visit is a series of strokes: around the object to a stand-off; on to the surface of
the box; two to four sweeps to random depths, from just outside to beyond the middle (nothing resists), half of them
followed by lingering of 0.2 to 0.7 s; a little back. The skin faces the direction that the hand came from, tilted and
turned anew for each stroke. A stroke has a log-normal mean speed and the minimum-jerk profile of human reaching (Flash
and Hogan 1985); tremor is added.

The path is the uniform cubic B-spline of the control points (`kernels/motions/around.py`): inside the convex workspace,
and no faster than the control points step. Strokes are drawn one after another from one generator, so a later time
never changes an earlier pose.
"""

import itertools
import math
from collections.abc import Callable, Generator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .options import FLOOR, MARGIN

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

INTERVAL = 0.15  # between control points [s]: a hand changes its mind no faster
STANDOFF = 0.045  # from the bounds, before a visit [m]: half a palm
SPEED_RANGE = (0.08, 0.4)  # mean speed of one stroke [m/s]; its peak is 1.875 times that
TURN_SPEED = 1.6  # mean angular speed of one stroke at most [rad/s]
TREMOR = 0.0015  # of each control point, one sigma [m], cut off at two
TILT = math.radians(15.0)  # how far the skin strays from facing the object, one sigma [rad]
ARC_SHARES = np.linspace(0.0, 1.0, 33)[:, None]  # where the points of an arc around the object are
STROKES_A_REPORT = 1 << 8  # strokes between two reports of progress: a tenth of a second

AROUND, INTO, BACK = range(3)
"""Kinds of strokes: around the object to a new direction; to a place in it; a little back."""
KIND, OCTANT, DEPTH, SPEED = range(4)
"""Columns of a stroke's numbers: its kind; from which octant it comes, after a stroke around; how deep it goes (0 the
object's middle, 1 its surface), or how far back [m]; its median speed [m/s]."""
ASIDE, DIRECTION, TILTED, HASTE = slice(4, 7), slice(7, 10), slice(10, 13), 13
"""Further ones: how far aside, as shares of half the object's box; and of mean 0 and standard deviation 1, three
numbers of a direction, three of a tilt, one of the speed."""
_UNUSED = (0.0, 0.0, 0.0)
# Made once, for they are used in each stroke: two directions, and the signs of a quaternion of the inverse rotation.
_Y, _Z, _CONJUGATE = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([-1.0, -1.0, -1.0, 1.0])
_AXES, _NEXT, _LAST = np.arange(3), np.array([1, 2, 0]), np.array([2, 0, 1])  # and the axis after each, and before it

Draws = Generator[tuple[Array, tuple[float, ...]], int, None]
"""Gives numbers of mean 0 and standard deviation 1 for the tremor of the last stroke and of the rest after it,
[control, 3], and numbers of the next stroke, in these columns. Takes how many control points that one has."""
Progress = Callable[[int, int], None]
"""Takes how much is done and how much there is."""


def unreported(done: int, total: int) -> None:
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
    """Hands on their strokes, and the boxes of their objects [m]; the first axis is that of explorers."""

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


def control_count(end: float) -> int:
    """Control points that a pose at a time [s] takes, with all before it."""
    return int(end / INTERVAL) + 4


def control_turns(quaternion: Array) -> Array:
    """Rotation vectors from each control point to the next [rad], shape [control - 1, 3]."""
    return logarithm(product(quaternion[:-1] * _CONJUGATE, quaternion[1:]))


def control_points(
    boxes: Array, seeds: Sequence[int], counts: Sequence[int], progress: Progress = unreported
) -> ControlPoints:
    """At least so many control points of each exploration, within its workspace.

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
        if len(parts) % STROKES_A_REPORT == 0:
            progress(int(min(found.min(), wanted.max())), int(wanted.max()))
        left = (found < wanted)[number].nonzero()[0]
        if not len(left):
            return _ordered(parts, boxes)
        if len(left) < len(number):
            number, explorers = number[left], _Explorers(*(values[left] for values in explorers))
        explorers, strokes = _move(explorers, np.array([drawn[k][1] for k in left.tolist()]))


def stroke_draws(seed: int) -> Draws:
    """What is drawn of an exploration, for ever; the first stroke is one point, without tremor."""
    rng = np.random.default_rng(seed)
    octant = int(rng.integers(8))
    yield np.zeros((0, 3)), (AROUND, octant, 0.0, 1.0, *_UNUSED, *rng.standard_normal(6).tolist(), 0.0)
    tremor = np.zeros((1, 3))
    for octant in itertools.chain.from_iterable(rng.permutation(8).tolist() for _ in itertools.count()):
        count = yield tremor, (AROUND, octant, 0.0, 0.32, *_UNUSED, *rng.standard_normal(7).tolist())
        tremor = rng.standard_normal((count, 3))
        depths = [rng.uniform(0.8, 1.1), *rng.uniform(-0.25, 1.1, int(rng.integers(2, 5))).tolist()]
        for index, depth in enumerate(depths):
            aside = rng.uniform(-0.7, 0.7, 3).tolist()
            speed = 0.25 if index == 0 else 0.18
            count = yield tremor, (INTO, 0, depth, speed, *aside, *_UNUSED, *rng.standard_normal(4).tolist())
            tremor = rng.standard_normal((count, 3))
            if index > 0 and rng.random() < 0.5:
                resting = max(1, round(rng.uniform(0.2, 0.7) / INTERVAL))
                tremor = np.concatenate([tremor, rng.standard_normal((resting, 3))])
        far = rng.uniform(0.01, STANDOFF)
        count = yield tremor, (BACK, 0, far, 0.25, *_UNUSED, *_UNUSED, *rng.standard_normal(4).tolist())
        tremor = rng.standard_normal((count, 3))


def _begin(boxes: Array, drawn: Array) -> tuple[_Explorers, _Strokes]:
    """Where hands begin: at the stand-off."""
    centre, half = (boxes[:, 0] + boxes[:, 1]) / 2.0, (boxes[:, 1] - boxes[:, 0]) / 2.0
    direction = _octant_direction(drawn)
    here = centre + _reach(half, direction, STANDOFF)
    turn = _facing(direction, drawn)
    explorers = _Explorers(centre, half, direction, np.zeros((len(boxes), 1)), here, turn)
    return explorers, _Strokes(np.ones(len(boxes), np.int64), here, turn)


def _move(explorers: _Explorers, drawn: Array) -> tuple[_Explorers, _Strokes]:
    """One stroke of each, by numbers drawn for it: control points along it, with the minimum-jerk profile."""
    centre, half, direction, depth, here, turn = explorers
    kind = drawn[:, KIND]
    around = (kind == AROUND).nonzero()[0]
    if len(around):
        direction = direction.copy()
        direction[around] = _octant_direction(drawn[around])
    deep, across, drawn_depth = _reach(half, direction, 0.0), drawn[:, ASIDE] * half, drawn[:, DEPTH, None]
    into = centre + drawn_depth * deep + (across - dot(across, direction) * direction)
    back = here + (1.0 - depth) * deep + direction * drawn_depth
    step = np.where(kind[:, None] == BACK, back, into) - here
    length = length_of(step)[:, 0]
    arcs = step[:0, None]
    if len(around):
        arcs = _arcs_around(centre[around], half[around], here[around], direction[around])
    marks = np.concatenate([np.zeros((len(arcs), 1)), length_of(np.diff(arcs, axis=1))[..., 0]], axis=1).cumsum(axis=1)
    length[around] = marks[:, -1]
    speed = np.clip(drawn[:, SPEED] * power_of_e(0.4 * drawn[:, HASTE]), *SPEED_RANGE)
    rotation = logarithm(product(turn * _CONJUGATE, _facing(direction, drawn)))
    seconds = np.maximum(length / speed, length_of(rotation)[:, 0] / TURN_SPEED)
    count = np.maximum(1, np.ceil(seconds / INTERVAL)).astype(np.int64)
    share = np.concatenate([_profile(number) for number in count.tolist()])
    owner, stop = np.repeat(np.arange(len(count)), count), np.cumsum(count)
    position = here[owner] + share * step[owner]
    for k, arc, mark in zip(around.tolist(), arcs, marks, strict=True):
        own = slice(stop[k] - count[k], stop[k])
        along = share[own] * length[k]
        before = np.clip(np.searchsorted(mark, along[:, 0], side="right") - 1, 0, len(mark) - 2)
        span = (mark[before + 1] - mark[before])[:, None]
        part = (along - mark[before, None]) / np.where(span > 0.0, span, 1.0)
        position[own] = arc[before] + part * (arc[before + 1] - arc[before])
    quaternion = product(turn[owner], exponential(share * rotation[owner]))
    depth = np.where(kind[:, None] == INTO, drawn_depth, depth)
    moved = _Explorers(centre, half, direction, depth, position[stop - 1], quaternion[stop - 1])
    return moved, _Strokes(count, position, quaternion)


@lru_cache(maxsize=1024)
def _profile(count: int) -> Array:
    """The minimum-jerk profile at so many control points, the first one left out, shape [control, 1]."""
    s = (np.arange(1, count + 1) / count)[:, None]
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


def _arcs_around(centre: Array, half: Array, here: Array, direction: Array) -> Array:
    """Polylines to the stand-off in a direction, on the great arc, keeping to grown boxes; [arc, 33, 3] [m]."""
    out = here - centre
    distance = length_of(out)
    start = out / distance
    level = distance / length_of(_reach(half, start, STANDOFF))
    cosine = np.clip(dot(start, direction), -1.0, 1.0)
    sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
    angle = arc_tangent(sine, cosine)[:, None]
    s = ARC_SHARES
    ahead = sine_cosine(s * angle)[0]
    arc = ahead[:, ::-1] * start[:, None] + ahead * direction[:, None]  # shares are as far from 1 as others from 0
    arc = arc / np.maximum(sine, 1e-9)[:, None]
    arc /= length_of(arc)
    return centre[:, None] + ((1.0 - s) * level[:, None] + s) * _reach(half[:, None], arc, STANDOFF)


def _reach(half: Array, direction: Array, grown: float) -> Array:
    """From the middle along unit directions to the surface of the object's box grown by `grown` [m]."""
    return direction * ((half + grown) / np.maximum(np.abs(direction), 1e-9)).min(axis=-1, keepdims=True)


def _octant_direction(drawn: Array) -> Array:
    """Unit directions, each uniform in an octant: bits 0, 1, 2 set make x, y, z negative."""
    direction = np.abs(drawn[:, DIRECTION])
    octant = drawn[:, OCTANT, None].astype(np.int64)
    return direction / length_of(direction) * np.where(octant >> _AXES & 1, -1.0, 1.0)


def _facing(direction: Array, drawn: Array) -> Array:
    """Quaternions of hands on the `direction` side of the object, skin towards it, tilted a little."""
    is_flat = np.abs(direction[:, 1:2]) < 0.75
    ahead = np.where(is_flat, _Y, _Z)
    wrist = -(ahead - np.where(is_flat, direction[:, 1:2], direction[:, 2:]) * direction)
    wrist /= length_of(wrist)
    axes = np.stack([cross(direction, wrist), direction, wrist], axis=1)
    return product(from_axes(axes), exponential(TILT * drawn[:, TILTED]))


def _trembling(strokes: _Strokes, tremor: Sequence[Array]) -> tuple[Integers, Array, Array]:
    """Control points of strokes and the rests after them: whose each is, its position and its quaternion."""
    count = np.array([len(own) for own in tremor])
    owner = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    shift = np.clip(TREMOR * np.concatenate(tremor), -2.0 * TREMOR, 2.0 * TREMOR)
    source = np.minimum(within, (strokes.counts - 1)[owner]) + (np.cumsum(strokes.counts) - strokes.counts)[owner]
    return owner, strokes.position[source] + shift, strokes.quaternion[source]


def _ordered(parts: Sequence[tuple[Integers, Array, Array]], boxes: Array) -> ControlPoints:
    """The control points of one exploration after the other."""
    number, position, quaternion = (np.concatenate(values) for values in zip(*parts, strict=True))
    order = np.argsort(number, kind="stable")
    number = number[order]
    low, high = boxes[:, 0] - MARGIN, boxes[:, 1] + MARGIN
    low[:, 2] = np.maximum(low[:, 2], FLOOR)
    # Clipping to a box never lengthens a step, so the limit on speed holds.
    clipped = np.clip(position[order], low[number], high[number])
    start = np.concatenate([[0], np.cumsum(np.bincount(number, minlength=len(boxes)))])
    return ControlPoints(clipped, quaternion[order], start)


# Quaternions (xyzw) and rotation vectors [rad].


def product(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions, [..., 4]: first b, then a."""
    vector_a, scalar_a, vector_b, scalar_b = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = scalar_a * vector_b + scalar_b * vector_a + cross(vector_a, vector_b)
    return np.concatenate([vector, scalar_a * scalar_b - dot(vector_a, vector_b)], axis=-1)


def cross(a: Array, b: Array) -> Array:
    """Cross product, [..., 3]; np.cross takes ten times as long for a single vector."""
    return a.take(_NEXT, axis=-1) * b.take(_LAST, axis=-1) - a.take(_LAST, axis=-1) * b.take(_NEXT, axis=-1)


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors, [..., k] to [..., 1]: summed in order, where `a @ b` rounds by processor."""
    return np.add.reduce(a * b, axis=-1, keepdims=True)


def length_of(x: Array) -> Array:
    """Length of vectors, [..., k] to [..., 1]."""
    return np.sqrt(dot(x, x))


def exponential(rotation: Array) -> Array:
    """Quaternion of a rotation vector, [..., 3]."""
    half = 0.5 * length_of(rotation)
    sine, cosine = sine_cosine(half)
    scale = np.where(half > 1e-9, 0.5 * sine / np.maximum(half, 1e-9), 0.5)
    return np.concatenate([rotation * scale, cosine], axis=-1)


def logarithm(q: Array) -> Array:
    """Rotation vector of a unit quaternion, of an angle of at most pi; [..., 3]."""
    sine = length_of(q[..., :3])
    angle = 2.0 * arc_tangent(sine, np.abs(q[..., 3:]))
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return q[..., :3] * np.where(q[..., 3:] < 0.0, -scale, scale)


_DIAGONAL = np.array([[1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0]])
_PRODUCTS = np.array([[0, 6, 5, 7], [6, 1, 4, 8], [5, 4, 2, 9], [7, 8, 9, 3]])  # those with x, y, z, w


def from_axes(axes: Array) -> Array:
    """Quaternions of rotations, by the axes x, y and z of the rotated frame, [turn, 3, 3]."""
    entry = axes.reshape(-1, 9)
    # Four times the products of a quaternion's numbers with each other. The largest of the four squares is at least 1:
    # no case divides by nearly nothing.
    square = 1.0 + entry[:, :1] * _DIAGONAL[0] + entry[:, 4:5] * _DIAGONAL[1] + entry[:, 8:] * _DIAGONAL[2]
    one, other = entry.take([5, 6, 1], axis=1), entry.take([7, 2, 3], axis=1)
    products = np.concatenate([square, one + other, one - other], axis=1)
    numbers = np.take_along_axis(products, _PRODUCTS[np.argmax(square, axis=1)], axis=1)
    return numbers / length_of(numbers)


# Functions of angles, from + - * / and square roots alone.

# Taylor's coefficients, as arrays of no dimension: NumPy takes two thirds of the time that it takes with floats.
SINE = tuple(np.array((-1.0) ** k / math.factorial(2 * k + 1)) for k in range(9))
COSINE = tuple(np.array((-1.0) ** k / math.factorial(2 * k)) for k in range(10))
ARC = tuple(np.array((-1.0) ** k / (2 * k + 1)) for k in range(12))
EXPONENT = tuple(np.array(1.0 / math.factorial(k)) for k in range(13))
QUARTER_HIGH, QUARTER_LOW = 1.5707963267341256, 6.077100506506192e-11  # pi / 2: 33 bits, and the rest


def sine_cosine(angle: Array) -> tuple[Array, Array]:
    """Sine and cosine of angles [rad] of up to 800,000: the bits of kernels/motions/portable_angles.py."""
    quarter = np.rint(angle * (2.0 / math.pi))
    rest = (angle - quarter * QUARTER_HIGH) - quarter * QUARTER_LOW
    square = rest * rest
    sine, cosine = rest * _polynomial(SINE, square), _polynomial(COSINE, square)
    k = quarter - 4.0 * np.floor(0.25 * quarter)
    swapped = (k == 1.0) | (k == 3.0)
    first, second = np.where(swapped, cosine, sine), np.where(swapped, sine, cosine)
    return np.where(k >= 2.0, -first, first), np.where((k == 1.0) | (k == 2.0), -second, second)


def arc_tangent(across: Array, along: Array) -> Array:
    """Angle 0..pi [rad] between the direction `along` and a vector with that part and the part `across` >= 0."""
    flat = np.abs(along)
    larger = np.maximum(across, flat)
    x = np.minimum(across, flat) / np.where(larger > 0.0, larger, 1.0)
    for _ in range(2):  # half the angle
        x = x / (1.0 + np.sqrt(1.0 + x * x))
    angle = 4.0 * (x * _polynomial(ARC, x * x))
    angle = np.where(across > flat, math.pi / 2.0 - angle, angle)
    return np.where(along < 0.0, math.pi - angle, angle)


def power_of_e(x: Array) -> Array:
    """e^x of x in -40..40."""
    value = _polynomial(EXPONENT, x / 128.0)
    for _ in range(7):
        value = value * value
    return value


def _polynomial(coefficients: Sequence[Array], x: Array) -> Array:
    """Horner's rule; the first coefficient is that of 1."""
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * x + coefficient
    return value
