"""The second launch for closed solids of few vertices: writes the points of the contours that the first one counted."""

from functools import partial
from typing import Any

import warp as wp

from ..contours import Contours
from ..offsets import BLOCK, scan_counts
from ..patch import EXACT, Patch, half_extents, section_frame
from ..section.contour_writing import room_for_contours
from ..section.piece_walker import PolylineWriter
from .cut_loops import is_drawn_exactly, stored_cut
from .loop_table import LoopTable, place_vertices, room_to_remember
from .section_cutting import LAUNCH_BOUNDS, REST_THREADS, CutSections, query_count, section_in
from .section_walker import ClearWriter, draw_clear_section, draw_section

wp.set_module_options(EXACT)


@wp.kernel(launch_bounds=LAUNCH_BOUNDS)
def _draw_clear_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    closes: int,
    word: wp.array2d[wp.uint64],
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    memory: wp.array[wp.float64],  # `room_to_remember`
    # Out:
    lines: Contours,
):
    """Write the polylines of each section that was not cut exactly."""
    section = wp.tid()
    writer = ClearWriter()
    writer.line = section_start[section]
    if writer.line == section_start[section + 1] or is_drawn_exactly(word, section):
        return
    writer.i = point_start[section]
    writer.patch = section % patch.shape[0]
    f = section_frame(pose, patch, section)
    side = half_extents(patch[writer.patch], bounded)
    place_vertices(table, f, memory)
    writer = draw_clear_section(table, f, side, memory, stored_cut(word, section), closes, lines, writer)


@wp.kernel
def _draw_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    closes: int,
    word: wp.array2d[wp.uint64],
    section_start: wp.array[wp.int64],
    point_start: wp.array[wp.int64],
    memory: wp.array[wp.float64],
    rest: wp.array[wp.int32],  # sections, None for all
    rest_count: wp.array[wp.int32],
    step: int,  # threads
    # Out:
    lines: Contours,
):
    """Write the polylines of any sections, and where the last polyline of all ends."""
    count = word.shape[1]
    if wp.tid() == 0:
        lines.polyline_start[section_start[count]] = point_start[count]
    for query in range(wp.tid(), query_count(rest, rest_count, count), step):
        section = section_in(rest, query)
        writer = PolylineWriter()
        writer.line = section_start[section]
        if writer.line < section_start[section + 1]:
            writer.i = point_start[section]
            writer.patch = section % patch.shape[0]
            f = section_frame(pose, patch, section)
            side = half_extents(patch[writer.patch], bounded)
            place_vertices(table, f, memory)
            writer = draw_section(table, f, side, memory, stored_cut(word, section), closes, lines, writer)


def draw_sections(
    table: Any,
    pose: wp.array,
    patch: wp.array,
    cut: CutSections,
    *,
    bounded: bool,
    closes: bool,
    limit: int | None = None,
) -> Contours:
    """Write the contours that `cut_sections` counted, other arguments as for it; bit-identical to `draw_contours`.

    Raises PointLimitError, before memory is allocated for them, if there are more points than `limit`.
    """
    (point_start, section_start), (point_count, polyline_count) = scan_counts(cut.points, cut.polylines, limit=limit)
    contours = room_for_contours(section_start, polyline_count, point_count)
    inputs = [table, pose, patch, int(bounded), int(closes), cut.word, section_start, point_start]
    inputs.append(room_to_remember(pose.device))
    count, split = cut.word.shape[1], cut.rest is not None
    launch = partial(wp.launch, outputs=[contours], device=pose.device, block_dim=BLOCK)
    if split:
        launch(_draw_clear_sections, count, inputs=inputs)
    step = min(count, REST_THREADS) if split else count
    launch(_draw_sections, step, inputs=[*inputs, cut.rest, cut.rest_count, step])
    return contours
