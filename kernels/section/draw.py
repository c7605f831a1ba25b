"""Writing contours: the ordered pieces of each section as polylines, with points in the array's frame.

| pieces | how they are drawn |
|---|---|
| of tree searches, and all on CPUs | one thread a section walks from crossing to crossing |
| with `ContourPieces.lists` (scan searches on GPUs) | the lanes of a warp share out the points of the warp's queries |
| with `ContourPieces.listed` (flat searches) | a thread a section writes ends of pieces, lanes the listed crossings |

The functions take flags (`draws`, `begins`, ...) instead of being called in a branch: around a branch, Warp on a CPU
would select whole structs through memory.

*Drawing from `lists`.* If none of its steps at the patch's sides has zero length, a piece has these points: where it
enters; the crossings at which its listed steps begin; its last crossing; where it leaves. Queries for which that is not
so are noted, and drawn by walking.
"""

from functools import partial
from typing import Any

import warp as wp

from ..contours import Contours
from ..offsets import BLOCK
from ..patch import EXACT, Frame, Patch, corner, half_extents, outcode, output_point, section_frame
from .clip import NONE, corners_left, segment_of, side_point
from .half_edges import OPEN, Surface
from .join import (
    BEGIN,
    PLANE_WORDS,
    WALKED,
    Entries,
    Joined,
    SectionPlane,
    begins_line,
    entry_corners,
    entry_count,
    entry_slot,
    has_boundary,
    is_through,
    keep_plane,
    piece_end,
    plane_memory,
    plane_of,
    slot_int,
)
from .lanes import (
    bits_to,
    int_at,
    is_bit,
    lane_count,
    lane_of_warp,
    mark_bit,
    memory_of_warp,
    set_int,
    set_long,
    sums_of_warp,
    sync_warp,
    threads_for,
    warp_size,
)
from .pieces import CLOSED, SLOTS, ContourPieces, end_side, enter_side, leave_side, listed_step, section_of, start_of
from .walk import crossing_after, crossing_at, point_of

wp.set_module_options(EXACT)

OBJECT = 0
HAND = 1
MADE = 2


@wp.struct
class PolylineWriter:
    """State of writing: the last point is held back until the next point differs from it."""

    i: wp.int64  # index of the held point
    line: wp.int64  # index of the next polyline
    patch: int
    x: wp.vec3  # the held point
    kind: int  # of the segment that starts there
    first: wp.vec3  # first point of the polyline


@wp.func
def write_to(lines: Contours, writer: PolylineWriter, y: wp.vec3, draws: bool):
    """Hold point y if `draws`; first write the held point if it differs from y."""
    out = writer
    if draws and not (writer.x == y):
        lines.points[writer.i] = writer.x
        if writer.kind != OBJECT:
            lines.kind[writer.i] = wp.uint8(writer.kind)
        out.i = writer.i + wp.int64(1)
    if draws:
        out.x = y
        out.kind = OBJECT
    return out


@wp.func
def begin_line(lines: Contours, writer: PolylineWriter, begins: bool, closed: bool):
    """Write the header of a polyline if one begins here."""
    out = writer
    if begins:
        lines.polyline_start[writer.line] = writer.i
        lines.polyline_patch[writer.line] = writer.patch
        lines.polyline_closed[writer.line] = wp.uint8(closed)
        out.line = writer.line + wp.int64(1)
    return out


@wp.func
def end_line(lines: Contours, writer: PolylineWriter, ends: bool):
    """Write the held point if the polyline ends here; it repeats the kind of the point before."""
    out = writer
    if ends:
        lines.points[writer.i] = writer.x
        lines.kind[writer.i] = lines.kind[writer.i - wp.int64(1)]
        out.i = writer.i + wp.int64(1)
    return out


