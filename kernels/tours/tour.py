"""A path through points that are thinned before (`thinning`), as short as exchanges make it; one polyline a pose.

Points of a pose come in an order. The path starts with nearest neighbours; then, pass by pass, ranges are reversed
(2-opt) and runs of one to three points moved elsewhere, either way round (Or-opt), wherever that shortens it. An open
path is a closed one through one more point, which is at no distance from any.
"""

from typing import NamedTuple

import warp as wp

from ..offsets import BLOCK, last_of, offsets_of
from ..patch import EXACT
from ..section.contour_writing import Contours
from ..section.row_walker import MADE
from .thinning import apart, thin_points

wp.set_module_options(EXACT)

SWEEPS = wp.constant(20)  # at most; a few are enough for a hundred points
RUN_MOST = wp.constant(3)  # points that Or-opt moves at once
LEAST_GAIN = wp.constant(wp.float64(1.0e-9))  # [m]; what shortens by less is left


@wp.struct
class Tour:
    """One pose's path under way."""

    point: wp.array[wp.vec3]
    order: wp.array[wp.int32]  # of points, in the order of the path
    first: int  # of the pose's points
    place: int  # of the pose's order
    count: int  # of points
    length: int  # of the order: one more, the dummy `count`, if the path is open


@wp.func
def at(tour: Tour, i: int):
    """The point at place i of the cyclic order."""
    return tour.order[tour.place + i % tour.length]


@wp.func
def way(tour: Tour, a: int, b: int):
    """Distance between two points of the path; none to the dummy [m]."""
    if a == tour.count or b == tour.count:
        return wp.float64(0.0)
    return wp.sqrt(apart(tour.point[tour.first + a], tour.point[tour.first + b]))


@wp.func
def swap_places(tour: Tour, i: int, j: int):
    """Exchange what stands at two places."""
    a = tour.order[tour.place + i]
    tour.order[tour.place + i] = tour.order[tour.place + j]
    tour.order[tour.place + j] = a


@wp.func
def reverse_places(tour: Tour, first: int, last: int):
    """Reverse a range of the order."""
    i = int(first)
    j = int(last)
    while i < j:
        swap_places(tour, i, j)
        i += 1
        j -= 1


@wp.func
def order_nearest(tour: Tour):
    """From the first point always to the nearest that is left; the dummy last."""
    for i in range(tour.length):
        tour.order[tour.place + i] = i
    for i in range(1, tour.count - 1):
        best = int(i)
        least = way(tour, at(tour, i - 1), at(tour, i))
        for j in range(i + 1, tour.count):
            d = way(tour, at(tour, i - 1), at(tour, j))
            if d < least:
                best = j
                least = d
        swap_places(tour, i, best)


@wp.func
def sweep_reversals(tour: Tour):
    """2-opt once around: reverse each range if that shortens the path; returns whether any did."""
    improved = int(0)
    for i in range(tour.length - 2):
        a = at(tour, i)
        b = at(tour, i + 1)
        step = way(tour, a, b)
        for j in range(i + 2, tour.length):
            if i == 0 and j == tour.length - 1:
                continue
            c = at(tour, j)
            gain = step + way(tour, c, at(tour, j + 1)) - way(tour, a, c)
            if gain > LEAST_GAIN:  # seldom
                gain -= way(tour, b, at(tour, j + 1))
            if gain > LEAST_GAIN:
                reverse_places(tour, i + 1, j)
                improved = int(1)
                b = at(tour, i + 1)
                step = way(tour, a, b)
    return improved


@wp.func
def move_run(tour: Tour, first: int, size: int, place: int, turned: int):
    """Take a run out and put it in behind another place, turned around or not."""
    last = first + size - 1
    if turned == 1:
        reverse_places(tour, first, last)
    if place > last:  # three reversals rotate a range
        reverse_places(tour, first, last)
        reverse_places(tour, last + 1, place)
        reverse_places(tour, first, place)
    else:
        reverse_places(tour, place + 1, first - 1)
        reverse_places(tour, first, last)
        reverse_places(tour, place + 1, last)


@wp.func
def sweep_runs(tour: Tour):
    """Or-opt once around: move each run to where that shortens the path most; whether any was moved."""
    improved = int(0)
    for size in range(1, wp.min(RUN_MOST, tour.length - 2) + 1):
        for first in range(tour.length - size + 1):
            before = (first + tour.length - 1) % tour.length
            a = at(tour, first)
            b = at(tour, first + size - 1)
            p = at(tour, before)
            q = at(tour, first + size)
            saved = way(tour, p, a) + way(tour, b, q) - way(tour, p, q)
            best = wp.float64(LEAST_GAIN)
            place = int(-1)
            turned = int(0)
            if saved > LEAST_GAIN:
                for k in range(tour.length):
                    if k == before or (k >= first and k < first + size):
                        continue
                    c = at(tour, k)
                    d = at(tour, k + 1)
                    gain = saved + way(tour, c, d)
                    straight = gain - way(tour, c, a)
                    around = gain - way(tour, c, b)
                    if straight > best or around > best:  # else less the other ways they cannot be
                        straight -= way(tour, b, d)
                        around -= way(tour, a, d)
                    if straight > best or around > best:
                        best = wp.max(straight, around)
                        place = k
                        turned = wp.where(around > straight, 1, 0)
            if place >= 0:
                move_run(tour, first, size, place, turned)
                improved = int(1)
    return improved


