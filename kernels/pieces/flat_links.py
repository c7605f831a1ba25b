"""Links between listed crossings of a section: which one comes next on the contour, and where pieces begin and end."""

import warp as wp

from ..patch import Coarse, Frame, is_above, outcode, output_point
from ..section.edge_pairing import OPEN
from ..section.half_edges import Surface
from ..section.segment_clipping import NONE, corners_left, needs_left, segment_of
from ..section.triangle_walk import (
    crossing_after,
    crossing_at,
    half_after,
    half_before,
    link_of,
    load_vec4,
    point_of,
    vertex_of,
)
from .lane_space import LaneSpace, begin_at, half_at, link_at, set_begin, set_link, set_state, state_at

OUTCODE = wp.constant(15)  # bits of a link: the outcode of the crossing in its patch
FIRST = wp.constant(16)  # its piece begins with it
LAST = wp.constant(32)  # its piece ends in the triangle that it enters
STEP = wp.constant(64)  # the step from it to the next crossing inside the patch has non-zero length
INSIDE = wp.constant(128)  # it lies on a piece, and so does the next crossing, which is inside the patch
STEP_BITS = wp.constant(16 + 32 + 64 + 128)  # FIRST, LAST, STEP and INSIDE
ASTRAY = wp.constant(256)  # nothing comes before it, yet no piece begins with it: it lies on none
LOOP = wp.constant(512)  # it lies on a loop
ASKS = wp.constant(1024)  # not in a link: the points of its step decide what its other bits are
FROM_OPEN = wp.constant(16)  # bits before crossings are linked: it lies on an open edge
TO_OPEN = wp.constant(32)  # the next crossing lies on an open edge
PLACE = wp.constant(10)  # bits below the place of the next crossing, plus 1: 0 for none
CROSSINGS_MOST = 2 ** (31 - 10) - 4  # of a section, so that a link has room for any place; a multiple of EVEN


@wp.func
def next_of(link: int):
    """Place of the next crossing in a section's list; NONE if it is not listed."""
    return (link >> PLACE) - 1


@wp.func
def place_of(s: LaneSpace, count: int, half: int, stride: int):
    """Place of the crossing of the half-edge's triangle in a section's list; NONE if it is not listed.

    stride: a power of 2 of which twice is more than the count. All lanes take as many steps.
    """
    place = int(0)  # so many half-edges are lower, at least
    step = int(stride)
    while step > 0:
        probe = wp.min(place + step, count)
        place = wp.where(half_at(s, probe - 1) < half, probe, place)
        step = step >> 1
    if place < count:
        if half_at(s, place) == half:
            return place
    return NONE


@wp.func
def point_at(s: LaneSpace, i: int):
    """A crossing's output point."""
    state = state_at(s, i)
    x = wp.cast(wp.int32(state), wp.float32)
    y = wp.cast(wp.int32(state >> wp.int64(32)), wp.float32)
    return wp.vec3(x, y, wp.cast(begin_at(s, i), wp.float32))


@wp.func
def place_crossing(
    surface: Surface, f: Frame, g: Coarse, side: wp.vec2d, s: LaneSpace, count: int, stride: int, i: int
):
    """Compute a crossing's output point, outcode and the place of the next crossing, before crossings are linked.

    stride: see `place_of`.
    """
    half = half_at(s, i)
    p = point_of(f, crossing_at(surface, f, half), side)
    bits = outcode(p, side)
    if link_of(load_vec4(surface.corner, half)) == OPEN:
        bits = bits | FROM_OPEN
    before = half_before(half)
    third = vertex_of(load_vec4(surface.corner, before))
    following = link_of(load_vec4(surface.corner, wp.where(is_above(f, g, third), half_after(half), before)))
    place = int(NONE)
    if following == OPEN:
        bits = bits | TO_OPEN
    else:
        place = place_of(s, count, following >> 1, stride)
    x = output_point(f, p)  # stored where the crossing's state and its beginning will be
    set_state(s, i, (wp.int64(wp.cast(x[1], wp.int32)) << wp.int64(32)) | (wp.int64(wp.cast(x[0], wp.uint32))))
    set_begin(s, i, wp.cast(x[2], wp.int32))
    set_link(s, i, ((place + 1) << PLACE) | bits)


@wp.func
def sides_of(surface: Surface, f: Frame, side: wp.vec2d, half: int, out: int):
    """The side by which the segment from the crossing of `half` enters the patch, and that by which the segment from
    the crossing of `out` leaves it; NONE for none."""
    enter = int(NONE)
    leave = int(NONE)
    k = int(0)
    while k < 2:  # a loop keeps the code short
        c = crossing_at(surface, f, wp.where(k == 0, half, out))
        p = point_of(f, c, side)
        q = point_of(f, crossing_after(surface, f, c), side)
        clipped = segment_of(outcode(p, side), outcode(q, side), corners_left(p, q, side))
        if k == 0:
            enter = clipped.enter
        leave = clipped.leave
        k += 1
    return wp.vec2i(enter, leave)


@wp.func
def link_crossing(s: LaneSpace, i: int):
    """Complete the link of a crossing: whether its piece begins or ends with it, and whether its step counts.

    The next crossing's point is that which its own lane computed: both have the same vertices. One that is not listed
    lies outside the patch, or at an open edge. Lanes may complete links that others read, who look at the outcode only.
    Returns the bits of FIRST to STEP; ASKS, if `link_by_points` is to find them.
    """
    own = link_at(s, i)
    place = next_of(own)
    code = own & OUTCODE
    code_next = int(OUTCODE)
    bits = int(0)
    if place != NONE:
        code_next = link_at(s, place) & OUTCODE
    if code == 0:
        bits = wp.where((own & FROM_OPEN) != 0, FIRST, 0)
        if code_next == 0:
            bits = bits | wp.where(point_at(s, i) == point_at(s, place), INSIDE, INSIDE | STEP)
        else:
            bits = bits | LAST
        if (own & TO_OPEN) != 0:
            bits = bits | ASKS
    elif place == NONE:
        bits = ASKS
    elif needs_left(code, code_next):
        bits = wp.where((code & code_next) == 0, ASKS, 0)
    elif segment_of(code, code_next, 0).enter != NONE:
        bits = first_bits(code_next)
    set_link(s, i, (own & ~STEP_BITS) | (bits & ~ASKS))
    return bits


@wp.func
def first_bits(code_next: int):
    """Bits of the link of a crossing outside the patch whose step enters it."""
    return FIRST | wp.where(code_next == 0, INSIDE, LAST)


@wp.func
def link_by_points(surface: Surface, f: Frame, side: wp.vec2d, s: LaneSpace, i: int):
    """Complete the link of a crossing that asks for the points of its step; returns the bits of FIRST to STEP."""
    own = link_at(s, i)
    place = next_of(own)
    code = own & OUTCODE
    bits = own & STEP_BITS
    c = crossing_at(surface, f, half_at(s, i))
    p = point_of(f, c, side)
    q = point_of(f, crossing_after(surface, f, c), side)
    if code != 0:
        if segment_of(code, outcode(q, side), corners_left(p, q, side)).enter != NONE:
            code_next = int(OUTCODE)
            if place != NONE:
                code_next = link_at(s, place) & OUTCODE
            bits = first_bits(code_next)
    elif outcode(q, side) == 0 and not (output_point(f, p) == output_point(f, q)):
        bits = bits | STEP
    set_link(s, i, (own & ~STEP_BITS) | bits)
    return bits
