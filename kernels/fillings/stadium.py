"""Where offsets are nearer to an edge than the distance.

That is in the edge's *stadium*: a rectangle along the edge, and a disc around each of its ends. A moved edge is in a
stadium for one interval of its parameter, since a stadium is convex; an arc crosses its boundary at some parameters.
"""

import warp as wp

from .inset_edges import InsetEdges, cross_of, diamond_angle, left_of, offset_end, side_of, square_distance

TOUCH = wp.constant(wp.float64(1e-9))  # [m]; crossings this far beyond a rectangle's end are crossings, too


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
    radius = edges.radius
    length = edges.length[j]
    end = edges.length[e]
    out = wp.vec2d(wp.float64(wp.inf), -wp.float64(wp.inf))
    away = edges.origin[e] + edges.distance * left_of(edges.way[e]) - edges.origin[j]
    x = wp.dot(away, edges.way[j])
    ux = wp.dot(edges.way[e], edges.way[j])
    if (x > -radius or x + end * ux > -radius) and (x < length + radius or x + end * ux < length + radius):
        y = cross_of(edges.way[j], away)
        uy = cross_of(edges.way[j], edges.way[e])
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
def put_sorted(bounds: wp.array[wp.float64], base: wp.int64, count: int, value: wp.float64):
    """Insert a value into sorted ones."""
    k = count
    while k > 0 and bounds[base + wp.int64(wp.max(k - 1, 0))] > value:
        bounds[base + wp.int64(k)] = bounds[base + wp.int64(k - 1)]
        k -= 1
    bounds[base + wp.int64(k)] = value


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

    direction: along the normal and the way of the arc's edge, a unit vector. cap: -1 or 1: the boundary is that of the
    disc at the start or end of edge j, 0: a side of the rectangle. bounds: empty, count only. Returns the new count.
    """
    out = count
    t = diamond_angle(direction[0], direction[1])
    if t > wp.float64(0.0) and t < offset_end(edges, offset):
        way = edges.way[offset // 2]
        x = edges.origin[edges.after[offset // 2]] - edges.origin[j]
        x = x + edges.distance * (direction[0] * left_of(way) + direction[1] * way)
        along = wp.dot(x, edges.way[j])
        there = along >= -TOUCH and along <= edges.length[j] + TOUCH
        if cap < 0:
            there = along <= TOUCH
        elif cap > 0:
            there = along >= edges.length[j] - TOUCH
        if there:
            if bounds.shape[0] > 0:
                put_sorted(bounds, base, count, t)
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
    edges: InsetEdges,
    offset: int,
    j: int,
    cap: int,
    bounds: wp.array[wp.float64],
    base: wp.int64,
    count: int,
):
    """Keep where an arc crosses the circle around the start, cap -1, or end, cap 1, of an edge; the new count."""
    out = count
    d = edges.distance
    way = edges.way[offset // 2]
    away = edges.origin[j] - edges.origin[edges.after[offset // 2]]
    if cap > 0:
        away = edges.origin[edges.after[j]] - edges.origin[edges.after[offset // 2]]
    size = wp.length(away)
    if size > wp.float64(0.0):
        axis = wp.vec2d(wp.dot(away, left_of(way)) / size, wp.dot(away, way) / size)
        cosine = (d * d + size * size - edges.radius * edges.radius) / (wp.float64(2.0) * d * size)
        out = put_pair(edges, offset, j, axis, cosine, cap, bounds, base, out)
    return out


@wp.func
def put_arc_crossings(edges: InsetEdges, offset: int, j: int, bounds: wp.array[wp.float64], base: wp.int64, count: int):
    """Keep where an arc crosses the boundary of an edge's stadium; the new count of crossings."""
    out = count
    d = edges.distance
    way = edges.way[offset // 2]
    middle = edges.origin[edges.after[offset // 2]]
    if square_distance(edges, j, middle) < wp.float64(4.0) * d * d:
        out = put_cap_crossings(edges, offset, j, int(-1), bounds, base, out)
        out = put_cap_crossings(edges, offset, j, int(1), bounds, base, out)
        across = left_of(edges.way[j])
        axis = wp.vec2d(wp.dot(across, left_of(way)), wp.dot(across, way))
        height = side_of(edges, j, middle)
        out = put_pair(edges, offset, j, axis, (edges.radius - height) / d, int(0), bounds, base, out)
        out = put_pair(edges, offset, j, axis, (-edges.radius - height) / d, int(0), bounds, base, out)
    return out