@wp.func
def begin_at(tour: Tour, point: int):
    """Turn the order around until it begins with a point."""
    i = int(0)
    while at(tour, i) != point:
        i += 1
    if i > 0:
        reverse_places(tour, 0, i - 1)
        reverse_places(tour, i, tour.length - 1)
        reverse_places(tour, 0, tour.length - 1)


@wp.kernel
def _order_points(
    # In:
    point: wp.array[wp.vec3],
    start: wp.array[wp.int64],
    closes: int,
    # Out:
    order: wp.array[wp.int32],  # shape [point + pose], a pose's part begins at start + pose
):
    """Find a short path through each pose's points."""
    pose = wp.tid()
    tour = Tour()
    tour.point = point
    tour.order = order
    tour.first = int(start[pose])
    tour.place = tour.first + pose
    tour.count = int(start[pose + 1]) - tour.first
    tour.length = tour.count + 1 - closes
    order_nearest(tour)
    improved = int(1)
    sweep = int(0)
    while improved == 1 and sweep < SWEEPS and tour.length > 3:
        improved = wp.max(sweep_reversals(tour), sweep_runs(tour))
        sweep += 1
    if tour.count > 0:
        begin_at(tour, wp.where(closes == 1, 0, tour.count))
        if at(tour, 1) > at(tour, tour.length - 1):
            reverse_places(tour, 1, tour.length - 1)


@wp.kernel
def _write_tours(
    # In:
    point: wp.array[wp.vec3],
    start: wp.array[wp.int64],
    order: wp.array[wp.int32],
    point_start: wp.array[wp.int64],
    line_start: wp.array[wp.int64],
    closes: int,
    # Out:
    out: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
):
    """Write each pose's polyline, a closed one with its first point again at its end."""
    pose = wp.tid()
    line = line_start[pose]
    if line_start[pose + 1] > line:
        place = point_start[pose]
        polyline_start[line] = place
        count = int(start[pose + 1] - start[pose])
        base = start[pose] + wp.int64(pose + 1 - closes)  # an open path's order begins with the dummy
        for k in range(count):
            out[place + wp.int64(k)] = point[start[pose] + wp.int64(order[base + wp.int64(k)])]
        if closes == 1:
            out[place + wp.int64(count)] = out[place]


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
    """One polyline a pose at most, of kind MADE and patch 0; `section_start` by pose."""
    single_count: int
    """Poses with a single point, which no path leads through: they are left empty."""


def tour_points(point: wp.array, start: wp.array, *, separation: float, closes: bool) -> Tours:
    """One polyline through each pose's points, thinned to a separation: short, though not always the shortest.

    point: vec3 [m], array frame, shape [point]; start: offsets of each pose's points, int64, shape [pose + 1].
    separation: exclusion radius [m], see `thin_points`. closes: come back to the first point.
    The result depends on the order of a pose's points and on nothing else. Poses of one point stay empty, and are
    counted. Raises as `thin_points`.
    """
    device, pose_count = point.device, start.shape[0] - 1
    kept, kept_start = thin_points(point, start, separation=separation)
    order = wp.empty(kept.shape[0] + pose_count, dtype=wp.int32, device=device)
    inputs = [kept, kept_start, int(closes)]
    wp.launch(_order_points, pose_count, inputs=inputs, outputs=[order], device=device, block_dim=BLOCK)
    points, lines = (wp.zeros(pose_count + 1, dtype=wp.int64, device=device) for _ in range(2))
    inputs = [kept_start, int(closes)]
    wp.launch(_count_tours, pose_count, inputs=inputs, outputs=[points, lines], device=device, block_dim=BLOCK)
    point_start, line_start = offsets_of(points), offsets_of(lines)
    point_count, line_count = last_of(point_start), last_of(line_start)
    contours = Contours(
        points=wp.empty(point_count, dtype=wp.vec3, device=device),
        kind=wp.full(point_count, MADE, dtype=wp.uint8, device=device),
        polyline_start=wp.full(line_count + 1, point_count, dtype=wp.int64, device=device),
        polyline_patch=wp.zeros(line_count, dtype=wp.int32, device=device),
        polyline_closed=wp.full(line_count, int(closes), dtype=wp.uint8, device=device),
        section_start=line_start,
    )
    inputs = [kept, kept_start, order, point_start, line_start, int(closes)]
    outputs = [contours.points, contours.polyline_start]
    wp.launch(_write_tours, pose_count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    return Tours(contours, kept.shape[0] - (point_count - line_count * int(closes)))
