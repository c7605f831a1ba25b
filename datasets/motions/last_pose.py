"""When a motion ends: no next pose says how long its last one lasts."""

import numpy as np
from numpy.typing import NDArray

INTERVALS_LOOKED_AT = 4096
"""First intervals of a motion of which the median is taken, so that a file's other times need not be read."""
LAST_MOST = 0.1
"""Longest time for which a last pose lasts [s]: poses that are farther apart are chosen ones, not a tracker's."""


def usual_interval(time: NDArray[np.float64]) -> float:
    """Median of the first intervals between times of two poses or more [s]."""
    return float(np.median(np.diff(time[: INTERVALS_LOOKED_AT + 1]), overwrite_input=True))


def end_of_motion(time: NDArray[np.float64], last: float | None = None) -> float:
    """When a motion ends [s]: its last pose lasts one usual interval, at most LAST_MOST; a single pose does not last.

    time: of its first poses, INTERVALS_LOOKED_AT + 1 at least or all. last: of its last pose; None: the last of `time`.
    """
    end = float(time[-1]) if last is None else last
    return end + min(usual_interval(time), LAST_MOST) if len(time) > 1 else end
