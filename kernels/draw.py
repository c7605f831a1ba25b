"""Ordered pieces -> contours in the array's frame, walked a second time and written."""

from typing import Any, NamedTuple

import warp as wp

from .clip import corners_left, segment_of, side_point
from .close import BEGIN, BOUNDARY, CORNERS, SLOT, Entries, Joined
from .patch import EXACT, Frame, Patch, corner, half_of, lifted, outcode, section_frame
from .piece import CLOSED, Pieces, section_of, start_of
from .ragged import BLOCK
from .surface import OPEN, Surface
from .walk import crossing_after, crossing_at, point_of

wp.set_module_options(EXACT)

OBJECT = 0
HAND = 1
MADE = 2


class Contours(NamedTuple):
    """Device arrays of a contour batch (design: ContourBatch)."""

    points: wp.array  # vec3 [m], array frame, shape [point]
    kind: wp.array  # uint8, shape [point]
    polyline_start: wp.array  # int64, shape [polyline + 1]
    polyline_patch: wp.array  # int32, shape [polyline]
    polyline_closed: wp.array  # uint8, shape [polyline]
    section_start: wp.array  # int64, shape [section + 1]


@wp.struct
class Lines:
    """Where contours are written: see Contours; `kind` comes as OBJECT."""

    points: wp.array[wp.vec3]
    kind: wp.array[wp.uint8]
    polyline_start: wp.array[wp.int64]
    polyline_patch: wp.array[wp.int32]
    polyline_closed: wp.array[wp.uint8]


@wp.struct
class Pen:
    """The last point, not written before the next one is known to differ from it."""

    i: wp.int64  # where it goes
    x: wp.vec3
    kind: int  # of the segment that starts there
    first: wp.vec3  # where its last piece began


@wp.func
def drawn_to(lines: Lines, pen: Pen, y: wp.vec3):
    """The pen at y, its point before written if the way was of some length."""
    out = Pen()
    out.i = pen.i
    if not (pen.x == y):
        lines.points[pen.i] = pen.x
        if pen.kind != OBJECT:
            lines.kind[pen.i] = wp.uint8(pen.kind)
        out.i = pen.i + wp.int64(1)
    out.x = y
    out.kind = OBJECT
    out.first = pen.first
    return out


@wp.func
def finish_line(lines: Lines, i: wp.int64, y: wp.vec3):
    """Write a polyline's last point; its kind repeats the one before."""
    lines.points[i] = y
    lines.kind[i] = lines.kind[i - wp.int64(1)]


@wp.func
def draw_piece(surface: Surface, f: Frame, side: wp.vec2d, half: int, lines: Lines, pen: Pen, starts: bool):
    """Walk a piece from where it enters, or starts, to where it leaves, ends or closes."""
    c = crossing_at(surface, f, half)
    n = crossing_after(surface, f, c)
    p = point_of(c)
    q = point_of(n)
    code_p = outcode(p, side)
    code_q = outcode(q, side)
    x = lifted(f, p)
    if code_p != 0:
        x = lifted(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).enter, p, q, side))
    out = Pen()
    out.i = pen.i
    if not starts:
        out = drawn_to(lines, pen, x)
    out.x = x
    out.kind = OBJECT
    out.first = x
    while code_q == 0 and n.half != OPEN and n.half != half:
        out = drawn_to(lines, out, lifted(f, q))
        p = q
        code_p = code_q
        n = crossing_after(surface, f, n)
        q = point_of(n)
        code_q = outcode(q, side)
    x = lifted(f, q)
    if code_q != 0:
        x = lifted(f, side_point(segment_of(code_p, code_q, corners_left(p, q, side)).leave, p, q, side))
    return drawn_to(lines, out, x)


@wp.func
def draw_corners(lines: Lines, pen: Pen, f: Frame, half: wp.vec2d, first: int, count: int):
    """Lead the pen around corners of the patch; all it draws from here is of the hand's kind."""
    out = pen
    out.kind = HAND
    for k in range(count):
        out = drawn_to(lines, out, lifted(f, corner((first + k) % 4, half)))
        out.kind = HAND
    return out


