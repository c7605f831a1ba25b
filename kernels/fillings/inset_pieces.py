"""The pieces of offsets that are at least the distance away from every edge of their region.

A piece of a moved edge lies between the intervals in which the edge is in a stadium (`stadium`). An arc is divided
where it crosses the boundary of any stadium, and the middle of each part decides whether that belongs to a piece.
"""

import warp as wp

from ..offsets import BLOCK, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT
from .inset_edges import InsetEdges, edges_of, has_arc, next_edge, offset_end, offset_point, reach_of, square_distance
from .stadium import put_arc_crossings, stadium_interval

wp.set_module_options(EXACT)

DOUBTFUL = wp.constant(wp.float64(1e-8))  # [m]; of two pieces that run to and fro, this near is no way between them
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
def is_too_near(edges: InsetEdges, offset: int, x: wp.vec2d):
    """Whether a point of an arc is in the stadium of an edge other than the two that meet in its middle."""
    e = offset // 2
    first, stop = edges_of(edges, edges.region[e])
    reach = reach_of(x, x, edges.distance)
    out = int(0)
    j = next_edge(edges, reach, first, stop)
    while j < stop and out == 0:
        if j != e and j != edges.after[e] and square_distance(edges, j, x) < edges.radius * edges.radius:
            out = int(1)
        j = next_edge(edges, reach, j + 1, stop)
    return out != 0


@wp.func
def reach_of_offset(edges: InsetEdges, offset: int):
    """A box that meets every edge whose stadium an offset can meet."""
    a = offset_point(edges, offset, wp.float64(0.0))
    b = offset_point(edges, offset, offset_end(edges, offset))
    away = edges.distance
    if offset % 2 != 0:
        away += wp.float64(0.5) * wp.length(b - a)  # an arc of half a turn or less is no farther from its chord
    return reach_of(a, b, away)


@wp.kernel
def _count_bounds(
    # In:
    edges: InsetEdges,
    failed: wp.array[wp.int32],
    none: wp.array[wp.float64],  # empty
    # Out:
    count: wp.array[wp.int64],  # shape [offset + 1]: numbers that an offset's pieces need at most; 0: it has none
):
    """Count the crossings of each offset with stadiums."""
    offset = wp.tid()
    e = offset // 2
    if failed[edges.region[e]] != 0 or (offset % 2 != 0 and not has_arc(edges, e)):
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
            total = put_arc_crossings(edges, offset, j, none, wp.int64(0), total)
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
        size = size * edges.distance  # an arc is longer than this
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


@wp.kernel
def _keep_pieces(
    # In:
    edges: InsetEdges,
    place: wp.array[wp.int64],  # offsets of each offset's bounds
    # Out:
    bounds: wp.array[wp.float64],  # begin and end of each piece, first in the places of its offset
    count: wp.array[wp.int64],  # pieces, shape [offset + 1]
):
    """Find the pieces of each offset."""
    offset = wp.tid()
    if place[offset + 1] > place[offset]:
        pieces = int(0)
        if offset % 2 == 0:
            pieces = keep_outside(edges, offset // 2, bounds, place[offset])
        else:
            pieces = keep_far(edges, offset, bounds, place[offset])
        count[offset] = wp.int64(pieces)


@wp.kernel
def _gather_pieces(
    # In:
    edges: InsetEdges,
    place: wp.array[wp.int64],
    bounds: wp.array[wp.float64],
    # Out:
    pieces: OffsetPieces,
):
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
def _find_doubtful_regions(
    # In:
    edges: InsetEdges,
    pieces: OffsetPieces,
    # Out:
    failed: wp.array[wp.int32],  # 1: a piece lies on one that runs the other way
):
    """Find regions a part of which is twice the distance wide: what is left there is no area, or it is rounding."""
    i = wp.tid()
    offset = pieces.offset[i]
    e = offset // 2
    if offset % 2 == 0:
        first, stop = edges_of(edges, edges.region[e])
        x = offset_point(edges, offset, wp.float64(0.5) * (pieces.begin[i] + pieces.end[i]))
        most = edges.distance + DOUBTFUL
        reach = reach_of(x, x, most)
        j = next_edge(edges, reach, first, stop)
        while j < stop:
            if wp.dot(edges.way[e], edges.way[j]) < OPPOSITE and square_distance(edges, j, x) < most * most:
                failed[edges.region[e]] = 1
            j = next_edge(edges, reach, j + 1, stop)


@on_one_device
def find_pieces(edges: InsetEdges, failed: wp.array) -> OffsetPieces:
    """Pieces of the offsets of all regions that have not failed; those of which a piece is in doubt fail, too."""
    device, offset_count, pieces = edges.origin.device, 2 * edges.origin.shape[0], OffsetPieces()
    options = {"device": device, "block_dim": BLOCK}
    count = wp.zeros(offset_count + 1, dtype=wp.int64, device=device)
    none = wp.empty(0, dtype=wp.float64, device=device)
    wp.launch(_count_bounds, offset_count, inputs=[edges, failed, none], outputs=[count], **options)
    place = offsets_of(count)
    bounds = wp.empty(last_of(place), dtype=wp.float64, device=device)
    count.zero_()
    wp.launch(_keep_pieces, offset_count, inputs=[edges, place], outputs=[bounds, count], **options)
    pieces.start = offsets_of(count)
    total = last_of(pieces.start)
    pieces.offset = wp.empty(total, dtype=wp.int32, device=device)
    pieces.begin, pieces.end = (wp.empty(total, dtype=wp.float64, device=device) for _ in range(2))
    pieces.first, pieces.last = (wp.empty(total, dtype=wp.vec2d, device=device) for _ in range(2))
    wp.launch(_gather_pieces, offset_count, inputs=[edges, place, bounds], outputs=[pieces], **options)
    wp.launch(_find_doubtful_regions, total, inputs=[edges, pieces], outputs=[failed], **options)
    return pieces
