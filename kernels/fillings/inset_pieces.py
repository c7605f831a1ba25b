"""Lines and arcs at a distance inside of regions in a plane, *offsets*, and their pieces that are far enough inside.

A region's edges run with the inside on their left. Edge e has two offsets: number 2 e is the edge moved to its left,
and number 2 e + 1 is the arc around the edge's end, there only where the outline turns right or straight back. The
parameter of a moved edge is the distance along it [m]; that of an arc grows with the angle (`diamond_angle`), and needs
sums, products and roots only, so that every device gives the same bits.

Nearer to an edge than the distance is its *stadium*: a rectangle along the edge, and a disc around each of its ends. A
moved edge is in a stadium for one interval of its parameter, since a stadium is convex; its pieces lie between these
intervals. An arc crosses a stadium's boundary at some parameters. It is divided where it crosses any stadium's, and the
middle of each part decides whether that belongs to a piece.
"""

import warp as wp

from ..offsets import count_then_fill, launch, scan_counts
from ..one_device import on_one_device
from ..patch import EXACT
from ..stages.regions import Regions

wp.set_module_options(EXACT)

BLOCK_EDGES = wp.constant(16)  # edges that share a box, so that those far away are passed over together
SLACK = wp.constant(
    wp.float64(1e-9)
)  # [m]; what is nearer to an edge than the distance by less is not too near: offsets touch their neighbours
STRAIGHT_BACK = wp.constant(wp.float64(1e-9))  # sine of the turn at a vertex below which an outline turns straight back
SHORTEST_EDGE = wp.constant(wp.float64(1e-12))  # [m]; a shorter one has no direction, and is left out


@wp.struct
class InsetEdges:
    """Edges by region, and within it by polyline as it runs."""

    region_start: wp.array[wp.int64]  # offsets of each region's entries, which are its polylines
    start: wp.array[wp.int64]  # offsets of each entry's edges
    origin: wp.array[wp.vec2d]  # where an edge starts [m]
    tangent: wp.array[wp.vec2d]  # unit vector along it
    length: wp.array[wp.float64]  # [m]
    before: wp.array[wp.int32]  # the edge before it on its polyline
    after: wp.array[wp.int32]
    region: wp.array[wp.int32]
    low: wp.array[wp.vec2d]  # box of every 16 edges, shape [block] [m]
    high: wp.array[wp.vec2d]
    distance: wp.array[wp.float64]  # of each region's offsets from its edges [m]
    filters: wp.array[wp.int32]  # of each region: whether only offsets that lie inside it have pieces


@wp.func
def left_of(a: wp.vec2d):
    """The vector turned left by a right angle."""
    return wp.vec2d(-a[1], a[0])


@wp.func
def cross_of(a: wp.vec2d, b: wp.vec2d):
    """The sine of the angle from a to b, times their lengths."""
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def diamond_angle(x: wp.float64, y: wp.float64):
    """A number 0..4 that grows with the angle of (x, y), 1 a right angle."""
    size = wp.abs(x) + wp.abs(y)
    turn = y / size
    if x < wp.float64(0.0):
        turn = wp.float64(2.0) - turn
    elif y < wp.float64(0.0):
        turn = wp.float64(4.0) + turn
    return turn


@wp.func
def has_arc(edges: InsetEdges, e: int):
    """Whether the outline turns right, or straight back, at the end of an edge."""
    tangent = edges.tangent[e]
    other = edges.tangent[edges.after[e]]
    turn = cross_of(tangent, other)
    return turn < wp.float64(0.0) or (turn < STRAIGHT_BACK and wp.dot(tangent, other) < wp.float64(0.0))


@wp.func
def offset_end(edges: InsetEdges, offset: int):
    """The parameter at which an offset ends; it starts at 0."""
    e = offset // 2
    out = edges.length[e]
    if offset % 2 != 0:
        tangent = edges.tangent[e]
        other = edges.tangent[edges.after[e]]
        out = diamond_angle(wp.dot(tangent, other), wp.max(-cross_of(tangent, other), wp.float64(0.0)))
    return out


