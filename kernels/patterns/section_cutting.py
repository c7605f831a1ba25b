"""The first launch for closed solids of few vertices: cuts each section's loops, and counts its polylines and points.

A section then keeps four words and two counts in memory, and no pieces. Each crossing has bits of these words, so that
no section has more pieces than there is room for.
"""

from functools import partial
from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, Patch, coarse_frame, half_extents, require_section_poses, section_frame
from .cut_loops import CutLoops, bit_count, cut_loops, store_cut
from .loop_table import LoopTable, room_to_remember
from .piece_joints import JointCounts, join_counts
from .section_walker import PointCounter, count_section

wp.set_module_options(EXACT)

LAUNCH_BOUNDS = (BLOCK, 12)  # 12 blocks at a time, 80 registers: shared memory allows no more (`remember`)
REST_THREADS = 2**16  # that take the sections which a split leaves: enough to fill a GPU, and few if there are none


@wp.func
def query_count(rest: wp.array[wp.int32], rest_count: wp.array[wp.int32], section_count: int):
    """Number of sections that are cut and drawn exactly: those in `rest`, or all."""
    if rest.shape[0] > 0:
        return rest_count[0]
    return section_count


@wp.func
def section_in(rest: wp.array[wp.int32], query: int):
    """Section of a query."""
    if rest.shape[0] > 0:
        return rest[query]
    return query


@wp.func
def total_of(cut: CutLoops, joined: JointCounts, closes: int):
    """Polylines and points of a section's cut loops, if these are clear."""
    total = PointCounter()
    total.lines = bit_count(cut.pieces)
    total.points = cut.steps + 2 * cut.open_count - bit_count(wp.uint64(cut.clipped.enters & cut.clipped.leaves))
    if closes == 1:
        total.lines += joined.lines - cut.open_count
        total.points += joined.steps
        if cut.open_count == 0 and cut.winding > 0:
            total.lines += 1
            total.points += 4
    total.points += total.lines
    return total


@wp.kernel(launch_bounds=LAUNCH_BOUNDS)
def _cut_clear_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],  # of the hand or of each patch -> array frame, shape [pose, 1 or patch]
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    memory: wp.array[wp.float64],  # `room_to_remember`
    # Out:
    word: wp.array2d[wp.uint64],  # `store_cut`, shape [4, section]
    polylines: wp.array[wp.int64],  # of each section
    points: wp.array[wp.int64],
    rest: wp.array[wp.int32],  # sections for `_cut_sections`, in any order, shape [section]
    rest_count: wp.array[wp.int32],  # number of these, zero-initialised, shape [1]
):
    """Cut and count the sections where nothing lies so near to anything that it must be computed exactly."""
    section = wp.tid()
    f = section_frame(pose, patch, section)
    side = half_extents(patch[section % patch.shape[0]], bounded)
    g = coarse_frame(f, side, table.reach)
    cut = cut_loops(table, f, g, side, memory, False)
    joined = JointCounts()
    if closes == 1 and cut.clear == 1:
        joined = join_counts(table, f, g, side, memory, cut, False)
        cut.clear = joined.clear
    if cut.clear == 1:
        total = total_of(cut, joined, closes)
        store_cut(word, section, cut, False)
        polylines[section] = wp.int64(total.lines)
        points[section] = wp.int64(total.points)
    else:
        rest[wp.atomic_add(rest_count, 0, 1)] = section


@wp.kernel
def _cut_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    closes: int,
    memory: wp.array[wp.float64],
    rest: wp.array[wp.int32],  # sections, None for all
    rest_count: wp.array[wp.int32],
    step: int,  # threads
    # Out:
    word: wp.array2d[wp.uint64],
    polylines: wp.array[wp.int64],
    points: wp.array[wp.int64],
):
    """Cut and count any sections."""
    for query in range(wp.tid(), query_count(rest, rest_count, word.shape[1]), step):
        section = section_in(rest, query)
        f = section_frame(pose, patch, section)
        side = half_extents(patch[section % patch.shape[0]], bounded)
        g = coarse_frame(f, side, table.reach)
        cut = cut_loops(table, f, g, side, memory, True)
        joined = JointCounts()
        joined.clear = 1
        if closes == 1:
            joined = join_counts(table, f, g, side, memory, cut, True)
        total = total_of(cut, joined, closes)
        if cut.open_count > 0 and (cut.clear & joined.clear) == 0:  # rare
            total = count_section(table, f, side, memory, cut, closes, 0, PointCounter())
        store_cut(word, section, cut, True)
        polylines[section] = wp.int64(total.lines)
        points[section] = wp.int64(total.points)


class CutSections(NamedTuple):
    """Sections whose contours are cut and counted, not yet drawn or measured."""

    word: wp.array  # cut loops of each section (`store_cut`), uint64, shape [4, section]
    polylines: wp.array  # of each section, int64, shape [section + 1], the last one 0
    points: wp.array
    rest: wp.array | None  # sections that were cut exactly, int32, in any order; None if all were
    rest_count: wp.array | None  # how many these are, int32, shape [1]


def cut_sections(
    table: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool, split: bool | None = None
) -> CutSections:
    """Cut and count the contours of a surface that has a LoopTable in every patch at every pose.

    pose: wp.transform, of the hand or of each patch, shape [pose, 1 or patch]; patch: Patch, shape [patch]; all on one
    device. bounded: whether patches cut contours off; closes: whether contours are closed along bounded patches.
    split: whether only doubtful sections are cut and drawn exactly, which gives the same; by default on a GPU, where
    a long branch of one thread makes others wait.
    """
    require_section_poses(pose, patch)
    device, count = pose.device, pose.shape[0] * patch.shape[0]
    split = not device.is_cpu if split is None else split
    polylines, points = (wp.zeros(count + 1, dtype=wp.int64, device=device) for _ in range(2))
    word = wp.empty((4, count), dtype=wp.uint64, device=device)
    rest = wp.empty(count, dtype=wp.int32, device=device) if split else None
    rest_count = wp.zeros(1, dtype=wp.int32, device=device) if split else None
    inputs = [table, pose, patch, int(bounded), int(closes), room_to_remember(device)]
    outputs = [word, polylines, points]
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    if split:
        launch(_cut_clear_sections, count, inputs=inputs, outputs=[*outputs, rest, rest_count])
    step = min(count, REST_THREADS) if split else count
    launch(_cut_sections, step, inputs=[*inputs, rest, rest_count, step], outputs=outputs)
    return CutSections(word, polylines, points, rest, rest_count)
