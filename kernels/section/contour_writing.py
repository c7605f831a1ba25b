"""Writing contours: walks the ordered pieces a second time and writes points in the array's frame.

Pieces with listed crossings are not walked: one thread a section writes what is few, and lanes the crossings' points.
"""

from functools import partial
from typing import Any

import warp as wp

from ..contours import Contours
from ..lanes import lane_count
from ..offsets import BLOCK
from ..patch import EXACT, Patch, half_extents, output_point, section_frame
from ..warps import threads_for
from .half_edges import Surface
from .joining import COUNT, SLOT, Entries, Joined
from .listed_drawing import LANE_WORDS, _draw_listed_sections
from .piece_walker import PolylineWriter, draw_section, draw_section_ends
from .pieces import ContourPieces, section_of, start_of
from .triangle_walk import crossing_at, point_of

wp.set_module_options(EXACT)


GROUPS_MOST = 2**24  # of lanes that draw; 64 times as many threads have numbers in 31 bits


@wp.func
def write_section(
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    query: int,
    bounded: int,
    closes: int,
    section_start: wp.array[wp.int64],
    point_start: wp.array[wp.int64],
    lines: Contours,
):
    """Write a query's polylines by walking its pieces."""
    section = section_of(pieces, query)
    own = section % patch.shape[0]
    writer = PolylineWriter()
    writer.i = point_start[section]
    writer.line = section_start[section]
    writer.patch = own
    f = section_frame(pose, patch, section)
    writer = draw_section(surface, f, half_extents(patch[own], bounded), pieces, entries, query, closes, lines, writer)
    if section == section_start.shape[0] - 2:
        lines.polyline_start[section_start[section + 1]] = point_start[section + 1]


@wp.kernel
def _draw_contours(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    lines: Contours,
):
    """Write each query's polylines."""
    write_section(surface, pose, patch, pieces, entries, wp.tid(), bounded, closes, section_start, point_start, lines)


@wp.kernel
def _draw_rest(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    bounded: int,
    closes: int,
    section_start: wp.array[wp.int64],
    point_start: wp.array[wp.int64],
    rest: wp.array[wp.int32],  # queries that `_draw_listed_sections` leaves out
    rest_count: wp.array[wp.int32],
    # Out:
    lines: Contours,
):
    """Write the polylines of the queries that are left."""
    if wp.tid() < rest_count[0]:
        query = rest[wp.tid()]
        write_section(surface, pose, patch, pieces, entries, query, bounded, closes, section_start, point_start, lines)


@wp.kernel
def _draw_ends(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    bounded: int,
    closes: int,
    section_start: wp.array[wp.int64],
    point_start: wp.array[wp.int64],
    # Out:
    lines: Contours,
):
    """Write each query's polylines but for the points of listed crossings; their places into `ContourPieces.place`."""
    query = wp.tid()
    section = section_of(pieces, query)
    own = section % patch.shape[0]
    writer = PolylineWriter()
    writer.i = point_start[section]
    writer.line = section_start[section]
    writer.patch = own
    f = section_frame(pose, patch, section)
    writer = draw_section_ends(
        surface, f, half_extents(patch[own], bounded), pieces, entries, query, closes, lines, writer
    )
    if section == section_start.shape[0] - 2:
        lines.polyline_start[section_start[section + 1]] = point_start[section + 1]


@wp.kernel(launch_bounds=(BLOCK, 12))
def _draw_listed(
    # In:
    surface: Surface,
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    bounded: int,
    lanes: int,  # of a group
    groups: int,
    # Out:
    points: wp.array[wp.vec3],
):
    """Write the points of the listed crossings of each query's polylines."""
    query = wp.tid() // lanes
    lane = wp.tid() - query * lanes
    while query < entries.count.shape[0]:
        count = entries.count[query] & COUNT
        if count > 0:
            f = pieces.frame[query]
            side = half_extents(patch[section_of(pieces, query) % patch.shape[0]], bounded)
            base = start_of(pieces, query)
            query_start = pieces.query_start[query]
            for e in range(count):
                slot = base + wp.int64(entries.entry[base + wp.int64(e) * pieces.stride] & SLOT) * pieces.stride
                begin = query_start + wp.int64(pieces.begin[slot])
                place = pieces.place[slot]
                steps = pieces.steps[slot] // 2
                k = int(lane)
                while k < steps:
                    half = pieces.listed[begin + wp.int64(k)]
                    x = output_point(f, point_of(f, crossing_at(surface, f, half), side))
                    points[place + wp.int64(k)] = x
                    k += lanes
        query += groups


def draw_contours(
    surface: Any, pose: wp.array, patch: wp.array, joined: Joined, *, bounded: bool, closes: bool
) -> Contours:
    """Write the polylines that `join_pieces` ordered and counted; arguments as for it and `find_pieces`.

    Sections, pose * patches + patch, stand for the poses of the contours.
    """
    device = pose.device
    lines = room_for_contours(joined.section_start, joined.polyline_count, joined.point_count)
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    for pieces, entries in joined.blocks:
        if pieces.lists.words > 0:
            draw_listed_sections(surface, pose, patch, pieces, entries, joined, lines, bounded=bounded, closes=closes)
            continue
        query_count, drawn = pieces.count.shape[0], [patch, pieces, entries, int(bounded)]
        inputs = [surface, pose, *drawn, int(closes), joined.section_start, joined.point_start]
        launch(_draw_contours if pieces.listed is None else _draw_ends, query_count, inputs=inputs, outputs=[lines])
        if pieces.listed is not None:
            lanes, groups = lane_count(device), min(query_count, GROUPS_MOST)
            launch(_draw_listed, groups * lanes, inputs=[surface, *drawn, lanes, groups], outputs=[lines.points])
    return lines


def draw_listed_sections(
    surface: Any,
    pose: wp.array,
    patch: wp.array,
    pieces: Any,
    entries: Any,
    joined: Joined,
    lines: Any,
    *,
    bounded: bool,
    closes: bool,
) -> None:
    """Write queries from listed steps, and those by walking for which that is not enough."""
    device, query_count = pose.device, pieces.count.shape[0]
    rest = [wp.empty(query_count, dtype=wp.int32, device=device), wp.zeros(1, dtype=wp.int32, device=device)]
    inputs = [surface, pose, patch, pieces, entries, int(bounded), int(closes)]
    inputs += [joined.section_start, joined.point_start]
    own = wp.empty(LANE_WORDS, dtype=wp.int64, device=device)
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    launch(_draw_listed_sections, threads_for(device, query_count), inputs=inputs, outputs=[own, lines, *rest])
    launch(_draw_rest, query_count, inputs=[*inputs, *rest], outputs=[lines])


def room_for_contours(section_start: wp.array, polyline_count: int, point_count: int) -> Contours:
    """Allocate contours that have these polylines in each section."""
    device, out = section_start.device, Contours()
    starts = wp.empty if section_start.shape[0] > 1 else wp.zeros  # the last section writes the last start
    out.points = wp.empty(point_count, dtype=wp.vec3, device=device)
    out.kind = wp.zeros(point_count, dtype=wp.uint8, device=device)
    out.polyline_start = starts(polyline_count + 1, dtype=wp.int64, device=device)
    out.polyline_patch = wp.empty(polyline_count, dtype=wp.int32, device=device)
    out.polyline_closed = wp.empty(polyline_count, dtype=wp.uint8, device=device)
    out.pose_start = section_start
    return out
