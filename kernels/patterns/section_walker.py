"""Walking a section's polylines from the table: one generated function counts points, writes them or adds lengths.

| function | sink | state | result |
|---|---|---|---|
| count_section | int (unused) | PointCounter | numbers of polylines and points |
| draw_section | Contours | PolylineWriter | points, kinds and polylines in arrays |
| draw_clear_section | Contours | ClearWriter | the same for a section that was not cut exactly |
| add_section | int: 1 if contours enclose an area | LengthAccumulator | lengths by kind and area vectors |

Points come in the order in which `section.piece_walker` passes them; polylines of no length are left out. So the
bits are the same.
"""

from typing import Any

import warp as wp

from ..contours import Contours
from ..patch import Frame, corner, output_point
from ..section.piece_walker import (
    HAND,
    OBJECT,
    LengthAccumulator,
    PolylineWriter,
    add_boundary,
    add_to,
    begin_sum,
    draw_boundary,
    end_sum,
    write_to,
)
from ..section.segment_clipping import blend, side_point
from ..section.triangle_walk import Crossing, point_of
from .cut_loops import WHOLE, CutLoops, bit_of, entering_segment, leaves_with, lowest_bit, packed_at, side_in
from .loop_table import LoopTable, crossing_of, next_of
from .piece_joints import PieceJoint, joint_after


@wp.struct
class PointCounter:
    """State of counting: the last point, and what the polylines before it come to."""

    x: wp.vec3  # the last point
    kind: int  # unused: the walker sets it in every state
    first: wp.vec3  # first point of the polyline
    steps: int  # of non-zero length in the polyline
    lines: int
    points: int


@wp.func
def count_to(unused: int, counter: PointCounter, y: wp.vec3, draws: bool):
    """Go to point y if `draws`."""
    out = counter
    if draws and not (counter.x == y):
        out.steps = counter.steps + 1
    if draws:
        out.x = y
    return out


@wp.func
def begin_count(unused: int, counter: PointCounter, begins: bool, closed: bool):
    """Begin a polyline."""
    out = counter
    if begins:
        out.steps = 0
    return out


@wp.func
def end_count(unused: int, counter: PointCounter, ends: bool, closed: bool):
    """Count the polyline that ends here, unless it has no length."""
    out = counter
    if ends and counter.steps > 0:
        out.lines = counter.lines + 1
        out.points = counter.points + counter.steps + 1
    return out


@wp.func
def count_boundary(unused: int, counter: PointCounter, f: Frame, half: wp.vec2d, draws: bool):
    """Count the patch's whole boundary."""
    out = counter
    if draws:
        out.lines = counter.lines + 1
        out.points = counter.points + 5
    return out


@wp.func
def begin_writing(lines: Contours, writer: PolylineWriter, begins: bool, closed: bool):
    """Write where a polyline begins; so does the next one, at the same place, if this one has no length."""
    if begins:
        lines.polyline_start[writer.line] = writer.i
    return writer


@wp.func
def end_writing(lines: Contours, writer: PolylineWriter, ends: bool, closed: bool):
    """Write the held point and the rest of the header of the polyline that ends here, unless it has no length."""
    out = writer
    if ends:
        if writer.i > lines.polyline_start[writer.line]:
            lines.points[writer.i] = writer.x
            lines.kind[writer.i] = lines.kind[writer.i - wp.int64(1)]
            lines.polyline_patch[writer.line] = writer.patch
            lines.polyline_closed[writer.line] = wp.uint8(closed)
            out.i = writer.i + wp.int64(1)
            out.line = writer.line + wp.int64(1)
    return out


@wp.struct
class ClearWriter:
    """State of writing if no step has length zero: the last point is held back until its segment's kind is known."""

    x: wp.vec3  # the held point
    kind: int  # of the segment that starts there
    first: wp.vec3  # first point of the polyline
    written: int  # kind of the segment before
    i: wp.int64  # index of the held point
    line: wp.int64  # index of the next polyline
    patch: int


@wp.func
def write_point(lines: Contours, i: wp.int64, x: wp.vec3, kind: int):
    """Write a point and the kind of the segment that starts there."""
    lines.points[i] = x
    if kind != OBJECT:
        lines.kind[i] = wp.uint8(kind)


@wp.func
def write_clear(lines: Contours, writer: ClearWriter, y: wp.vec3, draws: bool):
    """Write the held point and hold point y, if `draws`."""
    out = writer
    if draws:
        write_point(lines, writer.i, writer.x, writer.kind)
        out.i = writer.i + wp.int64(1)
        out.x = y
        out.written = writer.kind
        out.kind = OBJECT
    return out


@wp.func
def begin_clear(lines: Contours, writer: ClearWriter, begins: bool, closed: bool):
    """Write the header of a polyline if one begins here."""
    out = writer
    if begins:
        lines.polyline_start[writer.line] = writer.i
        lines.polyline_patch[writer.line] = writer.patch
        lines.polyline_closed[writer.line] = wp.uint8(closed)
        out.line = writer.line + wp.int64(1)
    return out


@wp.func
def end_clear(lines: Contours, writer: ClearWriter, ends: bool, closed: bool):
    """Write the held point if the polyline ends here; it repeats the kind of the point before."""
    out = writer
    if ends:
        write_point(lines, writer.i, writer.x, writer.written)
        out.i = writer.i + wp.int64(1)
    return out


