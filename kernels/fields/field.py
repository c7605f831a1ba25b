"""Fields: solids as functions of position that kernels evaluate, and root finding on their surfaces.

Voxels, expression trees, user-defined functions and the inside of a mesh are all fields. A kernel that evaluates a
field is generated for the field's functions by a factory with `made_once`; fields that differ in `data` only share it.
"""

from collections.abc import Callable
from functools import cache, wraps
from threading import RLock
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..offsets import launch
from ..patch import EXACT

ROOT_STEPS = wp.constant(60)  # most steps of a root search
SLOPE_STEPS = wp.constant(16)  # steps with false position, of which every fourth bisects; later ones all bisect
ROOT_WIDTH = wp.constant(wp.float64(1.0e-8))  # [m]; accuracy of a root; the float32 spacing at 0.2 m is 1.5e-8 m
PROOF = wp.constant(wp.float64(0.9))  # distance beyond a predicted root at which its sign is tested [ROOT_WIDTH]

_MAKING = RLock()


def made_once(factory: Callable[..., Any]) -> Callable[..., Any]:
    """`functools.cache` that calls the factory once per arguments even if several threads ask at the same time."""
    cached = cache(factory)

    @wraps(factory)
    def made(*arguments: Any) -> Any:
        with _MAKING:
            return cached(*arguments)

    return made


class Field(NamedTuple):
    """A solid that can be evaluated at any point of the array's frame."""

    value: Any
    """wp.func (data, x: wp.vec3d [m]) -> wp.float64: below 0 inside, 0 or above outside; finite everywhere."""
    data_type: Any
    """The wp.struct class of `data`."""
    data: Any
    """The struct that the functions read, on one device."""
    root: Any = None
    """wp.func (data, a: wp.vec3d, b: wp.vec3d) -> wp.vec3d: a point of the surface between a and b, of which exactly
    one is inside; swapping a and b gives the same bits. None: `root_of` finds it from `value`."""
    ball: Any = None
    """wp.func (data, x: wp.vec3d, radius: wp.float64 [m]) -> int: -1 if all points at most `radius` from x are surely
    inside, 1 if all are outside, 0 if neither or not known. Searches skip balls with -1 or 1, so it saves time and must
    not change results. None: 0 everywhere. For signed distances use `distance_ball`."""

    inside: Any = None
    """wp.func (data, x: wp.vec3d) -> bool: a faster test whether `value` is below 0. None: `value` is computed."""
    grain: float = 0.0
    """Resolution of the data, as the voxel spacing: smaller details are not the solid's [m]."""


@wp.func
def ball_unknown(data: Any, x: wp.vec3d, radius: wp.float64):
    """A ball function for fields without one: always unknown."""
    return int(0)


@made_once
def distance_ball(value: Any) -> Any:
    """A wp.func as `Field.ball` for a 1-Lipschitz value function, such as a signed distance [m]."""

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
    """A wp.func (data, inner, outer, f_inner, f_outer, least) -> root's position from inner (0) to outer (1).

    Illinois false position, with bisection where that is slow; it ends once the sign changes within `least`, also for
    a flat value function. Once the slopes to both ends predict a root within `least`, the next value lies just
    beyond the prediction; a change of sign confirms the root. If the sign does not change, all further steps bisect.
    """

    @wp.func
    def share(data: Any, inner: wp.vec3d, outer: wp.vec3d, f_inner: wp.float64, f_outer: wp.float64, least: wp.float64):
        half = wp.float64(0.5)
        span = outer - inner
        fa = wp.float64(f_inner)
        fb = wp.float64(f_outer)
        low = wp.float64(0.0)  # inside
        high = wp.float64(1.0)  # outside
        at = wp.float64(0.0)
        weight = wp.float64(1.0)  # Illinois weight of the inner end's value relative to the outer end's
        moved_last = int(0)  # end; 1: inner, 2: outer
        state = int(0)  # 1: the next value confirms the prediction; 2: bisect
        step = int(0)
        while step < ROOT_STEPS and high - low > least:
            if state == 1:
                at = wp.where(moved_last == 1, at + PROOF * least, at - PROOF * least)
            elif state == 2 or step % 4 == 3 or step >= SLOPE_STEPS:
                at = half * (low + high)
            else:
                at = low + (high - low) * (weight * fa / (weight * fa - fb))
            # keep this distance from the ends: if one end is the root, the other end can still approach it
            at = wp.clamp(at, low + half * least, high - half * least)
            f = value(data, inner + at * span)
            if state == 1:
                state = int(2)  # bisect unless this value confirms the root, which ends the loop
            elif state == 0:
                near = half * least
                if wp.abs(f) * (at - low) <= near * (f - fa) and wp.abs(f) * (high - at) <= near * (fb - f):
                    state = int(1)
            if f < wp.float64(0.0):
                low = at
                fa = f
                weight = wp.where(moved_last == 1, wp.float64(2.0) * weight, wp.float64(1.0))
                moved_last = int(1)
            else:
                high = at
                fb = f
                weight = wp.where(moved_last == 2, half * weight, wp.float64(1.0))
                moved_last = int(2)
            step += int(1)
        return low + (high - low) * (fa / (fa - fb))

    return share


