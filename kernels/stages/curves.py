"""Polylines with fewer vertices (Douglas and Peucker 1973), rounder corners (Chaikin 1974), and without repeats."""

import warp as wp

from ..contours import Contours, keep_rows, segment_length, with_room, write_point
from ..offsets import launch, scan_counts
from ..patch import EXACT, to_float64

wp.set_module_options(EXACT)


@wp.struct
class VertexTolerance:
    """How far what replaces a vertex may be off."""

    place: wp.float64  # [m]
    level: wp.float64  # of intensity


@wp.func
def excess_of(c: Contours, most: VertexTolerance, a: wp.int64, b: wp.int64, i: wp.int64):
    """Distance of vertex i from the segment a..b, in tolerances: the larger of position and intensity."""
    p = to_float64(c.points[a])
    d = to_float64(c.points[b]) - p
    x = to_float64(c.points[i]) - p
    square = wp.dot(d, d)
    part = wp.float64(0.0)
    if square > wp.float64(0.0):
        part = wp.clamp(wp.dot(x, d) / square, wp.float64(0.0), wp.float64(1.0))
    out = wp.length(x - part * d) / most.place
    if c.intensity.shape[0] > 0:
        low = wp.float64(c.intensity[a])
        level = low + part * (wp.float64(c.intensity[b]) - low)
        out = wp.max(out, wp.abs(wp.float64(c.intensity[i]) - level) / most.level)
    return out


@wp.func
def farthest(c: Contours, most: VertexTolerance, a: wp.int64, b: wp.int64, low: wp.int64, high: wp.int64):
    """The vertex of low..high - 1 that is farthest from the segment a..b, the first of equals, and its excess."""
    best = wp.float64(-1.0)
    at = low
    i = low
    while i < high:
        e = excess_of(c, most, a, b, i)
        if e > best:
            best = e
            at = i
        i += wp.int64(1)
    return at, best


@wp.func
def keep_fixed(c: Contours, first: wp.int64, last: wp.int64, keep: wp.array[wp.int64]):
    """Mark the ends, where the kind changes, and where the focal point pauses."""
    i = first
    while i <= last:
        fixed = i == first or i == last
        if not fixed:
            fixed = c.kind[i] != c.kind[i - wp.int64(1)]
        if not fixed and c.dwell.shape[0] > 0:
            fixed = c.dwell[i] > 0.0
        keep[i] = wp.int64(0)
        if fixed:
            keep[i] = wp.int64(1)
        i += wp.int64(1)


@wp.func
def keep_triangle(c: Contours, most: VertexTolerance, first: wp.int64, last: wp.int64, keep: wp.array[wp.int64]):
    """Mark the vertex of a loop that is farthest from its start, and the one farthest from the line between them."""
    far, _e = farthest(c, most, first, first, first + wp.int64(1), last)
    keep[far] = wp.int64(1)
    before, e = farthest(c, most, first, far, first + wp.int64(1), far)
    after, f = farthest(c, most, far, last, far + wp.int64(1), last)
    if f > e:
        before = after
        e = f
    if e > wp.float64(0.0):
        keep[before] = wp.int64(1)


@wp.kernel
def _simplify_polylines(c: Contours, most: VertexTolerance, keep: wp.array[wp.int64]):
    """Keep the farthest vertex between two that stay, until none is farther than the tolerance."""
    line = wp.tid()
    first = c.polyline_start[line]
    last = c.polyline_start[line + 1] - wp.int64(1)
    if last < first:
        return
    keep_fixed(c, first, last, keep)
    if int(c.polyline_closed[line]) != 0 and last - first > wp.int64(2):
        keep_triangle(c, most, first, last, keep)
    a = first
    while a < last:
        b = a + wp.int64(1)
        while keep[b] == wp.int64(0):
            b += wp.int64(1)
        at, excess = farthest(c, most, a, b, a + wp.int64(1), b)
        if excess > wp.float64(1.0):
            keep[at] = wp.int64(1)
        else:
            a = b


@wp.kernel
def _mark_distinct(c: Contours, point_keep: wp.array[wp.int64], polyline_keep: wp.array[wp.int64]):
    """Mark the points of a polyline that differ from the one before, unless one is all that is left; else write 0."""
    line = wp.tid()
    first = c.polyline_start[line]
    stay = int(0)
    for k in range(int(c.polyline_start[line + 1] - first)):
        i = first + wp.int64(k)
        differs = k == 0
        if not differs:
            differs = not (c.points[i] == c.points[i - wp.int64(1)])
        if differs:
            point_keep[i] = wp.int64(1)
            stay += 1
    if stay == 1:
        point_keep[first] = wp.int64(0)
    if stay > 1:
        polyline_keep[line] = wp.int64(1)


@wp.kernel
def _match_ends(c: Contours):
    """Let a last point have the kind of the one before it, and that of a loop the values of its first."""
    line = wp.tid()
    first = c.polyline_start[line]
    last = c.polyline_start[line + 1] - wp.int64(1)
    if last > first:
        c.kind[last] = c.kind[last - wp.int64(1)]
        if c.polyline_closed[line] != wp.uint8(0):
            if c.intensity.shape[0] > 0:
                c.intensity[last] = c.intensity[first]
            if c.dwell.shape[0] > 0:
                c.dwell[last] = c.dwell[first]


def simplify_polylines(contours: Contours, *, tolerance: float, level: float) -> Contours:
    """Polylines with fewer vertices.

    Every vertex left out is within `tolerance` [m] of the segment that replaces it, its intensity within `level` of
    the one there. Ends, starts of loops, vertices where the kind changes and vertices with a dwell stay; a loop keeps
    three vertices if it has three that are no line.
    """
    most = VertexTolerance()
    most.place, most.level = wp.float64(tolerance), wp.float64(level)
    keep = wp.zeros(contours.points.shape[0] + 1, dtype=wp.int64, device=contours.points.device)
    launch(_simplify_polylines, contours.polyline_closed.shape[0], [contours, most], [keep])
    return keep_rows(contours, keep)


def drop_repeats(contours: Contours) -> Contours:
    """Polylines without segments of no length, and without polylines of which one point or none is left.

    Then a last point has the kind of the one before it, and that of a loop the values of its first: the points that
    stand last after others are left out had values of their own.
    """
    device, line_count = contours.points.device, contours.polyline_closed.shape[0]
    point_keep = wp.zeros(contours.points.shape[0] + 1, dtype=wp.int64, device=device)
    polyline_keep = wp.zeros(line_count + 1, dtype=wp.int64, device=device)
    launch(_mark_distinct, line_count, [contours], [point_keep, polyline_keep])
    out = keep_rows(contours, point_keep, polyline_keep)
    launch(_match_ends, out.polyline_closed.shape[0], [], [out])
    return out


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
