"""Open pieces joined to closed contours by the patch's boundary, as in `section.joining`, without sorted memory.

A word of sides holds two bits of each piece, at bits 2 p. Pieces are ordered by sides with a few operations on such
words; the place along a side counts only among pieces that have that side in common.
"""

import warp as wp

from ..patch import Coarse, Frame
from ..section.scan_search import CrossingPoint
from ..section.segment_clipping import side_point, side_position
from ..section.triangle_walk import point_of
from .cut_loops import (
    ONE,
    OPEN_BITS,
    CutLoops,
    bit_count,
    bit_of,
    entering_segment,
    leaving_segment,
    lowest_bit,
    packed_at,
    side_in,
)
from .loop_table import LoopTable, crossing_of, next_of
from .side_words import segments_at


@wp.struct
class PieceJoint:
    """The piece and corners to which the boundary leads from a piece's end."""

    piece: int  # the piece that it leads to
    corners: int  # corners of the patch on the way
    corner: int  # the first of them
    clear: int  # 1 if this is surely right


@wp.struct
class JointCounts:
    """Polylines and steps that joints add to a section's open pieces."""

    lines: int  # closed contours
    steps: int  # of non-zero length along the boundary
    clear: int  # 1 if these are surely right, provided that `CutLoops.clear`


@wp.func
def spread_bits(x: wp.uint64):
    """The lower 32 bits, bit p moved to bit 2 p."""
    y = x & OPEN_BITS
    y = (y | (y << wp.uint64(16))) & wp.uint64(0x0000FFFF0000FFFF)
    y = (y | (y << wp.uint64(8))) & wp.uint64(0x00FF00FF00FF00FF)
    y = (y | (y << wp.uint64(4))) & wp.uint64(0x0F0F0F0F0F0F0F0F)
    y = (y | (y << wp.uint64(2))) & wp.uint64(0x3333333333333333)
    return (y | (y << ONE)) & wp.uint64(0x5555555555555555)


@wp.func
def pieces_at(sides: wp.uint64, spread: wp.uint64, side: int):
    """Spread bits of the pieces that have a side."""
    low = wp.where((side & 1) != 0, sides, ~sides)
    return spread & low & (wp.where((side & 2) != 0, sides, ~sides) >> ONE)


@wp.func
def count_before(sides: wp.uint64, spread: wp.uint64, side: int):
    """Number of pieces that have a lower side."""
    high = sides >> ONE
    either = wp.where(side == 1, sides | high, wp.where(side == 2, high, sides & high))
    return wp.where(side == 0, 0, bit_count(spread & ~either))


@wp.func
def end_position(
    table: LoopTable,
    f: Frame,
    half: wp.vec2d,
    memory: wp.array[wp.float64],
    cut: CutLoops,
    piece: int,
    side: int,
    leaving: bool,
):
    """Position along its side at which a piece leaves (or enters) [m]."""
    k = int(0)
    if leaving:
        k = leaving_segment(table, cut, piece)
    else:
        k = entering_segment(table, cut, piece)
    packed = packed_at(table, cut, k)
    p = point_of(f, crossing_of(memory, packed), half)
    q = point_of(f, crossing_of(memory, packed_at(table, cut, next_of(packed))), half)
    return side_position(side, side_point(side, p, q, half))


@wp.func
def rank_at_side(
    table: LoopTable,
    f: Frame,
    half: wp.vec2d,
    memory: wp.array[wp.float64],
    cut: CutLoops,
    pieces: wp.uint64,
    piece: int,
    side: int,
    leaving: bool,
):
    """Number of other pieces at a side (spread bits) that leave (or enter) before a piece; at one place, by number."""
    rank = int(0)
    own = end_position(table, f, half, memory, cut, piece, side, leaving)
    rest = pieces & ~bit_of(2 * piece)
    while rest != wp.uint64(0):
        other = lowest_bit(rest) >> 1
        x = end_position(table, f, half, memory, cut, other, side, leaving)
        if x < own or (x == own and other < piece):
            rank += 1
        rest = rest & (rest - ONE)
    return rank


