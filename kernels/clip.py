"""Polylines ∩ patch: the pieces strictly inside (OC), and whether the patch's corner 0 is inside the solid."""

import warp as wp

from .patch import BOTTOM, EXACT, LEFT, Patch, corner, crosses, left_of, outcode, side_point
from .ragged import Polylines, empty_polylines, offsets_of

wp.set_module_options(EXACT)

NONE = wp.constant(-1)


@wp.struct
class Passage:
    """Sides by which a segment enters and leaves the patch, -1 for none."""

    enter: int
    leave: int


@wp.func
def passage_of(p: wp.vec2d, q: wp.vec2d, code_p: int, code_q: int, half: wp.vec2d):
    """Sides by which p -> q enters and leaves the patch."""
    t = Passage()
    t.enter = NONE
    t.leave = NONE
    if code_p != code_q and (code_p & code_q) == 0:
        for k in range(4):
            c = crosses(k, p, q, code_p, code_q, half)
            if c == 1:
                t.leave = k
            if c == -1:
                t.enter = k
    return t


@wp.func
def first_entry(lines: Polylines, base: wp.int64, count: int, half: wp.vec2d):
    """Number of the first segment of a loop that enters the patch; -1 if none does, -2 if no point is outside."""
    outside = int(0)
    p = lines.point[base]
    code_p = outcode(p, half)
    for i in range(count):
        q = lines.point[base + wp.int64((i + 1) % count)]
        code_q = outcode(q, half)
        if code_p != 0:
            outside = 1
            t = passage_of(p, q, code_p, code_q, half)
            if t.enter != NONE:
                return i
        p = q
        code_p = code_q
    return outside - 2


@wp.func
def winding_step(p: wp.vec2d, q: wp.vec2d, code_p: int, code_q: int, half: wp.vec2d):
    """What a segment adds to the winding number around corner 0: a ray along side 0's line, away from the patch.

        crosses that line   beyond the corner   adds
        downward            yes                 +1
        upward              yes                 -1
        anything else                            0

    Beyond is decided as `crosses` decides it, so the state at the corner fits the crossings of both its sides.
    """
    if (code_p & BOTTOM) == (code_q & BOTTOM):
        return 0
    downward = (code_q & BOTTOM) != 0
    beyond = (code_p & LEFT) != 0
    if (code_p & LEFT) != (code_q & LEFT):
        beyond = left_of(p, q, corner(0, half)) == downward
    if not beyond:
        return 0
    if downward:
        return 1
    return -1


@wp.kernel
def _count_pieces(
    # In:
    lines: Polylines,
    patch: wp.array[Patch],
    # Out:
    entry: wp.array[wp.int32],  # where to start on each polyline, shape [polyline]
    polyline_count: wp.array[wp.int64],  # shape [section + 1]
    point_count: wp.array[wp.int64],  # shape [section + 1]
    corner_winding: wp.array[wp.int32],  # of the solid around corner 0, shape [section]
):
    """Count the pieces and their points; sum up the winding number around corner 0."""
    section = wp.tid()
    half = patch[section % patch.shape[0]].half
    pieces = int(0)
    points = int(0)
    winding = int(0)
    for line in range(int(lines.section_start[section]), int(lines.section_start[section + 1])):
        base = lines.polyline_start[line]
        count = int(lines.polyline_start[line + 1] - base)
        closed = lines.closed[line] != wp.uint8(0)
        start = int(0)
        if closed:
            start = first_entry(lines, base, count, half)
        entry[line] = start
        steps = count
        if not closed:
            steps = count - 1
        p = lines.point[base]
        code_p = outcode(p, half)
        if code_p == 0:
            points += 1
            if not closed or start == -2:
                pieces += 1
        for i in range(steps):
            q = lines.point[base + wp.int64((i + 1) % count)]
            code_q = outcode(q, half)
            winding += winding_step(p, q, code_p, code_q, half)
            t = passage_of(p, q, code_p, code_q, half)
            if t.enter != NONE:
                pieces += 1
                points += 1
            if t.leave != NONE:
                points += 1
            if code_q == 0 and i + 1 < count:
                points += 1
            p = q
            code_p = code_q
    polyline_count[section] = wp.int64(pieces)
    point_count[section] = wp.int64(points)
    corner_winding[section] = winding