@wp.func
def draw_boundary(lines: Contours, writer: PolylineWriter, f: Frame, half: wp.vec2d, draws: bool):
    """Write the patch's whole boundary as a closed polyline of five points, if `draws`."""
    out = begin_line(lines, writer, draws, True)
    if draws:
        for k in range(5):
            lines.points[out.i] = output_point(f, corner(k % 4, half))
            lines.kind[out.i] = wp.uint8(HAND)
            out.i = out.i + wp.int64(1)
    return out


@wp.func
def draw_piece(
    surface: Surface,
    f: Frame,
    side: wp.vec2d,
    pieces: ContourPieces,
    slot: wp.int64,
    lines: Contours,
    writer: PolylineWriter,
    starts: bool,
):
    """Walk a piece from its first point (on a side or inside) to its last; `starts`: a polyline begins with it."""
    half = pieces.half[slot]
    c = crossing_at(surface, f, half)
    n = crossing_after(surface, f, c)
    p = point_of(f, c, side)
    q = point_of(f, n, side)
    code_p = outcode(p, side)
    code_q = outcode(q, side)
    x = output_point(f, p)
    if code_p != 0:
        x = output_point(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).enter, p, q, side))
    out = write_to(lines, writer, x, not starts)
    if starts:
        out.first = x
    out.x = x
    out.kind = OBJECT
    while code_q == 0 and n.half != OPEN and n.half != half:
        out = write_to(lines, out, output_point(f, q), True)
        p = q
        code_p = code_q
        n = crossing_after(surface, f, n)
        q = point_of(f, n, side)
        code_q = outcode(q, side)
    x = output_point(f, q)
    if code_q != 0:
        x = output_point(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).leave, p, q, side))
    return write_to(lines, out, x, True)


@wp.func
def draw_piece_ends(
    surface: Surface,
    f: Frame,
    side: wp.vec2d,
    pieces: ContourPieces,
    slot: wp.int64,
    lines: Contours,
    writer: PolylineWriter,
    starts: bool,
):
    """Write a piece's first and last points; leave the place of its listed crossings in `ContourPieces.place`.

    A piece's points: where it enters (unless it starts inside); one for each listed crossing; and the last point inside
    or where it leaves, which the writer holds at the end.
    """
    half = pieces.half[slot]
    c = crossing_at(surface, f, half)
    p = point_of(f, c, side)
    code_p = outcode(p, side)
    x = output_point(f, p)
    q = point_of(f, crossing_after(surface, f, c), side)
    code_q = outcode(q, side)
    if code_p != 0:
        x = output_point(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).enter, p, q, side))
    out = write_to(lines, writer, x, not starts)
    if starts:
        out.first = x
    out.x = x
    out.kind = OBJECT
    out = write_to(lines, out, output_point(f, q), code_p != 0 and code_q == 0)
    pieces.place[slot] = out.i
    if pieces.key[slot] >= CLOSED:
        out.i = out.i + wp.int64(pieces.steps[slot] // 2)
        return out
    c = crossing_at(surface, f, pieces.out[slot])
    p = point_of(f, c, side)
    q = point_of(f, crossing_after(surface, f, c), side)
    code_p = outcode(p, side)
    code_q = outcode(q, side)
    out.i = out.i + wp.int64(pieces.steps[slot] // 2)
    if code_q == 0:  # the chain ends inside, at an open edge
        out.x = output_point(f, q)
        return out
    if code_p == 0:
        out.x = output_point(f, p)
    x = output_point(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).leave, p, q, side))
    return write_to(lines, out, x, True)


@wp.func
def draw_corners(
    lines: Contours, writer: PolylineWriter, f: Frame, half: wp.vec2d, first: int, count: int, draws: bool
):
    """Write `count` corners of the patch from corner `first` on, if `draws`; segments from here on are hand kind."""
    out = writer
    if draws:
        out.kind = HAND
    for k in range(count):
        out = write_to(lines, out, output_point(f, corner((first + k) % 4, half)), draws)
        if draws:
            out.kind = HAND
    return out


