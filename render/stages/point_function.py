"""Functions of position as transform stages: a Warp function gives each vertex another place, or its intensity.

A function is evaluated at vertices only: a rendering warns of segments along which it is no straight line.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from ...kernels.stages.point_function import map_intensity, map_points
from ..contour_batch import ContourBatch
from ..validation import require_choice
from .registry import StageEntry, first_line, register_stage
from .setting import Setting
from .user_code_digest import innermost

LEVEL = 0.05  # of intensity that nobody feels: simplifying may change it, and ramps may be off by it
RESAMPLED = 0.25  # focal widths between vertices that "resample" leaves; shorter segments are never warned of


def register_point_function(name: str, func: Any, *, gives: str) -> None:
    """Register a Warp function as a transform stage that runs for every point on the device.

    func: a wp.func defined in a file. gives: "point" for x -> wp.vec3, the new point [m, array frame], or "intensity"
    for x -> float in 0..1; x: wp.vec3 [m, array frame]. Segments stay straight between vertices, and intensity linear:
    put the stage "resample" before a function that varies faster. Rendering warns of a segment longer than a quarter of
    the focal width on which the function is off that by more than 0.05, or by a quarter of the focal width.

    >>> import warp as wp
    >>> from palpate.render import IntersectionStrategy, register_point_function, render, static_pose
    >>> @wp.func
    ... def twice_as_high(x: wp.vec3):
    ...     "Every point twice as high."
    ...     return wp.vec3(x[0], x[1], 2.0 * x[2])
    >>> register_point_function("example-twice-as-high", twice_as_high, gives="point")
    >>> strategy = IntersectionStrategy(prune=("outside",), transform=("close", "example-twice-as-high"))
    >>> render("cube", "palm", static_pose([0, 0, 0.2]), strategy).points[0]
    array([-0.0425, -0.0425,  0.4   ], dtype=float32)
    """
    require_choice(f"stage {name!r}: gives", gives, ("point", "intensity"))
    stage = move_points if gives == "point" else set_intensity
    line = first_line(getattr(func, "func", func))
    register_stage(StageEntry(name, "transform", line, {}, partial(stage, func), "device"))


def move_points(func: Any, batch: ContourBatch, setting: Setting) -> ContourBatch:
    """Move every point to the result of a Warp function; warn of segments that it would bend."""
    points, deviation = map_points(func, batch.points, length_least=length_least(func, setting))
    warn_of_bends(func, batch, deviation, setting, most=RESAMPLED * setting.focal_width, unit=" m")
    return replace(batch, points=points)


def set_intensity(func: Any, batch: ContourBatch, setting: Setting) -> ContourBatch:
    """Set the intensity at every point to the result of a Warp function; warn of segments where it is no ramp."""
    intensity, deviation = map_intensity(func, batch.points, length_least=length_least(func, setting))
    warn_of_bends(func, batch, deviation, setting, most=LEVEL)
    return replace(batch, intensity=intensity)


def length_least(func: Any, setting: Setting) -> float:
    """Length above which segments are compared with a function [m]; infinite once this rendering has warned of it."""
    # float32 rounds the parts that "resample" leaves: none may be taken for longer
    return np.inf if _name_of(func) in setting.warned else 1.001 * RESAMPLED * setting.focal_width


def warn_of_bends(
    func: Any, batch: ContourBatch, deviation: wp.array, setting: Setting, *, most: float, unit: str = ""
) -> None:
    """Warn, once a rendering, of a segment along which a function leaves the straight line by more than `most`.

    deviation: as `map_intensity` gives it, in `unit`.
    """
    if deviation.shape[0] == 0:
        return
    off = deviation.numpy().copy()
    if not off.max(initial=0.0) > most:  # NaN compares false: what is not finite is refused later
        return
    is_segment, length = segment_lengths(batch.numpy())
    off[~(is_segment & (off > most))] = 0.0
    at = int(off.argmax())
    if off[at] > 0:
        name = _name_of(func)
        setting.warn_once(
            name,
            f"{name}: along a segment of {length[at]:.2g} m this function of position is up to {off[at]:.2g}{unit} off "
            "the straight line between the segment's ends, and contours follow it at vertices only: put the stage "
            '"resample" before it',
        )


def _name_of(func: Any) -> str:
    """The name of a Warp function."""
    return getattr(innermost(func), "__name__", repr(func))


def segment_lengths(batch: ContourBatch) -> tuple[np.ndarray, np.ndarray]:
    """Whether a segment starts at each point, and its length [m], 0 where none does; for a batch on the host."""
    points = batch.points.astype(np.float64)
    is_segment = np.ones(len(points), bool)
    is_segment[batch.polyline_start[1:][np.diff(batch.polyline_start) > 0] - 1] = False
    length = np.zeros(len(points))
    here = np.flatnonzero(is_segment)
    length[here] = np.linalg.norm(points[here + 1] - points[here], axis=1)
    return is_segment, length
