"""Insets: what of a region in a plane is at least a distance away from its outlines, as loops around it.

The loops are made of the pieces of offsets (`inset_pieces`). A piece goes on with the next offset of its polyline where
neither is cut, or both are at one point; else with the piece that begins nearest to its end, if that is mutual.

A region's pieces do not all go on so where outlines cross, since what is left of them is not inside, or where a part of
the region is exactly twice the distance wide. Such a region is tried again ATTEMPTS - 1 times: with the pieces that
are inside only, and ASIDE farther in each time, which no part is twice as wide as.
"""

import numpy as np
import warp as wp

from ..offsets import launch, scan_counts
from ..one_device import on_one_device
from ..patch import EXACT
from ..stages.regions import FlatLines, Regions, room_for_lines
from .inset_pieces import (
    InsetEdges,
    OffsetPieces,
    cross_of,
    edges_of,
    find_edges,
    find_pieces,
    has_arc,
    left_of,
    offset_end,
    winding_of,
)

wp.set_module_options(EXACT)

JOINED = wp.constant(wp.float64(2e-5))  # [m]; ends of pieces this near may be one: two offsets that touch are cut apart
SAME = wp.constant(wp.float64(1e-6))  # [m]; ends of neighbours that cut each other this near are one
THINNEST = wp.constant(wp.float64(1e-7))  # [m]; a loop that is thinner is rounding
ASIDE = wp.constant(wp.float64(1e-7))  # [m]; nobody feels it, and rounding is a thousandth of it
ATTEMPTS = 4
ROUND = 64  # segments of a full turn around a corner


@wp.struct
class PieceLinks:
    """For each piece the one that goes on at its end, and the one that leads to it; -1: not known."""

    after: wp.array[wp.int32]
    before: wp.array[wp.int32]


@wp.struct
class ArcSteps:
    """Corners of an arc's polygon, from its start on."""

    parameter: wp.array[wp.float64]
    direction: wp.array[wp.vec2d]  # along the normal and the tangent of the arc's edge


@wp.struct
class InsetLoop:
    """A loop and the point at which it starts."""

    piece: wp.int32  # the piece on which it starts
    step: wp.int32  # the corner of that piece's arc at which it starts, -1: where the piece begins
    count: wp.int64  # its points
    area: wp.float64  # [m2]
    length: wp.float64  # [m]
    start: wp.vec2d  # [m]


