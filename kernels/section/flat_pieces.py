"""Pieces from lists of crossings: the lanes of a group join the crossings of one section to chains and rank them.

Ranks come from pointer jumping: each crossing knows one that comes before it in its chain, and how many steps of
non-zero length lie between. A round replaces that crossing by the one which it knows itself. So after log2(n) rounds
every crossing of a chain of n knows the chain's first one. A loop inside the patch has no first crossing: rounds that
pass on the lowest rank find it, and then the loop is ranked as a chain from there.
"""

from typing import Any

import warp as wp

from ..lanes import lane_count, sync_lanes, take_row, votes_of
from ..offsets import BLOCK
from ..patch import EXACT, Frame, Patch, coarse_frame, half_extents
from .flat_crossings import KEPT, CrossingLists, LaneSpace
from .flat_links import (
    ASTRAY,
    FIRST,
    LAST,
    LOOP,
    STEP,
    CrossingSpan,
    link_crossing,
    place_crossing,
    side_entered,
)
from .half_edges import Surface
from .pieces import CLOSED, ContourPieces, room_of, section_of, start_of, store_piece
from .segment_clipping import NONE
from .triangle_walk import link_of, load_vec4

wp.set_module_options(EXACT)

RANK_MOST = wp.constant(0x7FFFFFFF)


@wp.func
def packed(high: int, low: int):
    """Two numbers >= 0 in one word, which lanes read and write at once."""
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
def begin_ranks(s: CrossingSpan, space: LaneSpace, i: int):
    """Begin with what comes directly before a crossing, or with itself where a chain begins."""
    bits = space.word[s.bits + i]
    before = space.word[s.before + i]
    if (bits & FIRST) != 0 or before == NONE:
        space.state[s.state + i] = packed(i, 0)
        if (bits & FIRST) == 0:
            space.word[s.bits + i] = bits | ASTRAY
    else:
        space.state[s.state + i] = packed(before >> 1, before & 1)


@wp.func
def is_on_loop(s: CrossingSpan, space: LaneSpace, i: int):
    """Whether a crossing lies on a loop whose first crossing is not known; after the rounds."""
    known = high_of(space.state[s.state + i])
    return (space.word[s.bits + known] & (FIRST | ASTRAY)) == 0


@wp.func
def jump(s: CrossingSpan, space: LaneSpace, lane: int, lanes: int):
    """Rounds of pointer jumping, until all crossings of chains know the first one of theirs.

    A lane may read what another has written in the same round already: that is as true as what it has replaced.
    """
    span = int(1)
    while span < s.count:
        changed = bool(False)
        i = int(lane)
        while i < s.count:
            own = space.state[s.state + i]
            known = high_of(own)
            further = space.state[s.state + known]
            if high_of(further) != known:
                space.state[s.state + i] = packed(high_of(further), (low_of(own) + low_of(further)) & RANK_MOST)
                changed = True
            i += lanes
        sync_lanes()
        if votes_of(changed) == 0:
            break
        span = 2 * span


@wp.func
def mark_loops(s: CrossingSpan, space: LaneSpace, lane: int, lanes: int):
    """Mark the crossings that lie on loops; returns whether there are any."""
    found = bool(False)
    i = int(lane)
    while i < s.count:
        if is_on_loop(s, space, i):
            space.word[s.bits + i] = space.word[s.bits + i] | LOOP
            found = True
        i += lanes
    sync_lanes()
    return votes_of(found) != 0


@wp.func
def scanned_rank(surface: Surface, half: int):
    """The rank of a half-edge whose edge is scanned, else RANK_MOST."""
    if link_of(load_vec4(surface.corner, half)) & 1 == 0:
        return RANK_MOST
    return surface.rank[half]


@wp.func
def open_loops(surface: Surface, lists: CrossingLists, s: CrossingSpan, space: LaneSpace, lane: int, lanes: int):
    """Make the scanned crossing with the lowest rank the first of each loop: rounds that pass on the lowest rank."""
    i = int(lane)
    while i < s.count:
        if (space.word[s.bits + i] & LOOP) != 0:
            rank = scanned_rank(surface, lists.half[s.start + wp.int64(i)])
            space.state[s.state + i] = packed(space.word[s.before + i] >> 1, rank)
        i += lanes
    sync_lanes()
    span = int(1)
    while span < s.count:
        i = lane
        while i < s.count:
            if (space.word[s.bits + i] & LOOP) != 0:
                own = space.state[s.state + i]
                further = space.state[s.state + high_of(own)]
                space.state[s.state + i] = packed(high_of(further), wp.min(low_of(own), low_of(further)))
            i += lanes
        sync_lanes()
        span = 2 * span
    i = lane
    while i < s.count:
        bits = space.word[s.bits + i]
        if (bits & LOOP) != 0:
            rank = scanned_rank(surface, lists.half[s.start + wp.int64(i)])
            if rank != RANK_MOST and rank == low_of(space.state[s.state + i]):
                space.word[s.bits + i] = bits | FIRST
            begin_ranks(s, space, i)
        i += lanes
    sync_lanes()


