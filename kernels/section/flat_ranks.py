"""Pieces from listed crossings: the lanes of a group link a section's crossings, and rank them along their chains.

A link says which crossing comes next on the contour, and whether pieces begin or end there. Ranks come from pointer
jumping: each crossing knows one that comes before it in its chain, and how many steps of non-zero length lie between.
A jump replaces that crossing by the one which it knows itself. So every crossing of a chain of n knows the chain's
first one after log4(n) rounds of three jumps. A loop inside the patch has no first crossing: rounds that pass on the
lowest rank find it, and then the loop is ranked as a chain from there.
"""

from typing import Any

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, Coarse, Frame, Patch, coarse_frame, half_extents, is_above, outcode, output_point
from .clip import NONE, corners_left, needs_left, segment_of
from .flat_space import (
    NEAR_FEW,
    NEAR_MANY,
    RANKS,
    STORED,
    LaneSpace,
    QueryBlock,
    address_of_few,
    address_of_many,
    begin_at,
    far_space,
    half_at,
    link_at,
    near_space,
    note_lacking,
    set_begin,
    set_half,
    set_link,
    set_state,
    state_at,
)
from .half_edges import OPEN, Surface
from .lanes import any_lane, claim_query, lane_count, sync_lanes
from .pieces import CLOSED, UNLISTED, ContourPieces, section_of, sides_word, start_of, store_piece
from .walk import crossing_after, crossing_at, half_after, half_before, link_of, load_vec4, point_of, vertex_of

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


MANY_LANES = 128  # of a group, which are the threads of a GPU block
OTHER_BLOCKS = {f"{__name__}.many": MANY_LANES}  # a Warp module of its own: all kernels of one have blocks of one size
(MANY,) = OTHER_BLOCKS
RANK_MOST = wp.constant(0x7FFFFFFF)
JUMPS = wp.constant(3)  # of a round
TURNS_MOST = wp.constant(31)  # bits of a word

wp.set_module_options(EXACT)
wp.set_module_options(EXACT, MANY)


@wp.func
def packed(high: int, low: int):
    """Two numbers >= 0 in one state, which lanes read and write at once."""
    return (wp.int64(high) << wp.int64(32)) | wp.int64(low)


@wp.func
def high_of(state: wp.int64):
    """The first number of `packed`."""
    return int(state >> wp.int64(32))


@wp.func
def low_of(state: wp.int64):
    """The second number of `packed`."""
    return int(state & wp.int64(RANK_MOST))


@wp.func
def begin_ranks(s: LaneSpace, count: int, lane: int, lanes: int):
    """Begin with what comes directly before a crossing, or with itself where a chain begins."""
    i = int(lane)
    while i < count:
        set_state(s, i, packed(i, 0))
        i += lanes
    sync_lanes()
    i = lane
    while i < count:
        link = link_at(s, i)
        if (link & INSIDE) != 0:
            set_state(s, next_of(link), packed(i, wp.where((link & STEP) != 0, 1, 0)))
        i += lanes
    sync_lanes()
    i = lane
    while i < count:
        link = link_at(s, i)
        if (link & FIRST) == 0 and high_of(state_at(s, i)) == i:
            set_link(s, i, link | ASTRAY)
        i += lanes


@wp.func
def jump(s: LaneSpace, count: int, lane: int, lanes: int):
    """Rounds of pointer jumping, until all crossings of chains know the first one of theirs.

    A round makes JUMPS jumps, which then reach 1 + JUMPS times as far: lanes wait for each other after fewer rounds. A
    lane may read what another has written in the same round already: that is as true as what it has replaced.
    """
    span = int(1)
    while span < count:
        changed = bool(False)
        i = int(lane)
        while i < count:
            own = state_at(s, i)
            known = high_of(own)
            steps = low_of(own)
            for _ in range(JUMPS):
                further = state_at(s, known)
                known = high_of(further)
                steps = (steps + low_of(further)) & RANK_MOST
            if known != high_of(own):
                set_state(s, i, packed(known, steps))
                changed = True
            i += lanes
        if not any_lane(changed):
            break
        span = (1 + JUMPS) * span


@wp.func
def mark_loops(s: LaneSpace, count: int, lane: int, lanes: int):
    """Mark the crossings that lie on loops, whose first crossings are not known; returns whether there are any."""
    found = bool(False)
    i = int(lane)
    while i < count:
        known = high_of(state_at(s, i))
        if (link_at(s, known) & (FIRST | ASTRAY)) == 0:
            set_link(s, i, link_at(s, i) | LOOP)
            found = True
        i += lanes
    return any_lane(found)


@wp.func
def scanned_rank(surface: Surface, half: int):
    """The rank of a half-edge whose edge is scanned, else RANK_MOST."""
    if link_of(load_vec4(surface.corner, half)) & 1 == 0:
        return RANK_MOST
    return surface.rank[half]


