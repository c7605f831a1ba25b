"""Hatches: parallel lines that fill regions in a plane, each by itself or joined along the region's boundary.

A *span* is a stretch of a row inside a region, between two of the row's crossings with the region's outlines. Joined
spans make a line: from the end of a span to where the same outline next crosses the next row, on either way round, if a
span ends there that is on no line yet.
"""

import math
from typing import NamedTuple

import warp as wp

from ..offsets import PointLimitError, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT
from ..stages.cut import launch
from .hatch_crossings import Outlines, RowCrossings, find_crossings, find_rows, row_height

wp.set_module_options(EXACT)

SHORTEST = wp.constant(wp.float64(1e-7))  # [m]; a shorter span is a touch


class Hatch(NamedTuple):
    """Device arrays of the lines over regions, in the order of the regions."""

    points: wp.array  # vec2d, along u and v [m], shape [point]
    line_start: wp.array  # int64, offsets into points, shape [line + 1]
    line_region: wp.array  # int32, shape [line]


@wp.struct
class SpanSequence:
    """Spans in the order in which they are drawn; a region has half as many places as it has crossings."""

    begin: wp.array[wp.int64]  # the crossing at which a span is entered
    end: wp.array[wp.int64]  # the crossing at which it is left
    way: wp.array[wp.int32]  # how the boundary leads on to the next span: 1 as it runs, -1 back, 0 not at all
    region: wp.array[wp.int32]
    points: wp.array[wp.int64]  # number of points of the span and the way to the next; 0: the place is not used
    starts: wp.array[wp.int64]  # 1: a line starts with the span


@wp.func
def pair_crossings(c: RowCrossings, base: wp.int64, count: int, mate: wp.array[wp.int64]):
    """Find the spans of a region: the ends of each are each other's mates, other crossings have none, -1."""
    winding = int(0)
    begin = base
    for k in range(count):
        w = base + wp.int64(c.order[base + wp.int64(k)])
        mate[w] = wp.int64(-1)
        before = winding
        winding += int(c.enters[w])
        if before <= 0 and winding > 0:
            begin = w
        if before > 0 and winding <= 0 and c.x[w] - c.x[begin] > SHORTEST:
            mate[begin] = w
            mate[w] = begin


@wp.func
def is_ahead(c: RowCrossings, mate: wp.array[wp.int64], at: wp.int64, to: wp.int64):
    """Whether a crossing is the end of a span on the next row that is not drawn yet."""
    return c.row[to] == c.row[at] + 1 and mate[to] >= wp.int64(0)


@wp.func
def find_next(c: RowCrossings, mate: wp.array[wp.int64], at: wp.int64):
    """The neighbour of a crossing on its outline at which a span is entered, -1 if there is none, and the way there."""
    first = c.start[c.entry[at]]
    stop = c.start[c.entry[at] + 1]
    after = at + wp.int64(1)
    if after == stop:
        after = first
    before = at - wp.int64(1)
    if before < first:
        before = stop - wp.int64(1)
    to = wp.int64(-1)
    way = int(0)
    if is_ahead(c, mate, at, after):
        to = after
        way = int(1)
    elif is_ahead(c, mate, at, before):
        to = before
        way = int(-1)
    return to, way


@wp.func
def count_between(o: Outlines, c: RowCrossings, at: wp.int64, to: wp.int64, way: int):
    """Number of vertices between two crossings of an outline."""
    a = wp.where(way > 0, at, to)
    b = wp.where(way > 0, to, at)
    count = wp.int64(c.edge[b]) - wp.int64(c.edge[a])
    if b < a:
        line = o.region_line[c.entry[at]]
        count += o.polyline_start[line + 1] - o.polyline_start[line] - wp.int64(1)
    return count


@wp.func
def walk_line(
    o: Outlines,
    c: RowCrossings,
    mate: wp.array[wp.int64],
    region: int,
    begin: wp.int64,
    place: wp.int64,
    s: SpanSequence,
):
    """Write the spans of a line, and take their ends' mates; the place after them."""
    at = begin
    next_place = place
    while at >= wp.int64(0):
        end = mate[at]
        mate[at] = wp.int64(-1)
        mate[end] = wp.int64(-1)
        to, way = find_next(c, mate, end)
        count = wp.int64(2)
        if way != 0:
            count += count_between(o, c, end, to, way)
        s.begin[next_place] = at
        s.end[next_place] = end
        s.way[next_place] = way
        s.region[next_place] = region
        s.points[next_place] = count
        s.starts[next_place] = wp.where(next_place == place, wp.int64(1), wp.int64(0))
        next_place += wp.int64(1)
        at = to
    return next_place


@wp.kernel
def _join_spans(
    # In:
    o: Outlines,
    c: RowCrossings,
    connected: int,  # 0: each span is a line
    mate: wp.array[wp.int64],  # scratch, by crossing
    # Out:
    s: SpanSequence,
):
    """Order the spans of each region into lines."""
    region = wp.tid()
    base = c.start[o.region_start[region]]
    count = int(c.start[o.region_start[region + 1]] - base)
    pair_crossings(c, base, count, mate)
    place = base / wp.int64(2)
    for k in range(count):
        first = base + wp.int64(c.order[base + wp.int64(k)])
        last = mate[first]
        if last >= wp.int64(0) and int(c.enters[first]) > 0:
            if connected != 0:
                _ahead, leads_on = find_next(c, mate, last)
                _behind, leads_back = find_next(c, mate, first)
                place = walk_line(
                    o, c, mate, region, wp.where(leads_on == 0 and leads_back != 0, last, first), place, s
                )
            else:
                odd = c.row[first] % 2 != 0
                s.begin[place] = wp.where(odd, last, first)
                s.end[place] = wp.where(odd, first, last)
                s.way[place] = 0
                s.region[place] = region
                s.points[place] = wp.int64(2)
                s.starts[place] = wp.int64(1)
                place += wp.int64(1)