@wp.func
def joint_after(
    table: LoopTable, f: Frame, half: wp.vec2d, memory: wp.array[wp.float64], cut: CutLoops, piece: int, exact: bool
):
    """The joint after an open piece: leaving end r is paired with entering end r + winding, as in `match_ends`.

    exact: pieces that have a side in common are ordered along it; else the joint is not clear.
    """
    joint = PieceJoint()
    joint.clear = 1
    spread = spread_bits(cut.pieces)
    leave = side_in(cut.leave_side, piece)
    place = count_before(cut.leave_side, spread, leave) + wp.max(cut.winding, 0)
    pieces = pieces_at(cut.leave_side, spread, leave)
    if (pieces & (pieces - ONE)) != wp.uint64(0):
        joint.clear = 0
        if exact:
            place += rank_at_side(table, f, half, memory, cut, pieces, piece, leave, True)
    rank = int(place)
    while rank >= cut.open_count:
        rank -= cut.open_count
    enter = int(0)
    for side in range(1, 4):
        if count_before(cut.enter_side, spread, side) <= rank:
            enter = side
    rank -= count_before(cut.enter_side, spread, enter)
    pieces = pieces_at(cut.enter_side, spread, enter)
    joint.piece = lowest_bit(pieces) >> 1
    if (pieces & (pieces - ONE)) != wp.uint64(0):
        joint.clear = 0
        rest = wp.where(exact, pieces, wp.uint64(0))
        while rest != wp.uint64(0):
            joint.piece = lowest_bit(rest) >> 1
            rest = rest & (rest - ONE)
            if rank_at_side(table, f, half, memory, cut, pieces, joint.piece, enter, False) == rank:
                rest = wp.uint64(0)
    joint.corners = wp.max(enter - leave + wp.where(place >= cut.open_count, 4, 0), 0)
    joint.corner = leave + 1
    if exact:
        joint.clear = 1
    return joint


@wp.func
def side_crossing(table: LoopTable, half: wp.vec2d, memory: wp.array[wp.float64], cut: CutLoops, k: int, side: int):
    """Crossing of segment k with a side, without a division: x / d along the side [m]; y is not set."""
    packed = packed_at(table, cut, k)
    c = crossing_of(memory, packed)
    n = crossing_of(memory, packed_at(table, cut, next_of(packed)))
    upright = (side & 1) != 0
    at = wp.where(upright, half[0], half[1])
    at = wp.where(side == 1 or side == 2, at, -at)
    p = c.upper[2] - c.lower[2]
    px = c.lower[0] * c.upper[2] - c.upper[0] * c.lower[2]
    py = c.lower[1] * c.upper[2] - c.upper[1] * c.lower[2]
    q = n.upper[2] - n.lower[2]
    qx = n.lower[0] * n.upper[2] - n.upper[0] * n.lower[2]
    qy = n.lower[1] * n.upper[2] - n.upper[1] * n.lower[2]
    a = wp.where(upright, px, py) - at * p
    b = wp.where(upright, qx, qy) - at * q
    out = CrossingPoint()
    out.x = wp.where(upright, py, px) * b - wp.where(upright, qy, qx) * a
    out.d = p * b - q * a
    return out


@wp.func
def are_apart(table: LoopTable, g: Coarse, half: wp.vec2d, memory: wp.array[wp.float64], cut: CutLoops):
    """Whether no piece enters, in float32, where one leaves by the same side, if `CutLoops.clear`."""
    c = cut.clipped
    apart = int(1)
    sides = int(0)
    for side in range(4):
        enters = segments_at(c.enters, c.enter_low, c.enter_high, side)
        if enters != wp.uint32(0) and segments_at(c.leaves, c.leave_low, c.leave_high, side) != wp.uint32(0):
            sides = sides | (1 << side)
    while sides != 0:
        side = lowest_bit(wp.uint64(sides))
        sides = sides & (sides - 1)
        leaves = wp.uint64(segments_at(c.leaves, c.leave_low, c.leave_high, side))
        while leaves != wp.uint64(0):
            p = side_crossing(table, half, memory, cut, lowest_bit(leaves), side)
            leaves = leaves & (leaves - ONE)
            rest = wp.uint64(segments_at(c.enters, c.enter_low, c.enter_high, side))
            while rest != wp.uint64(0):
                q = side_crossing(table, half, memory, cut, lowest_bit(rest), side)
                rest = rest & (rest - ONE)
                room = wp.float64(2.0 * g.unsure) * wp.abs(p.d * q.d)  # as in `moves`
                if wp.abs(p.x * q.d - q.x * p.d) <= room:
                    apart = 0
    return apart


@wp.func
def join_counts(
    table: LoopTable, f: Frame, g: Coarse, half: wp.vec2d, memory: wp.array[wp.float64], cut: CutLoops, exact: bool
):
    """Closed contours of the open pieces, and the steps of non-zero length of their joints; exact: as `joint_after`."""
    counts = JointCounts()
    counts.clear = are_apart(table, g, half, memory, cut)
    rest = cut.pieces & OPEN_BITS
    first = lowest_bit(rest)
    piece = int(first)
    while rest != wp.uint64(0):
        rest = rest & ~bit_of(piece)
        joint = joint_after(table, f, half, memory, cut, piece, exact)
        counts.steps += joint.corners + 1
        counts.clear = counts.clear & joint.clear
        if joint.corners == 0 and side_in(cut.enter_side, joint.piece) != side_in(cut.leave_side, piece):
            counts.clear = 0
        piece = joint.piece
        if counts.clear == 0 and not exact:
            rest = wp.uint64(0)
        if piece == first:
            counts.lines += 1
            first = lowest_bit(rest)
            piece = first
    return counts
