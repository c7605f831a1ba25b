"""Points of each pose, thinned: one is chosen if no point chosen before is nearer than the separation."""

from collections.abc import Callable
from math import ceil, floor, log10

import numpy as np
import warp as wp

from ..offsets import launch, scan_counts
from ..one_device import on_one_device
from ..patch import EXACT, to_float64

wp.set_module_options(EXACT)

POINTS_MOST = 2000  # of a pose's path: the work grows with their square, to about a second
NARROWEST = 1e-6  # [m]
WIDER = 1.2  # from one separation that is tried to the next


@wp.func
def apart(x: wp.vec3, y: wp.vec3):
    """Square of the distance of two points [m2]."""
    d = to_float64(x) - to_float64(y)
    return wp.dot(d, d)


@wp.kernel
def _thin_points(
    start: wp.array[wp.int64],
    separation: wp.float64,  # [m]
    most: wp.int64,  # to keep; one more shows that there are more
    # In and out:
    point: wp.array[wp.vec3],  # those chosen come first in each pose's range
    count: wp.array[wp.int64],  # chosen, shape [pose + 1], the last one stays 0
):
    """Keep points that are not too near to one chosen before; where but one is left, the farthest from it too."""
    pose = wp.tid()
    first = start[pose]
    n = wp.int64(0)
    far = wp.float64(0.0)
    farthest = wp.vec3()
    for c in range(int(start[pose + 1] - first)):
        if n > most:
            break
        x = point[first + wp.int64(c)]
        k = n - wp.int64(1)
        while k >= wp.int64(0):  # the latest first: it is likely near
            if apart(x, point[first + k]) < separation * separation:
                break
            k -= wp.int64(1)
        if k < wp.int64(0):
            point[first + n] = x
            n += wp.int64(1)
        elif n == wp.int64(1) and apart(x, point[first]) > far:
            far = apart(x, point[first])
            farthest = x
    if n == wp.int64(1) and far > wp.float64(0.0):
        point[first + n] = farthest
        n = wp.int64(2)
    count[pose] = n


@wp.kernel
def _gather_points(
    point: wp.array[wp.vec3], start: wp.array[wp.int64], chosen_start: wp.array[wp.int64], chosen: wp.array[wp.vec3]
):
    """Move what each pose keeps together."""
    pose = wp.tid()
    for k in range(int(chosen_start[pose + 1] - chosen_start[pose])):
        chosen[chosen_start[pose] + wp.int64(k)] = point[start[pose] + wp.int64(k)]


class TooManyPointsError(ValueError):
    """More points are left at a pose than a path is looked for through."""

    def __init__(self, pose: int, point_count: int, separation: float) -> None:
        super().__init__(f"more than {POINTS_MOST} of {point_count} points are {separation:g} m apart")
        self.pose = pose
        """Row of the pose."""
        self.point_count = point_count
        """Its points before they are thinned."""


@on_one_device
def thin_points(point: wp.array, start: wp.array, *, separation: float) -> tuple[wp.array, wp.array]:
    """Thin each pose's points until none is nearer to another than `separation` [m]; they keep their order.

    point: vec3 [m], shape [point]; start: offsets of each pose's points, int64, shape [pose + 1].
    Where but one would be left, the point farthest from it is chosen too, so that there is something to draw.
    Returns the points that are left and their offsets. Raises ValueError for a separation that is not positive,
    TooManyPointsError for the first pose where more than POINTS_MOST would be left.
    """
    if not 0.0 < separation < float("inf"):
        raise ValueError(f"separation must be a positive length, not {separation} m")
    device, pose_count = point.device, start.shape[0] - 1
    scratch = wp.clone(point)
    count = wp.zeros(pose_count + 1, dtype=wp.int64, device=device)
    launch(_thin_points, pose_count, [start, wp.float64(separation), wp.int64(POINTS_MOST), scratch], [count])
    over = np.flatnonzero(count.numpy() > POINTS_MOST)
    if len(over):
        pose = int(over[0])
        raise TooManyPointsError(pose, int(np.diff(start.numpy()[pose : pose + 2])[0]), separation)
    (chosen_start,), (total,) = scan_counts(count)
    chosen = wp.empty(total, dtype=wp.vec3, device=device)
    launch(_gather_points, pose_count, [scratch, start, chosen_start], [chosen])
    return chosen, chosen_start


def separation_that_fits(fits: Callable[[float], bool], separation: float) -> float:
    """A larger separation, of two digits, at which a pose keeps POINTS_MOST points at most [m].

    fits: whether it does at a separation.
    """
    separation = max(separation, NARROWEST)
    while True:
        separation *= WIDER
        digit = 10.0 ** (floor(log10(separation)) - 1)
        separation = round(ceil(separation / digit) * digit, 15)
        if fits(separation):
            return separation
