"""Links between listed crossings of a section: which one comes next on the contour, and where pieces begin and end."""

import warp as wp

from ..patch import Coarse, Frame, is_above, outcode, output_point
from .edge_pairing import OPEN
from .flat_crossings import CrossingLists, LaneSpace
from .half_edges import Surface
from .segment_clipping import NONE, corners_left, segment_of
from .triangle_walk import (
    crossing_after,
    crossing_at,
    half_after,
    half_before,
    link_of,
    load_vec4,
    point_of,
    vertex_of,
)

ACTIVE = wp.constant(1)  # bits of a crossing: it lies on a piece
FIRST = wp.constant(2)  # its piece begins with it
LAST = wp.constant(4)  # its piece ends in the triangle that it enters
STEP = wp.constant(8)  # the step from it to the next crossing inside the patch has non-zero length
ASTRAY = wp.constant(16)  # nothing comes before it, yet no piece begins with it: it lies on none
LOOP = wp.constant(32)  # it lies on a loop
OUTCODE = wp.constant(15)  # bits with a crossing's point: the outcode in its patch
FROM_OPEN = wp.constant(16)  # it lies on an open edge
TO_OPEN = wp.constant(32)  # the next crossing lies on an open edge


@wp.struct
class CrossingSpan:
    """A section's crossings, and its group's memory for them."""

    start: wp.int64  # in `CrossingLists.half`
    count: int
    bits: int  # start, in `LaneSpace.word`, of the crossings' bits; before they are linked, places of the next ones
    before: int  # start, in `LaneSpace.word`, of 2 * (place of the crossing before) + (length of the step not zero)
    state: int  # start in `LaneSpace.state` and `LaneSpace.point`


@wp.func
def place_of(lists: CrossingLists, s: CrossingSpan, half: int):
    """Place of the crossing of the half-edge's triangle in a section's list; NONE if it is not listed."""
    low = int(0)
    high = int(s.count)
    while low < high:
        middle = (low + high) // 2
        if lists.half[s.start + wp.int64(middle)] < half:
            low = middle + 1
        else:
            high = middle
    if low < s.count:
        if lists.half[s.start + wp.int64(low)] == half:
            return low
    return NONE


@wp.func
def place_crossing(
    surface: Surface,
    f: Frame,
    g: Coarse,
    side: wp.vec2d,
    lists: CrossingLists,
    s: CrossingSpan,
    space: LaneSpace,
    i: int,
):
    """Compute a crossing's output point, outcode and the place of the next crossing, before crossings are linked."""
    half = lists.half[s.start + wp.int64(i)]
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
        place = place_of(lists, s, following >> 1)
    x = output_point(f, p)
    space.point[s.state + i] = wp.vec4(x[0], x[1], x[2], wp.cast(bits, wp.float32))
    space.word[s.bits + i] = place
    space.word[s.before + i] = NONE


@wp.func
def side_entered(surface: Surface, f: Frame, side: wp.vec2d, half: int, leaves: bool):
    """The side by which the segment from a half-edge's crossing enters the patch, or leaves it; NONE for none."""
    c = crossing_at(surface, f, half)
    p = point_of(f, c, side)
    q = point_of(f, crossing_after(surface, f, c), side)
    clipped = segment_of(outcode(p, side), outcode(q, side), corners_left(p, q, side))
    if leaves:
        return clipped.leave
    return clipped.enter


@wp.func
def steps_to_open(surface: Surface, f: Frame, side: wp.vec2d, half: int):
    """Whether the step from a half-edge's crossing, inside, to one at an open edge stays inside and is not zero."""
    c = crossing_at(surface, f, half)
    p = point_of(f, c, side)
    q = point_of(f, crossing_after(surface, f, c), side)
    return outcode(q, side) == 0 and not (output_point(f, p) == output_point(f, q))


@wp.func
def link_crossing(
    surface: Surface, f: Frame, side: wp.vec2d, lists: CrossingLists, s: CrossingSpan, space: LaneSpace, i: int
):
    """Compute the bits of a crossing, and tell the next one what comes before it.

    The next crossing's point is that which its own lane computed: both have the same vertices. One that is not listed
    lies outside the patch, or at an open edge.
    """
    own = space.point[s.state + i]
    place = space.word[s.bits + i]
    code = link_of(own) & OUTCODE
    code_next = int(OUTCODE)
    step = int(0)
    if place != NONE:
        following = space.point[s.state + place]
        code_next = link_of(following) & OUTCODE
        if code == 0 and code_next == 0 and not (vertex_of(own) == vertex_of(following)):
            step = 1
    bits = int(0)
    half = lists.half[s.start + wp.int64(i)]
    if code == 0:
        bits = ACTIVE
        if (link_of(own) & FROM_OPEN) != 0:
            bits = ACTIVE | FIRST
        if (link_of(own) & TO_OPEN) != 0:
            if steps_to_open(surface, f, side, half):
                step = 1
    elif place == NONE or (code & code_next) == 0:
        if side_entered(surface, f, side, half, False) != NONE:
            bits = ACTIVE | FIRST
    if bits != 0:
        if step == 1:
            bits = bits | STEP
        if code_next == 0:
            space.word[s.before + place] = 2 * i + step
        else:
            bits = bits | LAST
    space.word[s.bits + i] = bits
