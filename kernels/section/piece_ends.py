"""Ends of pieces on the patches' sides: where pieces enter and leave, in which order, and which piece follows which."""

import warp as wp

from ..patch import Frame, outcode, output_point
from .half_edges import Surface
from .pieces import CLOSED, ContourPieces, end_side, enter_side, is_listed, leave_side
from .segment_clipping import NONE, side_point, side_position
from .triangle_walk import crossing_after, crossing_at, point_of

BY_KEY = wp.constant(2)  # an order of pieces; 0 and 1: by where they enter, leave

# A link consists of the slot of the piece that the boundary leads to from where this one leaves, and these bits:
FOLLOWER = wp.constant((1 << 24) - 1)  # the slot's
PASSED = wp.constant(24)  # bits above: how many corners the boundary passes on the way
PASSES = wp.constant(15)
NO_CORNERS = wp.constant(15)  # instead of a number: contours are not closed, or the piece is a loop
LOST = wp.constant(28)  # bits above: steps of zero length at the piece's ends
DONE = wp.constant(1 << 30)  # the piece is in a loop that is entered or dropped


@wp.struct
class PieceEnds:
    """Ends of a query's open pieces, sorted along the boundary; scratch, by slot."""

    leaving: wp.array[wp.int32]  # piece, in the order of the places where pieces leave; in the end, by key
    entering: wp.array[wp.int32]  # piece, in the order of the places where pieces enter: `Entries.entry`, until entered
    link: wp.array[wp.int32]
    position: wp.array[wp.vec2d]  # how far along its side each piece enters and leaves [m]
    first: wp.array[wp.vec3]  # first and last point [m], array frame
    last: wp.array[wp.vec3]


@wp.struct
class PieceEnd:
    """Point at which a piece enters or leaves by a side, on a segment p -> q [m]."""

    p: wp.vec2d
    q: wp.vec2d
    at: wp.vec2d


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)];
""")
def slot_int(a: wp.array[wp.int32], i: int) -> int:
    """Entry of a slot, without a look at the index' sign."""


@wp.func_native("""
    a.data[static_cast<unsigned>(i)] = x;
""")
def set_slot_int(a: wp.array[wp.int32], i: int, x: int):
    """Write the entry of a slot."""


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)];
""")
def slot_point(a: wp.array[wp.vec3], i: int) -> wp.vec3:
    """Point of a slot."""


@wp.func_native("""
    a.data[static_cast<unsigned>(i)] = x;
""")
def set_slot_point(a: wp.array[wp.vec3], i: int, x: wp.vec3):
    """Write the point of a slot."""


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)][end];
""")
def end_position(a: wp.array[wp.vec2d], i: int, end: int) -> wp.float64:
    """Position of an end of a slot's piece."""


@wp.func_native("""
    a.data[static_cast<unsigned>(i)][end] = x;
""")
def set_end_position(a: wp.array[wp.vec2d], i: int, end: int, x: wp.float64):
    """Write the position of an end of a slot's piece."""


@wp.func
def corners_after(link: int):
    """Corners that the boundary passes behind a piece; NO_CORNERS for no boundary."""
    return (link >> PASSED) & PASSES


@wp.func
def is_through(pieces: ContourPieces, i: int):
    """Whether an open piece enters and leaves with one segment."""
    side = slot_int(pieces.side, i)
    if enter_side(side) == NONE or leave_side(side) == NONE:
        return False
    return slot_int(pieces.half, i) == slot_int(pieces.out, i)


@wp.func
def is_clear(pieces: ContourPieces, i: int):
    """Whether no step at a piece's ends has zero length, for sure."""
    return (slot_int(pieces.steps, i) & 1) != 0


@wp.func
def piece_end(surface: Surface, f: Frame, half: wp.vec2d, pieces: ContourPieces, i: int, end: int):
    """The end of a piece where it enters (0) or leaves (1) by a side."""
    out = PieceEnd()
    crossing = slot_int(pieces.half, i)
    if end == 1:
        crossing = slot_int(pieces.out, i)
    c = crossing_at(surface, f, crossing)
    out.p = point_of(f, c, half)
    out.q = point_of(f, crossing_after(surface, f, c), half)
    out.at = side_point(end_side(slot_int(pieces.side, i), end), out.p, out.q, half)
    return out


@wp.func
def is_lost(placed: PieceEnd, f: Frame, half: wp.vec2d, side: int, end: int):
    """Whether the step at an end has zero length; side: `ContourPieces.side`.

    The step of a piece that passes through with one segment is that at the end where it leaves.
    """
    inner = placed.q
    if end == 1:
        inner = placed.p
    if outcode(inner, half) != 0:
        if end == 0:
            return False
        inner = side_point(enter_side(side), placed.p, placed.q, half)
    return output_point(f, placed.at) == output_point(f, inner)