@wp.func
def store_ranked(
    surface: Surface,
    f: Frame,
    side: wp.vec2d,
    lists: CrossingLists,
    s: CrossingSpan,
    space: LaneSpace,
    i: int,
    block_row: int,
    pieces: ContourPieces,
    row: int,
):
    """Store the piece that ends with a crossing, or the loop that begins with it, if any."""
    bits = space.word[s.bits + i]
    if (bits & (LAST | LOOP)) == 0 or (bits & (LOOP | FIRST)) == LOOP:
        return
    first = int(i)
    last = int(i)
    step = wp.where((bits & STEP) != 0, 1, 0)
    if (bits & LOOP) != 0:
        last = space.word[s.before + i] >> 1
        step = space.word[s.before + i] & 1
    else:
        first = high_of(space.state[s.state + i])
        if (space.word[s.bits + first] & FIRST) == 0:
            return
    steps = low_of(space.state[s.state + last]) + step
    half = lists.half[s.start + wp.int64(first)]
    slot = wp.atomic_add(pieces.count, row, 1)
    begin = wp.atomic_add(lists.steps, block_row, steps)
    space.word[s.before + first] = begin
    if slot < room_of(pieces, row):
        pieces.begin[start_of(pieces, row) + wp.int64(slot) * pieces.stride] = begin
    if (bits & LOOP) != 0:
        store_piece(pieces, row, slot, half, half, NONE, NONE, steps, CLOSED + surface.rank[half], 1)
    else:
        out = lists.half[s.start + wp.int64(last)]
        enter = side_entered(surface, f, side, half, False)
        leave = side_entered(surface, f, side, out, True)
        store_piece(pieces, row, slot, half, out, enter, leave, steps, half, 0)


@wp.func
def rank_crossings_of(surface: Surface, lists: CrossingLists, s: CrossingSpan, space: LaneSpace, lane: int, lanes: int):
    """Rank all linked crossings of a section along their chains and loops."""
    i = int(lane)
    while i < s.count:
        begin_ranks(s, space, i)
        i += lanes
    sync_lanes()
    jump(s, space, lane, lanes)
    if mark_loops(s, space, lane, lanes):
        open_loops(surface, lists, s, space, lane, lanes)
        jump(s, space, lane, lanes)


@wp.func
def list_steps(
    lists: CrossingLists, s: CrossingSpan, space: LaneSpace, start: wp.int64, i: int, listed: wp.array[wp.int32]
):
    """List a crossing with its piece if the step that begins there has non-zero length."""
    if (space.word[s.bits + i] & STEP) != 0:
        own = space.state[s.state + i]
        first = high_of(own)
        if (space.word[s.bits + first] & FIRST) != 0:
            place = space.word[s.before + first] + low_of(own)
            listed[start + wp.int64(place)] = lists.half[s.start + wp.int64(i)]


@wp.kernel
def _rank_crossings(
    # In:
    surface: Surface,
    patch: wp.array[Patch],
    first: int,  # row of the block
    bounded: int,
    lanes: int,  # of a group
    lists: CrossingLists,
    listed_before: wp.int64,  # half-edges that blocks before have listed
    # Out:
    taken: wp.array[wp.int32],  # rows of the block that groups took, zero-initialised, shape [1]
    space: LaneSpace,  # scratch
    pieces: ContourPieces,
    listed: wp.array[wp.int32],  # of this block, as `ContourPieces.listed`
):
    """Store the pieces of each row of a block, and list the half-edges of their steps."""
    group = wp.tid() // lanes
    lane = wp.tid() % lanes
    block_row = take_row(taken, lane)
    while block_row < lists.count.shape[0]:
        row = first + block_row
        f = pieces.frame[row]
        side = half_extents(patch[section_of(pieces, row) % patch.shape[0]], bounded)
        g = coarse_frame(f, side, surface.reach)
        s = CrossingSpan()
        s.start = lists.start[block_row]
        s.count = lists.count[block_row]
        s.bits = group * 2 * space.most
        s.before = s.bits + space.most
        s.state = group * space.most
        if lane == 0:
            pieces.count[row] = 0
        i = int(lane)
        while i < s.count:
            place_crossing(surface, f, g, side, lists, s, space, i)
            i += lanes
        sync_lanes()
        i = lane
        while i < s.count:
            link_crossing(surface, f, side, lists, s, space, i)
            i += lanes
        sync_lanes()
        rank_crossings_of(surface, lists, s, space, lane, lanes)
        i = lane
        while i < s.count:
            store_ranked(surface, f, side, lists, s, space, i, block_row, pieces, row)
            i += lanes
        sync_lanes()
        start = first_listed(lists, block_row, listed_before, pieces, row, lane)
        i = lane
        while i < s.count and start >= wp.int64(0):
            list_steps(lists, s, space, start, i, listed)
            i += lanes
        sync_lanes()
        block_row = take_row(taken, lane)


@wp.func
def first_listed(
    lists: CrossingLists, block_row: int, listed_before: wp.int64, pieces: ContourPieces, row: int, lane: int
):
    """Where the half-edges of a row's steps are listed in its block; below 0 for a row with too few slots."""
    fits = pieces.count[row] <= room_of(pieces, row)
    if lane == 0:
        start = wp.int64(0)
        if fits:
            start = wp.atomic_add(lists.numbers, KEPT, wp.int64(lists.steps[block_row]))
        else:
            wp.atomic_add(pieces.excess, 0, 1)
        pieces.row_start[row] = listed_before + start
    sync_lanes()
    if fits:
        return pieces.row_start[row] - listed_before
    return wp.int64(-1)


def rank_crossings(
    surface: Any,
    patch: wp.array,
    first: int,
    lists: Any,
    listed_before: int,
    *,
    bounded: bool,
    groups: int,
    space: Any,
    pieces: Any,
    listed: wp.array,
) -> None:
    """Store the pieces of as many rows as `lists` has, from row `first` on, and list the half-edges of their steps.

    `excess` counts rows with too few slots. listed: with space for all crossings of `lists`.
    """
    device = patch.device
    lanes = lane_count(device)
    taken = wp.zeros(1, dtype=wp.int32, device=device)
    inputs = [surface, patch, first, int(bounded), lanes, lists, wp.int64(listed_before)]
    outputs = [taken, space, pieces, listed]
    wp.launch(_rank_crossings, groups * lanes, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