@wp.func
def clear_boundary(lines: Contours, writer: ClearWriter, f: Frame, half: wp.vec2d, draws: bool):
    """Write the patch's whole boundary as a closed polyline of five points, if `draws`."""
    out = begin_clear(lines, writer, draws, True)
    if draws:
        for k in range(5):
            write_point(lines, out.i, output_point(f, corner(k % 4, half)), int(HAND))
            out.i = out.i + wp.int64(1)
    return out


@wp.func
def place_of(f: Frame, c: Crossing, side: wp.vec2d, exact: bool):
    """Point of a crossing in the patch's plane [m]; unless `exact`, it is flush with no side."""
    if exact:
        return point_of(f, c, side)
    return blend(wp.vec2d(c.upper[0], c.upper[1]), wp.vec2d(c.lower[0], c.lower[1]), c.upper[2], c.lower[2])


@wp.func
def end_adding(encloses: int, sums: LengthAccumulator, ends: bool, closed: bool):
    """Add the area of the polyline that ends here to the sum."""
    return end_sum(encloses, sums, ends)


def section_walker(
    sink_type: Any, state_type: Any, to: Any, begin: Any, end: Any, boundary: Any, *, exact: bool = True
) -> Any:
    """A wp.func that walks a section's polylines: it passes each point to `to`, each polyline's begin and end to
    `begin` and `end`, and the patch's whole boundary to `boundary`. Signatures as the functions of PointCounter above.

    exact: unless the sections are those which `cut_loops` and `join_counts` found clear without being exact.
    """
    exactly = wp.constant(exact)

    @wp.func
    def walk_piece(
        table: LoopTable,
        f: Frame,
        side: wp.vec2d,
        memory: wp.array[wp.float64],
        cut: CutLoops,
        piece: int,
        sink: sink_type,
        state: state_type,
        starts: bool,
    ):
        """Walk a piece from its first point (on a side or inside) to its last; `starts`: a polyline begins with it."""
        first = entering_segment(table, cut, piece)
        packed = packed_at(table, cut, first)
        k = next_of(packed)
        following = packed_at(table, cut, k)
        p = place_of(f, crossing_of(memory, packed), side, exactly)
        q = place_of(f, crossing_of(memory, following), side, exactly)
        x = p
        if piece < WHOLE:
            x = side_point(side_in(cut.enter_side, piece), p, q, side)
        y = output_point(f, x)
        out = to(sink, state, y, not starts)
        if starts:
            out.first = y
        out.x = y
        out.kind = OBJECT
        segment = int(first)
        while not leaves_with(cut, segment) and k != first:
            out = to(sink, out, output_point(f, q), True)
            p = q
            segment = k
            k = next_of(following)
            following = packed_at(table, cut, k)
            q = place_of(f, crossing_of(memory, following), side, exactly)
        x = q
        if piece < WHOLE:
            x = side_point(side_in(cut.leave_side, piece), p, q, side)
        return to(sink, out, output_point(f, x), True)

    @wp.func
    def walk_corners(sink: sink_type, state: state_type, f: Frame, half: wp.vec2d, joint: PieceJoint, turns: bool):
        """Pass the corners of a joint, if the contour turns there; segments from here on are hand kind."""
        out = state
        if turns:
            out.kind = HAND
        for k in range(joint.corners):
            out = to(sink, out, output_point(f, corner((joint.corner + k) & 3, half)), turns)
            if turns:
                out.kind = HAND
        return out

    @wp.func
    def walk_section(
        table: LoopTable,
        f: Frame,
        side: wp.vec2d,
        memory: wp.array[wp.float64],
        cut: CutLoops,
        closes: int,
        sink: sink_type,
        state: state_type,
    ):
        """Walk a section's polylines; a closed one repeats its first point at its end."""
        out = state
        rest = cut.pieces
        piece = lowest_bit(rest)
        first = int(piece)
        while rest != wp.uint64(0):
            rest = rest & ~bit_of(piece)
            turns = closes == 1 and piece < WHOLE
            closed = closes == 1 or piece >= WHOLE
            out = begin(sink, out, piece == first, closed)
            out = walk_piece(table, f, side, memory, cut, piece, sink, out, piece == first)
            joint = PieceJoint()
            joint.piece = piece
            if turns:
                joint = joint_after(table, f, side, memory, cut, piece, exactly)
            out = walk_corners(sink, out, f, side, joint, turns)
            ends = joint.piece == first
            out = to(sink, out, out.first, ends and turns)
            out = end(sink, out, ends, closed)
            piece = joint.piece
            if ends:
                piece = lowest_bit(rest)
                first = piece
        return boundary(sink, out, f, side, closes == 1 and cut.open_count == 0 and cut.winding > 0)

    return walk_section


count_section = section_walker(int, PointCounter, count_to, begin_count, end_count, count_boundary)
draw_clear_section = section_walker(
    Contours, ClearWriter, write_clear, begin_clear, end_clear, clear_boundary, exact=False
)
draw_section = section_walker(Contours, PolylineWriter, write_to, begin_writing, end_writing, draw_boundary)
add_section = section_walker(int, LengthAccumulator, add_to, begin_sum, end_adding, add_boundary)
