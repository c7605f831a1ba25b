"""Pieces from linked crossings: the lanes of a group rank the crossings of one section along their chains.

Ranks come from pointer jumping: each crossing knows one that comes before it in its chain, and how many steps of
non-zero length lie between. A jump replaces that crossing by the one which it knows itself. So every crossing of a
chain of n knows the chain's first one after log4(n) rounds of three jumps. A loop inside the patch has no first
crossing: rounds that pass on the lowest rank find it, and then the loop is ranked as a chain from there.
"""

from typing import Any

import warp as wp

from ..lanes import any_lane, claim_query, lane_count, sync_lanes
from ..offsets import BLOCK
from ..patch import EXACT, Frame, Patch, coarse_frame, half_extents
from ..section.half_edges import Surface
from ..section.pieces import CLOSED, UNLISTED, ContourPieces, section_of, sides_word, start_of, store_piece
from ..section.segment_clipping import NONE
from ..section.triangle_walk import link_of, load_vec4
from .flat_links import (
    ASKS,
    ASTRAY,
    FIRST,
    INSIDE,
    LAST,
    LOOP,
    STEP,
    link_by_points,
    link_crossing,
    next_of,
    place_crossing,
    sides_of,
)
from .lane_space import (
    NEAR_FEW,
    NEAR_MANY,
    LaneSpace,
    address_of_few,
    address_of_many,
    begin_at,
    far_space,
    half_at,
    link_at,
    near_space,
    set_begin,
    set_half,
    set_link,
    set_state,
    state_at,
)
from .query_block import RANKS, STORED, QueryBlock, note_lacking

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