def section_writer(pass_piece: Any) -> Any:
    """A wp.func that writes a query's polylines; `pass_piece` writes one piece, as `draw_piece` does."""

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
        """Write a query's polylines; a closed one repeats its first point at its end."""
        section = section_of(pieces, query)
        own = section % patch.shape[0]
        out = PolylineWriter()
        out.i = point_start[section]
        out.line = section_start[section]
        out.patch = own
        f = section_frame(pose, patch, section)
        side = half_extents(patch[own], bounded)
        base = start_of(pieces, query)
        count = entry_count(entries.count[query])
        for e in range(count):
            code = entries.entry[base + wp.int64(e) * pieces.stride]
            slot = base + wp.int64(entry_slot(code)) * pieces.stride
            whole = pieces.key[slot] >= CLOSED
            begins = begins_line(code)
            out = begin_line(lines, out, begins, whole or closes == 1)
            out = pass_piece(surface, f, side, pieces, slot, lines, out, begins)
            turns = closes == 1 and not whole
            corners = int(0)
            if turns:
                corners = entry_corners(code)
            out = draw_corners(lines, out, f, side, leave_side(pieces.side[slot]) + 1, corners, turns)
            ends = e + 1 == count
            if not ends:
                ends = begins_line(entries.entry[base + wp.int64(e + 1) * pieces.stride])
            out = write_to(lines, out, out.first, ends and closes == 1)
            out = end_line(lines, out, ends)
        draw_boundary(lines, out, f, side, has_boundary(entries.count[query]))
        if section == section_start.shape[0] - 2:
            lines.polyline_start[section_start[section + 1]] = point_start[section + 1]

    return write_section


write_section = section_writer(draw_piece)
write_section_ends = section_writer(draw_piece_ends)


# A piece in the warp's memory is PIECE half words, of 32 bits each. The first: number of its first crossing among those
# of the warp | its lane << LANE | its slot << SLOT_AT | THROUGH. The second: places of its first crossing and, <<
# CLOSING, of its polyline's last point, if that repeats where the piece enters, among the query's points. The third:
# `ContourPieces.side`.
PIECE = wp.constant(3)
NUMBER = wp.constant((1 << 16) - 1)
LANE = wp.constant(16)
SLOT_AT = wp.constant(21)
THROUGH = wp.constant(1 << 24)  # it has no crossing inside, but a number for one
CLOSING = wp.constant(16)
BIT_WORDS = wp.constant(3)  # of a query: a bit for each of its crossings
PIECE_WORDS = SLOTS * int(PIECE) // 2  # of a query
LANE_WORDS = PLANE_WORDS + PIECE_WORDS + int(BIT_WORDS)  # of a lane's memory on a CPU


@wp.func_native(memory_of_warp(PIECE_WORDS, begin=PLANE_WORDS))
def piece_memory(own: wp.array[wp.int64]) -> wp.uint64:
    """Address of the warp's pieces."""


@wp.func_native(memory_of_warp(int(BIT_WORDS), begin=PLANE_WORDS + PIECE_WORDS))
def bit_memory(own: wp.array[wp.int64]) -> wp.uint64:
    """Address of bits of the warp's crossings: 1 for the first one of each piece."""


@wp.struct
class WarpMemory:
    """Memory of a warp."""

    pieces: wp.uint64
    planes: wp.uint64
    bits: wp.uint64


@wp.func_native("""
    points.data[i] = x;
""")
def write_point(points: wp.array[wp.vec3], i: wp.int64, x: wp.vec3):
    """Write point i."""


@wp.func
def slot_of(piece: int):
    """The slot of a piece in the warp's memory."""
    return (piece >> SLOT_AT) & (SLOTS - 1)


@wp.func
def lane_of(piece: int):
    """The lane to which it belongs."""
    return (piece >> LANE) & 31


@wp.func_native(f"""
    kind.data[i] = {HAND};
""")
def mark_hand(kind: wp.array[wp.uint8], i: wp.int64):
    """Make the segment that starts at point i one of kind HAND."""


