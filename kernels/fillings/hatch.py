"""Hatches: parallel lines that fill regions in a plane, each by itself or joined along the region's boundary.

Lines are *rows*: row k lies at k times the spacing from the plane's origin. A region has the rows that lie strictly
between its lowest and its highest point; if none does, it has one row through its middle. A vertex on a row counts as
below it, so a line crosses every closed polyline an even number of times.

A *span* is the part of a row inside a region, between two of the row's crossings with the region's outlines. Joined
spans make a line: from the end of a span to where the same outline next crosses the next row, in either direction, if a
span ends there that is on no line yet.
"""

import math

import warp as wp

from ..offsets import count_then_fill, launch, scan_counts
from ..one_device import on_one_device
from ..patch import EXACT
from ..stages.regions import FlatLines, Regions, room_for_lines

wp.set_module_options(EXACT)

SHORTEST = wp.constant(wp.float64(1e-7))  # [m]; a shorter span is a touch


@wp.struct
class Outlines:
    """Regions in a plane whose first axis runs along the rows; a region's polylines are its *entries*."""

    r: Regions
    points: wp.array[wp.vec2d]  # along and across the rows [m]
    level: wp.array[wp.int64]  # the first row at or above each point
    region_of: wp.array[wp.int32]  # region of each entry
    first: wp.array[wp.int64]  # a region's first row
    rows: wp.array[wp.int64]  # its number of rows; 0: one through its middle, -1: the region is not filled
    middle: wp.array[wp.float64]  # height of a region's middle [m]
    spacing: wp.float64  # of rows [m]


@wp.struct
class RowCrossings:
    """Crossings of rows with outlines, by entry, and along each as it runs."""

    start: wp.array[wp.int64]  # offsets of each entry's crossings
    entry: wp.array[wp.int32]
    edge: wp.array[wp.int32]  # number of the vertex before it on its polyline
    row: wp.array[wp.int32]  # from its region's first row on
    enters: wp.array[wp.int8]  # 1: the row comes to the left of the outline there, -1: it leaves it
    x: wp.array[wp.float64]  # along the row [m]
    order: wp.array[wp.int32]  # crossings of each region, counted from its first, sorted by row and x


@wp.kernel
def _turn_points(o: Outlines, cosine: wp.float64, sine: wp.float64):
    """Turn each point so that rows run along the first axis, and find the first row that is not below it."""
    i = wp.tid()
    x = o.r.local[i][0]
    y = o.r.local[i][1]
    across = x * -sine + y * cosine
    o.points[i] = wp.vec2d(x * cosine + y * sine, across)
    k = wp.int64(wp.ceil(across / o.spacing))
    if o.spacing * wp.float64(k - wp.int64(1)) >= across:  # the quotient is rounded
        k -= wp.int64(1)
    if o.spacing * wp.float64(k) < across:
        k += wp.int64(1)
    o.level[i] = k


@wp.kernel
def _find_rows(filled: wp.array[wp.uint8], o: Outlines):
    """Find the rows of each region; filled: 0: the region is left out."""
    region = wp.tid()
    low = wp.float64(wp.inf)
    high = -low
    for entry in range(int(o.r.region_start[region]), int(o.r.region_start[region + 1])):
        o.region_of[entry] = region
        base = o.r.polyline_start[o.r.region_line[entry]]
        for k in range(int(o.r.polyline_start[o.r.region_line[entry] + 1] - base)):
            across = o.points[base + wp.int64(k)][1]
            low = wp.min(low, across)
            high = wp.max(high, across)
    o.first[region] = wp.int64(0)
    o.rows[region] = wp.int64(-1)
    o.middle[region] = wp.float64(0.5) * (low + high)
    if filled[region] != wp.uint8(0) and low <= high:
        o.first[region] = wp.int64(wp.floor(low / o.spacing)) + wp.int64(1)
        o.rows[region] = wp.max(wp.int64(wp.ceil(high / o.spacing)) - o.first[region], wp.int64(0))


@wp.func
def level_of(o: Outlines, region: int, i: wp.int64):
    """The first row of the region, counted from its first, at or above a point; one past the last if there is none."""
    if o.rows[region] == wp.int64(0):
        return wp.where(o.points[i][1] <= o.middle[region], wp.int64(0), wp.int64(1))
    return wp.clamp(o.level[i] - o.first[region], wp.int64(0), o.rows[region])


@wp.func
def row_height(o: Outlines, region: int, row: wp.int64):
    """Height of a region's row [m]."""
    if o.rows[region] == wp.int64(0):
        return o.middle[region]
    return o.spacing * wp.float64(o.first[region] + row)


@wp.kernel
def _count_crossings(o: Outlines, count: wp.array[wp.int64]):
    """Count the crossings of each entry."""
    entry = wp.tid()
    region = o.region_of[entry]
    base = o.r.polyline_start[o.r.region_line[entry]]
    total = wp.int64(0)
    if o.rows[region] >= wp.int64(0):
        for k in range(int(o.r.polyline_start[o.r.region_line[entry] + 1] - base) - 1):
            i = base + wp.int64(k)
            total += wp.abs(level_of(o, region, i + wp.int64(1)) - level_of(o, region, i))
    count[entry] = total


