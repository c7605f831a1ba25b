"""Flat search, for large surfaces on a GPU: the lanes of a group share the work of each section.

Four kernels, which one after the other search a block of queries: frames, winding numbers, lists of crossings, pieces.
Nothing is waited for between them. A query for which room was too small is noted, and searched again with more.

To list crossings, lanes test the boxes of a level side by side and list those that may meet a window in order. All
warps test the level with which a descent begins; then each descends from its share of the boxes listed, without waiting
for the others. So the crossed faces of a section come out in ascending order, warp by warp.
"""

from functools import partial
from typing import Any

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, Frame, Patch, coarse_frame, half_extents, section_frame
from .flat_boxes import PackedFrame, crossed_halves, meets_packed, pack_boxes, packed_frame
from .flat_ranks import rank_crossings
from .flat_space import (
    CROSSINGS_MOST,
    LACKING,
    LISTED,
    LISTS,
    NEAR_FEW,
    NO_SPACE,
    OF_CORNER,
    OF_PATCH,
    SPACE,
    WINDINGS,
    WORDS,
    FlatSize,
    LaneSpace,
    QueryBlock,
    add_lists,
    add_slots,
    address_after,
    far_space,
    framed_queries,
    half_at,
    note_lacking,
    room_for_groups_of,
    set_half,
    warp_space,
)
from .half_edges import LEAF, Surface
from .lanes import (
    Warp,
    claim_query,
    int_at,
    lane_count,
    numbers_of_warps,
    set_int,
    sync_lanes,
    sync_warp,
    votes_of,
    warp_numbers_of,
    warp_of,
    warp_votes_of,
)
from .pieces import ContourPieces, CutPlanes, section_of
from .tree import TreeSearch, corner_window, patch_window, winding_across

wp.set_module_options(EXACT)

FIRST_MOST = wp.constant(128)  # boxes, at most, of the level with which a descent begins
LEVELS = wp.constant(2)  # that a descent goes down at once: fewer boxes are tested than level by level, in fewer turns


@wp.struct
class BoxList:
    """Boxes of one level that may meet a window, for one warp."""

    address: wp.uint64
    count: int
    needed: int  # room for boxes that the longest list of any level needs, too long if there was too little


@wp.func
def list_first_boxes(
    surface: Surface, p: PackedFrame, group: LaneSpace, s: LaneSpace, first: int, lane: int, warp: Warp
):
    """List those of the `first` boxes of the first level that may meet the window; returns this warp's share.

    The list stands in the last words of the group's memory, where no warp lists what comes next.
    """
    boxes = BoxList()
    boxes.address = address_after(group.address, WORDS * group.most - s.most)
    turn = int(0)
    count = int(0)
    k = int(lane)
    while k - lane < first:
        met = k < first
        if met:
            met = meets_packed(surface.packed_box, p, first + k)
        votes = votes_of(met, turn)
        if met and count + votes[0] < s.most:
            set_int(boxes.address, count + votes[0], first + k)
        count += votes[1]
        turn += 1
        k += warp.lanes << warp.bits
    sync_lanes()
    share = (count + (1 << warp.bits) - 1) >> warp.bits
    begin = share * warp.own
    boxes.address = address_after(boxes.address, begin)
    boxes.count = wp.clamp(count - begin, 0, share)
    boxes.needed = count
    return boxes


@wp.func
def list_boxes_below(surface: Surface, p: PackedFrame, s: LaneSpace, boxes: BoxList, part: int, warp: Warp):
    """List the boxes LEVELS below that may meet the window; part: of the warp's memory that takes them."""
    below = BoxList()
    below.address = address_after(s.address, part * s.most)
    k = int(warp.lane)
    while k - warp.lane < boxes.count << LEVELS:
        met = k < boxes.count << LEVELS
        node = int(0)
        if met:
            node = (int_at(boxes.address, k >> LEVELS) << LEVELS) + (k & ((1 << LEVELS) - 1))
            met = meets_packed(surface.packed_box, p, node)
        votes = warp_votes_of(met)
        if met and below.count + votes[0] < s.most:
            set_int(below.address, below.count + votes[0], node)
        below.count += votes[1]
        k += warp.lanes
    sync_warp()
    below.needed = wp.max(boxes.needed, below.count)
    return below


@wp.func
def list_leaves(surface: Surface, p: PackedFrame, group: LaneSpace, s: LaneSpace, lane: int, warp: Warp):
    """List the leaves that may meet a window, of this warp's share; group, s: memory of the group and of the warp."""
    level = int(surface.leaf_first)
    while level > FIRST_MOST:
        level = level >> LEVELS
    boxes = list_first_boxes(surface, p, group, s, level, lane, warp)
    part = int(1)
    while level < surface.leaf_first and boxes.needed <= s.most:
        boxes = list_boxes_below(surface, p, s, boxes, part, warp)
        part = 3 - part
        level = level << LEVELS
    return boxes


