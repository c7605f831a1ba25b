"""Drawing from listed steps: the lanes of a warp share out the points of the warp's rows.

If none of its steps at the patch's sides has zero length, a piece has these points: where it enters; the crossings at
which its listed steps begin; its last crossing; where it leaves. Rows for which that is not so are listed, to be drawn
by walking.
"""

import warp as wp

from ..patch import EXACT, Frame, Patch, corner, half_extents, output_point, section_frame
from ..warps import (
    half_word_at,
    lane_of_warp,
    lanes_of_warp,
    long_at,
    memory_of_warp,
    set_half_word,
    set_long,
    set_vec3d,
    sums_of_warp,
    sync_warp,
    vec3d_at,
)
from .half_edges import Surface
from .joining import BEGIN, BOUNDARY, CORNERS, COUNT, SLOT, WALKED, Entries, is_through
from .pieces import CLOSED, SLOTS, ContourPieces, end_side, enter_side, leave_side, listed_step
from .rough_walk import load_int
from .row_walker import HAND, LineArrays, PolylineWriter, begin_line, draw_boundary
from .segment_clipping import NONE, side_point
from .triangle_walk import crossing_after, crossing_at, point_of

wp.set_module_options(EXACT)

# A piece in the warp's memory is 32 bits: number of its first crossing among those of the warp, and its lane << LANE |
# slot << SLOT_AT; and 32 more: places of its first crossing and of its polyline's last point, if that repeats where the
# piece enters, << CLOSING, among the points of its row.
NUMBER = wp.constant((1 << 16) - 1)
LANE = wp.constant(16)
SLOT_AT = wp.constant(21)
CLOSING = wp.constant(16)
PLANE_WORDS = wp.constant(17)  # of a row: its frame, half extents, where its points begin; an odd number, so that lanes
# which read different rows seldom wait for each other


@wp.func_native(memory_of_warp(SLOTS))
def piece_memory(own: wp.array[wp.int64]) -> wp.uint64:
    """Address of the warp's pieces."""


@wp.func_native(memory_of_warp(int(PLANE_WORDS)))
def plane_memory(own: wp.array[wp.int64]) -> wp.uint64:
    """Address of the warp's planes."""


@wp.struct
class RowPlane:
    """What points of a row are computed with."""

    f: Frame
    side: wp.vec2d  # half extents of the patch [m]
    start: wp.int64  # of the row's points among all


@wp.func
def keep_plane(memory: wp.uint64, lane: int, plane: RowPlane):
    """Write a row's plane to the warp's memory."""
    i = lane * PLANE_WORDS
    set_vec3d(memory, i, plane.f.origin)
    set_vec3d(memory, i + 3, plane.f.u)
    set_vec3d(memory, i + 6, plane.f.v)
    set_vec3d(memory, i + 9, plane.f.n)
    set_vec3d(memory, i + 12, wp.vec3d(plane.f.flush, plane.side[0], plane.side[1]))
    set_long(memory, i + 15, plane.start)
    set_long(memory, i + 16, wp.int64(plane.f.relative))


@wp.func
def plane_of(memory: wp.uint64, lane: int):
    """The plane of a lane's row."""
    plane = RowPlane()
    i = lane * PLANE_WORDS
    plane.f.origin = vec3d_at(memory, i)
    plane.f.u = vec3d_at(memory, i + 3)
    plane.f.v = vec3d_at(memory, i + 6)
    plane.f.n = vec3d_at(memory, i + 9)
    x = vec3d_at(memory, i + 12)
    plane.f.flush = x[0]
    plane.side = wp.vec2d(x[1], x[2])
    plane.start = long_at(memory, i + 15)
    plane.f.relative = int(long_at(memory, i + 16))
    return plane


@wp.func
def crossing_count(pieces: ContourPieces, i: wp.int64):
    """Number of points of a piece that are crossings: its listed ones, and the last one unless it has none inside."""
    return pieces.steps[i] // 2 + wp.where(is_through(pieces, i), 0, 1)


