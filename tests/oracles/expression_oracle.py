"""Expressions worked out point by point from what their words mean, and random ones."""

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.render.objects.functions import expression as ex
from palpate.render.objects.functions.expression import KINDS


def value(e, x):
    """The expression's value at points, float64."""
    if isinstance(e, ex.Transform):
        back = Rotation.from_quat(e.rotation).inv()
        return e.scale * value(e.of[0], back.apply(x - np.array(e.at)) / e.scale)
    if e.parts:
        return joined(e, [value(part, x) for part in e.parts])
    radius = np.hypot(x[:, 0], x[:, 1])
    match e:
        case ex.Sphere():
            return np.sqrt((x**2).sum(axis=1)) - e.radius
        case ex.Box():
            half = np.array(e.size) / 2
            outside = np.linalg.norm(x - np.clip(x, -half, half), axis=1)
            return np.where(outside > 0, outside, -(half - abs(x)).min(axis=1))
        case ex.Cylinder():
            return disc_distance(radius, abs(x[:, 2]), e.radius, e.height / 2)
        case ex.Torus():
            return np.hypot(radius - e.radius, x[:, 2]) - e.tube
        case ex.Capsule():
            a, b = np.array(e.start), np.array(e.stop)
            t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            return np.linalg.norm(x - a - t[:, None] * (b - a), axis=1) - e.radius
        case ex.HalfSpace():
            return x @ np.array(e.normal) - e.distance


def disc_distance(r, h, radius, height):
    """Distance to a rectangle from the middle, in a quarter of the plane."""
    outside = np.hypot(np.maximum(r - radius, 0), np.maximum(h - height, 0))
    return np.where(outside > 0, outside, -np.minimum(radius - r, height - h))


def joined(e, values):
    """An operator's value from those of its parts."""
    first, rest = values[0], values[1:]
    match e:
        case ex.Union():
            return np.min(values, axis=0)
        case ex.Intersection():
            return np.max(values, axis=0)
        case ex.Difference():
            return np.max([first, *(-v for v in rest)], axis=0)
        case ex.SmoothUnion():
            near = np.clip(1 - abs(first - rest[0]) / e.width, 0, None)
            return np.minimum(first, rest[0]) - e.width / 4 * near**2
        case ex.Offset():
            return first - e.distance


length = st.floats(0.004, 0.06)
place = st.floats(-0.08, 0.08)
spot = st.tuples(place, place, place)


def far_apart(a, b, radius):
    """A capsule whose ends are apart."""
    return ex.Capsule(a, (b[0] + 0.2, b[1], b[2]), radius)


solids = st.one_of(
    st.builds(ex.sphere, length),
    st.builds(ex.box, length, length, length),
    st.builds(ex.cylinder, length, length),
    st.builds(ex.torus, length, length),
    st.builds(far_apart, spot, spot, length),
)
half_spaces = st.builds(lambda x, y, d: ex.half_space((x, y, 1.0), d), place, place, place)


def operators(part):
    """One more operator over some parts."""
    some = st.lists(part, min_size=2, max_size=4).map(tuple)
    return st.one_of(
        some.map(ex.Union),
        some.map(ex.Intersection),
        some.map(ex.Difference),
        st.builds(lambda a, b, w: a.blended(b, w), part, part, length),
        st.builds(lambda a, d: a.grown(d), part, st.floats(-0.01, 0.02)),
        st.builds(lambda a, at: a.moved(*at), part, spot),
        st.builds(lambda a, at: a.turned(*at), part, st.tuples(*[st.floats(-180, 180)] * 3)),
        st.builds(lambda a, f: a.scaled(f), part, st.floats(0.3, 3.0)),
    )


expressions = st.recursive(st.one_of(solids, half_spaces), operators, max_leaves=12)
bounded_expressions = st.recursive(solids, operators, max_leaves=8)
assert set(KINDS) == {"sphere", "box", "cylinder", "torus", "capsule", "half-space"} | {
    "union",
    "intersection",
    "difference",
    "smooth union",
    "offset",
    "transform",
}, "an oracle is missing"
