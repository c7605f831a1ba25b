"""The pen that goes along ordered pieces of a row: one walk, whether points are written or lengths are added up.

| | sink | pen | what is kept |
|---|---|---|---|
| draw_row | Lines | Pen | points, kinds and polylines in arrays |
| add_row | int: 1 where contours enclose something | Tape | lengths by kind and what is enclosed, in the pen itself |

Tape adds in the order, and of the float32 points, that `tally` would add what Pen has written: both come to the same
bits. Functions are asked whether to do anything, since a branch around them has structs chosen from memory on a CPU.
"""

from typing import Any

import warp as wp

from ..patch import Frame, corner, outcode, output_point, to_float64
from .edge_pairing import OPEN
from .half_edges import Surface
from .joining import BEGIN, BOUNDARY, CORNERS, SLOT, Entries
from .pieces import CLOSED, ContourPieces, start_of
from .segment_clipping import corners_left, segment_of, side_point
from .triangle_walk import crossing_after, crossing_at, point_of

OBJECT = 0
HAND = 1
MADE = 2


@wp.struct
class LineArrays:
    """Where contours are written: see `draw.Contours`; `kind` comes as OBJECT."""

    points: wp.array[wp.vec3]
    kind: wp.array[wp.uint8]
    polyline_start: wp.array[wp.int64]
    polyline_patch: wp.array[wp.int32]
    polyline_closed: wp.array[wp.uint8]


@wp.struct
class PolylineWriter:
    """The last point, not written before the next one is known to differ from it."""

    i: wp.int64  # where it goes
    line: wp.int64  # where the next polyline goes
    patch: int
    x: wp.vec3
    kind: int  # of the segment that starts there
    first: wp.vec3  # where the polyline began


@wp.struct
class LengthAccumulator:
    """The last point, and sums over what lies before it."""

    x: wp.vec3
    kind: int  # of the segment that starts there
    first: wp.vec3  # where the polyline began
    outline: wp.float64  # length of the object's kind [m]
    side: wp.float64  # of the hand's
    own: wp.vec3d  # twice the area that the polyline encloses so far, seen from its first point [m^2]
    swept: wp.vec3d  # of the polylines before


@wp.func
def write_to(lines: LineArrays, pen: PolylineWriter, y: wp.vec3, draws: bool):
    """The pen at y, its point before written if it draws and the way was of some length."""
    out = pen
    if draws and not (pen.x == y):
        lines.points[pen.i] = pen.x
        if pen.kind != OBJECT:
            lines.kind[pen.i] = wp.uint8(pen.kind)
        out.i = pen.i + wp.int64(1)
    if draws:
        out.x = y
        out.kind = OBJECT
    return out


@wp.func
def add_to(encloses: int, tape: LengthAccumulator, y: wp.vec3, draws: bool):
    """The pen at y, the way added if it draws and that was of some length."""
    out = tape
    if draws and not (tape.x == y):
        way = wp.length(to_float64(y - tape.x))
        if tape.kind == OBJECT:
            out.outline = tape.outline + way
        else:
            out.side = tape.side + way
        if encloses == 1:
            origin = to_float64(tape.first)
            out.own = tape.own + wp.cross(to_float64(tape.x) - origin, to_float64(y) - origin)
    if draws:
        out.x = y
        out.kind = OBJECT
    return out


@wp.func
def begin_line(lines: LineArrays, pen: PolylineWriter, begins: bool, closed: bool):
    """The pen where a polyline starts, which is entered, if one begins."""
    out = pen
    if begins:
        lines.polyline_start[pen.line] = pen.i
        lines.polyline_patch[pen.line] = pen.patch
        lines.polyline_closed[pen.line] = wp.uint8(closed)
        out.line = pen.line + wp.int64(1)
    return out


@wp.func
def begin_sum(encloses: int, tape: LengthAccumulator, begins: bool, closed: bool):
    """The pen where a polyline starts if one begins."""
    out = tape
    if begins:
        out.own = wp.vec3d()
    return out


@wp.func
def end_line(lines: LineArrays, pen: PolylineWriter, ends: bool):
    """The pen after a polyline, if it ends here, whose last point is written; its kind repeats the one before."""
    out = pen
    if ends:
        lines.points[pen.i] = pen.x
        lines.kind[pen.i] = lines.kind[pen.i - wp.int64(1)]
        out.i = pen.i + wp.int64(1)
    return out