@wp.func
def write_corners(f: Frame, half: wp.vec2d, first: int, count: int, begin: wp.int64, lines: LineArrays):
    """Write corners of a patch as points."""
    for k in range(count):
        lines.points[begin + wp.int64(k)] = output_point(f, corner((first + k) % 4, half))
        lines.kind[begin + wp.int64(k)] = wp.uint8(HAND)


@wp.func
def place_pieces(
    plane: RowPlane,
    pieces: ContourPieces,
    entries: Entries,
    row: int,
    count: int,
    closes: int,
    memory: wp.uint64,
    first: int,
    lines: LineArrays,
    writer: PolylineWriter,
):
    """Write a row's polylines and corners, and its pieces to the warp's memory from number `first` on.

    Returns how many of the row's points are crossings.
    """
    out = writer
    crossings = int(0)
    begin = int(0)
    place = int(0)  # of the next point in the row
    for e in range(count):
        code = entries.entry[wp.int64(row) + wp.int64(e) * pieces.stride]
        slot = code & SLOT
        i = wp.int64(row) + wp.int64(slot) * pieces.stride
        side = pieces.side[i]
        whole = pieces.key[i] >= CLOSED
        if (code & BEGIN) != 0:
            begin = first + e
            out.i = plane.start + wp.int64(place)
            out = begin_line(lines, out, True, whole or closes == 1)
        place += wp.where(enter_side(side) != NONE, 1, 0)
        set_half_word(memory, 2 * (first + e), crossings | (lane_of_warp() << LANE) | (slot << SLOT_AT))
        set_half_word(memory, 2 * (first + e) + 1, place)
        crossings += crossing_count(pieces, i)
        place += crossing_count(pieces, i)
        if not whole:
            place += 1
            if closes == 1:
                corners = code >> CORNERS
                write_corners(plane.f, plane.side, leave_side(side) + 1, corners, plane.start + wp.int64(place), lines)
                place += corners
                ends = e + 1 == count
                if not ends:
                    ends = (entries.entry[wp.int64(row) + wp.int64(e + 1) * pieces.stride] & BEGIN) != 0
                if ends:
                    own = half_word_at(memory, 2 * begin + 1)
                    set_half_word(memory, 2 * begin + 1, own | (place << CLOSING))
                    lines.kind[plane.start + wp.int64(place)] = wp.uint8(HAND)
                    place += 1
    out.i = plane.start + wp.int64(place)
    draw_boundary(lines, out, plane.f, plane.side, entries.count[row] >= BOUNDARY)
    return crossings


@wp.func
def number_crossings(memory: wp.uint64, first: int, count: int, before: int):
    """Add the number of crossings of the lanes below to those of a row's pieces."""
    for j in range(first, first + count):
        set_half_word(memory, 2 * j, half_word_at(memory, 2 * j) + before)


@wp.func
def piece_with(memory: wp.uint64, count: int, k: int):
    """Which of so many pieces crossing number k of the warp belongs to."""
    step = int(1)
    while 2 * step < count:
        step = 2 * step
    found = int(0)
    while step > 0:
        if found + step < count:
            if (half_word_at(memory, 2 * (found + step)) & NUMBER) <= k:
                found += step
        step = step >> 1
    return found


@wp.func
def draw_crossings(
    surface: Surface,
    pieces: ContourPieces,
    first_row: int,
    memory: wp.uint64,
    planes: wp.uint64,
    count: int,
    crossings: int,
    lines: LineArrays,
):
    """Write the crossings of all pieces of a warp."""
    k = lane_of_warp()
    while k < crossings:
        j = piece_with(memory, count, k)
        piece = half_word_at(memory, 2 * j)
        lane = (piece >> LANE) & 31
        row = first_row + lane
        i = row + (piece >> SLOT_AT) * int(pieces.stride)
        step = k - (piece & NUMBER)
        half = int(0)
        if step < load_int(pieces.steps, i) >> 1:
            half = listed_step(pieces, row, load_int(pieces.side, i), step)
        else:
            half = load_int(pieces.out, i)
        plane = plane_of(planes, lane)
        x = output_point(plane.f, point_of(plane.f, crossing_at(surface, plane.f, half), plane.side))
        place = (half_word_at(memory, 2 * j + 1) & NUMBER) + step
        lines.points[plane.start + wp.int64(place)] = x
        k += lanes_of_warp()


