"""A section's loops cut by its patch: which segments enter and which leave, as bits of words.

A thread keeps the words of a section in registers, and a section's four words in memory are all that the launch which
writes points gets from the launch that counts them.
"""

import warp as wp

from ..patch import Coarse, Frame, output_point
from ..section.scan_search import CrossingPoint, crossing_point, point_if_clear
from ..section.segment_clipping import NONE, corners_left, needs_left, segment_of, side_point
from ..section.triangle_walk import point_of
from .loop_table import CROSSING_BITS, KEY, PLACE, LoopTable, crossing_of, next_of, place_vertices
from .side_words import (
    ClippedSegments,
    SideWords,
    clip_segments,
    mark_corners,
    mark_crossing,
    side_at,
    unit_of,
    word_if,
)

WHOLE = wp.constant(32)  # number of the piece that is all of the loop which begins with crossing 0
OPEN_BITS = wp.constant(wp.uint64(0xFFFFFFFF))
ONE = wp.constant(wp.uint64(1))
SIDE_BITS = wp.constant(wp.uint64(3))


@wp.struct
class CutLoops:
    """Cuts of a section's loops by a patch. Segment k runs from crossing k to the next one of its loop.

    Pieces are numbered as they are drawn: piece p < WHOLE enters with the segment whose crossing has key p, piece
    WHOLE + k is the loop that begins with crossing k and stays inside.
    """

    begin: int  # of the pattern's crossings in the table
    pieces: wp.uint64  # bit p: piece p is there
    enter_side: wp.uint64  # patch side by which piece p enters, in bits 2 p
    leave_side: wp.uint64  # patch side by which piece p leaves, in bits 2 p
    open_count: int  # pieces that enter
    winding: int  # of the solid around the patch's corner 0
    steps: int  # of non-zero length between crossings inside
    clipped: ClippedSegments  # without winding
    clear: int  # 1 if the ends of open pieces surely differ, in float32, from the crossings and corners beside them


# The fourth word of a section in memory: which segments leave, and from these bits on other numbers of CutLoops.
BEGIN_SHIFT, WINDING_SHIFT, EXACT_SHIFT = (wp.constant(wp.uint64(bit)) for bit in (32, 52, 58))
BEGIN_BITS, COUNT_BITS = wp.constant(wp.uint64(0xFFFFF)), wp.constant(wp.uint64(63))


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __ffsll(static_cast<long long>(x)) - 1;
#else
    return x == 0 ? -1 : __builtin_ctzll(x);
#endif
""")
def lowest_bit(x: wp.uint64) -> int:
    """Number of the lowest bit that is set, -1 for none."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __popcll(x);
#else
    return __builtin_popcountll(x);
#endif
""")
def bit_count(x: wp.uint64) -> int:
    """Number of bits that are set."""


@wp.func
def bit_of(k: int):
    """The word in which only bit k is set."""
    return ONE << wp.uint64(k)


@wp.func
def store_cut(word: wp.array2d[wp.uint64], section: int, cut: CutLoops, exact: bool):
    """Write what drawing needs of a section's cut loops, shape [4, section]; exact: whether `cut_loops` was."""
    word[0, section] = cut.pieces
    word[1, section] = cut.enter_side
    word[2, section] = cut.leave_side
    numbers = wp.uint64(cut.begin) << BEGIN_SHIFT | wp.uint64(wp.max(cut.winding, 0)) << WINDING_SHIFT
    word[3, section] = wp.uint64(cut.clipped.leaves) | numbers | wp.uint64(wp.where(exact, 1, 0)) << EXACT_SHIFT


@wp.func
def is_drawn_exactly(word: wp.array2d[wp.uint64], section: int):
    """Whether a section's cut loops must be drawn exactly, too."""
    return (word[3, section] >> EXACT_SHIFT) != wp.uint64(0)


@wp.func
def stored_cut(word: wp.array2d[wp.uint64], section: int):
    """The cut loops that `store_cut` wrote."""
    cut = CutLoops()
    cut.pieces = word[0, section]
    cut.enter_side = word[1, section]
    cut.leave_side = word[2, section]
    last = word[3, section]
    cut.clipped.leaves = wp.uint32(last & OPEN_BITS)
    cut.begin = int((last >> BEGIN_SHIFT) & BEGIN_BITS)
    cut.winding = int((last >> WINDING_SHIFT) & COUNT_BITS)
    cut.open_count = bit_count(cut.pieces & OPEN_BITS)
    return cut


@wp.func
def packed_at(table: LoopTable, cut: CutLoops, k: int):
    """Crossing k of a section, packed."""
    return table.crossing[cut.begin + k]


