"""Edges of regions in a plane, and the lines and arcs at a distance inside of them: *offsets*.

A region's edges run with the inside on their left. Edge e has two offsets: number 2 e is the edge moved to its left,
and number 2 e + 1 is the arc around the edge's end, there only where the outline turns right or straight back. The
parameter of a moved edge is the distance along it [m]; that of an arc grows with the angle (`diamond_angle`), and needs
sums, products and roots only, so that every device gives the same bits.
"""

import warp as wp

from ..offsets import count_then_fill, launch
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
