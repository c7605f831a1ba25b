"""A segment against a patch: where it enters and leaves, and how it winds around the patch's corner 0."""

import warp as wp

from .patch import BOTTOM, LEFT, blend, corner

NONE = wp.constant(-1)


@wp.func
def left_of(p: wp.vec2d, q: wp.vec2d, c: wp.vec2d):
    """Whether corner c lies to the left of p -> q or on it.

    Monotone in each coordinate of c however it rounds, so the answers at a patch's four corners always fit one line.
    """
    return (q[0] - p[0]) * (c[1] - p[1]) - (q[1] - p[1]) * (c[0] - p[0]) >= wp.float64(0.0)


@wp.func
def crosses(k: int, p: wp.vec2d, q: wp.vec2d, code_p: int, code_q: int, half: wp.vec2d):
    """Whether p -> q crosses side k of the patch: 1 outward, -1 inward, 0 not.

    A segment that passes a corner asks `left_of` about it once for both sides, so it crosses exactly one of them, or
    cuts the corner off by crossing both, or misses both:

        corner between p and q (both sides' bits differ)   side ending in it      side starting in it
        outward                                            crossed if left        crossed if not left
        inward                                             crossed if not left    crossed if left
    """
    side = 1 << k
    if (code_p & side) == (code_q & side):
        return 0
    outward = (code_q & side) != 0
    after = 1 << ((k + 1) % 4)
    before = 1 << ((k + 3) % 4)
    if (code_p & after) != (code_q & after):
        if left_of(p, q, corner((k + 1) % 4, half)) != outward:
            return 0
    elif (code_p & after) != 0:
        return 0
    if (code_p & before) != (code_q & before):
        if left_of(p, q, corner(k, half)) == outward:
            return 0
    elif (code_p & before) != 0:
        return 0
    if outward:
        return 1
    return -1


@wp.func
def side_point(k: int, p: wp.vec2d, q: wp.vec2d, half: wp.vec2d):
    """Where p -> q crosses side k, never beyond its corners [m]."""
    if k == 1 or k == 3:
        x = half[0]
        if k == 3:
            x = -x
        return wp.vec2d(x, wp.clamp(blend(p[1], q[1], p[0] - x, q[0] - x), -half[1], half[1]))
    y = half[1]
    if k == 0:
        y = -y
    return wp.vec2d(wp.clamp(blend(p[0], q[0], p[1] - y, q[1] - y), -half[0], half[0]), y)


@wp.func
def side_position(k: int, p: wp.vec2d):
    """How far along side k a point of it lies, counter-clockwise."""
    if k == 0:
        return p[0]
    if k == 1:
        return p[1]
    if k == 2:
        return -p[0]
    return -p[1]


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