@wp.kernel
def _link_neighbours(edges: InsetEdges, pieces: OffsetPieces, links: PieceLinks):
    """Link the last piece of each offset to the first of the next one, if neither is cut or both are at one point."""
    i = wp.tid()
    offset = pieces.offset[i]
    following = 2 * edges.after[offset // 2]
    if offset % 2 == 0 and has_arc(edges, offset // 2):
        following = offset + 1
    k = int(pieces.start[following])
    if wp.int64(i + 1) == pieces.start[offset + 1] and wp.int64(k) < pieces.start[following + 1]:
        uncut = pieces.end[i] == offset_end(edges, offset) and pieces.begin[k] == wp.float64(0.0)
        if wp.length(pieces.first[k] - pieces.last[i]) < wp.where(uncut, JOINED, SAME):
            links.after[i] = k
            links.before[k] = i


@wp.kernel
def _link_nearest(edges: InsetEdges, pieces: OffsetPieces, neighbours: PieceLinks, links: PieceLinks):
    """Link the ends that are left to the nearest begin of a piece that is left, and the begins to the nearest end."""
    i = wp.tid()
    begin, end = edges_of(edges, edges.region[pieces.offset[i] // 2])
    after = neighbours.after[i]
    before = neighbours.before[i]
    links.after[i] = after
    links.before[i] = before
    if after >= 0 and before >= 0:
        return
    least_first = JOINED
    least_last = JOINED
    for k in range(int(pieces.start[2 * begin]), int(pieces.start[2 * end])):
        if after < 0 and neighbours.before[k] < 0:
            gap = wp.length(pieces.first[k] - pieces.last[i])
            if gap < least_last:
                least_last = gap
                links.after[i] = k
        if before < 0 and neighbours.after[k] < 0:
            gap = wp.length(pieces.last[k] - pieces.first[i])
            if gap < least_first:
                least_first = gap
                links.before[i] = k


@wp.func
def next_corner(pieces: OffsetPieces, links: PieceLinks, steps: ArcSteps, i: int, step: int):
    """The piece and the corner of its arc that follow on a loop; corner -1 is where the piece begins."""
    size = steps.parameter.shape[0]
    k = step + 1
    if pieces.offset[i] % 2 == 0:
        k = size
    elif step < 0:
        while k < size and steps.parameter[k] <= pieces.begin[i]:
            k += 1
    piece = links.after[i]
    corner = int(-1)
    if k < size and steps.parameter[k] < pieces.end[i]:
        piece = i
        corner = k
    return piece, corner


@wp.func
def corner_point(edges: InsetEdges, pieces: OffsetPieces, steps: ArcSteps, i: int, step: int):
    """The point of a corner [m]."""
    out = pieces.first[i]
    if step >= 0:
        e = pieces.offset[i] // 2
        tangent = edges.tangent[e]
        direction = steps.direction[step]
        distance = edges.distance[edges.region[e]]
        out = edges.origin[edges.after[e]] + distance * (direction[0] * left_of(tangent) + direction[1] * tangent)
    return out


@wp.func
def measure_loop(
    edges: InsetEdges,
    pieces: OffsetPieces,
    links: PieceLinks,
    steps: ArcSteps,
    begin: int,
    origin: wp.vec2d,
    visited: wp.array[wp.uint8],
):
    """The loop that a piece is on, starting at its point that is nearest to an origin."""
    loop = InsetLoop()
    base = pieces.first[begin]
    before = base
    nearest = wp.float64(wp.inf)
    i = begin
    step = int(-1)
    while i != begin or step >= 0 or loop.count == wp.int64(0):
        visited[i] = wp.uint8(1)
        x = corner_point(edges, pieces, steps, i, step)
        loop.count += wp.int64(1)
        loop.area += wp.float64(0.5) * cross_of(before - base, x - base)
        loop.length += wp.length(x - before)
        if wp.length(x - origin) < nearest:
            nearest = wp.length(x - origin)
            loop.piece = i
            loop.step = step
            loop.start = x
        before = x
        following, corner = next_corner(pieces, links, steps, i, step)
        i = following
        step = corner
    loop.length += wp.length(base - before)
    return loop


@wp.func
def is_linked(links: PieceLinks, first: int, stop: int):
    """Whether each of some pieces goes on with one that it leads to."""
    out = int(1)
    for i in range(first, stop):
        after = links.after[i]
        if after < 0 or links.before[i] < 0:
            out = int(0)
        elif links.before[after] != i:
            out = int(0)
    return out != 0


@wp.func
def comes_first(a: InsetLoop, b: InsetLoop):
    """Whether a loop comes before another one: by area, the largest first, then by its start."""
    out = a.start[1] < b.start[1]
    if a.area != b.area:
        out = a.area > b.area
    elif a.start[0] != b.start[0]:
        out = a.start[0] < b.start[0]
    return out


@wp.kernel
def _find_loops(
    # In:
    edges: InsetEdges,
    pieces: OffsetPieces,
    links: PieceLinks,
    steps: ArcSteps,
    visited: wp.array[wp.uint8],  # scratch, by piece, 0
    # Out:
    failed: wp.array[wp.int32],
    loops: wp.array[InsetLoop],  # a region's are first in the places of its pieces
    point_count: wp.array[wp.int64],  # of each loop, 0, shape [piece + 1]
    used: wp.array[wp.int64],  # 1: there is a loop in that place, 0, shape [piece + 1]
):
    """Find the loops of each region, sorted."""
    region = wp.tid()
    begin, end = edges_of(edges, region)
    first = int(pieces.start[2 * begin])
    stop = int(pieces.start[2 * end])
    if failed[region] != 0 or first == stop:
        return
    if not is_linked(links, first, stop):
        failed[region] = 1
        return
    count = int(0)
    for i in range(first, stop):
        if visited[i] == wp.uint8(0):
            loop = measure_loop(edges, pieces, links, steps, i, edges.origin[begin], visited)
            if wp.float64(2.0) * wp.abs(loop.area) > THINNEST * loop.length:
                if winding_of(edges, region, loop.start) > 0:
                    at = int(first + count)
                    while at > first and comes_first(loop, loops[wp.max(at - 1, 0)]):
                        loops[at] = loops[at - 1]
                        at -= 1
                    loops[at] = loop
                    count += 1
    for k in range(first, first + count):
        point_count[k] = loops[k].count
        used[k] = wp.int64(1)


@wp.kernel
def _draw_loops(
    # In:
    edges: InsetEdges,
    pieces: OffsetPieces,
    links: PieceLinks,
    steps: ArcSteps,
    loops: wp.array[InsetLoop],
    point_place: wp.array[wp.int64],  # offsets of each loop's points
    line_place: wp.array[wp.int64],  # loops before each
    # Out:
    points: wp.array[wp.vec2d],  # [m]
    line_start: wp.array[wp.int64],
    line_region: wp.array[wp.int32],
):
    """Write the points of each loop."""
    k = wp.tid()
    if line_place[k + 1] == line_place[k]:
        return
    line_start[line_place[k]] = point_place[k]
    line_region[line_place[k]] = edges.region[pieces.offset[k] // 2]
    i = loops[k].piece
    step = loops[k].step
    for at in range(int(point_place[k + 1] - point_place[k])):
        points[point_place[k] + wp.int64(at)] = corner_point(edges, pieces, steps, i, step)
        following, corner = next_corner(pieces, links, steps, i, step)
        i = following
        step = corner


def arc_steps(device: str) -> ArcSteps:
    """Corners of an arc of half a turn after its start, at every 64th part of a turn."""
    angle = 2.0 * np.pi * np.arange(1, ROUND // 2) / ROUND
    x, y = np.cos(angle), np.sin(angle)
    steps, size = ArcSteps(), np.abs(x) + y
    steps.parameter = wp.array(np.where(x < 0, 2.0 - y / size, y / size), dtype=wp.float64, device=device)
    steps.direction = wp.array(np.stack([x, y], axis=1), dtype=wp.vec2d, device=device)
    return steps


@on_one_device
def link_pieces(edges: InsetEdges, pieces: OffsetPieces) -> PieceLinks:
    """How pieces go on."""
    device, count = edges.origin.device, pieces.offset.shape[0]
    neighbours, links = PieceLinks(), PieceLinks()
    for name in ("after", "before"):
        setattr(neighbours, name, wp.full(count, -1, dtype=wp.int32, device=device))
        setattr(links, name, wp.empty(count, dtype=wp.int32, device=device))
    launch(_link_neighbours, count, [edges, pieces], [neighbours])
    launch(_link_nearest, count, [edges, pieces, neighbours], [links])
    return links


@wp.kernel
def _step_aside(failed: wp.array[wp.int32], edges: InsetEdges):
    """Move the offsets of regions that have failed a little farther in, and keep only those that lie inside."""
    region = wp.tid()
    if failed[region] != 0:
        edges.distance[region] = edges.distance[region] + ASIDE
        edges.filters[region] = 1


@on_one_device
def draw_inset(
    regions: Regions, filled: wp.array, *, distance: float, point_limit: int | None = None
) -> tuple[FlatLines, wp.array]:
    """Loops around what is at least `distance` [m] inside regions, counter-clockwise around it, clockwise around holes.

    Other arguments as for `draw_hatch`. Of a region, outer loops come first, the largest first. A loop starts near the
    region's first point. Corners of the outline that point inwards are rounded, by 64 segments a turn.
    Returns also which regions have no loops because all ATTEMPTS failed, 1, int32, shape [region].
    Raises PointLimitError before memory is allocated for more points than `point_limit`.
    """
    edges = find_edges(regions, filled, distance)
    out, failed = _draw_loops_of(edges, point_limit)
    for _attempt in range(1, ATTEMPTS):
        if not failed.numpy().any():
            break
        # The loops of the other regions come out the same, and all stay in order.
        launch(_step_aside, failed.shape[0], [failed], [edges])
        out, failed = _draw_loops_of(edges, point_limit)
    return out, failed


def _draw_loops_of(edges: InsetEdges, point_limit: int | None) -> tuple[FlatLines, wp.array]:
    """Loops at the distances of `edges`, and which regions failed."""
    pieces, failed = find_pieces(edges)
    device, count = failed.device, pieces.offset.shape[0]
    found = [edges, pieces, link_pieces(edges, pieces), arc_steps(device)]
    loops = wp.empty(count, dtype=InsetLoop, device=device)
    counts = [wp.zeros(count + 1, dtype=wp.int64, device=device) for _ in range(2)]
    visited = wp.zeros(count, dtype=wp.uint8, device=device)
    launch(_find_loops, failed.shape[0], [*found, visited], [failed, loops, *counts])
    starts, totals = scan_counts(*counts, limit=point_limit)
    out = room_for_lines(*totals, device)
    launch(_draw_loops, count, [*found, loops, *starts], out)
    return out, failed