@wp.func
def place_end(surface: Surface, f: Frame, half: wp.vec2d, pieces: ContourPieces, i: int, end: int, ends: PieceEnds):
    """Compute where an open piece enters (0) or leaves (1), and whether a step of zero length is lost there."""
    side = slot_int(pieces.side, i)
    if end_side(side, end) != NONE:
        placed = piece_end(surface, f, half, pieces, i, end)
        set_end_position(ends.position, i, end, side_position(end_side(side, end), placed.at))
        if end == 0:
            set_slot_point(ends.first, i, output_point(f, placed.at))
        else:
            set_slot_point(ends.last, i, output_point(f, placed.at))
        if not is_clear(pieces, i):
            if is_lost(placed, f, half, side, end):
                wp.atomic_add(ends.link, i, 1 << LOST)


@wp.func
def steps_most(pieces: ContourPieces, i: int):
    """Number of a piece's steps if none at the patch's sides has zero length."""
    steps = slot_int(pieces.steps, i) >> 1
    if slot_int(pieces.key, i) < CLOSED:
        side = slot_int(pieces.side, i)
        at_sides = wp.where(enter_side(side) != NONE, 1, 0) + wp.where(leave_side(side) != NONE, 1, 0)
        if slot_int(pieces.steps, i) < 2 and is_through(pieces, i):
            at_sides = 1
        steps += at_sides
    return steps


@wp.func
def is_drawable(pieces: ContourPieces, i: int):
    """Whether all points of a piece are those of listed steps, of its last crossing and of where it meets sides."""
    side = slot_int(pieces.side, i)
    return is_listed(side) and (leave_side(side) != NONE or slot_int(pieces.key, i) >= CLOSED)


@wp.func
def comes_before(pieces: ContourPieces, a: int, b: int, by: int, ends: PieceEnds):
    """Whether a piece comes before another: by where they enter or leave, then by key; a, b: their indices."""
    if by != BY_KEY:
        side_a = end_side(slot_int(pieces.side, a), by)
        side_b = end_side(slot_int(pieces.side, b), by)
        if side_a != side_b:
            return side_a < side_b
        one = end_position(ends.position, a, by)
        two = end_position(ends.position, b, by)
        if one != two:
            return one < two
    return slot_int(pieces.key, a) < slot_int(pieces.key, b)


@wp.func
def sort_slots(pieces: ContourPieces, base: int, count: int, by: int, ends: PieceEnds, order: wp.array[wp.int32]):
    """Shell sort of a query's slots, by ends of open pieces only; returns how many there are. For a few it is an
    insertion sort."""
    stride = int(pieces.stride)
    n = int(0)
    for slot in range(count):
        if by == BY_KEY or slot_int(pieces.key, base + slot * stride) < CLOSED:
            set_slot_int(order, base + n * stride, slot)
            n += 1
    gap = int(1)
    while 3 * gap + 3 <= n:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            slot = slot_int(order, base + i * stride)
            place = int(i)
            while place >= gap:
                other = slot_int(order, base + (place - gap) * stride)
                if not comes_before(pieces, base + slot * stride, base + other * stride, by, ends):
                    break
                set_slot_int(order, base + place * stride, other)
                place -= gap
            set_slot_int(order, base + place * stride, slot)
        gap = gap // 3
    return n


@wp.func
def match_ends(pieces: ContourPieces, base: int, count: int, winding: int, ends: PieceEnds):
    """Match leaving and entering ends; returns how many open pieces there are.

    Along the boundary a solid interval begins where a piece leaves and ends where one enters. At corner 0, `winding`
    solid intervals are already open, and the first `winding` entering ends close them. So leaving end k pairs with
    entering end (k + winding) mod n, all ends sorted along the boundary. Pairing uses sort rank, not distances: two
    ends that rounding has swapped still pair, and no spurious corner is inserted between them.
    """
    stride = int(pieces.stride)
    n = sort_slots(pieces, base, count, 1, ends, ends.leaving)
    sort_slots(pieces, base, count, 0, ends, ends.entering)
    for k in range(n):
        own = base + slot_int(ends.leaving, base + k * stride) * stride
        entering = slot_int(ends.entering, base + (k + wp.max(winding, 0)) % n * stride)
        gap = enter_side(slot_int(pieces.side, base + entering * stride)) - leave_side(slot_int(pieces.side, own))
        if k + wp.max(winding, 0) >= n:
            gap += 4
        lost = slot_int(ends.link, own) >> LOST
        set_slot_int(ends.link, own, entering | (wp.max(gap, 0) << PASSED) | (lost << LOST))
    return n
