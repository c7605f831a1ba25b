"""The first launch for closed solids of few vertices: cuts each section's loops, and counts its polylines and points.

A section then keeps four words and two counts in memory, and no pieces. Each crossing has bits of these words, so that
no section has more pieces than there is room for.
"""

from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, Coarse, Frame, Patch, coarse_frame, half_extents, require_section_poses, section_frame
from .cut_loops import CutLoops, cut_loops, keep_cut
from .loop_table import LoopTable, room_to_remember
from .piece_joints import join_counts
from .section_walker import PointCounter, count_section

wp.set_module_options(EXACT)


@wp.func
def total_of(
    table: LoopTable, f: Frame, g: Coarse, side: wp.vec2d, memory: wp.array[wp.float64], cut: CutLoops, closes: int
):
    """Polylines and points of a section's cut loops."""
    total = PointCounter()
    lines = cut.open_count + cut.whole_count
    points = cut.steps + 2 * cut.open_count - cut.through
    clear = cut.clear
    if closes == 1:
        joined = join_counts(table, f, g, side, memory, cut)
        lines += joined.lines - cut.open_count
        points += joined.steps
        clear = clear & joined.clear
        if cut.open_count == 0 and cut.winding > 0:
            lines += 1
            points += 4
    if clear == 0:  # rare
        return count_section(table, f, side, memory, cut, closes, 0, total)
    total.lines = lines
    total.points = points + lines
    return total


@wp.kernel
def _cut_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],  # of the hand or of each patch -> array frame, shape [pose, 1 or patch]
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    memory: wp.array[wp.float64],  # `room_to_remember`
    # Out:
    word: wp.array2d[wp.uint64],  # `keep_cut`, shape [4, section]
    polylines: wp.array[wp.int64],  # of each section
    points: wp.array[wp.int64],
):
    """Cut each section's loops, and count its polylines and points."""
    section = wp.tid()
    f = section_frame(pose, patch, section)
    side = half_extents(patch[section % patch.shape[0]], bounded)
    g = coarse_frame(f, side, table.reach)
    cut = cut_loops(table, f, g, side, memory)
    total = total_of(table, f, g, side, memory, cut, closes)
    keep_cut(word, section, cut)
    polylines[section] = wp.int64(total.lines)
    points[section] = wp.int64(total.points)


class CutSections(NamedTuple):
    """Sections whose contours are cut and counted, not yet drawn or measured."""

    word: wp.array  # cut loops of each section (`keep_cut`), uint64, shape [4, section]
    polylines: wp.array  # of each section, int64, shape [section + 1], the last one 0
    points: wp.array


def cut_sections(table: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool) -> CutSections:
    """Cut and count the contours of a surface that has a LoopTable in every patch at every pose.

    pose: wp.transform, of the hand or of each patch, shape [pose, 1 or patch]; patch: Patch, shape [patch]; all on one
    device. bounded: whether patches cut contours off; closes: whether contours are closed along bounded patches.
    """
    require_section_poses(pose, patch)
    device, count = pose.device, pose.shape[0] * patch.shape[0]
    polylines, points = (wp.zeros(count + 1, dtype=wp.int64, device=device) for _ in range(2))
    word = wp.empty((4, count), dtype=wp.uint64, device=device)
    inputs = [table, pose, patch, int(bounded), int(closes), room_to_remember(device)]
    outputs = [word, polylines, points]
    wp.launch(_cut_sections, count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    return CutSections(word, polylines, points)
