"""A path through points that are thinned before (`thinning`, `nodes`), as short as exchanges make it; one a pose.

Points of a pose come in an order. The path starts with nearest neighbours; then, sweep by sweep, exchanges of two or
three steps (`exchange`) are made wherever they shorten it, from each point near which something has changed. An open
path is a closed one through one more point, which is at no distance from any.
"""

from typing import NamedTuple

import warp as wp

from ..contours import Contours, room_for
from ..offsets import launch, scan_counts
from ..one_device import on_one_device
from ..patch import EXACT
from ..section.row_walker import MADE
from .exchange import NEAR, Tour, measure_step, square_of, sweep_points

wp.set_module_options(EXACT)

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
                tour.way[row + k] = wp.sqrt(wp.cast(wp.uint32(nearest[k] >> wp.uint64(32)), wp.float32))


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
    way: wp.array[wp.float32],
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
    tour.way = way
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
    # In:
    start: wp.array[wp.int64],
    closes: int,
    # Out:
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
    way = wp.empty(int(NEAR) * rows, dtype=wp.float32, device=device)
    awake = wp.empty(rows, dtype=wp.uint8, device=device)
    launch(_order_points, pose_count, [point, start, int(closes)], [order, place, step, near, way, awake])
    counts = [wp.zeros(pose_count + 1, dtype=wp.int64, device=device) for _ in range(2)]
    launch(_count_tours, pose_count, [start, int(closes)], counts)
    (point_start, line_start), (point_count, line_count) = scan_counts(*counts)
    out = room_for(point_count, line_count, device, kind=int(MADE))
    out.pose_start = line_start
    launch(_write_tours, pose_count, [point, start, order, place, point_start, int(closes)], [out])
    return Tours(out, point.shape[0] - (point_count - line_count * int(closes)))
