"""Flat search, for large surfaces on a GPU: the lanes of a group share the work of each section.

Three kernels, which one after the other search a block of rows: frames and winding numbers, lists of crossings, pieces.
"""

from functools import partial
from typing import Any

import warp as wp

from ..lanes import lane_count, sync_lanes, take_row
from ..offsets import BLOCK
from ..patch import EXACT, Frame, Patch, coarse_frame, half_extents, section_frame
from ..section.half_edges import Surface
from ..section.pieces import ContourPieces, section_of
from ..section.tree_search import corner_window, patch_window
from .few_crossings import rank_few_crossings
from .flat_boxes import pack_boxes, packed_frame
from .flat_crossings import list_crossings, list_leaves, winding_of_lane
from .flat_links import CROSSINGS_MOST
from .lane_space import NEAR_FEW, far_space, half_at
from .many_crossings import rank_many_crossings
from .row_block import LISTED, SPACE, FlatSize, RowBlock, room_for_rows

wp.set_module_options(EXACT)

FEW = 0.75 * NEAR_FEW  # crossings of a row, mean, with which most rows find room beside few lanes


class CrossingLimitError(ValueError):
    """A section has more crossings than the flat search can link."""


@wp.kernel(launch_bounds=(BLOCK, 10))
def _prepare_rows(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    closes: int,
    lanes: int,  # of a group
    # Out:
    block: RowBlock,
    pieces: ContourPieces,
):
    """Frame of each row's patch, and winding number of the solid around its corner 0, 0 unless contours are closed."""
    group = wp.tid() // lanes
    lane = wp.tid() % lanes
    row = take_row(block.taken, 0, lane)
    while row < block.rows:
        row += block.first
        section = section_of(pieces, row)
        f = section_frame(pose, patch, section)
        side = half_extents(patch[section % patch.shape[0]], bounded)
        g = coarse_frame(f, side, surface.reach)
        if lane == 0:
            pieces.frame[row] = f
            pieces.winding[row] = 0
        sync_lanes()
        if closes == 1:
            p = packed_frame(surface, g, corner_window(g))
            s = far_space(block.far, group)
            leaves = list_leaves(surface, p, s, lane, lanes)
            if leaves.needed <= s.most:
                winding = winding_of_lane(surface, f, g, p, side, s, leaves, lane, lanes)
                if winding != 0:
                    wp.atomic_add(pieces.winding, row, winding)
            elif lane == 0:
                wp.atomic_max(block.numbers, SPACE, wp.int64(leaves.needed))
        row = take_row(block.taken, 0, lane)


@wp.kernel(launch_bounds=(BLOCK, 16))
def _list_crossings(
    # In:
    surface: Surface,
    patch: wp.array[Patch],
    pieces: ContourPieces,
    bounded: int,
    lanes: int,  # of a group
    # Out:
    block: RowBlock,
    row_start: wp.array[wp.int64],  # where the half-edges of each row begin among those of all blocks, shape [row]
    listed: wp.array[wp.int32],  # half-edges of the crossings of each row
):
    """List the crossings of each row of a block; `block.numbers` tells whether all found room."""
    group = wp.tid() // lanes
    lane = wp.tid() % lanes
    own = take_row(block.taken, 1, lane)
    while own < block.rows:
        row = block.first + own
        f = pieces.frame[row]
        side = half_extents(patch[section_of(pieces, row) % patch.shape[0]], bounded)
        g = coarse_frame(f, side, surface.reach)
        p = packed_frame(surface, g, patch_window(g))
        s = far_space(block.far, group)
        leaves = list_leaves(surface, p, s, lane, lanes)
        count = int(0)
        if leaves.needed <= s.most:
            count = list_crossings(surface, f, g, p, s, leaves, lane, lanes)
        needed = wp.max(leaves.needed, count)
        if needed > s.most:
            count = 0
            if lane == 0:
                wp.atomic_max(block.numbers, SPACE, wp.int64(needed))
        if lane == 0:
            start = wp.atomic_add(block.numbers, LISTED, wp.int64(count))
            row_start[row] = block.listed_before + start
            block.count[own] = wp.where(start + wp.int64(count) <= wp.int64(listed.shape[0]), count, 0)
        sync_lanes()
        i = int(lane)
        while i < block.count[own]:
            listed[row_start[row] - block.listed_before + wp.int64(i)] = half_at(s, i)
            i += lanes
        own = take_row(block.taken, 1, lane)


