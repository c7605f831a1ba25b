"""List all crossings of a section: the lanes of a group descend the box hierarchy together.

Lanes test the boxes of a level side by side and list those that may meet a window in order, so the crossed faces of a
section come out in ascending order.
"""

import warp as wp

from ..lanes import numbers_of, sync_lanes, votes_of
from ..patch import Coarse, Frame
from ..section.half_edges import LEAF, Surface
from ..section.tree_search import winding_across
from .flat_boxes import PackedFrame, crossed_halves, meets_packed
from .lane_space import LaneSpace, box_at, set_box, set_half

FIRST_MOST = wp.constant(128)  # boxes, at most, of the level with which a descent begins
LEVELS = wp.constant(2)  # that a descent goes down at once: fewer boxes are tested than level by level, in fewer turns


@wp.struct
class BoxList:
    """Boxes of one level that may meet a window."""

    part: int  # of the memory that holds them
    count: int
    needed: int  # the longest list of any level: more than there was room for if that was too little


@wp.func
def list_first_boxes(surface: Surface, p: PackedFrame, s: LaneSpace, first: int, lane: int, lanes: int):
    """List those of the `first` boxes of the first level that may meet the window."""
    boxes = BoxList()
    boxes.part = 1
    turn = int(0)
    k = int(lane)
    while k - lane < first:
        met = k < first
        if met:
            met = meets_packed(surface.packed_box, p, first + k)
        votes = votes_of(met, turn)
        if met and boxes.count + votes[0] < s.most:
            set_box(s, boxes.part, boxes.count + votes[0], first + k)
        boxes.count += votes[1]
        turn += 1
        k += lanes
    sync_lanes()
    boxes.needed = boxes.count
    return boxes


@wp.func
def list_boxes_below(surface: Surface, p: PackedFrame, s: LaneSpace, boxes: BoxList, lane: int, lanes: int):
    """List the boxes LEVELS below that may meet the window."""
    below = BoxList()
    below.part = 3 - boxes.part
    turn = int(0)
    k = int(lane)
    while k - lane < boxes.count << LEVELS:
        met = k < boxes.count << LEVELS
        node = int(0)
        if met:
            node = (box_at(s, boxes.part, k >> LEVELS) << LEVELS) + (k & ((1 << LEVELS) - 1))
            met = meets_packed(surface.packed_box, p, node)
        votes = votes_of(met, turn)
        if met and below.count + votes[0] < s.most:
            set_box(s, below.part, below.count + votes[0], node)
        below.count += votes[1]
        turn += 1
        k += lanes
    sync_lanes()
    below.needed = wp.max(boxes.needed, below.count)
    return below


@wp.func
def list_leaves(surface: Surface, p: PackedFrame, s: LaneSpace, lane: int, lanes: int):
    """List the leaves that may meet a window."""
    level = int(surface.leaf_first)
    while level > FIRST_MOST:
        level = level >> LEVELS
    boxes = list_first_boxes(surface, p, s, level, lane, lanes)
    while level < surface.leaf_first and boxes.needed <= s.most:
        boxes = list_boxes_below(surface, p, s, boxes, lane, lanes)
        level = level << LEVELS
    return boxes


@wp.func
def list_crossings(
    surface: Surface, f: Frame, g: Coarse, p: PackedFrame, s: LaneSpace, leaves: BoxList, lane: int, lanes: int
):
    """List the downward half-edges of the crossed faces of leaves; returns how many there are."""
    listed = int(0)
    turn = int(0)
    i = int(lane)
    while i - lane < leaves.count:
        node = int(0)
        codes = int(0)
        if i < leaves.count:
            node = box_at(s, leaves.part, i)
            codes = crossed_halves(surface, f, g, p, node)
        crossed = (codes | (codes >> 1)) & 0x1111  # codes are 0 to 3
        numbers = numbers_of((crossed * 0x1111) >> 12 & 15, turn)
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
        turn += 1
        i += lanes
    sync_lanes()
    return listed


@wp.func
def winding_of_lane(
    surface: Surface,
    f: Frame,
    g: Coarse,
    p: PackedFrame,
    side: wp.vec2d,
    s: LaneSpace,
    leaves: BoxList,
    lane: int,
    lanes: int,
):
    """What the faces of the leaves that are a lane's own add to the winding number around corner 0."""
    winding = int(0)
    i = int(lane)
    while i < leaves.count:
        node = box_at(s, leaves.part, i)
        codes = crossed_halves(surface, f, g, p, node)
        half = (node - surface.leaf_first) * (3 * LEAF) - 1
        while codes != 0:
            if codes & 15 != 0:
                winding += winding_across(surface, f, side, half + (codes & 15))
            half += 3
            codes = codes >> 4
        i += lanes
    return winding