@wp.func
def list_crossings(
    surface: Surface, frame: wp.array[Frame], query: int, p: PackedFrame, s: LaneSpace, leaves: BoxList, warp: Warp
):
    """List the downward half-edges of the crossed faces of a warp's leaves; returns how many there are."""
    listed = int(0)
    i = int(warp.lane)
    while i - warp.lane < leaves.count:
        node = int(0)
        codes = int(0)
        if i < leaves.count:
            node = int_at(leaves.address, i)
            codes = crossed_halves(surface, frame, query, p, node)
        crossed = (codes | (codes >> 1)) & 0x1111  # codes are 0 to 3
        numbers = warp_numbers_of((crossed * 0x1111) >> 12 & 15)
        place = listed + numbers[0]
        half = (node - surface.leaf_first) * (3 * LEAF) - 1
        while codes != 0:
            if codes & 15 != 0:
                if place < s.most:
                    set_half(s, place, half + (codes & 15))
                place += 1
            half += 3
            codes = codes >> 4
        listed += numbers[1]
        i += warp.lanes
    sync_warp()
    return listed


@wp.func
def winding_of_lane(
    surface: Surface, frame: wp.array[Frame], query: int, p: PackedFrame, side: wp.vec2d, leaves: BoxList, warp: Warp
):
    """Share of the winding number around corner 0 that the faces of a lane's own leaves add."""
    winding = int(0)
    i = int(warp.lane)
    while i < leaves.count:
        node = int_at(leaves.address, i)
        codes = crossed_halves(surface, frame, query, p, node)
        half = (node - surface.leaf_first) * (3 * LEAF) - 1
        while codes != 0:
            if codes & 15 != 0:
                winding += winding_across(surface, frame[query], side, half + (codes & 15))
            half += 3
            codes = codes >> 4
        i += warp.lanes
    return winding


# Room for half-edges of a query, in the mean, up to which nearly all queries fit into the memory beside few lanes:
FEW = 0.9 * NEAR_FEW


SPACELESS = wp.constant(1 << 28)  # number of crossings of a warp that had no space for them


@wp.kernel
def _write_frames(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    # Out:
    pieces: ContourPieces,
    window: wp.array2d[PackedFrame],  # `QueryBlock.window`
):
    """Frame of each query's patch, its windows, and the winding number around its corner 0 of a solid elsewhere."""
    query = wp.tid()
    section = section_of(pieces, query)
    f = section_frame(pose, patch, section)
    g = coarse_frame(f, half_extents(patch[section % patch.shape[0]], bounded), surface.reach)
    pieces.frame[query] = f
    pieces.winding[query] = 0
    window[OF_PATCH, query] = packed_frame(surface, g, patch_window(g))
    if window.shape[0] > OF_CORNER:
        window[OF_CORNER, query] = packed_frame(surface, g, corner_window(g))


