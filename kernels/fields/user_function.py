"""A user's own Warp function of position as a field."""

from typing import Any

import numpy as np
import warp as wp

from .field import Field, made_once

NOWHERE = wp.constant(wp.float64(1.0))  # a value that is not a number counts as outside
HIGHEST = wp.constant(wp.float64(1e30))


@wp.struct
class Placed:
    """Placement of a function's own coordinates in the array's frame, and the bounding box of its solid."""

    turn: wp.mat33d  # array frame -> own axes
    at: wp.vec3d  # of its origin, array frame [m]
    scale: wp.float64  # own coordinates -> metres of the array frame
    low: wp.vec3d  # of the box, own coordinates
    high: wp.vec3d


@wp.func
def local_point(data: Placed, x: wp.vec3d):
    """A point of the array's frame in the function's own coordinates."""
    return (data.turn * (x - data.at)) / data.scale


@wp.func
def value_in_box(data: Placed, own: wp.vec3d, f: wp.float64):
    """The function's value, raised outside the box so that it is always above 0 there."""
    known = NOWHERE
    if wp.isfinite(f):
        known = f
    beyond = wp.max(wp.max(data.low - own), wp.max(own - data.high))
    return wp.clamp(wp.max(known, beyond), -HIGHEST, HIGHEST)


@made_once
def function_value(function: Any, double: bool) -> Any:
    """The `Field.value` of a Warp function of wp.vec3d (double) or of wp.vec3."""

    @wp.func
    def value_double(data: Placed, x: wp.vec3d):
        own = local_point(data, x)
        return value_in_box(data, own, wp.float64(function(own)))

    @wp.func
    def value_single(data: Placed, x: wp.vec3d):
        own = local_point(data, x)
        rounded = wp.vec3(wp.float32(own[0]), wp.float32(own[1]), wp.float32(own[2]))
        return value_in_box(data, own, wp.float64(function(rounded)))

    return value_double if double else value_single


@made_once
def raw_value(function: Any, double: bool) -> Any:
    """Return value of a Warp function at a point in its own coordinates; it may be NaN."""

    @wp.func
    def raw_double(data: Placed, x: wp.vec3d):
        return wp.float64(function(x))

    @wp.func
    def raw_single(data: Placed, x: wp.vec3d):
        return wp.float64(function(wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))))

    return raw_double if double else raw_single


def function_field(
    function: Any, *, turn: np.ndarray, at: np.ndarray, scale: float, bounds: np.ndarray, double: bool
) -> Field:
    """A placed function as a field, on any device.

    turn: rotation own -> array, shape [3, 3]; at: [m], shape [3]; scale: own coordinates -> metres;
    bounds: own coordinates, shape [2, 3]; double: whether the function takes a wp.vec3d.
    """
    data = Placed()
    data.turn, data.at, data.scale = wp.mat33d(*turn.T.ravel()), wp.vec3d(*at), scale
    data.low, data.high = wp.vec3d(*bounds[0]), wp.vec3d(*bounds[1])
    return Field(function_value(function, double), Placed, data)