def flat_search_pieces(
    surface: Any,
    pose: wp.array,
    patch: wp.array,
    pieces: Any,
    *,
    bounded: bool,
    closes: bool,
    size: FlatSize | None = None,
) -> None:
    """Find the pieces of a surface of any size, and list the half-edges of their steps.

    Rows are searched in blocks. A block whose crossings need more memory than there is, is searched again with more.
    Raises CrossingLimitError for a section with more than CROSSINGS_MOST crossings.
    """
    device, row_count = pose.device, pieces.count.shape[0]
    size = size or FlatSize.for_surface(surface.corner.shape[0] // 3, bounded)
    with_steps(pieces, device)
    if surface.packed_face is None or surface.packed_face.shape[0] == 0:
        pack_boxes(surface, device)
    found: list[wp.array] = []
    first = 0
    while first < row_count:
        rows = range(first, min(row_count, first + max(1, int(size.block / size.listed))))
        before = sum(array.shape[0] for array in found)
        block, listed, size = _list_block(surface, pose, patch, pieces, rows, size, bounded, closes, before)
        few = listed.shape[0] <= FEW * len(rows)
        rank = rank_few_crossings if few else rank_many_crossings
        rank(surface, patch, block, bounded=bounded, pieces=pieces, listed=listed)
        found.append(listed)
        first = rows.stop
    pieces.listed = joined_arrays(found, device)


def _list_block(
    surface: Any,
    pose: wp.array,
    patch: wp.array,
    pieces: Any,
    rows: range,
    size: FlatSize,
    bounded: bool,
    closes: bool,
    listed_before: int,
) -> tuple[Any, wp.array, FlatSize]:
    """Prepare a block of rows and list their crossings: RowBlock, half-edges, and the capacities for the next block."""
    device, lanes = pose.device, lane_count(pose.device)
    capacity = int(len(rows) * size.listed) + 1
    while True:
        block = room_for_rows(rows, size, listed_before, device)
        listed = wp.empty(capacity, dtype=wp.int32, device=device)
        launch = partial(wp.launch, dim=block.steps.shape[0] * lanes, device=device, block_dim=BLOCK)
        inputs = [surface, pose, patch, int(bounded), int(closes), lanes]
        launch(_prepare_rows, inputs=inputs, outputs=[block, pieces])
        outputs = [block, pieces.row_start, listed]
        launch(_list_crossings, inputs=[surface, patch, pieces, int(bounded), lanes], outputs=outputs)
        needed, used = (int(number) for number in block.numbers.numpy())
        if needed == 0 and used <= capacity:
            return block, listed[:used], size.after(used / len(rows))
        if needed > CROSSINGS_MOST:
            raise CrossingLimitError(f"a section has {needed} crossings; a flat search links {CROSSINGS_MOST}")
        capacity = max(capacity, used)
        if needed:
            size = size._replace(space=max(2 * size.space, needed))


def with_steps(pieces: Any, device: Any) -> None:
    """Allocate the arrays of `pieces` for listed steps, but `listed` itself."""
    slots = pieces.half.shape[0]
    pieces.row_start = wp.empty(pieces.count.shape[0], dtype=wp.int64, device=device)
    pieces.frame = wp.empty(pieces.count.shape[0], dtype=Frame, device=device)
    pieces.begin = wp.empty(slots, dtype=wp.int32, device=device)
    pieces.place = wp.empty(slots, dtype=wp.int64, device=device)


def joined_arrays(arrays: list, device: Any) -> wp.array:
    """Arrays of numbers behind each other."""
    if len(arrays) == 1:
        return arrays[0]
    joined = wp.empty(sum(array.shape[0] for array in arrays), dtype=wp.int32, device=device)
    start = 0
    for array in (array for array in arrays if array.shape[0]):
        wp.copy(joined, array, dest_offset=start, count=array.shape[0])
        start += array.shape[0]
    return joined
