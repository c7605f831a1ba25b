"""Drawing from listed steps: the lanes of a warp share out the points of the warp's queries.

If none of its steps at the patch's sides has zero length, a piece has these points: where it enters; the crossings at
which its listed steps begin; its last crossing; where it leaves. Queries for which that is not so are listed, and drawn
by walking.
"""

import warp as wp

from ..contours import Contours
from ..offsets import BLOCK
from ..patch import EXACT, Patch, corner, half_extents, output_point, section_frame
from ..warps import (
    bits_to,
    int_at,
    is_bit,
    lane_of_warp,
    mark_bit,
    memory_of_warp,
    set_int,
    set_long,
    sums_of_warp,
    sync_warp,
    warp_size,
)
from .half_edges import Surface
from .joining import BEGIN, BOUNDARY, CORNERS, COUNT, SLOT, WALKED, Entries
from .piece_ends import is_through, piece_end, slot_int
from .piece_walker import HAND, PolylineWriter, begin_line, draw_boundary
from .pieces import CLOSED, SLOTS, ContourPieces, end_side, enter_side, leave_side, listed_step
from .segment_clipping import NONE
from .triangle_walk import crossing_at, point_of
from .warp_planes import PLANE_WORDS, SectionPlane, keep_plane, plane_memory, plane_of

wp.set_module_options(EXACT)

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
        slot = code & SLOT
        i = query + slot * int(pieces.stride)
        side = slot_int(pieces.side, i)
        whole = slot_int(pieces.key, i) >= CLOSED
        corners = code >> CORNERS
        if (code & BEGIN) != 0:
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
                if (code & BEGIN) != 0:  # a closed line's last point repeats where its first piece enters
                    own = int_at(memory.pieces, PIECE * begin + 1)
                    set_int(memory.pieces, PIECE * begin + 1, own | (place << CLOSING))
                    mark_hand(lines.kind, plane.start + wp.int64(place))
                    place += 1
    out.i = plane.start + wp.int64(place)
    draw_boundary(lines, out, plane.f, plane.side, entries.count[query] >= BOUNDARY)
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
        count = entries.count[query] & COUNT
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