@made_once
def root_of(value: Any) -> Any:
    """A wp.func as `Field.root` for a value function, accurate to ROOT_WIDTH. An outer end with value 0 is the root
    itself, unless the value is 0 over an interval: then the root is the interval's inner end.

    The search always runs from the inner end, so the result does not depend on the order of a and b.
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
    """`Field.root`, or `root_of` the field's value."""
    return field.root or root_of(field.value)


def inside_function(field: Field) -> Any:
    """`Field.inside`, or `inside_of` the field's value."""
    return field.inside or inside_of(field.value)


MODULE = {"module": "unique", "module_options": EXACT}  # options of generated kernels: wp.kernel(**MODULE)


wp.set_module_options(EXACT)


@wp.struct
class Lattice:
    """Points at equal steps along the axes."""

    low: wp.vec3d  # the first [m]
    step: wp.vec3d  # [m]


@wp.func
def node_at(lattice: Lattice, i: int, j: int, k: int):
    """A node's place [m]."""
    offset = wp.cw_mul(lattice.step, wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k)))
    return lattice.low + offset


def lattice_of(low: np.ndarray, step: np.ndarray | float) -> Lattice:
    """A lattice from its first point and its steps [m]."""
    out = Lattice()
    out.low, out.step = wp.vec3d(*low), wp.vec3d(*np.broadcast_to(step, 3))
    return out


@made_once
def probing_kernels(value: Any, data_type: Any) -> tuple[Any, Any]:
    """The kernels that ask one kind of field: at points, and at nodes."""

    @wp.kernel(**MODULE)
    def _probe_points(data: data_type, point: wp.array[wp.vec3d], out: wp.array[wp.float64]):
        """One value a point."""
        i = wp.tid()
        out[i] = wp.float64(value(data, point[i]))

    @wp.kernel(**MODULE)
    def _probe_nodes(data: data_type, lattice: Lattice, out: wp.array3d[wp.float64]):
        """One value a node."""
        i, j, k = wp.tid()
        out[i, j, k] = wp.float64(value(data, node_at(lattice, i, j, k)))

    return _probe_points, _probe_nodes


def probe_points(field: Field, points: np.ndarray, *, device: str) -> np.ndarray:
    """A field's values at points.

    points: [m], shape [point, 3]; device: where the field's data lie. Returns float64, shape [point].
    """
    kernel = probing_kernels(field.value, field.data_type)[0]
    point = wp.array(np.ascontiguousarray(points, np.float64), dtype=wp.vec3d, device=device)
    out = wp.empty(len(points), dtype=wp.float64, device=device)
    launch(kernel, len(points), [field.data, point], [out])
    return out.numpy()


def probe_nodes(field: Field, lattice: Lattice, shape: tuple[int, int, int], *, device: str) -> np.ndarray:
    """A field's values at the nodes of a lattice, float64, of the given shape."""
    kernel = probing_kernels(field.value, field.data_type)[1]
    out = wp.empty(shape, dtype=wp.float64, device=device)
    launch(kernel, shape, [field.data, lattice], [out])
    return out.numpy()
