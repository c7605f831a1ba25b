"""Metrics of a pose from ordered pieces without writing points; bit-identical to writing and then `tally`."""

from functools import partial
from typing import Any

import warp as wp

from ..metrics.tally import METRICS, NAN, write_lengths
from ..offsets import BLOCK
from ..patch import EXACT, Patch, half_extents, section_frame
from .half_edges import Surface
from .joining import Entries, Ordered
from .piece_walker import LengthAccumulator, add_section
from .pieces import ContourPieces, section_of

wp.set_module_options(EXACT)


@wp.kernel
def _tally_pieces(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    own: int,  # the patch whose queries are added
    whole: int,  # 1: queries are all sections, and only those of the patch are launched
    pieces: ContourPieces,
    entries: Entries,
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    # Out:
    total: wp.array2d[wp.float64],  # by kind [m], twice the area that CC encloses [m^2]; goes on, shape [pose, 3]
):
    """Add the lengths of a query's polylines to its pose's; launched patch by patch, which is their order."""
    query = wp.tid()
    if whole == 1:
        query = query * patch.shape[0] + own
    if entries.count[query] == 0:
        return
    section = section_of(pieces, query)
    if section % patch.shape[0] != own:
        return
    at = section // patch.shape[0]
    sums = LengthAccumulator()
    sums.outline = total[at, 0]
    sums.side = total[at, 1]
    f = section_frame(pose, patch, section)
    sums = add_section(surface, f, half_extents(patch[own], bounded), pieces, entries, query, closes, closes, sums)
    total[at, 0] = sums.outline
    if closes == 1:
        total[at, 1] = sums.side
        total[at, 2] += wp.length(sums.swept)


@wp.kernel
def _write_poses(
    total: wp.array2d[wp.float64],
    polylines: wp.array[wp.int64],  # of each section
    patch_count: int,
    closes: int,
    value: wp.array2d[wp.float32],  # shape [METRICS.., pose]
    length: wp.array[wp.float64],  # of all contours [m], shape [pose]
):
    """Totals as they are stored."""
    pose = wp.tid()
    count = wp.int64(0)
    for own in range(patch_count):
        count += polylines[pose * patch_count + own]
    write_lengths(wp.vec3d(total[pose, 0], total[pose, 1], wp.float64(0.0)), count, pose, value, length)
    value[5, pose] = NAN
    if closes == 1:
        value[5, pose] = wp.float32(wp.float64(0.5) * total[pose, 2])


def tally_pieces(
    surface: Any,
    pose: wp.array,
    patch: wp.array,
    ordered: Ordered,
    value: wp.array,
    length: wp.array,
    *,
    bounded: bool,
    closes: bool,
) -> None:
    """Measure each pose into rows METRICS of `value`, float32 [metric.., pose], with the arguments of `order_pieces`.

    The same bits as of `draw_contours` and `tally_contours`; the area is NaN unless contours are closed. length: takes
    the length of all contours in float64 [m], shape [pose].
    """
    pose_count, patch_count, device = pose.shape[0], patch.shape[0], pose.device
    require_values(value, length, pose_count)
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    total = wp.zeros((pose_count, 3), dtype=wp.float64, device=device)
    for own in range(patch_count):
        for pieces, entries in ordered.blocks:  # a section has entries in one block only
            query_count, whole = pieces.count.shape[0], pieces.count.shape[0] == pose_count * patch_count
            whole = whole and not pieces.section
            inputs = [surface, pose, patch, own, int(whole), pieces, entries, int(bounded), int(closes)]
            launch(_tally_pieces, pose_count if whole else query_count, inputs=inputs, outputs=[total])
    inputs = [total, ordered.polylines, patch_count, int(closes)]
    launch(_write_poses, pose_count, inputs=inputs, outputs=[value, length])


def require_values(value: wp.array, length: wp.array, pose_count: int) -> None:
    """Raise ValueError unless there is room for each pose's rows METRICS and length."""
    if value.shape[0] < len(METRICS) or value.shape[1] != pose_count or length.shape[0] != pose_count:
        raise ValueError(f"values must have shape [{len(METRICS)}.., {pose_count}], not {list(value.shape)}")
