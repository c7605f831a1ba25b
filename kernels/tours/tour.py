"""Points of each pose, thinned, and a path through them that is as short as exchanges of steps make it.

A point is chosen if no point chosen before is nearer than the separation.

Points of a pose come in an order. The path starts with nearest neighbours; then, sweep by sweep, it is shortened from
each point near which something has changed: by turning a part of it around (2-opt), or by moving a run of points
elsewhere (or-opt). An open path is a closed one through one more point, which is at no distance from any.
"""

from collections.abc import Callable
from math import ceil, floor, log10
from typing import NamedTuple

import numpy as np
import warp as wp

from ..contours import Contours, room_for
from ..offsets import launch, scan_counts
from ..one_device import on_one_device
from ..patch import EXACT, to_float64
from ..section.draw import MADE

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


NEAR = wp.constant(8)  # points that each point knows as its nearest
RUN_MOST = wp.constant(30)  # points that are moved at once; with 3, paths are 1 % longer
LEAST_GAIN = wp.constant(1.0e-6)  # [m]; what shortens by less is left


@wp.struct
class Tour:
    """One pose's path, a cycle; rows of the arrays are shared by all poses.

    Places and points are counted from the pose's first ones. An open path is a cycle through one more point, `count`,
    which is at no distance from any.
    """

    point: wp.array[wp.vec3]
    order: wp.array[wp.int16]  # points in the order of the path
    place: wp.array[wp.int16]  # of each point in the order
    step: wp.array[wp.float32]  # from each place to the next [m]
    near: wp.array[wp.int16]  # its nearest points, the nearest first, NEAR a point
    distance: wp.array[wp.float32]  # to them [m]
    awake: wp.array[wp.uint8]  # whether an exchange is looked for from the point
    first: int  # of the pose's points
    row: int  # of the pose's order, places and so on
    count: int  # of points
    length: int  # of the order
    known: int  # of the nearest points that each point knows: fewer than NEAR if there are no more


@wp.func
def square_of(tour: Tour, a: int, b: int):
    """Square of the distance of two points of the path; 0 to the point that opens it [m2]."""
    if a == tour.count or b == tour.count:
        return float(0.0)
    d = tour.point[tour.first + a] - tour.point[tour.first + b]
    return wp.dot(d, d)


@wp.func
def distance_of(tour: Tour, a: int, b: int):
    """Distance of two points of the path; 0 to the point that opens it [m]."""
    return wp.sqrt(square_of(tour, a, b))


@wp.func
def place_beside(tour: Tour, i: int, onward: int):
    """The place after place i (onward 1) or before it (0)."""
    if onward == 1:
        return wp.where(i + 1 == tour.length, 0, i + 1)
    return wp.where(i == 0, tour.length, i) - 1


@wp.func
def beside(tour: Tour, a: int, onward: int):
    """The point after a or before it."""
    return int(tour.order[tour.row + place_beside(tour, int(tour.place[tour.row + a]), onward)])


@wp.func
def step_beside(tour: Tour, a: int, onward: int):
    """Length of the step from a to the point beside it [m]."""
    i = int(tour.place[tour.row + a])
    return tour.step[tour.row + wp.where(onward == 1, i, place_beside(tour, i, 0))]


@wp.func
def measure_step(tour: Tour, i: int):
    """Find the length of the step from place i on."""
    a = int(tour.order[tour.row + i])
    tour.step[tour.row + i] = distance_of(tour, a, int(tour.order[tour.row + place_beside(tour, i, 1)]))