@wp.func
def begin_line(lines: Lines, line: wp.int64, i: wp.int64, patch: int, closed: bool):
    """Enter a polyline that starts at point i."""
    lines.polyline_start[line] = i
    lines.polyline_patch[line] = patch
    lines.polyline_closed[line] = wp.uint8(0)
    if closed:
        lines.polyline_closed[line] = wp.uint8(1)


@wp.func
def draw_boundary(lines: Lines, f: Frame, half: wp.vec2d, i: wp.int64):
    """The patch's whole boundary as a polyline from point i on."""
    place = wp.int64(i)
    for k in range(5):
        lines.points[place] = lifted(f, corner(k % 4, half))
        lines.kind[place] = wp.uint8(HAND)
        place += wp.int64(1)


@wp.kernel
def _draw_contours(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: Pieces,
    entries: Entries,
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    lines: Lines,
):
    """Write each row's polylines, a closed one with its first point again at its end."""
    row = wp.tid()
    section = section_of(pieces, row)
    own = section % patch.shape[0]
    f = section_frame(pose, patch, section)
    side = half_of(patch[own], bounded)
    base = start_of(pieces, row)
    line = section_start[section]
    pen = Pen()
    pen.i = point_start[section]
    first = wp.vec3()
    count = entries.count[row] & (BOUNDARY - 1)
    for e in range(count):
        code = entries.entry[base + wp.int64(e) * pieces.stride]
        slot = base + wp.int64(code & SLOT) * pieces.stride
        whole = pieces.key[slot] >= CLOSED
        begins = (code & BEGIN) != 0
        if begins:
            begin_line(lines, line, pen.i, own, whole or closes == 1)
            line += wp.int64(1)
        pen = draw_piece(surface, f, side, pieces.half[slot], lines, pen, begins)
        if begins:
            first = pen.first
        if closes == 1 and not whole:
            pen = draw_corners(lines, pen, f, side, pieces.side[slot][1] + 1, code >> CORNERS)
        ends = e + 1 == count
        if not ends:
            ends = (entries.entry[base + wp.int64(e + 1) * pieces.stride] & BEGIN) != 0
        if ends:
            if closes == 1:
                pen = drawn_to(lines, pen, first)
            finish_line(lines, pen.i, pen.x)
            pen.i += wp.int64(1)
    if entries.count[row] >= BOUNDARY:
        begin_line(lines, line, pen.i, own, True)
        draw_boundary(lines, f, side, pen.i)
    if section == section_start.shape[0] - 2:
        lines.polyline_start[section_start[section + 1]] = point_start[section + 1]


def draw_contours(
    surface: Any, pose: wp.array, patch: wp.array, joined: Joined, *, bounded: bool, closes: bool
) -> Contours:
    """Write what `join_pieces` ordered and counted, with the same arguments as there and in `find_pieces`."""
    device = pose.device
    out = Contours(
        points=wp.empty(joined.point_count, dtype=wp.vec3, device=device),
        kind=wp.zeros(joined.point_count, dtype=wp.uint8, device=device),
        polyline_start=(wp.empty if pose.shape[0] else wp.zeros)(
            joined.polyline_count + 1, dtype=wp.int64, device=device
        ),
        polyline_patch=wp.empty(joined.polyline_count, dtype=wp.int32, device=device),
        polyline_closed=wp.empty(joined.polyline_count, dtype=wp.uint8, device=device),
        section_start=joined.section_start,
    )
    lines = Lines()
    lines.points, lines.kind, lines.polyline_start = out.points, out.kind, out.polyline_start
    lines.polyline_patch, lines.polyline_closed = out.polyline_patch, out.polyline_closed
    for pieces, entries in joined.rows:
        inputs = [surface, pose, patch, pieces, entries, int(bounded), int(closes)]
        wp.launch(
            _draw_contours,
            pieces.count.shape[0],
            inputs=[*inputs, joined.section_start, joined.point_start],
            outputs=[lines],
            device=device,
            block_dim=BLOCK,
        )
    return out
