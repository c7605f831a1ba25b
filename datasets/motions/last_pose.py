"""When a motion ends: no next pose says how long its last one lasts."""

import numpy as np
from numpy.typing import NDArray

INTERVALS_LOOKED_AT = 4096
"""First intervals of a motion of which the median is taken, so that a file's other times need not be read."""
INTERVAL_MOST = 1.0
"""Longest interval that a last pose lasts, too [s]: poses farther apart were chosen by a person, not by a tracker."""


def usual_interval(time: NDArray[np.float64]) -> float:
    """Median of the first intervals between times of two poses or more [s]."""
    return float(np.median(np.diff(time[: INTERVALS_LOOKED_AT + 1]), overwrite_input=True))


def end_of_motion(time: NDArray[np.float64], last: float | None = None) -> float:
    """When a motion ends [s]: its last pose lasts one usual interval, or not at all if that is over INTERVAL_MOST.

    Poses at 0 and 4 s are a motion of 4 s. A single pose does not last.

    time: of its first poses, INTERVALS_LOOKED_AT + 1 at least or all. last: of its last pose; None: the last of `time`.
    """
    end = float(time[-1]) if last is None else last
    interval = usual_interval(time) if len(time) > 1 else 0.0
    return end + interval if interval <= INTERVAL_MOST else end