@wp.func
def open_loops(
    surface: Surface, s: LaneSpace, count: int, group: int, stored: wp.array[wp.int64], lane: int, lanes: int
):
    """Make the scanned crossing with the lowest rank the first of each loop: rounds that pass on the lowest rank.

    Each first crossing counts as a piece in `stored`.
    """
    i = int(lane)
    while i < count:
        link = link_at(s, i)
        if (link & LOOP) != 0:
            following = next_of(link)
            set_state(s, following, packed(i, scanned_rank(surface, half_at(s, following))))
        i += lanes
    sync_lanes()
    span = int(1)
    while span < count:
        i = lane
        while i < count:
            if (link_at(s, i) & LOOP) != 0:
                own = state_at(s, i)
                further = state_at(s, high_of(own))
                set_state(s, i, packed(high_of(further), wp.min(low_of(own), low_of(further))))
            i += lanes
        sync_lanes()
        span = 2 * span
    i = lane
    while i < count:
        link = link_at(s, i)
        if (link & LOOP) != 0:
            rank = scanned_rank(surface, half_at(s, i))
            if rank != RANK_MOST and rank == low_of(state_at(s, i)):
                set_link(s, i, link | FIRST)
                wp.atomic_add(stored, group, packed(1, 0))
        i += lanes
    sync_lanes()
    i = lane
    while i < count:
        link = link_at(s, i)
        if (link & LOOP) != 0:
            following = next_of(link)
            if (link_at(s, following) & FIRST) != 0:
                set_state(s, following, packed(following, 0))
            else:
                set_state(s, following, packed(i, wp.where((link & STEP) != 0, 1, 0)))
        i += lanes
    sync_lanes()


@wp.func
def claim_slots(block: QueryBlock, pieces: ContourPieces, group: int, query: int):
    """Claim as many slots as the query of a group has pieces, or note that there are too few."""
    count = high_of(block.stored[group])
    block.stored[group] = wp.int64(0)
    start = wp.atomic_add(block.numbers, STORED, wp.int64(count))
    if start + wp.int64(count) > wp.int64(pieces.half.shape[0]):
        note_lacking(block, pieces, query)
        count = 0
    pieces.start[query] = start
    pieces.count[query] = count


@wp.func
def store_ranked(
    surface: Surface, s: LaneSpace, i: int, group: int, query: int, stored: wp.array[wp.int64], pieces: ContourPieces
):
    """Store the piece or the loop that ends with a crossing, if any, but for its sides; stored: `QueryBlock.stored`."""
    link = link_at(s, i)
    is_loop = (link & LOOP) != 0
    first = int(0)
    if is_loop:
        first = next_of(link)
    elif (link & LAST) != 0:
        first = high_of(state_at(s, i))
    else:
        return
    if (link_at(s, first) & FIRST) == 0:
        return
    count = low_of(state_at(s, i)) + wp.where((link & STEP) != 0, 1, 0)
    half = half_at(s, first)
    before = wp.atomic_add(stored, group, packed(1, count))
    slot = high_of(before)
    begin = low_of(before)
    set_begin(s, first, begin)
    pieces.begin[start_of(pieces, query) + wp.int64(slot) * pieces.stride] = begin
    if is_loop:
        store_piece(pieces, query, slot, half, half, NONE, NONE, count, CLOSED + surface.rank[half], 1)
    else:
        store_piece(pieces, query, slot, half, half_at(s, i), NONE, NONE, count, half, 0)


@wp.func
def store_sides(surface: Surface, f: Frame, side: wp.vec2d, query: int, pieces: ContourPieces, lane: int, lanes: int):
    """Store the sides by which a query's open pieces enter and leave: they are few, and a lane's own piece each."""
    slot = int(lane)
    while slot < pieces.count[query]:
        own = start_of(pieces, query) + wp.int64(slot) * pieces.stride
        if pieces.key[own] < CLOSED:
            sides = sides_of(surface, f, side, pieces.half[own], pieces.out[own])
            pieces.side[own] = sides_word(sides[0], sides[1], UNLISTED)
        slot += lanes


@wp.func
def list_step(s: LaneSpace, start: wp.int64, i: int, listed: wp.array[wp.int32]):
    """List a crossing with its piece if the step that begins there has non-zero length."""
    if (link_at(s, i) & STEP) != 0:
        own = state_at(s, i)
        first = high_of(own)
        if (link_at(s, first) & FIRST) != 0:
            place = begin_at(s, first) + low_of(own)
            listed[start + wp.int64(place)] = half_at(s, i)


@wp.func
def complete_links(surface: Surface, f: Frame, side: wp.vec2d, s: LaneSpace, count: int, lane: int, lanes: int):
    """Complete the links of a lane's crossings; returns how many of them open pieces begin with."""
    firsts = int(0)
    first = int(lane)
    while first < count:
        asking = int(0)  # bits of turns whose crossing asks for points: few do, so a lane looks at its own afterwards
        turn = int(0)
        i = first
        while i < count and turn < TURNS_MOST:
            bits = link_crossing(s, i)
            if (bits & ASKS) != 0:
                asking = asking | (1 << turn)
            elif (bits & FIRST) != 0:
                firsts += 1
            i += lanes
            turn += 1
        turn = int(0)
        while asking != 0:
            while asking & 1 == 0:
                asking = asking >> 1
                turn += 1
            if (link_by_points(surface, f, side, s, first + turn * lanes) & FIRST) != 0:
                firsts += 1
            asking = asking & ~1
        first = i
    return firsts