@wp.kernel
def _find_crossings(o: Outlines, start: wp.array[wp.int64], c: RowCrossings):
    """Write the crossings of each entry, along its polyline."""
    entry = wp.tid()
    region = o.region_of[entry]
    begin = o.r.polyline_start[o.r.region_line[entry]]
    at = start[entry]
    i = begin
    while at < start[entry + 1]:
        a = o.points[i]
        b = o.points[i + wp.int64(1)]
        level = level_of(o, region, i)
        to = level_of(o, region, i + wp.int64(1))
        step = wp.where(to > level, wp.int64(1), wp.int64(-1))
        while level != to:
            row = wp.min(level, level + step)
            part = (row_height(o, region, row) - a[1]) / (b[1] - a[1])
            c.entry[at] = entry
            c.edge[at] = wp.int32(i - begin)
            c.row[at] = wp.int32(row)
            c.enters[at] = wp.int8(-step)
            c.x[at] = a[0] + part * (b[0] - a[0])
            level += step
            at += wp.int64(1)
        i += wp.int64(1)


@wp.func
def precedes(c: RowCrossings, base: wp.int64, one: wp.int32, other: wp.int32):
    """Whether a crossing comes before another one: by row, x, entering before leaving, then along the outline."""
    a = base + wp.int64(one)
    b = base + wp.int64(other)
    out = one < other
    if c.row[a] != c.row[b]:
        out = c.row[a] < c.row[b]
    elif c.x[a] != c.x[b]:
        out = c.x[a] < c.x[b]
    elif c.enters[a] != c.enters[b]:
        out = c.enters[a] > c.enters[b]
    return out


@wp.func
def sift_down(c: RowCrossings, base: wp.int64, root: int, count: int):
    """Restore a heap of `count` crossings, the last in order on top, below one that may be too small."""
    moved = c.order[base + wp.int64(root)]
    at = root
    child = 2 * at + 1
    while child < count:
        largest = c.order[base + wp.int64(child)]
        if child + 1 < count:
            other = c.order[base + wp.int64(child + 1)]
            if precedes(c, base, largest, other):
                largest = other
                child += 1
        if precedes(c, base, moved, largest):
            c.order[base + wp.int64(at)] = largest
            at = child
            child = 2 * at + 1
        else:
            child = count
    c.order[base + wp.int64(at)] = moved


