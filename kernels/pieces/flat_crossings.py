"""List all crossings of a section: the lanes of a group descend the box hierarchy together.

Lanes test the boxes of a level side by side and list those that may meet a window in order. All warps test the level
with which a descent begins; then each descends from its share of the boxes listed, without waiting for the others. So
the crossed faces of a section come out in ascending order, warp by warp.
"""

import warp as wp

from ..lanes import Warp, sync_lanes, votes_of
from ..patch import Frame
from ..section.half_edges import LEAF, Surface
from ..section.tree_search import winding_across
from ..warps import int_at, set_int, sync_warp, warp_numbers_of, warp_votes_of
from .flat_boxes import PackedFrame, crossed_halves, meets_packed
from .lane_space import WORDS, LaneSpace, address_after, set_half

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