@wp.func
def offset_point(edges: InsetEdges, offset: int, t: wp.float64):
    """The point of an offset at a parameter [m]."""
    e = offset // 2
    distance = edges.distance[edges.region[e]]
    tangent = edges.tangent[e]
    normal = left_of(tangent)
    out = edges.origin[e] + distance * normal + t * tangent
    if offset % 2 != 0:
        x = wp.float64(1.0) - t
        y = wp.min(t, wp.float64(2.0) - t)
        size = distance / wp.sqrt(x * x + y * y)
        out = edges.origin[edges.after[e]] + (size * x) * normal + (size * y) * tangent
    return out


@wp.func
def edges_of(edges: InsetEdges, region: int):
    """First edge of a region, and the one after its last."""
    return (
        int(edges.start[edges.region_start[region]]),
        int(edges.start[edges.region_start[region + 1]]),
    )


@wp.func
def side_of(edges: InsetEdges, e: int, x: wp.vec2d):
    """Distance of a point to the left of an edge's line [m]."""
    return cross_of(edges.tangent[e], x - edges.origin[e])


@wp.func
def square_distance(edges: InsetEdges, j: int, x: wp.vec2d):
    """Square of a point's distance from an edge [m2]."""
    away = x - edges.origin[j]
    part = wp.clamp(wp.dot(away, edges.tangent[j]), wp.float64(0.0), edges.length[j])
    rest = away - part * edges.tangent[j]
    return wp.dot(rest, rest)


@wp.func
def winding_of(edges: InsetEdges, region: int, x: wp.vec2d):
    """How often the outlines of a region go around a point."""
    first, stop = edges_of(edges, region)
    turns = int(0)
    for e in range(first, stop):
        a = edges.origin[e]
        b = edges.origin[edges.after[e]]
        if (a[1] <= x[1]) != (b[1] <= x[1]):
            left = cross_of(b - a, x - a)
            if a[1] <= x[1] and left > wp.float64(0.0):
                turns += 1
            elif a[1] > x[1] and left < wp.float64(0.0):
                turns -= 1
    return turns


@wp.struct
class Reach:
    """A box in which edges are looked for [m]."""

    low: wp.vec2d
    high: wp.vec2d


@wp.func
def reach_of(a: wp.vec2d, b: wp.vec2d, away: wp.float64):
    """A box around two points, and so far beyond them."""
    reach = Reach()
    reach.low = wp.vec2d(wp.min(a[0], b[0]) - away, wp.min(a[1], b[1]) - away)
    reach.high = wp.vec2d(wp.max(a[0], b[0]) + away, wp.max(a[1], b[1]) + away)
    return reach