@wp.func
def entering_segment(table: LoopTable, cut: CutLoops, piece: int):
    """Segment with which a piece begins."""
    if piece >= WHOLE:
        return piece - WHOLE
    return (packed_at(table, cut, piece) >> PLACE) & CROSSING_BITS


@wp.func
def leaves_with(cut: CutLoops, k: int):
    """Whether a piece ends with segment k."""
    return (cut.clipped.leaves & unit_of(k)) != wp.uint32(0)


@wp.func
def leaving_segment(table: LoopTable, cut: CutLoops, piece: int):
    """Segment with which an open piece ends."""
    k = entering_segment(table, cut, piece)
    while not leaves_with(cut, k):
        k = next_of(packed_at(table, cut, k))
    return k


@wp.func
def side_in(sides: wp.uint64, k: int):
    """Patch side that a word of two bits each holds for k."""
    return int((sides >> wp.uint64(2 * k)) & SIDE_BITS)


@wp.func
def side_bits(side: int, k: int):
    """The word in which k's two bits hold a patch side."""
    return wp.uint64(side) << wp.uint64(2 * k)


@wp.func
def is_near_corner(p: wp.vec2d, q: wp.vec2d, k: int, side: wp.vec2d, room: wp.float64):
    """Whether p -> q crosses side k at most `room` from a corner of the patch; not if k is NONE."""
    if k == NONE:
        return False
    x = side_point(k, p, q, side)
    return wp.abs(x[0]) >= side[0] - room and wp.abs(x[1]) >= side[1] - room


@wp.struct
class PassedCorners:
    """Corners of the patch that a segment passes."""

    left: int  # bits of those to its left, or on it
    clear: int  # not 0: where it enters and leaves, it surely differs in float32 from them and from its crossings


@wp.func
def pass_exactly(
    memory: wp.array[wp.float64],
    f: Frame,
    g: Coarse,
    side: wp.vec2d,
    one: int,
    p_code: int,
    two: int,
    q_code: int,
    clear: int,
):
    """The same from the ends' exact points; one, two: its packed crossings; clear: whether these are clear of sides."""
    out = PassedCorners()
    p = point_of(f, crossing_of(memory, one), side)
    q = point_of(f, crossing_of(memory, two), side)
    out.left = corners_left(p, q, side)
    if clear != 0:
        room = wp.float64(2.0 * g.unsure)  # as in `moves`
        s = segment_of(p_code, q_code, out.left)
        if not (is_near_corner(p, q, s.enter, side, room) or is_near_corner(p, q, s.leave, side, room)):
            out.clear = clear
    return out


@wp.func
def pass_corners(
    memory: wp.array[wp.float64],
    f: Frame,
    g: Coarse,
    side: wp.vec2d,
    one: int,
    p: CrossingPoint,
    two: int,
    q: CrossingPoint,
    exact: bool,
):
    """Corners that p -> q passes, packed in `one` and `two`: without a division, if it surely misses all of them.

    The determinant of p, q and a corner is the corner's distance from p -> q times that segment's length, times both
    d. If it exceeds `room` times the root of 2 for each corner, the segment meets no side within `room` of one; and
    points that are clear of sides are not moved onto them, so that rounding does not change its sign.
    """
    a = p.y * q.d - q.y * p.d
    b = q.x * p.d - p.x * q.d
    c = p.x * q.y - p.y * q.x
    u = side[0] * a
    v = side[1] * b
    zero = wp.float64(0.0)
    out = PassedCorners()
    out.clear = p.clear & q.clear
    out.left = wp.where(c - u - v >= zero, 1, 0) + wp.where(c + u - v >= zero, 2, 0)
    out.left += wp.where(c + u + v >= zero, 4, 0) + wp.where(c - u + v >= zero, 8, 0)
    least = wp.min(wp.abs(wp.abs(c - v) - wp.abs(u)), wp.abs(wp.abs(c + v) - wp.abs(u)))
    if out.clear == 0 or least <= wp.float64(3.0 * g.unsure) * (wp.abs(a) + wp.abs(b)):  # rare
        out.clear = 0
        if exact:
            out = pass_exactly(memory, f, g, side, one, p.code, two, q.code, p.clear & q.clear)
    return out


@wp.func
def cut_crossing(memory: wp.array[wp.float64], f: Frame, g: Coarse, side: wp.vec2d, packed: int, exact: bool):
    """The point of a packed crossing; its outcode is right if it is clear or `exact`."""
    c = crossing_of(memory, packed)
    if exact:
        return crossing_point(f, g, c, side)
    return point_if_clear(g, c, side)