@wp.func
def draw_ends(
    surface: Surface,
    pieces: ContourPieces,
    first_row: int,
    memory: wp.uint64,
    planes: wp.uint64,
    count: int,
    closes: int,
    lines: LineArrays,
):
    """Write where all pieces of a warp enter and leave."""
    k = lane_of_warp()
    while k < 2 * count:
        piece = half_word_at(memory, k & ~1)
        places = half_word_at(memory, k | 1)
        lane = (piece >> LANE) & 31
        i = first_row + lane + (piece >> SLOT_AT) * int(pieces.stride)
        leaves = k & 1
        side = end_side(load_int(pieces.side, i), leaves)
        if side != NONE:
            half = load_int(pieces.half, i)
            out = load_int(pieces.out, i)
            plane = plane_of(planes, lane)
            c = crossing_at(surface, plane.f, wp.where(leaves == 1, out, half))
            p = point_of(plane.f, c, plane.side)
            q = point_of(plane.f, crossing_after(surface, plane.f, c), plane.side)
            x = output_point(plane.f, side_point(side, p, q, plane.side))
            place = (places & NUMBER) - 1
            if leaves == 1:
                place += 1 + crossing_count(pieces, wp.int64(i))
                if closes == 1:
                    lines.kind[plane.start + wp.int64(place)] = wp.uint8(HAND)
            elif places >> CLOSING != 0:
                lines.points[plane.start + wp.int64(places >> CLOSING)] = x
            lines.points[plane.start + wp.int64(place)] = x
        k += lanes_of_warp()


@wp.kernel
def _draw_listed_rows(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,  # with `lists`; rows are sections
    entries: Entries,
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    lines: LineArrays,
    rest: wp.array[wp.int32],  # rows that are drawn by walking, in any order, shape [row]
    rest_count: wp.array[wp.int32],  # number of these rows, zero-initialised, shape [1]
):
    """Write each row's polylines from listed steps; list the other rows."""
    row = wp.tid()
    own_pieces = wp.zeros(shape=SLOTS, dtype=wp.int64)
    own_plane = wp.zeros(shape=PLANE_WORDS, dtype=wp.int64)
    memory = piece_memory(own_pieces)
    planes = plane_memory(own_plane)
    plane = RowPlane()
    writer = PolylineWriter()
    count = int(0)
    is_drawn = row < entries.count.shape[0]
    if is_drawn:
        count = entries.count[row] & COUNT
        writer.patch = row % patch.shape[0]
        writer.line = section_start[row]
        plane.start = point_start[row]
        plane.f = section_frame(pose, patch, row)
        plane.side = half_extents(patch[writer.patch], bounded)
        keep_plane(planes, lane_of_warp(), plane)
        if row == section_start.shape[0] - 2:
            lines.polyline_start[section_start[row + 1]] = point_start[row + 1]
        if entries.count[row] & WALKED != 0:
            rest[wp.atomic_add(rest_count, 0, 1)] = row
            count = 0
            is_drawn = False
    numbers = sums_of_warp(count)
    crossings = int(0)
    if is_drawn:
        crossings = place_pieces(plane, pieces, entries, row, count, closes, memory, numbers[0], lines, writer)
    crossing_numbers = sums_of_warp(crossings)
    number_crossings(memory, numbers[0], count, crossing_numbers[0])
    sync_warp()
    first_row = row - lane_of_warp()
    draw_ends(surface, pieces, first_row, memory, planes, numbers[1], closes, lines)
    draw_crossings(surface, pieces, first_row, memory, planes, numbers[1], crossing_numbers[1], lines)
