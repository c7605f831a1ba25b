"""A user's Warp function applied to every point of a batch: point -> point, or point -> intensity."""

from functools import cache
from typing import Any

import warp as wp

from ..fields.field import MODULE


@cache
def _make_point_kernel(func: Any) -> Any:
    """A kernel that moves every point by a function vec3 -> vec3."""

    @wp.kernel(**MODULE)
    def _map_points(
        # In:
        points: wp.array[wp.vec3],
        # Out:
        moved: wp.array[wp.vec3],
    ):
        """Move each point."""
        i = wp.tid()
        moved[i] = func(points[i])

    return _map_points


@cache
def _make_intensity_kernel(func: Any) -> Any:
    """A kernel that asks a function vec3 -> float at every point."""

    @wp.kernel(**MODULE)
    def _map_intensity(
        # In:
        points: wp.array[wp.vec3],
        # Out:
        intensity: wp.array[wp.float32],
    ):
        """Ask at each point."""
        i = wp.tid()
        intensity[i] = wp.float32(func(points[i]))

    return _map_intensity


def map_points(func: Any, points: wp.array) -> wp.array:
    """Every point [m], vec3 [point], at where a wp.func vec3 -> vec3 puts it, on the points' device."""
    moved = wp.empty_like(points)
    wp.launch(_make_point_kernel(func), points.shape[0], inputs=[points], outputs=[moved], device=points.device)
    return moved


def map_intensity(func: Any, points: wp.array) -> wp.array:
    """Values of a wp.func vec3 -> float at every point, float32 [point], on the points' device."""
    intensity = wp.empty(points.shape[0], dtype=wp.float32, device=points.device)
    kernel = _make_intensity_kernel(func)
    wp.launch(kernel, points.shape[0], inputs=[points], outputs=[intensity], device=points.device)
    return intensity