@wp.func
def add_pieces(table: LoopTable, cut: CutLoops, loop: ClippedSegments):
    """Add the open pieces of a loop: one begins with each segment that enters, and ends with the next that leaves."""
    out = cut
    rest = wp.uint64(loop.enters)
    while rest != wp.uint64(0):
        k = lowest_bit(rest)
        rest = rest & (rest - ONE)
        piece = (packed_at(table, cut, k) >> KEY) & CROSSING_BITS
        ahead = (loop.leaves >> wp.uint32(k)) << wp.uint32(k)
        leaving = lowest_bit(wp.uint64(wp.where(ahead != wp.uint32(0), ahead, loop.leaves)))
        out.pieces = out.pieces | bit_of(piece)
        out.enter_side = out.enter_side | side_bits(side_at(loop.enter_low, loop.enter_high, k), piece)
        out.leave_side = out.leave_side | side_bits(side_at(loop.leave_low, loop.leave_high, leaving), piece)
    return out


@wp.func
def add_loop(table: LoopTable, cut: CutLoops, words: SideWords, first: int, last: int, steps: int, exact: bool):
    """Clip the loop of crossings first..last, which has so many steps inside, and add what comes of it."""
    out = cut
    outside = words.bottom | words.right | words.top | words.left
    if outside == wp.uint32(0) and steps > 0:
        out.pieces = cut.pieces | bit_of(WHOLE + first)
    if outside != wp.uint32(0):
        loop = clip_segments(words, first, last)
        out = add_pieces(table, cut, loop)
        out.clipped.enters = cut.clipped.enters | loop.enters
        out.clipped.enter_low = cut.clipped.enter_low | loop.enter_low
        out.clipped.enter_high = cut.clipped.enter_high | loop.enter_high
        out.clipped.leaves = cut.clipped.leaves | loop.leaves
        out.clipped.leave_low = cut.clipped.leave_low | loop.leave_low
        out.clipped.leave_high = cut.clipped.leave_high | loop.leave_high
        out.winding = cut.winding + bit_count(wp.uint64(loop.ahead)) - bit_count(wp.uint64(loop.back))
        if exact and (words.unclear & (loop.enters | loop.leaves)) != wp.uint32(0):
            out.clear = 0
    if not exact and words.unclear != wp.uint32(0):
        out.clear = 0
    out.steps = cut.steps + steps
    return out


@wp.func
def cut_loops(table: LoopTable, f: Frame, g: Coarse, side: wp.vec2d, memory: wp.array[wp.float64], exact: bool):
    """Cut the loops of a section, and count its steps. Loops inside of no length are left out.

    exact: all but `CutLoops.clear` are right; else they are right if that is 1, and no branch is long.
    """
    cut = CutLoops()
    pattern = place_vertices(table, f, memory)
    cut.begin = table.start[pattern]
    count = table.start[pattern + 1] - cut.begin
    cut.clear = 1
    k = int(0)
    while k < count:
        first = k
        packed = packed_at(table, cut, k)
        p = cut_crossing(memory, f, g, side, packed, exact)
        words = SideWords()
        steps = int(0)
        goes_on = int(1)
        while goes_on == 1:
            onward = next_of(packed)
            following = packed_at(table, cut, onward)
            q = cut_crossing(memory, f, g, side, following, exact)
            bit = unit_of(k)
            words = mark_crossing(words, bit, p.code)
            clear = p.clear & q.clear
            if (p.code | q.code) == 0:
                room = wp.float64(2.0 * g.unsure) * p.d * q.d  # two points farther apart surely differ in float32
                if wp.abs(p.x * q.d - q.x * p.d) > room or wp.abs(p.y * q.d - q.y * p.d) > room:
                    steps += 1
                elif exact:
                    x = output_point(f, point_of(f, crossing_of(memory, packed), side))
                    if not (x == output_point(f, point_of(f, crossing_of(memory, following), side))):
                        steps += 1
                else:
                    clear = 0
            elif needs_left(p.code, q.code):
                passed = pass_corners(memory, f, g, side, packed, p, following, q, exact)
                words = mark_corners(words, bit, passed.left)
                clear = passed.clear
            words.unclear = words.unclear | word_if(clear == 0, bit)
            goes_on = wp.where(onward > k, 1, 0)
            k += 1
            p = q
            packed = following
        cut = add_loop(table, cut, words, first, k - 1, steps, exact)
    cut.open_count = bit_count(cut.pieces & OPEN_BITS)
    return cut
