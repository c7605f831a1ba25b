"""Whether vertices are near enough to each other for a function of position, which is evaluated at vertices only."""

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from ..contour_batch import ContourBatch
from .user_code_digest import innermost

if TYPE_CHECKING:
    from .registry import Setting

LEVEL = 0.05  # of intensity that nobody feels: simplifying may change it, and ramps may be off by it
RESAMPLED = 0.25  # focal widths between vertices that "resample" leaves; shorter segments are never warned of


def length_least(func: Any, setting: "Setting") -> float:
    """Length above which segments are compared with a function [m]; infinite once this rendering has warned of it."""
    # float32 rounds the parts that "resample" leaves: none may be taken for longer
    return np.inf if _name_of(func) in setting.warned else 1.001 * RESAMPLED * setting.focal_width


def warn_of_bends(
    func: Any, batch: ContourBatch, deviation: wp.array, setting: "Setting", *, most: float, unit: str = ""
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