@wp.func
def crossing_point(o: Outlines, c: RowCrossings, region: int, at: wp.int64):
    """A crossing's place, along and across the rows [m]."""
    return wp.vec2d(c.x[at], row_height(o, region, wp.int64(c.row[at])))


@wp.func
def turn_back(p: wp.vec2d, cosine: wp.float64, sine: wp.float64):
    """Coordinates along u and v of a point given along and across the rows [m]."""
    return wp.vec2d(p[0] * cosine + p[1] * -sine, p[0] * sine + p[1] * cosine)


@wp.kernel
def _draw_spans(
    # In:
    o: Outlines,
    c: RowCrossings,
    s: SpanSequence,
    point_place: wp.array[wp.int64],  # offsets of each span's points
    line_place: wp.array[wp.int64],  # lines that start before each span
    cosine: wp.float64,
    sine: wp.float64,
    # Out:
    points: wp.array[wp.vec2d],  # [m]
    line_start: wp.array[wp.int64],
    line_region: wp.array[wp.int32],
):
    """Write the points of each span, and the vertices of the boundary that lead on to the next."""
    span = wp.tid()
    count = s.points[span]
    if count == wp.int64(0):
        return
    region = s.region[span]
    at = point_place[span]
    if s.starts[span] != wp.int64(0):
        line_start[line_place[span]] = at
        line_region[line_place[span]] = region
    points[at] = turn_back(crossing_point(o, c, region, s.begin[span]), cosine, sine)
    points[at + wp.int64(1)] = turn_back(crossing_point(o, c, region, s.end[span]), cosine, sine)
    if count > wp.int64(2):
        line = o.region_line[c.entry[s.end[span]]]
        base = o.polyline_start[line]
        size = o.polyline_start[line + 1] - base - wp.int64(1)
        vertex = wp.int64(c.edge[s.end[span]])
        if s.way[span] > 0:
            vertex += wp.int64(1)
        for k in range(int(count) - 2):
            own = (vertex + wp.int64(s.way[span] * k) + size) % size  # the polyline goes round
            points[at + wp.int64(2 + k)] = turn_back(o.points[base + own], cosine, sine)


def join_spans(o: Outlines, c: RowCrossings, *, connected: bool) -> SpanSequence:
    """Spans of the regions in the order in which they are drawn."""
    device, total, s = c.x.device, c.x.shape[0], SpanSequence()
    places = total // 2
    s.begin, s.end = (wp.empty(places, dtype=wp.int64, device=device) for _ in range(2))
    s.way, s.region = (wp.empty(places, dtype=wp.int32, device=device) for _ in range(2))
    s.points, s.starts = (wp.zeros(places + 1, dtype=wp.int64, device=device) for _ in range(2))
    mate = wp.empty(total, dtype=wp.int64, device=device)
    launch(_join_spans, o.region_start.shape[0] - 1, [o, c, int(connected), mate], [s])
    return s


@on_one_device
def draw_hatch(
    points: wp.array,
    polyline_start: wp.array,
    region_start: wp.array,
    region_line: wp.array,
    filled: wp.array,
    *,
    spacing: float,
    angle: float,
    connected: bool,
    point_limit: int | None = None,
) -> Hatch:
    """Parallel lines over what regions enclose, in their planes, through the planes' origin.

    points: coordinates along u, v and n [m], vec3d. region_start: offsets into region_line, int64, shape [region + 1];
    region_line: the polylines of each region, int32, closed and with their first point repeated at their end,
    counter-clockwise around the region and clockwise around holes. filled: 0 for regions to leave out, uint8, shape
    [region]. spacing: between lines [m]; angle: of the lines from u towards v [rad]; connected: lines are joined along
    the boundary where they can be. A region between two lines gets one through its middle.
    Raises PointLimitError before memory is taken for more points than `point_limit`.
    """
    o = find_rows(points, polyline_start, region_start, region_line, filled, spacing=spacing, angle=angle)
    c = find_crossings(o, point_limit)
    s = join_spans(o, c, connected=connected)
    point_place, line_place = offsets_of(s.points), offsets_of(s.starts)
    total, line_count = last_of(point_place), last_of(line_place)
    if point_limit is not None and total > point_limit:
        raise PointLimitError(total, point_limit)
    device = points.device
    out = Hatch(
        wp.empty(total, dtype=wp.vec2d, device=device),
        wp.full(line_count + 1, total, dtype=wp.int64, device=device),
        wp.empty(line_count, dtype=wp.int32, device=device),
    )
    turn = [wp.float64(math.cos(angle)), wp.float64(math.sin(angle))]
    launch(_draw_spans, s.begin.shape[0], [o, c, s, point_place, line_place, *turn], list(out))
    return out
