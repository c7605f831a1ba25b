"""Which poses of a motion a picture shows: those at times that are asked for, or distinct ones that it chooses."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ...datasets.rigid import rotate
from ..errors import StrategyError

CANDIDATES = 48  # poses of which distinct ones are chosen: the best of so many equal ranges of poses
APART = 0.02  # [m] by which two poses differ at least, in the places of the palm's corners and of the contours on it
MOMENTS_MOST = 6
SPREAD = 0.1  # [m] of difference that the whole duration between two poses counts as
CORNERS = 0.0425 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], np.float64)  # [m], hand frame
SAMPLED = 64  # points of a pose's contours that are compared

ContoursOf = Callable[[int], np.ndarray]
"""Points of a pose's contours [m], array frame, shape [point, 3]."""


class MotionMoments(NamedTuple):
    """The poses that can be shown."""

    pose: np.ndarray
    """Of the hand, shape [pose, 7]."""
    time: np.ndarray | None
    """[s], shape [pose]; None for poses without times."""

    def at(self, index: int) -> float:
        """Time of a pose [s], or its number."""
        return float(index) if self.time is None else float(self.time[index])

    def text(self, index: int) -> str:
        """Time or number of a pose, for titles."""
        return f"pose {index}" if self.time is None else f"{self.time[index]:.2f} s"


def poses_at(times: Sequence[float], moments: MotionMoments, name: str) -> np.ndarray:
    """The poses that are nearest to times [s], or with these numbers where poses have no times; in order.

    name: of the file, for messages. Raises StrategyError for no time, more than MOMENTS_MOST, one outside the motion,
    and two of the same pose.
    """
    if not 1 <= len(times) <= MOMENTS_MOST:
        raise StrategyError(f"a picture shows 1 to {MOMENTS_MOST} moments, not {len(times)}: draw several pictures")
    count = len(moments.pose)
    where = np.arange(count, dtype=float) if moments.time is None else moments.time
    what, unit = ("pose", "") if moments.time is None else ("time", " s")
    chosen: list[int] = []
    for given in sorted(float(time) for time in times):
        if not (math.isfinite(given) and where[0] <= given <= where[-1]):
            raise StrategyError(
                f"{what} {given:g}{unit} is outside {name}, which has {what}s {where[0]:g} to {where[-1]:g}{unit}"
            )
        if moments.time is None and given != int(given):
            raise StrategyError(f"{name} has no times, so moments are numbers of poses, not {given:g}")
        nearest = int(np.argmin(np.abs(where - given)))
        if nearest in chosen:
            raise StrategyError(f"{what} {given:g}{unit} shows pose {nearest} again: leave out one of the two")
        chosen.append(nearest)
    return np.array(chosen)


def distinct_poses(worth: np.ndarray, moments: MotionMoments, contours_of: ContoursOf, count: int) -> np.ndarray:
    """At most `count` poses of much worth that differ from each other in pose and contour; in order.

    worth: of showing a pose, at least 0, shape [pose]. The first pose that is chosen is that of most worth. Each other
    one is the one whose worth (its root) times its distance from those chosen, in place, contour and time, is largest.
    Poses nearer than APART are not chosen. The first pose if none is worth anything.
    """
    ranges = np.array_split(np.arange(len(worth)), min(CANDIDATES, len(worth)))
    best = np.array([part[np.argmax(worth[part])] for part in ranges])
    best = best[worth[best] > 0]
    if not len(best):
        return np.zeros(1, int)
    placed = moments.pose[best][:, None]
    corners = placed[..., :3] + rotate(np.asarray(placed[..., 3:], np.float64), CORNERS[None])
    contours = [_on_palm(contours_of(int(i)), moments.pose[i]) for i in best]
    share = np.sqrt(worth[best] / worth[best].max())
    chosen = [int(np.argmax(share))]
    apart, spread = np.full(len(best), np.inf), np.full(len(best), np.inf)
    while len(chosen) < min(count, len(best)):
        latest = chosen[-1]
        moved = np.linalg.norm(corners - corners[latest], axis=2).mean(axis=1)
        later = SPREAD * np.abs(best - best[latest]) / len(worth)
        changed = np.array([_distance(own, contours[latest]) for own in contours])
        apart = np.minimum(apart, moved + 2.0 * changed)
        spread = np.minimum(spread, later)
        gain = np.where(apart >= APART, share * (apart + spread), 0.0)
        if not gain.any():
            break
        chosen.append(int(np.argmax(gain)))
    return np.sort(best[chosen])


def _on_palm(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Some points of a pose's contours in the hand's frame [m], shape [point, 3]."""
    some = points[np.linspace(0, len(points) - 1, min(SAMPLED, len(points))).astype(int)] if len(points) else points
    back = np.asarray(pose[3:], np.float64) * [-1, -1, -1, 1]
    return rotate(back, np.asarray(some, np.float64) - pose[:3])


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance of each of two sets of points from the other [m]."""
    if not len(a) or not len(b):
        return 0.0 if len(a) == len(b) else 0.085
    apart = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(apart.min(axis=1).mean() + apart.min(axis=0).mean()) / 2
