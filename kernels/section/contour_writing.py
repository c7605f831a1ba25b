"""Writing contours: walks the ordered pieces a second time and writes points in the array's frame."""

from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, Patch, half_extents, section_frame
from .half_edges import Surface
from .joining import Entries, Joined
from .pieces import ContourPieces, section_of
from .row_walker import LineArrays, PolylineWriter, draw_row

wp.set_module_options(EXACT)


class Contours(NamedTuple):
    """Device arrays of a contour batch; sections are numbered pose * patches + patch."""

    points: wp.array  # vec3 [m], array frame, shape [point]
    kind: wp.array  # uint8, shape [point]
    polyline_start: wp.array  # int64, shape [polyline + 1]
    polyline_patch: wp.array  # int32, shape [polyline]
    polyline_closed: wp.array  # uint8, shape [polyline]
    section_start: wp.array  # int64, shape [section + 1]


@wp.kernel
def _draw_contours(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: CC, 0: OC
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    lines: LineArrays,
):
    """Write each row's polylines."""
    row = wp.tid()
    section = section_of(pieces, row)
    own = section % patch.shape[0]
    writer = PolylineWriter()
    writer.i = point_start[section]
    writer.line = section_start[section]
    writer.patch = own
    f = section_frame(pose, patch, section)
    writer = draw_row(surface, f, half_extents(patch[own], bounded), pieces, entries, row, closes, lines, writer)
    if section == section_start.shape[0] - 2:
        lines.polyline_start[section_start[section + 1]] = point_start[section + 1]


def draw_contours(
    surface: Any, pose: wp.array, patch: wp.array, joined: Joined, *, bounded: bool, closes: bool
) -> Contours:
    """Write the polylines that `join_pieces` ordered and counted; arguments as for it and `find_pieces`."""
    device = pose.device
    out = Contours(
        points=wp.empty(joined.point_count, dtype=wp.vec3, device=device),
        kind=wp.zeros(joined.point_count, dtype=wp.uint8, device=device),
        polyline_start=(wp.empty if pose.shape[0] else wp.zeros)(
            joined.polyline_count + 1, dtype=wp.int64, device=device
        ),
        polyline_patch=wp.empty(joined.polyline_count, dtype=wp.int32, device=device),
        polyline_closed=wp.empty(joined.polyline_count, dtype=wp.uint8, device=device),
        section_start=joined.section_start,
    )
    lines = LineArrays()
    lines.points, lines.kind, lines.polyline_start = out.points, out.kind, out.polyline_start
    lines.polyline_patch, lines.polyline_closed = out.polyline_patch, out.polyline_closed
    for pieces, entries in joined.rows:
        inputs = [surface, pose, patch, pieces, entries, int(bounded), int(closes)]
        wp.launch(
            _draw_contours,
            pieces.count.shape[0],
            inputs=[*inputs, joined.section_start, joined.point_start],
            outputs=[lines],
            device=device,
            block_dim=BLOCK,
        )
    return out