@wp.func
def write_point(out: Polylines, i: wp.int64, p: wp.vec2d, key: int):
    """Write point i; its kind stays object."""
    out.point[i] = p
    out.key[i] = key


@wp.func
def begin_piece(out: Polylines, polyline: wp.int64, i: wp.int64, closed: wp.uint8, enter: int):
    """Begin a piece at point i; the side by which it leaves is not known yet."""
    out.polyline_start[polyline] = i
    out.closed[polyline] = closed
    out.side[polyline] = wp.vec2i(enter, NONE)


@wp.kernel
def _clip_polylines(
    # In:
    lines: Polylines,
    patch: wp.array[Patch],
    edge_count: int,
    entry: wp.array[wp.int32],
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    out: Polylines,
):
    """Write the pieces; a loop is walked from where it enters, so that no piece is split at the loop's start."""
    section = wp.tid()
    half = patch[section % patch.shape[0]].half
    i = point_start[section]
    piece = out.section_start[section]
    for line in range(int(lines.section_start[section]), int(lines.section_start[section + 1])):
        base = lines.polyline_start[line]
        count = int(lines.polyline_start[line + 1] - base)
        start = entry[line]
        steps = int(count)
        if lines.closed[line] == wp.uint8(0):
            steps = count - 1
        elif start == -1:
            steps = 0
        first = base + wp.int64(wp.max(start, 0))
        p = lines.point[first]
        code_p = outcode(p, half)
        if code_p == 0 and (steps > 0 or start == 0):
            begin_piece(out, piece, i, lines.closed[line], NONE)
            write_point(out, i, p, lines.key[first])
            i += wp.int64(1)
            piece += wp.int64(1)
        key_p = lines.key[first]
        for step in range(steps):
            j = base + wp.int64((wp.max(start, 0) + step + 1) % count)
            q = lines.point[j]
            code_q = outcode(q, half)
            t = passage_of(p, q, code_p, code_q, half)
            if t.enter != NONE:
                begin_piece(out, piece, i, wp.uint8(0), t.enter)
                write_point(out, i, side_point(t.enter, p, q, half), edge_count + 2 * key_p)
                i += wp.int64(1)
                piece += wp.int64(1)
            if t.leave != NONE:
                out.side[piece - wp.int64(1)] = wp.vec2i(out.side[piece - wp.int64(1)][0], t.leave)
                write_point(out, i, side_point(t.leave, p, q, half), edge_count + 2 * key_p + 1)
                i += wp.int64(1)
            if code_q == 0 and step + 1 < count:
                write_point(out, i, q, lines.key[j])
                i += wp.int64(1)
            p = q
            code_p = code_q
            key_p = lines.key[j]
    if section == lines.section_start.shape[0] - 2:
        out.polyline_start[piece] = i


def clip_polylines(lines: Polylines, patch: wp.array, edge_count: int) -> tuple[Polylines, wp.array]:
    """Cut polylines by their patches; a point on a patch's side is outside.

    patch: Patch, shape [patch]; edge_count: keys below it are mesh edges.
    Returns the pieces and the solid's winding number around each section's corner 0, int32, shape [section].
    """
    section_count = lines.section_start.shape[0] - 1
    device = lines.closed.device
    entry = wp.empty(lines.closed.shape[0], dtype=wp.int32, device=device)
    pieces = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    points = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    winding = wp.empty(section_count, dtype=wp.int32, device=device)
    wp.launch(
        _count_pieces, section_count, inputs=[lines, patch], outputs=[entry, pieces, points, winding], device=device
    )
    section_start, piece_count = offsets_of(pieces)
    point_start, point_count = offsets_of(points)
    out = empty_polylines(section_start, piece_count, point_count)
    wp.launch(
        _clip_polylines,
        section_count,
        inputs=[lines, patch, edge_count, entry, point_start],
        outputs=[out],
        device=device,
    )
    return out, winding