@wp.kernel(launch_bounds=(BLOCK, 10))
def _count_windings(
    surface: Surface,
    patch: wp.array[Patch],
    lanes: int,  # of a group
    block: QueryBlock,
    pieces: ContourPieces,
):
    """Winding number of the solid at corner 0 of each query's patch, at most NO_SPACE where boxes found no space."""
    lane = wp.tid() % lanes
    warp = warp_of(lane, lanes)
    group = far_space(block.far, wp.tid() // lanes)
    s = warp_space(group, warp)
    query = claim_query(block.numbers, WINDINGS, lane)
    while query < pieces.frame.shape[0]:
        p = block.window[OF_CORNER, query]
        leaves = list_leaves(surface, p, group, s, lane, warp)
        if leaves.needed <= s.most:
            side = patch[section_of(pieces, query) % patch.shape[0]].half
            winding = winding_of_lane(surface, pieces.frame, query, p, side, leaves, warp)
            if winding != 0:
                wp.atomic_add(pieces.winding, query, winding)
        elif warp.lane == 0:
            wp.atomic_add(pieces.winding, query, NO_SPACE)
            wp.atomic_max(block.numbers, SPACE, wp.int64(leaves.needed << warp.bits))
        query = claim_query(block.numbers, WINDINGS, lane)


@wp.func
def place_list(block: QueryBlock, pieces: ContourPieces, query: int, count: int):
    """Find a place for a query's crossings, or note that there is none; count: SPACELESS or more if a list had none."""
    placed = count < SPACELESS and pieces.winding[query] > NO_SPACE // 2
    if placed and count > 0:
        start = wp.atomic_add(block.numbers, LISTED, wp.int64(count))
        pieces.query_start[query] = start
        placed = start + wp.int64(count) <= wp.int64(pieces.listed.shape[0])
    if not placed:
        note_lacking(block, pieces, query)
    block.count[query] = wp.where(placed, count, 0)


@wp.kernel(launch_bounds=(BLOCK, 16))
def _list_crossings(
    surface: Surface,
    lanes: int,  # of a group
    block: QueryBlock,
    pieces: ContourPieces,
):
    """List the crossings of each query of a block."""
    lane = wp.tid() % lanes
    warp = warp_of(lane, lanes)
    group = far_space(block.far, wp.tid() // lanes)
    s = warp_space(group, warp)
    query = claim_query(block.numbers, LISTS, lane)
    while query < pieces.frame.shape[0]:
        p = block.window[OF_PATCH, query]
        leaves = list_leaves(surface, p, group, s, lane, warp)
        count = int(0)
        if leaves.needed <= s.most:
            count = list_crossings(surface, pieces.frame, query, p, s, leaves, warp)
        needed = wp.max(leaves.needed, count)
        if needed > s.most:
            count = SPACELESS
            if warp.lane == 0:
                wp.atomic_max(block.numbers, SPACE, wp.int64(needed << warp.bits))
        counts = numbers_of_warps(count)
        if lane == 0:
            place_list(block, pieces, query, counts[1])
        sync_lanes()
        if block.count[query] > 0:
            start = pieces.query_start[query] + wp.int64(counts[0])
            i = int(warp.lane)
            while i < count:
                pieces.listed[start + wp.int64(i)] = half_at(s, i)
                i += warp.lanes
        query = claim_query(block.numbers, LISTS, lane)


class FlatSearch:
    """A flat search of some sections, or all, block by block of queries, with rooms of a size.

    The half-edges at which the pieces' steps begin are listed. Queries for which room was too small have no pieces in
    what `launch` returns, but in what a later search does.
    """

    def __init__(
        self, planes: CutPlanes, section: wp.array | None, count: int, size: FlatSize | None = None, begin: int = 0
    ) -> None:
        """section: those of the queries, None for all; count: their number; begin: query that the block begins with."""
        self.planes, self.section, self.count, self.begin = planes, section, count, begin
        face_count = planes.surface.corner.shape[0] // 3
        self.size = size or FlatSize.for_surface(face_count, planes.bounded)

    def launch(self) -> Any:
        """ContourPieces of the next block of queries, which the device may not have found yet.

        Arrays are made just before a kernel needs them.
        """
        surface, pose, patch, bounded, closes = self.planes
        device, lanes, size = pose.device, lane_count(pose.device), self.size
        if surface.packed_face is None or surface.packed_face.shape[0] == 0:
            pack_boxes(surface, device)
        self._queries = range(self.begin, min(self.count, self.begin + size.queries()))
        count = len(self._queries)
        launch = partial(wp.launch, device=device, block_dim=BLOCK)
        pieces = framed_queries(self._queries, self.section, device)
        window = wp.empty((1 + int(closes), count), dtype=PackedFrame, device=device)
        launch(_write_frames, count, inputs=self.planes.inputs, outputs=[pieces, window])
        block = room_for_groups_of(count, size, device)
        block.window = window
        threads = block.groups * lanes
        if closes:
            launch(_count_windings, threads, inputs=[surface, patch, lanes], outputs=[block, pieces])
        add_lists(block, pieces, count, size, device)
        launch(_list_crossings, threads, inputs=[surface, lanes], outputs=[block, pieces])
        add_slots(block, pieces, count, size, device)
        rank_crossings(surface, patch, block, many=size.listed > FEW, bounded=bounded, pieces=pieces)
        self._pieces, self._numbers, self._lacking = pieces, block.numbers, block.lacking
        return pieces

    def rest(self) -> list[Any]:
        """The searches of queries that had too little room, and of the next block; waits for the device."""
        numbers, out = self._numbers.numpy(), []
        if self._queries.stop < self.count:
            used = min(int(numbers[LISTED]), self._pieces.listed.shape[0])
            self._pieces.listed = wp.clone(self._pieces.listed[:used])  # the rest is free for the next block
            size = self.size.after(len(self._queries), numbers)
            out.append(FlatSearch(self.planes, self.section, self.count, size, self._queries.stop))
        if missed := int(numbers[LACKING]):
            section, size = self._lacking[:missed], self.size.enlarged(numbers)
            is_walked = size.space > CROSSINGS_MOST  # the tree search has no such limit
            again = TreeSearch(self.planes, section) if is_walked else FlatSearch(self.planes, section, missed, size)
            out.append(again)
        return out