@wp.func
def keep_piece(
    pieces: ContourPieces, i: int, slot: int, side: int, j: int, number: int, place: int, memory: WarpMemory
):
    """Write a piece to the warp's memory as number j; returns how many of its points are crossings.

    side: `ContourPieces.side`; number: of its first crossing among the query's; place: of that crossing among the
    query's points.
    """
    steps = slot_int(pieces.steps, i) >> 1
    through = int(0)
    if steps == 0:
        if slot_int(pieces.key, i) < CLOSED and is_through(pieces, i):
            through = THROUGH
    set_int(memory.pieces, PIECE * j, number | (lane_of_warp() << LANE) | (slot << SLOT_AT) | through)
    set_int(memory.pieces, PIECE * j + 1, place)
    set_int(memory.pieces, PIECE * j + 2, side)
    return steps + wp.where(through != 0, 0, 1)


@wp.func
def place_pieces(
    plane: SectionPlane,
    pieces: ContourPieces,
    entries: Entries,
    query: int,
    count: int,
    closes: int,
    memory: WarpMemory,
    first: int,
    lines: Contours,
    writer: PolylineWriter,
):
    """Write a query's polylines and corners, and its pieces to the warp's memory from number `first` on.

    Returns how many numbers its crossings get: each piece has at least one.
    """
    out = writer
    crossings = int(0)
    begin = int(0)
    place = int(0)  # of the next point in the query
    code = int(0)
    if count > 0:
        code = slot_int(entries.entry, query)
    for e in range(count):
        slot = entry_slot(code)
        i = query + slot * int(pieces.stride)
        side = slot_int(pieces.side, i)
        whole = slot_int(pieces.key, i) >= CLOSED
        corners = entry_corners(code)
        if begins_line(code):
            begin = first + e
            out.i = plane.start + wp.int64(place)
            out = begin_line(lines, out, True, whole or closes == 1)
        place += wp.where(enter_side(side) != NONE, 1, 0)
        points = keep_piece(pieces, i, slot, side, first + e, crossings, place, memory)
        place += points
        crossings += wp.max(points, 1)
        code = BEGIN
        if e + 1 < count:
            code = slot_int(entries.entry, query + (e + 1) * int(pieces.stride))
        if not whole:
            place += 1
            if closes == 1:
                for k in range(corners):
                    x = corner((leave_side(side) + 1 + k) & 3, plane.side)
                    write_point(lines.points, plane.start + wp.int64(place + k), output_point(plane.f, x))
                    mark_hand(lines.kind, plane.start + wp.int64(place + k))
                place += corners
                if begins_line(code):  # a closed line's last point repeats where its first piece enters
                    own = int_at(memory.pieces, PIECE * begin + 1)
                    set_int(memory.pieces, PIECE * begin + 1, own | (place << CLOSING))
                    mark_hand(lines.kind, plane.start + wp.int64(place))
                    place += 1
    out.i = plane.start + wp.int64(place)
    draw_boundary(lines, out, plane.f, plane.side, has_boundary(entries.count[query]))
    return crossings


@wp.struct
class CrossingPlace:
    """A crossing, and where its point is written."""

    half: int  # its half-edge; NONE if it is not drawn
    lane: int  # of its query
    place: int  # of its point among those of the query


@wp.func
def crossing_place(pieces: ContourPieces, first_query: int, memory: WarpMemory, k: int, begun: int, crossings: int):
    """Crossing number k of a warp; begun: pieces that begin before the 32 crossings to which k belongs."""
    out = CrossingPlace()
    j = begun + bits_to(memory.bits, wp.uint32(k)) - 1
    piece = int_at(memory.pieces, PIECE * j)
    out.half = NONE
    if (piece & THROUGH) == 0:
        step = k - (piece & NUMBER)
        out.lane = lane_of(piece)
        out.place = (int_at(memory.pieces, PIECE * j + 1) & NUMBER) + step
        query = first_query + out.lane
        last = k + 1 == crossings or is_bit(memory.bits, wp.uint32(k + 1))  # the next one is another piece's
        i = query + slot_of(piece) * int(pieces.stride)
        out.half = listed_step(pieces, query, i, int_at(memory.pieces, PIECE * j + 2), step, last)
    return out


