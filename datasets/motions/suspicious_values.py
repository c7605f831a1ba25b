"""Signs that a motion's numbers are in other units, or its quaternions in another order, than those of palpate."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .facing import SHARE_ANGLES, facing_angles
from .last_pose import usual_interval

_REACH_LIKELY = 5.0  # [m]; farther positions, up to a thousand times this, look like millimetres
_POSES_AT_ONCE = 4096
# Median intervals [s] from which on times look like those of a unit, a tracker's poses being 1 ms to 1 s apart, and
# the fewest poses for which they do: a few poses may well be some seconds apart.
_TIME_UNITS = (
    ("nanoseconds", "ns", 1e-9, 1e6, 1e9, 2),
    ("microseconds", "us", 1e-6, 1e3, 1e6, 3),
    ("milliseconds", "ms", 1e-3, 1.0, 100.0, 10),
)
_TRACKER_RATES = (30.0, 60.0, 72.0, 90.0, 120.0)  # [Hz]; 1000 divided by each is no whole number
_FRAMES_FEWEST = 4


def likely_time_unit(interval: float, pose_count: int) -> str | None:
    """The unit in which times with this median interval [s] probably are, and what they would be; None for seconds."""
    for name, short, second, least, most, fewest in _TIME_UNITS:
        if least <= interval <= most and pose_count >= fewest:
            return f"{name}; times are in seconds, {interval:g} {short} are {interval * second:g}"
    return None


def are_frames_in_ms(time: NDArray[np.float64]) -> bool:
    """Whether times are whole numbers from 0, and those of a tracker's frames in ms, rounded up or down.

    Tells 0, 11, 22, 33 (90 Hz) from what a person chooses, as 0, 10, 20, 30 s. Fewer than 4 times never are.
    """
    frame = np.arange(len(time))
    exact = (1e3 * frame / rate for rate in _TRACKER_RATES)
    return len(time) >= _FRAMES_FEWEST and any(
        bool(((time == np.floor(times)) | (time == np.ceil(times))).all()) for times in exact
    )


def suspicious_units(pose: NDArray[np.float32], time: NDArray[np.float64] | None) -> Iterator[str]:
    """A sentence for positions that look like millimetres, and for times that look like smaller units than seconds.

    pose: shape [pose, 7]; time: theirs from 0 [s], None without times.
    """
    reach = max(float(pose[:, :3].max()), -float(pose[:, :3].min()))
    if _REACH_LIKELY < reach <= 1e3 * _REACH_LIKELY:
        yield f"positions reach {reach:g} m; lengths are in metres, {reach:g} mm are {reach / 1e3:g}"
    if time is None or len(time) < 2:
        return
    interval, fewest = usual_interval(time), _TIME_UNITS[-1][-1]
    is_short = len(time) < fewest and are_frames_in_ms(time)
    unit = likely_time_unit(interval, fewest if is_short else len(time))
    if unit is not None:
        yield f"times are {interval:g} s apart, which looks like {unit}"


def rounding(quaternion: NDArray[np.float64]) -> str:
    """Part of a sentence on a quaternion, shape [4], whose norm is not 1: that rounding it to few decimals explains it.

    Half a unit of the last decimal in each of four numbers moves the norm by one unit at most.
    """
    off = abs(float(np.linalg.norm(quaternion)) - 1.0)
    for decimals in (1, 2, 3):
        if np.abs(quaternion - quaternion.round(decimals)).max() < 1e-6:
            return f"; likely cause: rounded to {decimals} decimals: write six" if off <= 0.1**decimals else ""
    return ""


def suspicious_directions(pose: NDArray[np.float32]) -> Iterator[str]:
    """A sentence for poses of a palm, shape [pose, 7], of which none faces the array within 60 degrees."""
    most = max(SHARE_ANGLES)
    for first in range(0, len(pose), _POSES_AT_ONCE):
        if (facing_angles(pose[first : first + _POSES_AT_ONCE]) <= np.radians(most)).any():
            return
    yield (
        f"no pose faces the array: the palm's skin is turned away from its centre by more than {most} degrees in all "
        f"{len(pose)} poses; quaternions in the order w x y z need a header that says so: time,x,y,z,qw,qx,qy,qz"
    )
