"""Edges of regions in a plane, and the lines and arcs at a distance inside of them: *offsets*.

A region's edges run with the inside on their left. Edge e has two offsets: number 2 e is the edge moved to its left,
and number 2 e + 1 is the arc around the edge's end, there only where the outline turns right. The parameter of a moved
edge is the distance along it [m]; that of an arc grows with the angle (`diamond_angle`), and needs sums, products and
roots only, so that every device gives the same bits.
"""

import warp as wp

from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT
from ..stages.regions import Regions

wp.set_module_options(EXACT)

BLOCK_EDGES = wp.constant(16)  # edges that share a box, so that those far away are passed over together
SLACK = 1e-9  # [m]; what is nearer to an edge than the distance by less is not too near: offsets touch their neighbours
STRAIGHT_BACK = wp.constant(wp.float64(1e-9))  # sine of the turn at a vertex below which an outline turns straight back


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
    distance: wp.float64  # [m]
    radius: wp.float64  # distance less SLACK [m]


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
    """Whether the outline turns right at the end of an edge."""
    return cross_of(edges.tangent[e], edges.tangent[edges.after[e]]) < wp.float64(0.0)


@wp.func
def offset_end(edges: InsetEdges, offset: int):
    """The parameter at which an offset ends; it starts at 0."""
    e = offset // 2
    out = edges.length[e]
    if offset % 2 != 0:
        tangent = edges.tangent[e]
        other = edges.tangent[edges.after[e]]
        out = diamond_angle(wp.dot(tangent, other), -cross_of(tangent, other))
    return out


@wp.func
def offset_point(edges: InsetEdges, offset: int, t: wp.float64):
    """The point of an offset at a parameter [m]."""
    e = offset // 2
    tangent = edges.tangent[e]
    normal = left_of(tangent)
    out = edges.origin[e] + edges.distance * normal + t * tangent
    if offset % 2 != 0:
        x = wp.float64(1.0) - t
        y = wp.min(t, wp.float64(2.0) - t)
        size = edges.distance / wp.sqrt(x * x + y * y)
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
def square_distance(edges: InsetEdges, j: int, x: wp.vec2d):
    """Square of a point's distance from an edge [m2]."""
    away = x - edges.origin[j]
    part = wp.clamp(wp.dot(away, edges.tangent[j]), wp.float64(0.0), edges.length[j])
    rest = away - part * edges.tangent[j]
    return wp.dot(rest, rest)


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


@wp.kernel
def _count_edges(r: Regions, filled: wp.array[wp.uint8], count: wp.array[wp.int64]):
    """Count the edges of each polyline of a region that is filled."""
    region = wp.tid()
    for entry in range(int(r.region_start[region]), int(r.region_start[region + 1])):
        line = r.region_line[entry]
        size = wp.max(r.polyline_start[line + 1] - r.polyline_start[line] - wp.int64(1), wp.int64(0))
        count[entry] = wp.where(filled[region] != wp.uint8(0), size, wp.int64(0))


@wp.kernel
def _write_edges(
    # In:
    r: Regions,
    filled: wp.array[wp.uint8],
    start: wp.array[wp.int64],
    failed: wp.array[wp.int32],  # is set to 1 where an edge of the region has no length
    # Out:
    edges: InsetEdges,
):
    """Write the edges of each region."""
    region = wp.tid()
    for entry in range(int(r.region_start[region]), int(r.region_start[region + 1])):
        base = r.polyline_start[r.region_line[entry]]
        first = int(start[entry])
        count = int(start[entry + 1]) - first
        for k in range(count):
            a = r.local[base + wp.int64(k)]
            b = r.local[base + wp.int64(k + 1)]
            tangent = wp.vec2d(b[0] - a[0], b[1] - a[1])
            length = wp.sqrt(tangent[0] * tangent[0] + tangent[1] * tangent[1])
            edges.origin[first + k] = wp.vec2d(a[0], a[1])
            edges.length[first + k] = length
            edges.tangent[first + k] = tangent / wp.max(length, wp.float64(1e-30))
            edges.before[first + k] = first + (k + count - 1) % count
            edges.after[first + k] = first + (k + 1) % count
            edges.region[first + k] = region
            if length <= wp.float64(1e-12):
                failed[region] = 1


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


@wp.func
def side_of(edges: InsetEdges, e: int, x: wp.vec2d):
    """Distance of a point to the left of an edge's line [m]."""
    return cross_of(edges.tangent[e], x - edges.origin[e])


@wp.kernel
def _find_crossed_regions(edges: InsetEdges, failed: wp.array[wp.int32]):
    """Find regions whose left side is not everywhere inside: the outline crosses itself or turns straight back."""
    e = wp.tid()
    region = edges.region[e]
    _first, stop = edges_of(edges, region)
    reach = reach_of(edges.origin[e], edges.origin[edges.after[e]], wp.float64(0.0))
    crossed = int(0)
    j = next_edge(edges, reach, e + 1, stop)
    while j < stop:
        a = side_of(edges, e, edges.origin[j]) * side_of(edges, e, edges.origin[edges.after[j]])
        b = side_of(edges, j, edges.origin[e]) * side_of(edges, j, edges.origin[edges.after[e]])
        if a < wp.float64(0.0) and b < wp.float64(0.0):  # they cross at an inner point of both
            crossed = int(1)
        j = next_edge(edges, reach, j + 1, stop)
    tangent = edges.tangent[e]
    other = edges.tangent[edges.after[e]]
    if wp.abs(cross_of(tangent, other)) < STRAIGHT_BACK and wp.dot(tangent, other) < wp.float64(0.0):
        crossed = int(1)
    if crossed != 0:
        failed[region] = 1


@on_one_device
def find_edges(regions: Regions, filled: wp.array, distance: float) -> tuple[InsetEdges, wp.array]:
    """Edges of the regions that are filled, and which regions have an outline that is no simple one, int32 [region].

    Arguments as for `draw_inset`.
    """
    device, region_count = regions.local.device, regions.region_start.shape[0] - 1
    failed = wp.zeros(region_count, dtype=wp.int32, device=device)
    (edges,), (edges.start,) = count_then_fill(
        _count_edges,
        _write_edges,
        region_count,
        [regions, filled],
        lambda total: [_room_for_edges(total, device)],
        rows=regions.region_line.shape[0],
        more=[failed],
    )
    edges.region_start = regions.region_start
    edges.distance, edges.radius = wp.float64(distance), wp.float64(distance - SLACK)
    launch(_find_boxes, edges.low.shape[0], [], [edges])
    launch(_find_crossed_regions, edges.origin.shape[0], [edges], [failed])
    return edges, failed


def _room_for_edges(count: int, device: wp.Device) -> InsetEdges:
    edges = InsetEdges()
    for name, dtype in (("origin", wp.vec2d), ("tangent", wp.vec2d), ("length", wp.float64)):
        setattr(edges, name, wp.empty(count, dtype=dtype, device=device))
    for name in ("before", "after", "region"):
        setattr(edges, name, wp.empty(count, dtype=wp.int32, device=device))
    edges.low, edges.high = (wp.empty(-(-count // int(BLOCK_EDGES)), dtype=wp.vec2d, device=device) for _ in range(2))
    return edges
