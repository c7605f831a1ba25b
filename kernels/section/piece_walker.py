"""Walking the ordered pieces of a query: one generated function either writes points or accumulates lengths.

| function | sink | state | result |
|---|---|---|---|
| draw_section | Contours | PolylineWriter | points, kinds and polylines in arrays |
| draw_section_ends | Contours | PolylineWriter | the same but for points of crossings in `ContourPieces.listed` |
| add_section | int: 1 if contours enclose an area | LengthAccumulator | lengths by kind, area vectors, in the state |

Both use the same float32 points in the same order, so `add_section` gives the same bits as `tally` on written points.
The functions take flags (`draws`, `begins`, ...) instead of being called in a branch: around a branch, Warp on a CPU
would select whole structs through memory.
"""

from typing import Any

import warp as wp

from ..contours import Contours
from ..patch import Frame, corner, outcode, output_point, to_float64
from .edge_pairing import OPEN
from .half_edges import Surface
from .joining import BEGIN, BOUNDARY, CORNERS, COUNT, SLOT, Entries
from .pieces import CLOSED, ContourPieces, leave_side, start_of
from .segment_clipping import corners_left, segment_of, side_point
from .triangle_walk import crossing_after, crossing_at, point_of

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


@wp.struct
class LengthAccumulator:
    """State of accumulating: the last point, and sums over the segments before it."""

    x: wp.vec3  # the last point
    kind: int  # of the segment that starts there
    first: wp.vec3  # first point of the polyline
    outline: wp.float64  # length of object segments [m]
    side: wp.float64  # length of hand segments [m]
    own: wp.vec3d  # twice the area vector of the current polyline, about its first point [m^2]
    swept: wp.vec3d  # twice the area vector of the polylines before [m^2]


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
def add_to(encloses: int, sums: LengthAccumulator, y: wp.vec3, draws: bool):
    """Go to point y if `draws`, and add the segment to it unless its length is zero."""
    out = sums
    if draws and not (sums.x == y):
        length = wp.length(to_float64(y - sums.x))
        if sums.kind == OBJECT:
            out.outline = sums.outline + length
        else:
            out.side = sums.side + length
        if encloses == 1:
            origin = to_float64(sums.first)
            out.own = sums.own + wp.cross(to_float64(sums.x) - origin, to_float64(y) - origin)
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
def begin_sum(encloses: int, sums: LengthAccumulator, begins: bool, closed: bool):
    """Reset the polyline's area if one begins here."""
    out = sums
    if begins:
        out.own = wp.vec3d()
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
def end_sum(encloses: int, sums: LengthAccumulator, ends: bool):
    """Add the polyline's area to the sum if it ends here."""
    out = sums
    if ends:
        out.swept = sums.swept + sums.own
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
def add_boundary(encloses: int, sums: LengthAccumulator, f: Frame, half: wp.vec2d, draws: bool):
    """Add the patch's whole boundary as a closed polyline, if `draws`."""
    out = begin_sum(encloses, sums, draws, True)
    if draws:
        out.x = output_point(f, corner(0, half))
        out.first = out.x
    for k in range(wp.where(draws, 4, 0)):
        out.kind = HAND
        out = add_to(encloses, out, output_point(f, corner((k + 1) % 4, half)), draws)
    return end_sum(encloses, out, draws)


def piece_walker(
    sink_type: Any, state_type: Any, to: Any, begin: Any, end: Any, boundary: Any, piece: Any = None
) -> Any:
    """A wp.func that walks a query's pieces: it passes each point to `to`, each polyline's begin and end to `begin` and
    `end`, and the patch's whole boundary to `boundary`. Signatures as the functions of PolylineWriter above.

    piece: passes the points of one piece, as `draw_piece` does, which walks from crossing to crossing."""

    @wp.func
    def draw_piece(
        surface: Surface,
        f: Frame,
        side: wp.vec2d,
        pieces: ContourPieces,
        slot: wp.int64,
        sink: sink_type,
        state: state_type,
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
        out = to(sink, state, x, not starts)
        if starts:
            out.first = x
        out.x = x
        out.kind = OBJECT
        while code_q == 0 and n.half != OPEN and n.half != half:
            out = to(sink, out, output_point(f, q), True)
            p = q
            code_p = code_q
            n = crossing_after(surface, f, n)
            q = point_of(f, n, side)
            code_q = outcode(q, side)
        x = output_point(f, q)
        if code_q != 0:
            x = output_point(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).leave, p, q, side))
        return to(sink, out, x, True)

    pass_piece = piece or draw_piece

    @wp.func
    def draw_corners(sink: sink_type, state: state_type, f: Frame, half: wp.vec2d, first: int, count: int, draws: bool):
        """Pass `count` corners of the patch from corner `first` on, if `draws`; segments from here on are hand kind."""
        out = state
        if draws:
            out.kind = HAND
        for k in range(count):
            out = to(sink, out, output_point(f, corner((first + k) % 4, half)), draws)
            if draws:
                out.kind = HAND
        return out

    @wp.func
    def draw_section(
        surface: Surface,
        f: Frame,
        side: wp.vec2d,
        pieces: ContourPieces,
        entries: Entries,
        query: int,
        closes: int,
        sink: sink_type,
        state: state_type,
    ):
        """Draw a query's polylines; a closed one repeats its first point at its end."""
        base = start_of(pieces, query)
        out = state
        count = entries.count[query] & COUNT
        for e in range(count):
            code = entries.entry[base + wp.int64(e) * pieces.stride]
            slot = base + wp.int64(code & SLOT) * pieces.stride
            whole = pieces.key[slot] >= CLOSED
            begins = (code & BEGIN) != 0
            out = begin(sink, out, begins, whole or closes == 1)
            out = pass_piece(surface, f, side, pieces, slot, sink, out, begins)
            turns = closes == 1 and not whole
            corners = int(0)
            if turns:
                corners = code >> CORNERS
            out = draw_corners(sink, out, f, side, leave_side(pieces.side[slot]) + 1, corners, turns)
            ends = e + 1 == count
            if not ends:
                ends = (entries.entry[base + wp.int64(e + 1) * pieces.stride] & BEGIN) != 0
            out = to(sink, out, out.first, ends and closes == 1)
            out = end(sink, out, ends)
        return boundary(sink, out, f, side, entries.count[query] >= BOUNDARY)

    return draw_section


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


draw_section = piece_walker(Contours, PolylineWriter, write_to, begin_line, end_line, draw_boundary)
draw_section_ends = piece_walker(
    Contours, PolylineWriter, write_to, begin_line, end_line, draw_boundary, draw_piece_ends
)
add_section = piece_walker(int, LengthAccumulator, add_to, begin_sum, end_sum, add_boundary)
