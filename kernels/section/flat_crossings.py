"""Lists of all crossings of many sections: the lanes of a group descend the box hierarchy of one section together.

The descent goes level by level. Lanes test the boxes of a level side by side and list those that may meet the window in
order, so the crossed faces of a section come out in ascending order.
"""

from typing import Any

import warp as wp

from ..lanes import lane_count, sync_lanes, take_row, vote_count, votes_before, votes_of
from ..offsets import BLOCK
from ..patch import EXACT, Coarse, Frame, Patch, coarse_frame, half_extents
from .edge_pairing import OPEN
from .half_edges import LEAF, Surface
from .pieces import ContourPieces, section_of
from .tree_search import Window, down_half, meets

wp.set_module_options(EXACT)

FIRST_LEVEL = wp.constant(32)  # boxes of the level with which a descent begins: one for each lane
USED, SPACE, KEPT = range(3)  # numbers of a search: crossings listed, space that a section needs, halves kept


@wp.struct
class LaneSpace:
    """Memory of each group of lanes, for one section at a time."""

    most: int  # crossings or boxes of a level for which there is space
    word: wp.array[wp.int32]  # two halves of `most` each, shape [group * 2 * most]
    half: wp.array[wp.int32]  # half-edges of crossings, shape [group * most]
    state: wp.array[wp.int64]  # how far along its piece a crossing is (`flat_pieces`), shape [group * most]
    point: wp.array[wp.vec4]  # its output point, and bits (`flat_links`), shape [group * most]


@wp.struct
class CrossingLists:
    """Half-edges that run down through the planes of a block of rows, sorted within each row."""

    half: wp.array[wp.int32]
    start: wp.array[wp.int64]  # of each row in `half`, shape [row of the block]
    count: wp.array[wp.int32]  # crossings of each row, 0 where there was no space
    steps: wp.array[wp.int32]  # steps of non-zero length that each row's pieces have so far
    numbers: wp.array[wp.int64]  # by USED, SPACE, KEPT, zero-initialised


@wp.func
def list_first_boxes(surface: Surface, g: Coarse, w: Window, space: LaneSpace, base: int, lane: int, lanes: int):
    """List the boxes of the first level that may meet the window; returns how many there are."""
    first = wp.min(surface.leaf_first, FIRST_LEVEL)
    count = int(0)
    k = int(lane)
    while k - lane < first:
        met = k < first
        if met:
            met = meets(surface, g, w, first + k)
        votes = votes_of(met)
        place = count + votes_before(votes, lane)
        if met and place < space.most:
            space.word[base + place] = first + k
        count += vote_count(votes)
        k += lanes
    sync_lanes()
    return count


@wp.func
def list_next_boxes(
    surface: Surface,
    g: Coarse,
    w: Window,
    space: LaneSpace,
    source: int,
    target: int,
    count: int,
    lane: int,
    lanes: int,
):
    """List the children of `count` boxes that may meet the window; returns how many there are."""
    listed = int(0)
    k = int(lane)
    while k - lane < 2 * count:
        met = k < 2 * count
        node = int(0)
        if met:
            node = 2 * space.word[source + k // 2] + k % 2
            met = meets(surface, g, w, node)
        votes = votes_of(met)
        place = listed + votes_before(votes, lane)
        if met and place < space.most:
            space.word[target + place] = node
        listed += vote_count(votes)
        k += lanes
    sync_lanes()
    return listed


@wp.func
def list_faces(
    surface: Surface,
    f: Frame,
    g: Coarse,
    space: LaneSpace,
    source: int,
    target: int,
    count: int,
    lane: int,
    lanes: int,
):
    """List the downward half-edges of crossed faces in `count` leaves; returns how many there are."""
    listed = int(0)
    k = int(lane)
    while k - lane < LEAF * count:
        half = int(OPEN)
        if k < LEAF * count:
            leaf = space.word[source + k // LEAF] - surface.leaf_first
            half = down_half(surface, f, g, leaf * LEAF + k % LEAF)
        votes = votes_of(half != OPEN)
        place = listed + votes_before(votes, lane)
        if half != OPEN and place < space.most:
            space.half[target + place] = half
        listed += vote_count(votes)
        k += lanes
    sync_lanes()
    return listed


@wp.func
def list_crossings_of(
    surface: Surface, f: Frame, g: Coarse, w: Window, space: LaneSpace, group: int, lane: int, lanes: int
):
    """List a section's crossings in `space.half`; returns the space that was needed, and how many there are if there
    was enough."""
    source = group * 2 * space.most
    target = source + space.most
    count = list_first_boxes(surface, g, w, space, source, lane, lanes)
    needed = int(count)
    level = wp.min(surface.leaf_first, FIRST_LEVEL)
    while level < surface.leaf_first and needed <= space.most:
        count = list_next_boxes(surface, g, w, space, source, target, count, lane, lanes)
        needed = wp.max(needed, count)
        swapped = source
        source = target
        target = swapped
        level = 2 * level
    listed = int(0)
    if needed <= space.most:
        listed = list_faces(surface, f, g, space, source, group * space.most, count, lane, lanes)
        needed = wp.max(needed, listed)
    return needed, listed


@wp.kernel
def _list_crossings(
    # In:
    surface: Surface,
    patch: wp.array[Patch],
    pieces: ContourPieces,
    first: int,  # row of the block
    bounded: int,
    lanes: int,  # of a group
    # Out:
    taken: wp.array[wp.int32],  # rows of the block that groups took, zero-initialised, shape [1]
    space: LaneSpace,
    lists: CrossingLists,
):
    """List the crossings of each row of a block; `lists.numbers` tells whether all found space."""
    group = wp.tid() // lanes
    lane = wp.tid() % lanes
    row = take_row(taken, lane)
    while row < lists.count.shape[0]:
        own = section_of(pieces, first + row) % patch.shape[0]
        f = pieces.frame[first + row]
        g = coarse_frame(f, half_extents(patch[own], bounded), surface.reach)
        w = Window()
        w.low = -g.half
        w.high = g.half
        needed, count = list_crossings_of(surface, f, g, w, space, group, lane, lanes)
        if lane == 0:
            lists.start[row] = wp.atomic_add(lists.numbers, USED, wp.int64(count))
            if needed > space.most:
                wp.atomic_max(lists.numbers, SPACE, wp.int64(needed))
        sync_lanes()
        start = lists.start[row]
        if needed > space.most or start + wp.int64(count) > wp.int64(lists.half.shape[0]):
            count = 0
        if lane == 0:
            lists.count[row] = count
            lists.steps[row] = 0
        k = int(lane)
        while k < count:
            lists.half[start + wp.int64(k)] = space.half[group * space.most + k]
            k += lanes
        sync_lanes()
        row = take_row(taken, lane)


def list_crossings(
    surface: Any,
    patch: wp.array,
    pieces: Any,
    first: int,
    *,
    bounded: bool,
    groups: int,
    space: Any,
    lists: Any,
) -> None:
    """List the crossings of as many rows as `lists` has, from row `first` on; `groups` as many as `space` is for."""
    device = patch.device
    lanes = lane_count(device)
    taken = wp.zeros(1, dtype=wp.int32, device=device)
    inputs = [surface, patch, pieces, first, int(bounded), lanes]
    outputs = [taken, space, lists]
    wp.launch(_list_crossings, groups * lanes, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
