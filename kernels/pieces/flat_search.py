"""Flat search, for large surfaces on a GPU: the lanes of a group share the work of each section.

Four kernels, which one after the other search a block of queries: frames, winding numbers, lists of crossings, pieces.
Nothing is waited for between them. A query for which room was too small is noted, and searched again with more.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import warp as wp

from ..lanes import claim_query, lane_count, numbers_of_warps, sync_lanes, warp_of
from ..offsets import BLOCK
from ..patch import EXACT, Patch, coarse_frame, half_extents, section_frame
from ..section.half_edges import Surface
from ..section.pieces import ContourPieces, section_of
from ..section.tree_search import corner_window, patch_window, tree_pieces
from .flat_boxes import PackedFrame, pack_boxes, packed_frame
from .flat_crossings import list_crossings, list_leaves, winding_of_lane
from .flat_links import CROSSINGS_MOST
from .flat_ranks import rank_crossings
from .lane_space import NEAR_FEW, far_space, half_at, warp_space
from .query_block import (
    LACKING,
    LISTED,
    LISTS,
    NO_SPACE,
    OF_CORNER,
    OF_PATCH,
    SPACE,
    WINDINGS,
    FlatSize,
    QueryBlock,
    add_lists,
    add_slots,
    framed_queries,
    note_lacking,
    room_for_groups_of,
)

wp.set_module_options(EXACT)

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


class FlatWork(NamedTuple):
    """Surface, poses and patches that are searched."""

    surface: Any
    pose: wp.array
    patch: wp.array
    bounded: bool
    closes: bool


def flat_search_pieces(
    surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool, size: FlatSize | None = None
) -> Iterator[Any]:
    """Find the pieces of a surface of any size, and list the half-edges of their steps.

    Yields ContourPieces of blocks of queries, each as soon as its search is launched: what follows can be launched
    before the search is waited for. Sections for which room was too small have no pieces there, but in ContourPieces
    that come later.
    """
    if surface.packed_face is None or surface.packed_face.shape[0] == 0:
        pack_boxes(surface, pose.device)
    size = size or FlatSize.for_surface(surface.corner.shape[0] // 3, bounded)
    work = FlatWork(surface, pose, patch, bounded, closes)
    return _search_queries(work, None, pose.shape[0] * patch.shape[0], size)


def _search_queries(work: FlatWork, section: wp.array | None, count: int, size: FlatSize) -> Iterator[Any]:
    """Search some sections, or all, with rooms of a size; those for which it is too small again, with larger ones."""
    if size.space > CROSSINGS_MOST:  # the tree search has no such limit
        surface, pose, patch, bounded, closes = work
        yield from tree_pieces(surface, pose, patch, section, bounded=bounded, closes=closes)
        return
    stop = 0
    while True:
        queries = range(stop, min(count, stop + size.queries()))
        pieces, block = _launch_block(work, queries, section, size)
        yield pieces
        numbers, lacking = block.numbers.numpy(), block.lacking
        del block  # its memory is free for the next
        if missed := int(numbers[LACKING]):
            yield from _search_queries(work, lacking[:missed], missed, size.enlarged(numbers))
        stop = queries.stop
        if stop == count:
            return
        used = min(int(numbers[LISTED]), pieces.listed.shape[0])
        pieces.listed = wp.clone(pieces.listed[:used])  # the rest is free again
        size = size.after(len(queries), numbers)


def _launch_block(work: FlatWork, queries: range, section: wp.array | None, size: FlatSize) -> tuple[Any, Any]:
    """Launch a search; returns ContourPieces and QueryBlock, whose arrays are made just before a kernel needs them."""
    surface, pose, patch, bounded, closes = work
    device, lanes = pose.device, lane_count(pose.device)
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    pieces = framed_queries(queries, section, device)
    window = wp.empty((1 + int(closes), len(queries)), dtype=PackedFrame, device=device)
    launch(_write_frames, len(queries), inputs=[surface, pose, patch, int(bounded)], outputs=[pieces, window])
    block = room_for_groups_of(len(queries), size, device)
    block.window = window
    threads = block.groups * lanes
    if closes:
        launch(_count_windings, threads, inputs=[surface, patch, lanes], outputs=[block, pieces])
    add_lists(block, pieces, len(queries), size, device)
    launch(_list_crossings, threads, inputs=[surface, lanes], outputs=[block, pieces])
    add_slots(block, pieces, len(queries), size, device)
    rank_crossings(surface, patch, block, many=size.listed > FEW, bounded=bounded, pieces=pieces)
    return pieces, block
