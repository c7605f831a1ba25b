"""A segment against a patch: where it enters and leaves, and how it winds around the patch's corner 0."""

import warp as wp

from ..patch import BOTTOM, LEFT, corner

NONE = wp.constant(-1)
HIGHEST = wp.constant(wp.uint32(0xFFFFAA50))  # bits 2 n: number of the highest bit of n, for n in 0..15


@wp.func
def blend(p: wp.vec2d, q: wp.vec2d, a: wp.float64, b: wp.float64):
    """Point between p and q where what runs from a to b is 0, from the nearer end: exact at both ends."""
    near = wp.abs(a) <= wp.abs(b)
    from_near = wp.where(near, p, q)
    to_far = wp.where(near, q, p) - from_near
    return from_near + (wp.where(near, a, -b) / (a - b)) * to_far


@wp.func
def left_of(p: wp.vec2d, q: wp.vec2d, c: wp.vec2d):
    """Whether corner c lies to the left of p -> q or on it.

    Monotone in each coordinate of c however it rounds, so the answers at a patch's four corners always fit one line.
    """
    return (q[0] - p[0]) * (c[1] - p[1]) - (q[1] - p[1]) * (c[0] - p[0]) >= wp.float64(0.0)


@wp.func
def corners_left(p: wp.vec2d, q: wp.vec2d, half: wp.vec2d):
    """Bit k is set where corner k of the patch lies to the left of p -> q or on it."""
    left = int(0)
    for k in range(4):
        if left_of(p, q, corner(k, half)):
            left = left | (1 << k)
    return left


@wp.func
def bits_after(code: int):
    """Bit k is set where that of side k + 1 is set in a word of sides."""
    return (code >> 1) | ((code & 1) << 3)


@wp.func
def bits_before(code: int):
    """Bit k is set where that of side k - 1 is set in a word of sides."""
    return ((code << 1) & 15) | (code >> 3)


@wp.func
def crossed_sides(code_p: int, code_q: int, left: int):
    """Bits of the sides of the patch that p -> q crosses, if no side has both of its ends beyond itself.

    A segment that passes a corner asks once for both sides whether that is to its left, so it crosses exactly one of
    them, or cuts the corner off by crossing both, or misses both:

        corner between p and q (both sides' bits differ)   side ending in it      side starting in it
        outward                                            crossed if left        crossed if not left
        inward                                             crossed if not left    crossed if left
    """
    apart = code_p ^ code_q
    outward = apart & code_q
    after = bits_after(apart)  # bit k: the corner in which side k ends lies between p and q, if side k does
    before = bits_before(apart)
    ends = (after & ~(bits_after(left) ^ outward)) | ~(after | bits_after(code_p))
    starts = (before & (left ^ outward)) | ~(before | bits_before(code_p))
    return apart & ends & starts


@wp.func
def highest_side(sides: int):
    """The highest side whose bit is set, NONE for none."""
    return wp.where(sides == 0, NONE, int((HIGHEST >> wp.uint32(2 * sides)) & wp.uint32(3)))


@wp.func
def winding_step(code_p: int, code_q: int, left: int):
    """Contribution of a segment to the winding number around corner 0, by a ray along side 0's line, off the patch.

        crosses that line   beyond the corner   adds
        downward            yes                 +1
        upward              yes                 -1
        anything else                            0

    Beyond is decided as `crossed_sides` decides it, so the state at the corner fits the crossings of both its sides.
    """
    if (code_p & BOTTOM) == (code_q & BOTTOM):
        return 0
    downward = (code_q & BOTTOM) != 0
    beyond = (code_p & LEFT) != 0
    if (code_p & LEFT) != (code_q & LEFT):
        beyond = (left & 1 != 0) == downward
    if not beyond:
        return 0
    if downward:
        return 1
    return -1


@wp.struct
class Segment:
    """Result of clipping a contour's segment p -> q at the patch."""

    enter: int  # sides by which it enters and leaves, NONE for none
    leave: int
    winding: int  # what it adds to the winding number around corner 0


@wp.func
def needs_left(code_p: int, code_q: int):
    """Whether what p -> q does depends on the corners to its left: two sides that meet lie between p and q."""
    apart = code_p ^ code_q
    if (code_p & code_q) != 0:
        return (apart & BOTTOM) != 0 and (apart & LEFT) != 0
    return (apart & ((apart << 1) | (apart >> 3))) != 0


@wp.func
def segment_of(code_p: int, code_q: int, left: int):
    """Clip p -> q by its ends' outcodes and, if `needs_left`, by the corners to its left."""
    segment = Segment()
    segment.enter = NONE
    segment.leave = NONE
    if (code_p & code_q) == 0:
        crossed = crossed_sides(code_p, code_q, left)
        segment.leave = highest_side(crossed & code_q)
        segment.enter = highest_side(crossed & code_p)
    segment.winding = winding_step(code_p, code_q, left)
    return segment


@wp.func
def side_point(k: int, p: wp.vec2d, q: wp.vec2d, half: wp.vec2d):
    """Point where p -> q crosses side k, clamped to its corners [m]: that of `blend`, alike for all sides."""
    upright = (k & 1) != 0
    at = wp.where(upright, half[0], half[1])
    most = wp.where(upright, half[1], half[0])
    if k == 0 or k == 3:
        at = -at
    a = wp.where(upright, p[0], p[1]) - at
    b = wp.where(upright, q[0], q[1]) - at
    x = wp.where(upright, p[1], p[0])
    y = wp.where(upright, q[1], q[0])
    near = wp.abs(a) <= wp.abs(b)
    from_near = wp.where(near, x, y)
    to_far = wp.where(near, y, x) - from_near
    along = wp.clamp(from_near + (wp.where(near, a, -b) / (a - b)) * to_far, -most, most)
    return wp.vec2d(wp.where(upright, at, along), wp.where(upright, along, at))


@wp.func
def side_position(k: int, p: wp.vec2d):
    """Position of a point along side k, counter-clockwise [m]."""
    if k == 0:
        return p[0]
    if k == 1:
        return p[1]
    if k == 2:
        return -p[0]
    return -p[1]