@wp.func
def draw_crossings(
    surface: Surface, pieces: ContourPieces, first_query: int, memory: WarpMemory, crossings: int, lines: Contours
):
    """Write the crossings of all pieces of a warp; the next one is looked up while the point of one is computed."""
    k = lane_of_warp()
    begun = int(0)
    following = CrossingPlace()
    if k < crossings:
        following = crossing_place(pieces, first_query, memory, k, begun, crossings)
    while k < crossings:
        own = following
        before = k
        k += warp_size()
        if k < crossings:
            if (k ^ before) >> 5 != 0:
                begun += bits_to(memory.bits, wp.uint32(before | 31))
            following = crossing_place(pieces, first_query, memory, k, begun, crossings)
        if own.half != NONE:
            plane = plane_of(memory.planes, own.lane)
            x = output_point(plane.f, point_of(plane.f, crossing_at(surface, plane.f, own.half), plane.side))
            write_point(lines.points, plane.start + wp.int64(own.place), x)


@wp.func
def draw_ends(
    surface: Surface,
    pieces: ContourPieces,
    first_query: int,
    memory: WarpMemory,
    count: int,
    closes: int,
    lines: Contours,
):
    """Write where all pieces of a warp enter and leave."""
    k = lane_of_warp()
    while k < 2 * count:
        j = k >> 1
        piece = int_at(memory.pieces, PIECE * j)
        places = int_at(memory.pieces, PIECE * j + 1)
        lane = lane_of(piece)
        i = first_query + lane + slot_of(piece) * int(pieces.stride)
        leaves = k & 1
        if end_side(int_at(memory.pieces, PIECE * j + 2), leaves) != NONE:
            plane = plane_of(memory.planes, lane)
            x = output_point(plane.f, piece_end(surface, plane.f, plane.side, pieces, i, leaves).at)
            place = (places & NUMBER) - 1
            if leaves == 1:
                place += (slot_int(pieces.steps, i) >> 1) + wp.where((piece & THROUGH) != 0, 1, 2)
                if closes == 1:
                    mark_hand(lines.kind, plane.start + wp.int64(place))
            elif places >> CLOSING != 0:
                write_point(lines.points, plane.start + wp.int64(places >> CLOSING), x)
            write_point(lines.points, plane.start + wp.int64(place), x)
        k += warp_size()


@wp.kernel(launch_bounds=(BLOCK, 10))
def _draw_listed_sections(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,  # with `lists`; queries are sections
    entries: Entries,
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    own: wp.array[wp.int64],  # a CPU's memory of the lane, shape [LANE_WORDS]
    lines: Contours,
    rest: wp.array[wp.int32],  # queries that are drawn by walking, in any order, shape [query]
    rest_count: wp.array[wp.int32],  # number of these queries, zero-initialised, shape [1]
):
    """Write each query's polylines from listed steps; list the other queries."""
    query = wp.tid()
    memory = WarpMemory()
    memory.pieces = piece_memory(own)
    memory.planes = plane_memory(own)
    memory.bits = bit_memory(own)
    for k in range(BIT_WORDS):
        set_long(memory.bits, lane_of_warp() * BIT_WORDS + k, wp.int64(0))
    plane = SectionPlane()
    writer = PolylineWriter()
    count = int(0)
    is_drawn = query < entries.count.shape[0]
    if is_drawn:
        count = entry_count(entries.count[query])
        writer.patch = query % patch.shape[0]
        writer.line = section_start[query]
        plane.start = point_start[query]
        plane.f = section_frame(pose, patch, query)
        plane.side = half_extents(patch[writer.patch], bounded)
        keep_plane(memory.planes, lane_of_warp(), plane)
        if query == section_start.shape[0] - 2:
            lines.polyline_start[section_start[query + 1]] = point_start[query + 1]
        if entries.count[query] & WALKED != 0:
            rest[wp.atomic_add(rest_count, 0, 1)] = query
            count = 0
            is_drawn = False
    numbers = sums_of_warp(count)
    crossings = int(0)
    if is_drawn:
        crossings = place_pieces(plane, pieces, entries, query, count, closes, memory, numbers[0], lines, writer)
    crossing_numbers = sums_of_warp(crossings)
    sync_warp()
    for j in range(numbers[0], numbers[0] + count):  # crossings of the lanes below come before a query's own
        piece = int_at(memory.pieces, PIECE * j) + crossing_numbers[0]
        set_int(memory.pieces, PIECE * j, piece)
        mark_bit(memory.bits, wp.uint32(piece & NUMBER))  # its first crossing
    sync_warp()
    first_query = query - lane_of_warp()
    draw_ends(surface, pieces, first_query, memory, numbers[1], closes, lines)
    draw_crossings(surface, pieces, first_query, memory, crossing_numbers[1], lines)


