"""How the patch's boundary joins open pieces to closed contours: as `section.joining` does, without sorted memory."""

import warp as wp

from ..patch import Frame, output_point
from ..section.segment_clipping import side_point, side_position
from ..section.triangle_walk import point_of
from .cut_loops import (
    ONE,
    OPEN_BITS,
    CutLoops,
    bit_of,
    entering_segment,
    leaving_segment,
    lowest_bit,
    packed_at,
    side_in,
)
from .loop_table import LoopTable, next_of, table_crossing, table_crossing_after


@wp.struct
class PieceJoint:
    """Where the boundary leads from a piece's end."""

    piece: int  # the piece that it leads to
    corners: int  # corners of the patch on the way
    corner: int  # the first of them


@wp.func
def end_of(table: LoopTable, f: Frame, half: wp.vec2d, cut: CutLoops, k: int, side: int):
    """Where segment k crosses a side of the patch [m]."""
    packed = packed_at(table, cut, k)
    c = table_crossing(table, f, packed)
    n = table_crossing_after(table, f, c, packed, packed_at(table, cut, next_of(packed)))
    return side_point(side, point_of(f, c, half), point_of(f, n, half), half)


@wp.func
def position_of(table: LoopTable, f: Frame, half: wp.vec2d, cut: CutLoops, k: int, side: int):
    """How far along a side of the patch segment k crosses it [m]."""
    return side_position(side, end_of(table, f, half, cut, k, side))


@wp.func
def end_precedes(table: LoopTable, f: Frame, half: wp.vec2d, cut: CutLoops, one: int, two: int, leaving: bool):
    """Whether piece `one` leaves (or enters) before piece `two` along the boundary; at one place, by number."""
    a = int(0)
    b = int(0)
    side_a = int(0)
    side_b = int(0)
    if leaving:
        a = leaving_segment(table, cut, one)
        b = leaving_segment(table, cut, two)
        side_a = side_in(cut.leave_side, a)
        side_b = side_in(cut.leave_side, b)
    else:
        a = entering_segment(table, cut, one)
        b = entering_segment(table, cut, two)
        side_a = side_in(cut.enter_side, one)
        side_b = side_in(cut.enter_side, two)
    if side_a != side_b:
        return side_a < side_b
    x = position_of(table, f, half, cut, a, side_a)
    y = position_of(table, f, half, cut, b, side_b)
    if x != y:
        return x < y
    return one < two


@wp.func
def boundary_rank(table: LoopTable, f: Frame, half: wp.vec2d, cut: CutLoops, piece: int, leaving: bool):
    """How many open pieces leave (or enter) before a piece does."""
    rank = int(0)
    rest = (cut.pieces & OPEN_BITS) & ~bit_of(piece)
    while rest != wp.uint64(0):
        if end_precedes(table, f, half, cut, lowest_bit(rest), piece, leaving):
            rank += 1
        rest = rest & (rest - ONE)
    return rank


@wp.func
def joint_after(table: LoopTable, f: Frame, half: wp.vec2d, cut: CutLoops, piece: int):
    """The joint after an open piece: leaving end r is paired with entering end r + winding, as in `match_ends`."""
    joint = PieceJoint()
    joint.piece = piece
    winding = wp.max(cut.winding, 0)
    place = winding
    if cut.open_count > 1:
        place += boundary_rank(table, f, half, cut, piece, True)
        rest = cut.pieces & OPEN_BITS
        while rest != wp.uint64(0):
            candidate = lowest_bit(rest)
            rest = rest & (rest - ONE)
            if boundary_rank(table, f, half, cut, candidate, False) == place % cut.open_count:
                joint.piece = candidate
                rest = wp.uint64(0)
    leave = side_in(cut.leave_side, leaving_segment(table, cut, piece))
    gap = side_in(cut.enter_side, joint.piece) - leave
    joint.corners = wp.max(gap + wp.where(place >= cut.open_count, 4, 0), 0)
    joint.corner = leave + 1
    return joint


@wp.func
def joint_steps(table: LoopTable, f: Frame, half: wp.vec2d, cut: CutLoops, piece: int, joint: PieceJoint):
    """Steps of non-zero length of the joint after a piece, if `CutLoops.clear`."""
    if joint.corners > 0:
        return joint.corners + 1
    side = (joint.corner + 3) % 4
    x = end_of(table, f, half, cut, leaving_segment(table, cut, piece), side)
    enter = side_in(cut.enter_side, joint.piece)
    y = end_of(table, f, half, cut, entering_segment(table, cut, joint.piece), enter)
    return wp.where(output_point(f, x) == output_point(f, y), 0, 1)


@wp.func
def joined_counts(table: LoopTable, f: Frame, half: wp.vec2d, cut: CutLoops):
    """Closed contours of the open pieces, and the steps of non-zero length of their joints, if `CutLoops.clear`."""
    lines = int(0)
    steps = int(0)
    rest = cut.pieces & OPEN_BITS
    first = lowest_bit(rest)
    piece = int(first)
    while rest != wp.uint64(0):
        rest = rest & ~bit_of(piece)
        joint = joint_after(table, f, half, cut, piece)
        steps += joint_steps(table, f, half, cut, piece, joint)
        piece = joint.piece
        if piece == first:
            lines += 1
            first = lowest_bit(rest)
            piece = first
    return lines, steps