@wp.func
def link_crossings(
    surface: Surface,
    f: Frame,
    side: wp.vec2d,
    s: LaneSpace,
    count: int,
    group: int,
    stored: wp.array[wp.int64],
    lane: int,
    lanes: int,
):
    """Link all crossings of a section, and count its open pieces in `stored`."""
    g = coarse_frame(f, side, surface.reach)
    stride = int(1)
    while 2 * stride <= count:
        stride = 2 * stride
    i = int(lane)
    while i < count:
        place_crossing(surface, f, g, side, s, count, stride, i)
        i += lanes
    sync_lanes()
    firsts = complete_links(surface, f, side, s, count, lane, lanes)
    if firsts != 0:
        wp.atomic_add(stored, group, packed(firsts, 0))
    sync_lanes()


@wp.func
def rank_section(
    surface: Surface,
    f: Frame,
    side: wp.vec2d,
    s: LaneSpace,
    count: int,
    group: int,
    query: int,
    block: QueryBlock,
    pieces: ContourPieces,
    lane: int,
    lanes: int,
):
    """Store the pieces of a query with crossings, and list the half-edges of their steps instead of its crossings."""
    start = pieces.query_start[query]
    if lane == 0:
        block.stored[group] = wp.int64(0)
    i = int(lane)
    while i < count:
        set_half(s, i, pieces.listed[start + wp.int64(i)])
        i += lanes
    sync_lanes()
    link_crossings(surface, f, side, s, count, group, block.stored, lane, lanes)
    begin_ranks(s, count, lane, lanes)
    jump(s, count, lane, lanes)
    if mark_loops(s, count, lane, lanes):
        open_loops(surface, s, count, group, block.stored, lane, lanes)
        jump(s, count, lane, lanes)
    if lane == 0:
        claim_slots(block, pieces, group, query)
    sync_lanes()
    if pieces.count[query] > 0:
        i = lane
        while i < count:
            store_ranked(surface, s, i, group, query, block.stored, pieces)
            i += lanes
        sync_lanes()
        i = lane
        while i < count:
            list_step(s, start, i, pieces.listed)
            i += lanes
        store_sides(surface, f, side, query, pieces, lane, lanes)


@wp.func
def rank_sections(
    # In:
    surface: Surface,
    patch: wp.array[Patch],
    bounded: int,
    thread: int,
    lanes: int,  # of a group
    near: LaneSpace,  # memory near the lanes
    # Out:
    block: QueryBlock,
    pieces: ContourPieces,
):
    """Rank the crossings of each query of a block: see `rank_section`."""
    group = thread // lanes
    lane = thread % lanes
    query = claim_query(block.numbers, RANKS, lane)
    while query < pieces.frame.shape[0]:
        count = block.count[query]
        if count > 0:
            f = pieces.frame[query]
            side = half_extents(patch[section_of(pieces, query) % patch.shape[0]], bounded)
            s = near
            if count > near.most:
                s = far_space(block.far, group)
            rank_section(surface, f, side, s, count, group, query, block, pieces, lane, lanes)
        elif lane == 0:
            pieces.count[query] = 0
        query = claim_query(block.numbers, RANKS, lane)


@wp.kernel(launch_bounds=(BLOCK, 14))
def _rank_few_crossings(
    surface: Surface,
    patch: wp.array[Patch],
    bounded: int,
    lanes: int,  # of a group
    block: QueryBlock,
    pieces: ContourPieces,
):
    """Store the pieces of each query of a block, and list the half-edges of their steps, as `rank_sections`."""
    near = near_space(address_of_few(), NEAR_FEW)
    rank_sections(surface, patch, bounded, wp.tid(), lanes, near, block, pieces)


@wp.kernel(launch_bounds=(MANY_LANES, 6), module=MANY)
def _rank_many_crossings(
    surface: Surface, patch: wp.array[Patch], bounded: int, lanes: int, block: QueryBlock, pieces: ContourPieces
):
    """The same with more memory near the lanes."""
    near = near_space(address_of_many(), NEAR_MANY)
    rank_sections(surface, patch, bounded, wp.tid(), lanes, near, block, pieces)


def rank_crossings(surface: Any, patch: wp.array, block: Any, *, many: bool, bounded: bool, pieces: Any) -> None:
    """Store the pieces of each query of a QueryBlock, and list the half-edges of their steps: see `rank_sections`."""
    kernel, threads = (_rank_many_crossings, MANY_LANES) if many else (_rank_few_crossings, BLOCK)
    lanes = lane_count(patch.device, threads)
    wp.launch(
        kernel,
        block.groups * lanes,
        inputs=[surface, patch, int(bounded), lanes],
        outputs=[block, pieces],
        device=patch.device,
        block_dim=threads,
    )