@wp.kernel
def _sort_crossings(o: Outlines, c: RowCrossings):
    """Sort each region's crossings: heap sort, which is never quadratic."""
    region = wp.tid()
    base = c.start[o.r.region_start[region]]
    count = int(c.start[o.r.region_start[region + 1]] - base)
    for k in range(count):
        c.order[base + wp.int64(k)] = k
    for k in range(count // 2):
        sift_down(c, base, count // 2 - 1 - k, count)
    for k in range(count - 1):
        last = base + wp.int64(count - 1 - k)
        top = c.order[base]
        c.order[base] = c.order[last]
        c.order[last] = top
        sift_down(c, base, int(0), count - 1 - k)


@wp.struct
class SpanSequence:
    """Spans in the order in which they are drawn; a region has half as many places as it has crossings."""

    begin: wp.array[wp.int64]  # the crossing at which a span is entered
    end: wp.array[wp.int64]  # the crossing at which it is left
    direction: wp.array[wp.int32]  # how the boundary leads on to the next span: 1 as it runs, -1 back, 0 not at all
    region: wp.array[wp.int32]
    points: wp.array[wp.int64]  # number of points of the span and on to the next; 0: the place is not used
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
    """The neighbour of a crossing on its outline where a span is entered, -1 if there is none; the direction to it."""
    first = c.start[c.entry[at]]
    stop = c.start[c.entry[at] + 1]
    after = at + wp.int64(1)
    if after == stop:
        after = first
    before = at - wp.int64(1)
    if before < first:
        before = stop - wp.int64(1)
    to = wp.int64(-1)
    direction = int(0)
    if is_ahead(c, mate, at, after):
        to = after
        direction = int(1)
    elif is_ahead(c, mate, at, before):
        to = before
        direction = int(-1)
    return to, direction


@wp.func
def count_between(o: Outlines, c: RowCrossings, at: wp.int64, to: wp.int64, direction: int):
    """Number of vertices between two crossings of an outline."""
    a = wp.where(direction > 0, at, to)
    b = wp.where(direction > 0, to, at)
    count = wp.int64(c.edge[b]) - wp.int64(c.edge[a])
    if b < a:
        line = o.r.region_line[c.entry[at]]
        count += o.r.polyline_start[line + 1] - o.r.polyline_start[line] - wp.int64(1)
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
        to, direction = find_next(c, mate, end)
        count = wp.int64(2)
        if direction != 0:
            count += count_between(o, c, end, to, direction)
        s.begin[next_place] = at
        s.end[next_place] = end
        s.direction[next_place] = direction
        s.region[next_place] = region
        s.points[next_place] = count
        s.starts[next_place] = wp.where(next_place == place, wp.int64(1), wp.int64(0))
        next_place += wp.int64(1)
        at = to
    return next_place


@wp.kernel
def _join_spans(o: Outlines, c: RowCrossings, connected: int, mate: wp.array[wp.int64], s: SpanSequence):
    """Order the spans of each region into lines; connected: 0: each span is one. mate: scratch, by crossing."""
    region = wp.tid()
    base = c.start[o.r.region_start[region]]
    count = int(c.start[o.r.region_start[region + 1]] - base)
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
                s.direction[place] = 0
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
        line = o.r.region_line[c.entry[s.end[span]]]
        base = o.r.polyline_start[line]
        size = o.r.polyline_start[line + 1] - base - wp.int64(1)
        vertex = wp.int64(c.edge[s.end[span]])
        if s.direction[span] > 0:
            vertex += wp.int64(1)
        for k in range(int(count) - 2):
            own = (vertex + wp.int64(s.direction[span] * k) + size) % size  # the polyline goes round
            points[at + wp.int64(2 + k)] = turn_back(o.points[base + own], cosine, sine)


@on_one_device
def find_rows(regions: Regions, filled: wp.array, *, spacing: float, angle: float) -> Outlines:
    """Regions as rows at an angle [rad] cross them; arguments as for `draw_hatch`."""
    device, o, points = regions.local.device, Outlines(), regions.local.shape[0]
    o.r, o.spacing = regions, spacing
    o.points = wp.empty(points, dtype=wp.vec2d, device=device)
    o.level = wp.empty(points, dtype=wp.int64, device=device)
    count = regions.region_start.shape[0] - 1
    o.first, o.rows = (wp.empty(count, dtype=wp.int64, device=device) for _ in range(2))
    o.middle = wp.empty(count, dtype=wp.float64, device=device)
    o.region_of = wp.empty(regions.region_line.shape[0], dtype=wp.int32, device=device)
    launch(_turn_points, points, [o, wp.float64(math.cos(angle)), wp.float64(math.sin(angle))], [])
    launch(_find_rows, count, [filled], [o])
    return o


def find_crossings(o: Outlines, point_limit: int | None = None) -> RowCrossings:
    """Sorted crossings of rows with outlines.

    Raises PointLimitError before memory is allocated for more crossings than `point_limit`: most of them become points.
    """
    entries = o.region_of.shape[0]
    (c,), (c.start,) = count_then_fill(
        _count_crossings,
        _find_crossings,
        entries,
        [o],
        lambda total: [_room_for_crossings(total, o.points.device)],
        rows=entries,
        limit=point_limit,
    )
    launch(_sort_crossings, o.first.shape[0], [o], [c])
    return c


def _room_for_crossings(count: int, device: wp.Device) -> RowCrossings:
    c = RowCrossings()
    for name in ("entry", "edge", "row", "order"):
        setattr(c, name, wp.empty(count, dtype=wp.int32, device=device))
    c.enters = wp.empty(count, dtype=wp.int8, device=device)
    c.x = wp.empty(count, dtype=wp.float64, device=device)
    return c


@on_one_device
def join_spans(o: Outlines, c: RowCrossings, *, connected: bool) -> SpanSequence:
    """Spans of the regions in the order in which they are drawn."""
    device, total, s = c.x.device, c.x.shape[0], SpanSequence()
    places = total // 2
    s.begin, s.end = (wp.empty(places, dtype=wp.int64, device=device) for _ in range(2))
    s.direction, s.region = (wp.empty(places, dtype=wp.int32, device=device) for _ in range(2))
    s.points, s.starts = (wp.zeros(places + 1, dtype=wp.int64, device=device) for _ in range(2))
    mate = wp.empty(total, dtype=wp.int64, device=device)
    launch(_join_spans, o.first.shape[0], [o, c, int(connected), mate], [s])
    return s


@on_one_device
def draw_hatch(
    regions: Regions, filled: wp.array, *, spacing: float, angle: float, connected: bool, point_limit: int | None = None
) -> FlatLines:
    """Parallel lines over what regions enclose, in their planes, through the planes' origin.

    Polylines of regions are closed, counter-clockwise around the region and clockwise around holes. filled: 0 for
    regions to leave out, uint8, shape [region]. spacing: between lines [m]; angle: of the lines from u towards v [rad];
    connected: lines are joined along the boundary where they can be. A region between two lines gets one through its
    middle. Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    o = find_rows(regions, filled, spacing=spacing, angle=angle)
    c = find_crossings(o, point_limit)
    s = join_spans(o, c, connected=connected)
    starts, totals = scan_counts(s.points, s.starts, limit=point_limit)
    out = room_for_lines(*totals, c.x.device)
    turn = [wp.float64(math.cos(angle)), wp.float64(math.sin(angle))]
    launch(_draw_spans, s.begin.shape[0], [o, c, s, *starts, *turn], out)
    return out
