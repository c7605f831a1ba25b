"""Smooth polylines: corners cut after Chaikin (1974), or vertices moved towards the middle of their neighbours."""

import warp as wp

from ..contours import Contours, segment_length, with_columns, with_room, write_point
from ..offsets import launch, scan_counts
from ..patch import EXACT, to_float32, to_float64

wp.set_module_options(EXACT)

SHARE = wp.constant(wp.float64(0.25))  # of a segment that is cut off at each of its ends


@wp.kernel
def _count_cuts(c: Contours, times: wp.int64, count: wp.array[wp.int64]):
    """Count the points of a polyline after some rounds, `times` is 2 to their power; one without a segment has none."""
    line = wp.tid()
    one = wp.int64(1)
    segments = c.polyline_start[line + 1] - c.polyline_start[line] - one
    if segments > wp.int64(0):
        if c.polyline_closed[line] != wp.uint8(0):
            count[line] = segments * times + one
        else:
            count[line] = (segments - one) * times + wp.int64(2)


@wp.kernel
def _cut_corners(old: Contours, reach: wp.float64, out: Contours):
    """Write every segment of a polyline without its ends, at most `reach` [m] of each; ends of open polylines stay."""
    line = wp.tid()
    one = wp.int64(1)
    first = old.polyline_start[line]
    segments = int(old.polyline_start[line + 1] - first) - 1
    closed = old.polyline_closed[line] != wp.uint8(0)
    has_dwell = old.dwell.shape[0] > 0
    start = out.polyline_start[line]
    for k in range(segments):
        i = first + wp.int64(k)
        at = start + wp.int64(2 * k)
        cutoff = wp.min(SHARE, reach / wp.max(segment_length(old.points, i), wp.float64(1e-30)))
        low = cutoff
        high = wp.float64(1.0) - cutoff
        if not closed and k == 0:
            low = wp.float64(0.0)
        ends = not closed and k == segments - 1
        if ends:
            high = wp.float64(1.0)
        write_point(old, i, low, out, at)
        write_point(old, i, high, out, at + one)
        if has_dwell:
            out.dwell[at] = old.dwell[i]
            if ends:
                out.dwell[at + one] = old.dwell[i + one]
    if closed and segments > 0:
        seam = start + wp.int64(2 * segments)
        write_point(out, start, wp.float64(0.0), out, seam)
        out.kind[seam] = out.kind[seam - one]


@wp.kernel
def _relax_points(c: Contours, strength: wp.float64, rounds: wp.int32, points: wp.array[wp.vec3]):
    """Move every point of a polyline but open ends towards the middle of its neighbours, all at once in each round."""
    line = wp.tid()
    one = wp.int64(1)
    first = c.polyline_start[line]
    last = c.polyline_start[line + 1] - one
    closed = c.polyline_closed[line] != wp.uint8(0) and last > first
    for _r in range(rounds):
        i = first
        if not closed:
            i = first + one
        before = wp.vec3d()
        if i < last:
            before = to_float64(points[wp.where(closed, last - one, first)])
        while i < last:
            x = to_float64(points[i])
            middle = wp.float64(0.5) * (before + to_float64(points[i + one]))
            points[i] = to_float32(x + strength * (middle - x))
            before = x
            i += one
        if closed:
            points[last] = points[first]


def cut_corners(contours: Contours, *, reach: float, rounds: int, point_limit: int | None = None) -> Contours:
    """Polylines whose every segment has lost a quarter at each end, at most `reach` [m], in each round.

    Ends of open polylines stay. A cut at a corner is of the kind of the segment before it, and a pause at the corner
    comes behind the cut. Polylines without a segment get no points.
    Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    lines, counts = contours.polyline_closed.shape[0], []
    for k in range(rounds):
        counts.append(wp.zeros_like(contours.polyline_start))
        launch(_count_cuts, lines, [contours, wp.int64(2 ** (k + 1))], [counts[-1]])
    starts, totals = scan_counts(*reversed(counts), limit=point_limit)
    for start, total in zip(reversed(starts), reversed(totals), strict=True):
        out = with_room(contours, total)
        out.polyline_start = start
        launch(_cut_corners, lines, [contours, wp.float64(reach)], [out])
        contours = out
    return contours


def relax_points(contours: Contours, *, strength: float, rounds: int) -> Contours:
    """Contours whose points were moved in every round by `strength`, 0..1, towards the middle of their neighbours.

    Ends of open polylines stay; rounding to float32 ends each round.
    """
    moved = wp.clone(contours.points)
    launch(_relax_points, contours.polyline_closed.shape[0], [contours, wp.float64(strength), rounds], [moved])
    return with_columns(contours, points=moved)
