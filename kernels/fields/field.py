"""A solid as a function of position: what kernels ask of it, and where it turns from inside to outside.

Voxels, expression trees, a user's own function and the inside of a mesh are all fields. A kernel that asks one is made
for its functions by a factory with `made_once`; data of the same type share it.
"""

from collections.abc import Callable
from functools import cache, wraps
from threading import RLock
from typing import Any, NamedTuple

import warp as wp

from ..patch import EXACT

ROOT_STEPS = wp.constant(60)  # at worst
SLOPE_STEPS = wp.constant(16)  # of these by slopes, every fourth of them halves; the others all do
ROOT_WIDTH = wp.constant(wp.float64(1.0e-8))  # [m]; how well a root is known; float32's step at 0.2 m is 1.5e-8 m
PROOF = wp.constant(wp.float64(0.9))  # of that: how far beyond a root it is proven

_MAKING = RLock()


def made_once(factory: Callable[..., Any]) -> Callable[..., Any]:
    """`functools.cache` for what must be made once, whichever threads ask for it at the same time."""
    cached = cache(factory)

    @wraps(factory)
    def made(*arguments: Any) -> Any:
        with _MAKING:
            return cached(*arguments)

    return made


class Field(NamedTuple):
    """A solid that can be asked at any point of the array's frame."""

    value: Any
    """wp.func (data, x: wp.vec3d [m]) -> wp.float64: below 0 inside, 0 or above outside; finite everywhere."""
    data_type: Any
    """The wp.struct class of `data`."""
    data: Any
    """What `value` reads, on one device."""
    root: Any = None
    """wp.func (data, a: wp.vec3d, b: wp.vec3d) -> wp.vec3d: a point of the surface between a and b, of which exactly
    one is inside; symmetric in a and b to the bit. None: found from `value`, see `root_of`."""
    ball: Any = None
    """wp.func (data, x: wp.vec3d, radius: wp.float64 [m]) -> int: -1 if every point nearer to x than radius, or as
    near, is surely inside, 1 if outside, 0 if neither or not known. None: never known. Searches skip what it settles,
    so it saves time and must not change what they find; signed distances have `distance_ball`."""

    inside: Any = None
    """wp.func (data, x: wp.vec3d) -> bool: whether `value` is below 0 there, found sooner than the value; or None."""
    grain: float = 0.0
    """Size of the details that are no longer the solid's, as the spacing of voxels [m]."""


@made_once
def distance_ball(value: Any) -> Any:
    """A wp.func as `Field.ball` for a value function that changes by at most 1 a metre, as signed distances do."""

    @wp.func
    def ball(data: Any, x: wp.vec3d, radius: wp.float64):
        d = value(data, x)
        if d > radius:
            return int(1)
        if d < -radius:
            return int(-1)
        return int(0)

    return ball


@made_once
def inside_of(value: Any) -> Any:
    """A wp.func as `Field.inside` for a value function."""

    @wp.func
    def inside(data: Any, x: wp.vec3d):
        return value(data, x) < wp.float64(0.0)

    return inside


@made_once
def share_of(value: Any) -> Any:
    """A wp.func (data, inner, outer, f_inner, f_outer, least) -> share of the way from inner to outer to the root.

    Illinois' false position, halving where that is slow; it ends where the sign changes within `least`, whatever the
    value's slope. Once a value is that near to 0 by its slopes to both ends, the next one is taken just beyond the root
    they tell: that proves it. Where it does not, the value is flat there, and the way is halved from then on.
    """

    @wp.func
    def share(data: Any, inner: wp.vec3d, outer: wp.vec3d, f_inner: wp.float64, f_outer: wp.float64, least: wp.float64):
        half = wp.float64(0.5)
        way = outer - inner
        fa = wp.float64(f_inner)
        fb = wp.float64(f_outer)
        low = wp.float64(0.0)  # inside
        high = wp.float64(1.0)  # outside
        at = wp.float64(0.0)
        weight = wp.float64(1.0)  # of the value at the inner end, against that at the outer one
        kept = int(0)
        state = int(0)  # 1: the next value is the proof; 2: halve
        step = int(0)
        while step < ROOT_STEPS and high - low > least:
            if state == 1:
                at = wp.where(kept == 1, at + PROOF * least, at - PROOF * least)
            elif state == 2 or step % 4 == 3 or step >= SLOPE_STEPS:
                at = half * (low + high)
            else:
                at = low + (high - low) * (weight * fa / (weight * fa - fb))
            # never nearer to an end than this: once an end is the root, the other one closes up
            at = wp.clamp(at, low + half * least, high - half * least)
            f = value(data, inner + at * way)
            if state == 1:
                state = int(2)  # if this was no proof
            elif state == 0:
                near = half * least
                if wp.abs(f) * (at - low) <= near * (f - fa) and wp.abs(f) * (high - at) <= near * (fb - f):
                    state = int(1)
            if f < wp.float64(0.0):
                low = at
                fa = f
                weight = wp.where(kept == 1, wp.float64(2.0) * weight, wp.float64(1.0))
                kept = int(1)
            else:
                high = at
                fb = f
                weight = wp.where(kept == 2, half * weight, wp.float64(1.0))
                kept = int(2)
            step += int(1)
        return low + (high - low) * (fa / (fa - fb))

    return share


@made_once
def root_of(value: Any) -> Any:
    """A wp.func as `Field.root` for a value function, to ROOT_WIDTH; an outer end of value 0 is met exactly,
    unless the value is 0 over a stretch: then the stretch's inner end is met.

    The end that is inside comes first whichever it is, so the result does not depend on the order of a and b.
    """
    share = share_of(value)

    @wp.func
    def root(data: Any, a: wp.vec3d, b: wp.vec3d):
        fa = value(data, a)
        fb = value(data, b)
        least = ROOT_WIDTH / wp.max(wp.length(b - a), ROOT_WIDTH)
        if fb < wp.float64(0.0):
            return b + share(data, b, a, fb, fa, least) * (a - b)
        return a + share(data, a, b, fa, fb, least) * (b - a)

    return root


def root_function(field: Field) -> Any:
    """The field's own root function, or the one made from its value."""
    return field.root or root_of(field.value)


def inside_function(field: Field) -> Any:
    """The field's own inside function, or the one made from its value."""
    return field.inside or inside_of(field.value)


MODULE = {"module": "unique", "module_options": EXACT}  # how factories make kernels: wp.kernel(**MODULE)