@wp.func
def end_sum(encloses: int, tape: LengthAccumulator, ends: bool):
    """The pen after a polyline if it ends here."""
    out = tape
    if ends:
        out.swept = tape.swept + tape.own
    return out


@wp.func
def draw_boundary(lines: LineArrays, pen: PolylineWriter, f: Frame, half: wp.vec2d, draws: bool):
    """The patch's whole boundary as a polyline of five points, if the pen draws."""
    out = begin_line(lines, pen, draws, True)
    if draws:
        for k in range(5):
            lines.points[out.i] = output_point(f, corner(k % 4, half))
            lines.kind[out.i] = wp.uint8(HAND)
            out.i = out.i + wp.int64(1)
    return out


@wp.func
def add_boundary(encloses: int, tape: LengthAccumulator, f: Frame, half: wp.vec2d, draws: bool):
    """The patch's whole boundary as a polyline, if the pen draws."""
    out = begin_sum(encloses, tape, draws, True)
    if draws:
        out.x = output_point(f, corner(0, half))
        out.first = out.x
    for k in range(wp.where(draws, 4, 0)):
        out.kind = HAND
        out = add_to(encloses, out, output_point(f, corner((k + 1) % 4, half)), draws)
    return end_sum(encloses, out, draws)


def row_walker(sink_type: Any, pen_type: Any, to: Any, begin: Any, end: Any, boundary: Any) -> Any:
    """A wp.func that leads a pen through a row; the others are what it does on its way, as those of Pen above."""

    @wp.func
    def draw_piece(surface: Surface, f: Frame, side: wp.vec2d, half: int, sink: sink_type, pen: pen_type, starts: bool):
        """Walk a piece from where it enters, or starts, to where it leaves, ends or closes."""
        c = crossing_at(surface, f, half)
        n = crossing_after(surface, f, c)
        p = point_of(f, c, side)
        q = point_of(f, n, side)
        code_p = outcode(p, side)
        code_q = outcode(q, side)
        x = output_point(f, p)
        if code_p != 0:
            x = output_point(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).enter, p, q, side))
        out = to(sink, pen, x, not starts)
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

    @wp.func
    def draw_corners(sink: sink_type, pen: pen_type, f: Frame, half: wp.vec2d, first: int, count: int, draws: bool):
        """Lead the pen around corners of the patch if it draws; all it draws from here is of the hand's kind."""
        out = pen
        if draws:
            out.kind = HAND
        for k in range(count):
            out = to(sink, out, output_point(f, corner((first + k) % 4, half)), draws)
            if draws:
                out.kind = HAND
        return out

    @wp.func
    def draw_row(
        surface: Surface,
        f: Frame,
        side: wp.vec2d,
        pieces: ContourPieces,
        entries: Entries,
        row: int,
        closes: int,
        sink: sink_type,
        pen: pen_type,
    ):
        """Draw a row's polylines, a closed one with its first point again at its end."""
        base = start_of(pieces, row)
        out = pen
        count = entries.count[row] & (BOUNDARY - 1)
        for e in range(count):
            code = entries.entry[base + wp.int64(e) * pieces.stride]
            slot = base + wp.int64(code & SLOT) * pieces.stride
            whole = pieces.key[slot] >= CLOSED
            begins = (code & BEGIN) != 0
            out = begin(sink, out, begins, whole or closes == 1)
            out = draw_piece(surface, f, side, pieces.half[slot], sink, out, begins)
            turns = closes == 1 and not whole
            corners = int(0)
            if turns:
                corners = code >> CORNERS
            out = draw_corners(sink, out, f, side, pieces.side[slot][1] + 1, corners, turns)
            ends = e + 1 == count
            if not ends:
                ends = (entries.entry[base + wp.int64(e + 1) * pieces.stride] & BEGIN) != 0
            out = to(sink, out, out.first, ends and closes == 1)
            out = end(sink, out, ends)
        return boundary(sink, out, f, side, entries.count[row] >= BOUNDARY)

    return draw_row


draw_row = row_walker(LineArrays, PolylineWriter, write_to, begin_line, end_line, draw_boundary)
add_row = row_walker(int, LengthAccumulator, add_to, begin_sum, end_sum, add_boundary)
