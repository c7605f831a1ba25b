"""Metrics of a pose from its cut sections without writing points; bit-identical to drawing and then `tally`."""

from typing import Any

import warp as wp

from ..metrics.tally import NAN, write_lengths
from ..offsets import BLOCK
from ..patch import EXACT, Patch, half_extents, section_frame
from ..section.piece_walker import LengthAccumulator
from ..section.tally_undrawn import require_values
from .cut_loops import stored_cut
from .loop_table import LoopTable, place_vertices, room_to_remember
from .section_cutting import CutSections
from .section_walker import add_section

wp.set_module_options(EXACT)


@wp.kernel
def _sum_sections(
    # In:
    table: LoopTable,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    word: wp.array2d[wp.uint64],  # `store_cut`, shape [4, section]
    polylines: wp.array[wp.int64],  # of each section
    memory: wp.array[wp.float64],  # `room_to_remember`
    # Out:
    value: wp.array2d[wp.float32],  # shape [METRICS.., pose]
    length: wp.array[wp.float64],  # of all contours [m], shape [pose]
):
    """Add what each pose's polylines come to, patch by patch."""
    at = wp.tid()
    sums = LengthAccumulator()
    twice_area = wp.float64(0.0)
    count = wp.int64(0)
    for own in range(patch.shape[0]):
        section = at * patch.shape[0] + own
        count += polylines[section]
        if polylines[section] > wp.int64(0):
            f = section_frame(pose, patch, section)
            side = half_extents(patch[own], bounded)
            sums.swept = wp.vec3d()
            place_vertices(table, f, memory)
            sums = add_section(table, f, side, memory, stored_cut(word, section), closes, closes, sums)
            twice_area += wp.length(sums.swept)
    write_lengths(wp.vec3d(sums.outline, sums.side, wp.float64(0.0)), count, at, value, length)
    value[5, at] = wp.where(closes == 1, wp.float32(wp.float64(0.5) * twice_area), NAN)


def sum_sections(
    table: Any,
    pose: wp.array,
    patch: wp.array,
    cut: CutSections,
    value: wp.array,
    length: wp.array,
    *,
    bounded: bool,
    closes: bool,
) -> None:
    """Measure each pose into rows METRICS of `value` and into `length`, as `tally_pieces`; others as `cut_sections`."""
    require_values(value, length, pose.shape[0])
    inputs = [table, pose, patch, int(bounded), int(closes), cut.word, cut.polylines]
    inputs.append(room_to_remember(pose.device))
    launched = {"device": pose.device, "block_dim": BLOCK}
    wp.launch(_sum_sections, pose.shape[0], inputs=inputs, outputs=[value, length], **launched)
