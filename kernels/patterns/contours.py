"""Contours of closed solids of few vertices: one launch cuts loops and counts points, another writes the points.

Between them a section keeps four words and two offsets. Each crossing has bits of these words, so that no section has
more pieces than there is room for.
"""

from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK, PointLimitError, last_of, offsets_of
from ..patch import EXACT, Frame, Patch, coarse_frame, half_extents, require_section_poses, section_frame
from ..section.contour_writing import Contours, room_for_contours
from ..section.row_walker import LineArrays, PolylineWriter
from .cut_loops import CutLoops, cut_loops, keep_cut, kept_cut
from .loop_table import LoopTable
from .piece_joints import joined_counts
from .section_walker import PointCounter, count_section, draw_section

wp.set_module_options(EXACT)


@wp.func
def total_of(table: LoopTable, f: Frame, side: wp.vec2d, cut: CutLoops, closes: int):
    """Polylines and points of a section's cut loops."""
    total = PointCounter()
    if cut.open_count > 0 and cut.clear == 0:  # rare
        return count_section(table, f, side, cut, closes, 0, total)
    lines = cut.open_count + cut.whole_count
    points = cut.steps + 2 * cut.open_count - cut.through
    if closes == 1:
        joined, steps = joined_counts(table, f, side, cut)
        lines += joined - cut.open_count
        points += steps
        if cut.open_count == 0 and cut.winding > 0:
            lines += 1
            points += 4
    total.lines = lines
    total.points = points + lines
    return total


@wp.kernel
def _count_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],  # of the hand or of each patch -> array frame, shape [pose, 1 or patch]
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    # Out:
    word: wp.array2d[wp.uint64],  # `keep_cut`, shape [4, section]
    polylines: wp.array[wp.int64],  # of each section
    points: wp.array[wp.int64],
):
    """Count each section's polylines and points."""
    section = wp.tid()
    f = section_frame(pose, patch, section)
    side = half_extents(patch[section % patch.shape[0]], bounded)
    cut = cut_loops(table, f, coarse_frame(f, side, table.reach), side)
    total = total_of(table, f, side, cut, closes)
    keep_cut(word, section, cut)
    polylines[section] = wp.int64(total.lines)
    points[section] = wp.int64(total.points)


@wp.kernel
def _draw_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    closes: int,
    word: wp.array2d[wp.uint64],
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    lines: LineArrays,
):
    """Write each section's polylines."""
    section = wp.tid()
    if section == section_start.shape[0] - 2:
        lines.polyline_start[section_start[section + 1]] = point_start[section + 1]
    writer = PolylineWriter()
    writer.line = section_start[section]
    if writer.line == section_start[section + 1]:
        return
    writer.i = point_start[section]
    writer.patch = section % patch.shape[0]
    f = section_frame(pose, patch, section)
    side = half_extents(patch[writer.patch], bounded)
    writer = draw_section(table, f, side, kept_cut(word, section), closes, lines, writer)


class CountedSections(NamedTuple):
    """Polylines that are counted, not yet drawn."""

    word: wp.array  # cut loops of each section (`keep_cut`), uint64, shape [4, section]
    section_start: wp.array  # offsets of each section's polylines, int64, shape [section + 1]
    point_start: wp.array  # offsets of each section's points
    polyline_count: int
    point_count: int


def count_sections(
    table: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool, limit: int | None = None
) -> CountedSections:
    """Count the contours of a surface that has a LoopTable in every patch at every pose.

    pose: wp.transform, of the hand or of each patch, shape [pose, 1 or patch]; patch: Patch, shape [patch]; all on one
    device. bounded: whether patches cut contours off; closes: whether contours are closed along bounded patches.
    Raises PointLimitError, before memory is taken for them, if there are more points than `limit`.
    """
    require_section_poses(pose, patch)
    device, count = pose.device, pose.shape[0] * patch.shape[0]
    polylines, points = (wp.zeros(count + 1, dtype=wp.int64, device=device) for _ in range(2))
    word = wp.empty((4, count), dtype=wp.uint64, device=device)
    inputs = [table, pose, patch, int(bounded), int(closes)]
    wp.launch(_count_sections, count, inputs=inputs, outputs=[word, polylines, points], device=device, block_dim=BLOCK)
    section_start, point_start = offsets_of(polylines), offsets_of(points)
    polyline_count, point_count = last_of(section_start), last_of(point_start)
    if limit is not None and point_count > limit:
        raise PointLimitError(point_count, limit)
    return CountedSections(word, section_start, point_start, polyline_count, point_count)


def draw_sections(
    table: Any, pose: wp.array, patch: wp.array, counted: CountedSections, *, bounded: bool, closes: bool
) -> Contours:
    """Write the contours that `count_sections` counted, with the same arguments: bit-identical to `draw_contours`."""
    device, count = pose.device, pose.shape[0] * patch.shape[0]
    out, lines = room_for_contours(counted.section_start, counted.polyline_count, counted.point_count)
    starts = [counted.section_start, counted.point_start]
    inputs = [table, pose, patch, int(bounded), int(closes), counted.word, *starts]
    wp.launch(_draw_sections, count, inputs=inputs, outputs=[lines], device=device, block_dim=BLOCK)
    return out
