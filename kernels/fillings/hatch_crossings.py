"""Where parallel lines cross the closed polylines of regions in a plane, sorted along the lines.

Lines are *rows*: row k lies at k times the spacing from the plane's origin. A region has the rows that lie strictly
between its lowest and its highest point; if none does, it has one row through its middle. A vertex on a row counts as
below it, so a line crosses every closed polyline an even number of times.
"""

import math

import warp as wp

from ..offsets import BLOCK, PointLimitError, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT
from ..stages.cut import launch

wp.set_module_options(EXACT)


@wp.struct
class Outlines:
    """Regions in a plane whose first axis runs along the rows; a region's polylines are its *entries*."""

    points: wp.array[wp.vec2d]  # along and across the rows [m]
    level: wp.array[wp.int64]  # the first row at or above each point
    polyline_start: wp.array[wp.int64]
    region_start: wp.array[wp.int64]  # offsets into entries
    region_line: wp.array[wp.int32]  # polyline of each entry
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
def _turn_points(
    # In:
    points: wp.array[wp.vec3d],  # coordinates along u, v and n [m]
    cosine: wp.float64,
    sine: wp.float64,
    spacing: wp.float64,  # [m]
    # Out:
    turned: wp.array[wp.vec2d],  # along and across the rows [m]
    level: wp.array[wp.int64],
):
    """Turn each point so that rows run along the first axis, and find the first row that is not below it."""
    i = wp.tid()
    x = points[i][0]
    y = points[i][1]
    across = x * -sine + y * cosine
    turned[i] = wp.vec2d(x * cosine + y * sine, across)
    k = wp.int64(wp.ceil(across / spacing))
    if spacing * wp.float64(k - wp.int64(1)) >= across:  # the quotient is rounded
        k -= wp.int64(1)
    if spacing * wp.float64(k) < across:
        k += wp.int64(1)
    level[i] = k


@wp.kernel
def _find_rows(
    # In:
    o: Outlines,
    filled: wp.array[wp.uint8],  # 0: the region is left out
    # Out:
    first: wp.array[wp.int64],
    rows: wp.array[wp.int64],
    middle: wp.array[wp.float64],
    region_of: wp.array[wp.int32],
):
    """Find the rows of each region."""
    region = wp.tid()
    low = wp.float64(wp.inf)
    high = -low
    for entry in range(int(o.region_start[region]), int(o.region_start[region + 1])):
        region_of[entry] = region
        base = o.polyline_start[o.region_line[entry]]
        for k in range(int(o.polyline_start[o.region_line[entry] + 1] - base)):
            across = o.points[base + wp.int64(k)][1]
            low = wp.min(low, across)
            high = wp.max(high, across)
    first[region] = wp.int64(0)
    rows[region] = wp.int64(-1)
    middle[region] = wp.float64(0.5) * (low + high)
    if filled[region] != wp.uint8(0) and low <= high:
        first[region] = wp.int64(wp.floor(low / o.spacing)) + wp.int64(1)
        rows[region] = wp.max(wp.int64(wp.ceil(high / o.spacing)) - first[region], wp.int64(0))


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
def _count_crossings(
    # In:
    o: Outlines,
    # Out:
    count: wp.array[wp.int64],  # shape [entry + 1]
):
    """Count the crossings of each entry."""
    entry = wp.tid()
    region = o.region_of[entry]
    base = o.polyline_start[o.region_line[entry]]
    total = wp.int64(0)
    if o.rows[region] >= wp.int64(0):
        for k in range(int(o.polyline_start[o.region_line[entry] + 1] - base) - 1):
            i = base + wp.int64(k)
            total += wp.abs(level_of(o, region, i + wp.int64(1)) - level_of(o, region, i))
    count[entry] = total


@wp.kernel
def _find_crossings(
    # In:
    o: Outlines,
    # Out:
    c: RowCrossings,
):
    """Write the crossings of each entry, along its polyline."""
    entry = wp.tid()
    region = o.region_of[entry]
    begin = o.polyline_start[o.region_line[entry]]
    at = c.start[entry]
    i = begin
    while at < c.start[entry + 1]:
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
def _sort_crossings(
    # In:
    region_start: wp.array[wp.int64],
    # Out:
    c: RowCrossings,
):
    """Sort each region's crossings: heap sort, which is never quadratic."""
    region = wp.tid()
    base = c.start[region_start[region]]
    count = int(c.start[region_start[region + 1]] - base)
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


@on_one_device
def find_rows(
    points: wp.array,
    polyline_start: wp.array,
    region_start: wp.array,
    region_line: wp.array,
    filled: wp.array,
    *,
    spacing: float,
    angle: float,
) -> Outlines:
    """Regions as rows at an angle [rad] cross them; arguments as for `draw_hatch`."""
    device, o = points.device, Outlines()
    o.polyline_start, o.region_start, o.region_line, o.spacing = polyline_start, region_start, region_line, spacing
    o.points = wp.empty(points.shape[0], dtype=wp.vec2d, device=device)
    o.level = wp.empty(points.shape[0], dtype=wp.int64, device=device)
    turn = [wp.float64(math.cos(angle)), wp.float64(math.sin(angle)), wp.float64(spacing)]
    launch(_turn_points, points.shape[0], [points, *turn], [o.points, o.level])
    count = region_start.shape[0] - 1
    o.first, o.rows = (wp.empty(count, dtype=wp.int64, device=device) for _ in range(2))
    o.middle = wp.empty(count, dtype=wp.float64, device=device)
    o.region_of = wp.empty(region_line.shape[0], dtype=wp.int32, device=device)
    launch(_find_rows, count, [o, filled], [o.first, o.rows, o.middle, o.region_of])
    return o


def find_crossings(o: Outlines, point_limit: int | None = None) -> RowCrossings:
    """Sorted crossings of rows with outlines.

    Raises PointLimitError before memory is taken for more crossings than `point_limit`: most of them become points.
    """
    device, entry_count, c = o.points.device, o.region_line.shape[0], RowCrossings()
    c.start = wp.zeros(entry_count + 1, dtype=wp.int64, device=device)
    wp.launch(_count_crossings, entry_count, inputs=[o], outputs=[c.start], device=device, block_dim=BLOCK)
    c.start = offsets_of(c.start)
    total = last_of(c.start)
    if point_limit is not None and total > point_limit:
        raise PointLimitError(total, point_limit)
    for name in ("entry", "edge", "row", "order"):
        setattr(c, name, wp.empty(total, dtype=wp.int32, device=device))
    c.enters = wp.empty(total, dtype=wp.int8, device=device)
    c.x = wp.empty(total, dtype=wp.float64, device=device)
    wp.launch(_find_crossings, entry_count, inputs=[o], outputs=[c], device=device, block_dim=BLOCK)
    launch(_sort_crossings, o.region_start.shape[0] - 1, [o.region_start], [c])
    return c