@wp.func
def next_edge(edges: InsetEdges, reach: Reach, j: int, stop: int):
    """The first edge from j on, before `stop`, whose block's box meets another box; `stop` if there is none."""
    out = j
    going = int(1)
    while out < stop and going != 0:
        low = edges.low[out // BLOCK_EDGES]
        high = edges.high[out // BLOCK_EDGES]
        apart = low[0] > reach.high[0] or high[0] < reach.low[0]
        if apart or low[1] > reach.high[1] or high[1] < reach.low[1]:
            out = (out // BLOCK_EDGES + 1) * BLOCK_EDGES
        else:
            going = int(0)
    return wp.min(out, stop)


@wp.func
def edge_vector(r: Regions, point: wp.int64):
    """From a point of a polyline to the next one [m]."""
    a = r.local[point]
    b = r.local[point + wp.int64(1)]
    return wp.vec2d(b[0] - a[0], b[1] - a[1])


@wp.kernel
def _count_edges(r: Regions, filled: wp.array[wp.uint8], count: wp.array[wp.int64]):
    """Count the edges of each polyline of a region that is filled; points that repeat the one before make none."""
    region = wp.tid()
    for entry in range(int(r.region_start[region]), int(r.region_start[region + 1])):
        base = r.polyline_start[r.region_line[entry]]
        total = wp.int64(0)
        if filled[region] != wp.uint8(0):
            for k in range(int(r.polyline_start[r.region_line[entry] + 1] - base) - 1):
                if wp.length(edge_vector(r, base + wp.int64(k))) > SHORTEST_EDGE:
                    total += wp.int64(1)
        count[entry] = total


@wp.kernel
def _write_edges(r: Regions, filled: wp.array[wp.uint8], start: wp.array[wp.int64], edges: InsetEdges):
    """Write the edges of each region."""
    region = wp.tid()
    for entry in range(int(r.region_start[region]), int(r.region_start[region + 1])):
        point = r.polyline_start[r.region_line[entry]]
        first = int(start[entry])
        count = int(start[entry + 1]) - first
        k = int(0)
        while k < count:
            tangent = edge_vector(r, point)
            length = wp.sqrt(tangent[0] * tangent[0] + tangent[1] * tangent[1])
            if length > SHORTEST_EDGE:
                edges.origin[first + k] = wp.vec2d(r.local[point][0], r.local[point][1])
                edges.length[first + k] = length
                edges.tangent[first + k] = tangent / length
                edges.before[first + k] = first + (k + count - 1) % count
                edges.after[first + k] = first + (k + 1) % count
                edges.region[first + k] = region
                k += 1
            point += wp.int64(1)


@wp.kernel
def _find_boxes(edges: InsetEdges):
    """Find the box of each block of edges."""
    block = wp.tid()
    first = block * BLOCK_EDGES
    lowest = edges.origin[first]
    highest = edges.origin[first]
    for e in range(first, wp.min(first + BLOCK_EDGES, edges.origin.shape[0])):
        end = edges.origin[edges.after[e]]
        lowest = wp.min(lowest, wp.min(edges.origin[e], end))
        highest = wp.max(highest, wp.max(edges.origin[e], end))
    edges.low[block] = lowest
    edges.high[block] = highest


@on_one_device
def find_edges(regions: Regions, filled: wp.array, distance: float) -> InsetEdges:
    """Edges of the regions that are filled; arguments as for `draw_inset`."""
    device, region_count = regions.local.device, regions.region_start.shape[0] - 1
    (edges,), (edges.start,) = count_then_fill(
        _count_edges,
        _write_edges,
        region_count,
        [regions, filled],
        lambda total: [_room_for_edges(total, device)],
        rows=regions.region_line.shape[0],
    )
    edges.region_start = regions.region_start
    edges.distance = wp.full(region_count, distance, dtype=wp.float64, device=device)
    edges.filters = wp.zeros(region_count, dtype=wp.int32, device=device)
    launch(_find_boxes, edges.low.shape[0], [], [edges])
    return edges


def _room_for_edges(count: int, device: wp.Device) -> InsetEdges:
    edges = InsetEdges()
    for name, dtype in (("origin", wp.vec2d), ("tangent", wp.vec2d), ("length", wp.float64)):
        setattr(edges, name, wp.empty(count, dtype=dtype, device=device))
    for name in ("before", "after", "region"):
        setattr(edges, name, wp.empty(count, dtype=wp.int32, device=device))
    edges.low, edges.high = (wp.empty(-(-count // int(BLOCK_EDGES)), dtype=wp.vec2d, device=device) for _ in range(2))
    return edges


TOUCH = wp.constant(wp.float64(1e-9))  # [m]; crossings this far beyond a rectangle's end are crossings, too
DOUBTFUL = wp.constant(wp.float64(1e-8))  # [m]; two pieces that run to and fro, this near, have nothing between them
OPPOSITE = wp.constant(wp.float64(-0.99))  # cosine between edges that run to and fro
SHORTEST = wp.constant(wp.float64(1e-7))  # [m]; a shorter piece is rounding


@wp.struct
class OffsetPieces:
    """Pieces of offsets, in the order of the offsets, and along each."""

    start: wp.array[wp.int64]  # offsets of each offset's pieces
    offset: wp.array[wp.int32]  # which offset a piece is of
    begin: wp.array[wp.float64]  # parameter at which it begins
    end: wp.array[wp.float64]
    first: wp.array[wp.vec2d]  # the points there [m]
    last: wp.array[wp.vec2d]


@wp.func
def cap_interval(x: wp.float64, y: wp.float64, ux: wp.float64, uy: wp.float64, radius: wp.float64):
    """Where a line from (x, y) along a unit vector is inside a disc around the origin, [m]; empty: first > last."""
    middle = -(x * ux + y * uy)
    away = x * uy - y * ux
    square = radius * radius - away * away
    out = wp.vec2d(wp.float64(wp.inf), -wp.float64(wp.inf))
    if square > wp.float64(0.0):
        half = wp.sqrt(square)
        out = wp.vec2d(middle - half, middle + half)
    return out


@wp.func
def slab_interval(x: wp.float64, ux: wp.float64, low: wp.float64, high: wp.float64):
    """Where x + t ux is strictly between two bounds; empty: first > last."""
    infinite = wp.float64(wp.inf)
    out = wp.vec2d(-infinite, infinite)
    if ux == wp.float64(0.0):
        if x <= low or x >= high:
            out = wp.vec2d(infinite, -infinite)
    else:
        a = (low - x) / ux
        b = (high - x) / ux
        out = wp.vec2d(wp.min(a, b), wp.max(a, b))
    return out


@wp.func
def stadium_interval(edges: InsetEdges, e: int, j: int):
    """The parameters at which edge e, moved to its left, is inside the stadium of edge j; empty: first >= last."""
    zero = wp.float64(0.0)
    distance = edges.distance[edges.region[e]]
    radius = distance - SLACK
    length = edges.length[j]
    end = edges.length[e]
    out = wp.vec2d(wp.float64(wp.inf), -wp.float64(wp.inf))
    away = edges.origin[e] + distance * left_of(edges.tangent[e]) - edges.origin[j]
    x = wp.dot(away, edges.tangent[j])
    ux = wp.dot(edges.tangent[e], edges.tangent[j])
    if (x > -radius or x + end * ux > -radius) and (x < length + radius or x + end * ux < length + radius):
        y = cross_of(edges.tangent[j], away)
        uy = cross_of(edges.tangent[j], edges.tangent[e])
        if (y > -radius or y + end * uy > -radius) and (y < radius or y + end * uy < radius):
            a = cap_interval(x, y, ux, uy, radius)
            b = cap_interval(x - length, y, ux, uy, radius)
            along = slab_interval(x, ux, zero, length)
            across = slab_interval(y, uy, -radius, radius)
            low = wp.max(along[0], across[0])
            high = wp.min(along[1], across[1])
            out = wp.vec2d(wp.min(a[0], b[0]), wp.max(a[1], b[1]))
            if low < high:
                out = wp.vec2d(wp.min(out[0], low), wp.max(out[1], high))
            out = wp.vec2d(wp.max(out[0], zero), wp.min(out[1], end))
    return out


@wp.func
def put_crossing(
    edges: InsetEdges,
    offset: int,
    j: int,
    direction: wp.vec2d,
    cap: int,
    bounds: wp.array[wp.float64],
    base: wp.int64,
    count: int,
):
    """Keep the parameter of an arc at which it crosses the boundary of a stadium, if it does in a direction.

    direction: a unit vector, by the normal and the tangent of the arc's edge. cap: -1 or 1: the boundary is that of
    the disc at the start or end of edge j, 0: a side of the rectangle. base: -1: count only. Returns the new count.
    """
    out = count
    t = diamond_angle(direction[0], direction[1])
    if t > wp.float64(0.0) and t < offset_end(edges, offset):
        tangent = edges.tangent[offset // 2]
        x = edges.origin[edges.after[offset // 2]] - edges.origin[j]
        distance = edges.distance[edges.region[j]]
        x = x + distance * (direction[0] * left_of(tangent) + direction[1] * tangent)
        along = wp.dot(x, edges.tangent[j])
        there = along >= -TOUCH and along <= edges.length[j] + TOUCH
        if cap < 0:
            there = along <= TOUCH
        elif cap > 0:
            there = along >= edges.length[j] - TOUCH
        if there:
            if base >= wp.int64(0):
                k = int(count)  # the bounds are sorted, and stay so
                while k > 0 and bounds[base + wp.int64(wp.max(k - 1, 0))] > t:
                    bounds[base + wp.int64(k)] = bounds[base + wp.int64(k - 1)]
                    k -= 1
                bounds[base + wp.int64(k)] = t
            out = count + 1
    return out


@wp.func
def put_pair(
    edges: InsetEdges,
    offset: int,
    j: int,
    axis: wp.vec2d,
    cosine: wp.float64,
    cap: int,
    bounds: wp.array[wp.float64],
    base: wp.int64,
    count: int,
):
    """Keep the two crossings of an arc whose directions have a cosine with an axis; the new count."""
    out = count
    square = wp.float64(1.0) - cosine * cosine
    if square > wp.float64(0.0):
        across = wp.sqrt(square) * left_of(axis)
        out = put_crossing(edges, offset, j, cosine * axis + across, cap, bounds, base, out)
        out = put_crossing(edges, offset, j, cosine * axis - across, cap, bounds, base, out)
    return out


@wp.func
def put_cap_crossings(
    edges: InsetEdges, offset: int, j: int, cap: int, bounds: wp.array[wp.float64], base: wp.int64, count: int
):
    """Keep where an arc crosses the circle around the start, cap -1, or end, cap 1, of an edge; the new count."""
    out = count
    d = edges.distance[edges.region[j]]
    radius = d - SLACK
    tangent = edges.tangent[offset // 2]
    away = edges.origin[j] - edges.origin[edges.after[offset // 2]]
    if cap > 0:
        away = edges.origin[edges.after[j]] - edges.origin[edges.after[offset // 2]]
    size = wp.length(away)
    if size > wp.float64(0.0):
        axis = wp.vec2d(wp.dot(away, left_of(tangent)) / size, wp.dot(away, tangent) / size)
        cosine = (d * d + size * size - radius * radius) / (wp.float64(2.0) * d * size)
        out = put_pair(edges, offset, j, axis, cosine, cap, bounds, base, out)
    return out


@wp.func
def put_arc_crossings(edges: InsetEdges, offset: int, j: int, bounds: wp.array[wp.float64], base: wp.int64, count: int):
    """Keep where an arc crosses the boundary of an edge's stadium; the new count of crossings."""
    out = count
    d = edges.distance[edges.region[j]]
    radius = d - SLACK
    tangent = edges.tangent[offset // 2]
    middle = edges.origin[edges.after[offset // 2]]
    if square_distance(edges, j, middle) < wp.float64(4.0) * d * d:
        out = put_cap_crossings(edges, offset, j, int(-1), bounds, base, out)
        out = put_cap_crossings(edges, offset, j, int(1), bounds, base, out)
        across = left_of(edges.tangent[j])
        axis = wp.vec2d(wp.dot(across, left_of(tangent)), wp.dot(across, tangent))
        height = side_of(edges, j, middle)
        out = put_pair(edges, offset, j, axis, (radius - height) / d, int(0), bounds, base, out)
        out = put_pair(edges, offset, j, axis, (-radius - height) / d, int(0), bounds, base, out)
    return out


@wp.func
def is_too_near(edges: InsetEdges, offset: int, x: wp.vec2d):
    """Whether a point of an arc is in the stadium of an edge other than the two that meet in its middle."""
    e = offset // 2
    first, stop = edges_of(edges, edges.region[e])
    distance = edges.distance[edges.region[e]]
    radius = distance - SLACK
    reach = reach_of(x, x, distance)
    out = int(0)
    j = next_edge(edges, reach, first, stop)
    while j < stop and out == 0:
        if j != e and j != edges.after[e] and square_distance(edges, j, x) < radius * radius:
            out = int(1)
        j = next_edge(edges, reach, j + 1, stop)
    return out != 0


@wp.func
def reach_of_offset(edges: InsetEdges, offset: int):
    """A box that meets every edge whose stadium an offset can meet."""
    a = offset_point(edges, offset, wp.float64(0.0))
    b = offset_point(edges, offset, offset_end(edges, offset))
    away = edges.distance[edges.region[offset // 2]]
    if offset % 2 != 0:
        away += wp.float64(0.5) * wp.length(b - a)  # an arc of half a turn or less is no farther from its chord
    return reach_of(a, b, away)


@wp.kernel
def _count_bounds(edges: InsetEdges, count: wp.array[wp.int64]):
    """Count the crossings of each offset with stadiums: numbers that its pieces need at most; 0: it has none."""
    offset = wp.tid()
    e = offset // 2
    if offset % 2 != 0 and not has_arc(edges, e):
        return
    first, stop = edges_of(edges, edges.region[e])
    reach = reach_of_offset(edges, offset)
    total = int(0)
    j = next_edge(edges, reach, first, stop)
    while j < stop:
        if offset % 2 == 0 and j != e:
            span = stadium_interval(edges, e, j)
            if span[0] < span[1]:
                total += 2
            if span[0] <= wp.float64(0.0) and span[1] >= edges.length[e]:
                total = int(-2)
                j = stop
        elif offset % 2 != 0 and j != e and j != edges.after[e]:
            total = put_arc_crossings(edges, offset, j, edges.length, wp.int64(-1), total)
        j = next_edge(edges, reach, j + 1, stop)
    count[offset] = wp.int64(total + 2)


@wp.func
def sort_intervals(edges: InsetEdges, e: int, bounds: wp.array[wp.float64], base: wp.int64):
    """Write the intervals of a moved edge inside stadiums, sorted, behind the first place; how many there are."""
    first, stop = edges_of(edges, edges.region[e])
    reach = reach_of_offset(edges, 2 * e)
    count = int(0)
    j = next_edge(edges, reach, first, stop)
    while j < stop:
        if j != e:
            span = stadium_interval(edges, e, j)
            if span[0] < span[1]:
                k = count
                while k > 0 and bounds[base + wp.int64(wp.max(2 * k - 1, 0))] > span[0]:
                    bounds[base + wp.int64(2 * k + 1)] = bounds[base + wp.int64(2 * k - 1)]
                    bounds[base + wp.int64(2 * k + 2)] = bounds[base + wp.int64(2 * k)]
                    k -= 1
                bounds[base + wp.int64(2 * k + 1)] = span[0]
                bounds[base + wp.int64(2 * k + 2)] = span[1]
                count += 1
        j = next_edge(edges, reach, j + 1, stop)
    return count


@wp.func
def is_long(edges: InsetEdges, offset: int, begin: wp.float64, end: wp.float64):
    """Whether a piece of an offset is more than rounding."""
    size = end - begin
    if offset % 2 != 0:
        size = size * edges.distance[edges.region[offset // 2]]  # an arc is longer than this
    return size > SHORTEST


@wp.func
def keep_outside(edges: InsetEdges, e: int, bounds: wp.array[wp.float64], base: wp.int64):
    """Write begin and end of each piece of a moved edge; their number."""
    count = sort_intervals(edges, e, bounds, base)
    pieces = int(0)
    at = wp.float64(0.0)
    for k in range(count + 1):
        to = edges.length[e]
        onward = to
        if k < count:  # pieces are written over intervals that have been read
            to = bounds[base + wp.int64(2 * k + 1)]
            onward = bounds[base + wp.int64(2 * k + 2)]
        if is_long(edges, 2 * e, at, to):
            bounds[base + wp.int64(2 * pieces)] = at
            bounds[base + wp.int64(2 * pieces + 1)] = to
            pieces += 1
        at = wp.max(at, onward)
    return pieces


@wp.func
def keep_far(edges: InsetEdges, offset: int, bounds: wp.array[wp.float64], base: wp.int64):
    """Write begin and end of each piece of an arc; their number."""
    first, stop = edges_of(edges, edges.region[offset // 2])
    reach = reach_of_offset(edges, offset)
    count = int(0)
    j = next_edge(edges, reach, first, stop)
    while j < stop:
        if j != offset // 2 and j != edges.after[offset // 2]:
            count = put_arc_crossings(edges, offset, j, bounds, base + wp.int64(1), count)
        j = next_edge(edges, reach, j + 1, stop)
    pieces = int(0)
    at = wp.float64(0.0)
    begin = wp.float64(-1.0)
    for k in range(count + 1):
        to = offset_end(edges, offset)
        if k < count:
            to = bounds[base + wp.int64(k + 1)]
        near = is_too_near(edges, offset, offset_point(edges, offset, wp.float64(0.5) * (at + to)))
        if not near and begin < wp.float64(0.0):
            begin = at
        if begin >= wp.float64(0.0) and (near or k == count):
            last = wp.where(near, at, to)
            if is_long(edges, offset, begin, last):
                bounds[base + wp.int64(2 * pieces)] = begin
                bounds[base + wp.int64(2 * pieces + 1)] = last
                pieces += 1
            begin = wp.float64(-1.0)
        at = to
    return pieces


@wp.func
def keep_inside(edges: InsetEdges, offset: int, bounds: wp.array[wp.float64], base: wp.int64, pieces: int):
    """Keep the pieces of an offset that lie inside its region; their number."""
    out = int(0)
    for k in range(pieces):
        begin = bounds[base + wp.int64(2 * k)]
        end = bounds[base + wp.int64(2 * k + 1)]
        # No piece crosses an outline, so one point of it decides.
        middle = offset_point(edges, offset, wp.float64(0.5) * (begin + end))
        if winding_of(edges, edges.region[offset // 2], middle) > 0:
            bounds[base + wp.int64(2 * out)] = begin
            bounds[base + wp.int64(2 * out + 1)] = end
            out += 1
    return out


@wp.kernel
def _keep_pieces(
    # In:
    edges: InsetEdges,
    place: wp.array[wp.int64],  # offsets of each offset's bounds
    # Out:
    count: wp.array[wp.int64],  # pieces, shape [offset + 1]
    bounds: wp.array[wp.float64],  # begin and end of each piece, first in the places of its offset
):
    """Find the pieces of each offset."""
    offset = wp.tid()
    if place[offset + 1] > place[offset]:
        pieces = int(0)
        if offset % 2 == 0:
            pieces = keep_outside(edges, offset // 2, bounds, place[offset])
        else:
            pieces = keep_far(edges, offset, bounds, place[offset])
        if edges.filters[edges.region[offset // 2]] != 0:
            pieces = keep_inside(edges, offset, bounds, place[offset], pieces)
        count[offset] = wp.int64(pieces)


@wp.kernel
def _gather_pieces(edges: InsetEdges, place: wp.array[wp.int64], bounds: wp.array[wp.float64], pieces: OffsetPieces):
    """Write the pieces of each offset, one after the other."""
    offset = wp.tid()
    first = pieces.start[offset]
    for k in range(int(pieces.start[offset + 1] - first)):
        i = first + wp.int64(k)
        begin = bounds[place[offset] + wp.int64(2 * k)]
        end = bounds[place[offset] + wp.int64(2 * k + 1)]
        pieces.offset[i] = offset
        pieces.begin[i] = begin
        pieces.end[i] = end
        pieces.first[i] = offset_point(edges, offset, begin)
        pieces.last[i] = offset_point(edges, offset, end)


@wp.kernel
def _find_doubtful_regions(edges: InsetEdges, pieces: OffsetPieces, failed: wp.array[wp.int32]):
    """Find regions a part of which is twice the distance wide: what is left there is no area, or it is rounding.

    There a piece lies on one of opposite direction.
    """
    i = wp.tid()
    offset = pieces.offset[i]
    e = offset // 2
    if offset % 2 == 0:
        first, stop = edges_of(edges, edges.region[e])
        x = offset_point(edges, offset, wp.float64(0.5) * (pieces.begin[i] + pieces.end[i]))
        most = edges.distance[edges.region[e]] + DOUBTFUL
        reach = reach_of(x, x, most)
        j = next_edge(edges, reach, first, stop)
        while j < stop:
            opposite = wp.dot(edges.tangent[e], edges.tangent[j]) < OPPOSITE and side_of(edges, j, x) > wp.float64(0.0)
            if opposite and square_distance(edges, j, x) < most * most:
                failed[edges.region[e]] = 1
            j = next_edge(edges, reach, j + 1, stop)


@on_one_device
def find_pieces(edges: InsetEdges) -> tuple[OffsetPieces, wp.array]:
    """Pieces of the offsets of all regions, and of which region a piece is in doubt, int32, shape [region]."""
    device, offset_count, pieces = edges.origin.device, 2 * edges.origin.shape[0], OffsetPieces()
    failed = wp.zeros(edges.distance.shape[0], dtype=wp.int32, device=device)
    count = wp.zeros(offset_count + 1, dtype=wp.int64, device=device)
    (bounds,), (place,) = count_then_fill(
        _count_bounds,
        _keep_pieces,
        offset_count,
        [edges],
        lambda total: [wp.empty(total, dtype=wp.float64, device=device)],
        rows=offset_count,
        more=[count],
    )
    (pieces.start,), (total,) = scan_counts(count)
    pieces.offset = wp.empty(total, dtype=wp.int32, device=device)
    pieces.begin, pieces.end = (wp.empty(total, dtype=wp.float64, device=device) for _ in range(2))
    pieces.first, pieces.last = (wp.empty(total, dtype=wp.vec2d, device=device) for _ in range(2))
    launch(_gather_pieces, offset_count, [edges, place, bounds], [pieces])
    launch(_find_doubtful_regions, total, [edges, pieces], [failed])
    return pieces, failed