@wp.func
def reverse_between(tour: Tour, a: int, b: int):
    """Turn the path from a onward to b around, or the rest of it if that is shorter."""
    i = int(tour.place[tour.row + a])
    j = int(tour.place[tour.row + b])
    size = wp.where(j < i, j - i + tour.length, j - i) + 1
    if 2 * size > tour.length:
        size = tour.length - size
        k = place_beside(tour, j, 1)
        j = place_beside(tour, i, 0)
        i = k
    before = place_beside(tour, i, 0)
    last = j
    for _pair in range(size // 2):
        one = tour.order[tour.row + i]
        other = tour.order[tour.row + j]
        tour.order[tour.row + i] = other
        tour.order[tour.row + j] = one
        tour.place[tour.row + int(other)] = wp.int16(i)
        tour.place[tour.row + int(one)] = wp.int16(j)
        j = place_beside(tour, j, 0)
        step = tour.step[tour.row + i]
        tour.step[tour.row + i] = tour.step[tour.row + j]
        tour.step[tour.row + j] = step
        i = place_beside(tour, i, 1)
    if size > 0:
        measure_step(tour, before)
        measure_step(tour, last)


@wp.func
def exchange_steps(tour: Tour, b: int, a: int, d: int, c: int):
    """Turn the path from a to d around: steps b-a and d-c become b-d and a-c; b, a, d, c: in order, onward or back."""
    onward = beside(tour, b, 1) == a
    reverse_between(tour, wp.where(onward, a, d), wp.where(onward, d, a))
    # Exchanges are looked for from the four ends again.
    tour.awake[tour.row + b] = wp.uint8(1)
    tour.awake[tour.row + a] = wp.uint8(1)
    tour.awake[tour.row + d] = wp.uint8(1)
    tour.awake[tour.row + c] = wp.uint8(1)


@wp.func
def turn_part(tour: Tour, a: int, c: int, onward: int, saved: float):
    """Turn the path around from a to the point before c, if that shortens it; returns 1 if it does, else 0.

    onward: the direction from the point before a to a; saved: by a step from a to c instead of that to a [m].
    """
    b = beside(tour, a, 1 - onward)
    d = beside(tour, c, 1 - onward)
    if d == a or saved + step_beside(tour, c, 1 - onward) - distance_of(tour, b, d) <= LEAST_GAIN:
        return 0
    exchange_steps(tour, b, a, d, c)
    return 1


@wp.func
def move_run(tour: Tour, a: int, c: int, onward: int, saved: float):
    """Move a run of points that begins with a beside c, if that shortens the path; arguments as `turn_part`."""
    b = beside(tour, a, 1 - onward)
    e = a
    for _size in range(RUN_MOST):
        f = beside(tour, e, onward)
        if e == c or f == b or f == c:  # f == c: the run is beside c as it is
            return 0
        left = saved + step_beside(tour, e, onward) - distance_of(tour, b, f)
        before = beside(tour, c, 1 - onward)
        after = beside(tour, c, onward)
        if left + step_beside(tour, c, 1 - onward) - distance_of(tour, before, e) > LEAST_GAIN:
            # b a..e f..before c becomes b f..before e..a c
            exchange_steps(tour, b, a, before, c)
            exchange_steps(tour, b, before, f, e)
            return 1
        if c != b and left + step_beside(tour, c, onward) - distance_of(tour, after, e) > LEAST_GAIN:
            # b a..e f..c after becomes b f..c a..e after
            exchange_steps(tour, b, a, c, after)
            exchange_steps(tour, b, c, f, e)
            exchange_steps(tour, c, e, a, after)
            return 1
        e = f
    return 0


@wp.func
def shorten_at(tour: Tour, a: int):
    """Make the first exchange by a step from a to a near point that shortens the path; returns 1 if there is one."""
    for k in range(tour.known):
        c = int(tour.near[NEAR * (tour.row + a) + k])
        for onward in range(2):
            saved = step_beside(tour, a, 1 - onward) - tour.distance[NEAR * (tour.row + a) + k]
            if saved > 0.0:
                if turn_part(tour, a, c, onward, saved) == 1:
                    return 1
                if move_run(tour, a, c, onward, saved) == 1:
                    return 1
    return 0


@wp.func
def sweep_points(tour: Tour):
    """Look for exchanges from all points that are awake; returns 1 if there was one, else 0."""
    found = int(0)
    for a in range(tour.length):
        if tour.awake[tour.row + a] == wp.uint8(1):
            if shorten_at(tour, a) == 1:
                found = 1
            else:
                tour.awake[tour.row + a] = wp.uint8(0)
    return found


SWEEPS = wp.constant(100)  # at most; 8 were the most that 20,000 poses and 2,000 points needed
NO_KEY = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
Keys = wp.types.vector(length=int(NEAR), dtype=wp.uint64)  # a distance's square in bits, then the point: they sort


@wp.func
def know_nearest(tour: Tour):
    """Find each point's nearest."""
    for a in range(tour.length):
        nearest = Keys()
        for k in range(NEAR):
            nearest[k] = NO_KEY
        for b in range(tour.length):
            key = (wp.uint64(wp.cast(square_of(tour, a, b), wp.uint32)) << wp.uint64(32)) | wp.uint64(b)
            if b != a:
                for k in range(NEAR):
                    less = wp.min(nearest[k], key)
                    key = wp.max(nearest[k], key)
                    nearest[k] = less
        row = NEAR * (tour.row + a)
        for k in range(NEAR):
            if k < tour.known:
                tour.near[row + k] = wp.int16(nearest[k] & wp.uint64(0xFFFF))
                tour.distance[row + k] = wp.sqrt(wp.cast(wp.uint32(nearest[k] >> wp.uint64(32)), wp.float32))


@wp.func
def nearest_left(tour: Tour, a: int):
    """The nearest point to a that is not on the path yet; the first of those that are as near."""
    row = NEAR * (tour.row + a)
    for k in range(tour.known):
        b = int(tour.near[row + k])
        if b < tour.count and tour.place[tour.row + b] < wp.int16(0):
            return b
    best = int(-1)
    least = float(wp.inf)
    for b in range(tour.count):
        if tour.place[tour.row + b] < wp.int16(0):
            square = square_of(tour, a, b)
            if best < 0 or square < least:
                best = b
                least = square
    return best


@wp.func
def order_nearest(tour: Tour):
    """From the first point always to the nearest that is left; the point that opens the path last."""
    for b in range(tour.length):
        tour.place[tour.row + b] = wp.int16(-1)
        tour.awake[tour.row + b] = wp.uint8(1)
    a = int(0)
    for i in range(tour.length):
        tour.order[tour.row + i] = wp.int16(a)
        tour.place[tour.row + a] = wp.int16(i)
        if i + 1 < tour.count:
            a = nearest_left(tour, a)
        else:
            a = tour.count
    for i in range(tour.length):
        measure_step(tour, i)


@wp.kernel
def _order_points(
    # In:
    point: wp.array[wp.vec3],
    start: wp.array[wp.int64],
    closes: int,
    # Out:
    order: wp.array[wp.int16],  # shape [point + pose], a pose's row begins at start + pose
    place: wp.array[wp.int16],
    step: wp.array[wp.float32],  # scratch
    near: wp.array[wp.int16],  # shape [NEAR * (point + pose)]
    distance: wp.array[wp.float32],
    awake: wp.array[wp.uint8],  # shape [point + pose]
):
    """Find a short path through each pose's points."""
    pose = wp.tid()
    tour = Tour()
    tour.point = point
    tour.order = order
    tour.place = place
    tour.step = step
    tour.near = near
    tour.distance = distance
    tour.awake = awake
    tour.first = int(start[pose])
    tour.row = tour.first + pose
    tour.count = int(start[pose + 1]) - tour.first
    tour.length = tour.count + 1 - closes
    tour.known = wp.min(NEAR, tour.length - 1)
    know_nearest(tour)
    order_nearest(tour)
    improved = int(wp.where(tour.length > 3, 1, 0))
    sweep = int(0)
    while improved == 1 and sweep < SWEEPS:
        improved = sweep_points(tour)
        sweep += 1


@wp.kernel
def _write_tours(
    # In:
    point: wp.array[wp.vec3],
    start: wp.array[wp.int64],
    order: wp.array[wp.int16],
    place: wp.array[wp.int16],
    point_start: wp.array[wp.int64],
    closes: int,
    # Out:
    out: Contours,
):
    """Write each pose's polyline: a closed one from its first point to it again, towards the earlier neighbour."""
    pose = wp.tid()
    line = out.pose_start[pose]
    if out.pose_start[pose + 1] > line:
        at = point_start[pose]
        out.polyline_start[line] = at
        out.polyline_patch[line] = 0
        out.polyline_closed[line] = wp.uint8(closes)
        row = int(start[pose]) + pose
        count = int(start[pose + 1] - start[pose])
        length = count + 1 - closes
        i = int(place[row + wp.where(closes == 1, 0, count)])
        after = order[row + (i + 1) % length]
        before = order[row + (i + length - 1) % length]
        by = wp.where(after <= before, 1, length - 1)
        if closes == 0:
            i = (i + by) % length
        for k in range(count + closes):
            out.points[at + wp.int64(k)] = point[start[pose] + wp.int64(order[row + i])]
            i = (i + by) % length


@wp.kernel
def _count_tours(
    start: wp.array[wp.int64],
    closes: int,
    points: wp.array[wp.int64],  # shape [pose + 1], the last one stays 0
    lines: wp.array[wp.int64],
):
    """Count a polyline where there are two points or more."""
    pose = wp.tid()
    count = start[pose + 1] - start[pose]
    if count >= wp.int64(2):
        points[pose] = count + wp.int64(closes)
        lines[pose] = wp.int64(1)


class Tours(NamedTuple):
    """Paths, and how many poses had a point but no path."""

    contours: Contours
    """One polyline a pose at most, of kind MADE and patch 0."""
    single_count: int
    """Poses with a single point, which no path leads through: they are left empty."""


@on_one_device
def tour_points(point: wp.array, start: wp.array, *, closes: bool) -> Tours:
    """One polyline through each pose's points: short, though not always the shortest.

    point: vec3 [m], array frame, shape [point]; start: offsets of each pose's points, int64, shape [pose + 1].
    At most POINTS_MOST a pose, none of which coincide. closes: come back to the first point.
    The result depends on the order of a pose's points and on nothing else. Poses of one point stay empty, and are
    counted.
    """
    device, pose_count = point.device, start.shape[0] - 1
    rows = point.shape[0] + pose_count
    order, place = (wp.empty(rows, dtype=wp.int16, device=device) for _ in range(2))
    step = wp.empty(rows, dtype=wp.float32, device=device)
    near = wp.empty(int(NEAR) * rows, dtype=wp.int16, device=device)
    distance = wp.empty(int(NEAR) * rows, dtype=wp.float32, device=device)
    awake = wp.empty(rows, dtype=wp.uint8, device=device)
    launch(_order_points, pose_count, [point, start, int(closes)], [order, place, step, near, distance, awake])
    counts = [wp.zeros(pose_count + 1, dtype=wp.int64, device=device) for _ in range(2)]
    launch(_count_tours, pose_count, [start, int(closes)], counts)
    (point_start, line_start), (point_count, line_count) = scan_counts(*counts)
    out = room_for(point_count, line_count, device, kind=int(MADE))
    out.pose_start = line_start
    launch(_write_tours, pose_count, [point, start, order, place, point_start, int(closes)], [out])
    return Tours(out, point.shape[0] - (point_count - line_count * int(closes)))