GROUPS_MOST = 2**24  # of lanes that draw; 64 times as many threads have numbers in 31 bits


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
    rest: wp.array[wp.int32],  # queries that `_draw_listed_sections` leaves out; none: all queries are drawn
    rest_count: wp.array[wp.int32],
    # Out:
    lines: Contours,
):
    """Write each query's polylines."""
    query = wp.tid()
    if rest.shape[0] > 0:
        if query >= rest_count[0]:
            return
        query = rest[query]
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
    write_section_ends(surface, pose, patch, pieces, entries, query, bounded, closes, section_start, point_start, lines)


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
        count = entry_count(entries.count[query])
        if count > 0:
            f = pieces.frame[query]
            side = half_extents(patch[section_of(pieces, query) % patch.shape[0]], bounded)
            base = start_of(pieces, query)
            query_start = pieces.query_start[query]
            for e in range(count):
                slot = entry_slot(entries.entry[base + wp.int64(e) * pieces.stride])
                own = base + wp.int64(slot) * pieces.stride
                begin = query_start + wp.int64(pieces.begin[own])
                place = pieces.place[own]
                steps = pieces.steps[own] // 2
                k = int(lane)
                while k < steps:
                    half = pieces.listed[begin + wp.int64(k)]
                    x = output_point(f, point_of(f, crossing_at(surface, f, half), side))
                    points[place + wp.int64(k)] = x
                    k += lanes
        query += groups


def draw_contours(joined: Joined) -> Contours:
    """Write the polylines that `join_sections` ordered and counted.

    Sections, pose * patches + patch, stand for the poses of the contours.
    """
    surface, pose, patch, bounded, closes = joined.planes
    device = pose.device
    lines = room_for_contours(joined.section_start, joined.polyline_count, joined.point_count)
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    for pieces, entries in joined.blocks:
        query_count = pieces.count.shape[0]
        drawn = [patch, pieces, entries, int(bounded)]
        inputs = [surface, pose, *drawn, int(closes), joined.section_start, joined.point_start]
        if pieces.lists.words > 0:
            rest = [wp.empty(query_count, dtype=wp.int32, device=device), wp.zeros(1, dtype=wp.int32, device=device)]
            own = wp.empty(LANE_WORDS, dtype=wp.int64, device=device)
            launch(_draw_listed_sections, threads_for(device, query_count), inputs=inputs, outputs=[own, lines, *rest])
            launch(_draw_contours, query_count, inputs=[*inputs, *rest], outputs=[lines])
        elif pieces.listed is not None:
            launch(_draw_ends, query_count, inputs=inputs, outputs=[lines])
            lanes, groups = lane_count(device), min(query_count, GROUPS_MOST)
            launch(_draw_listed, groups * lanes, inputs=[surface, *drawn, lanes, groups], outputs=[lines.points])
        else:
            launch(_draw_contours, query_count, inputs=[*inputs, None, None], outputs=[lines])
    return lines


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
