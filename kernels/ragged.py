"""Ragged rows on a device: counts to offsets, and the polylines that pass from stage to stage."""

import warp as wp

OBJECT = 0
HAND = 1
MADE = 2


@wp.struct
class Polylines:
    """Polylines of every section in the frame of its patch, not yet in their final order.

    A closed polyline does not repeat its first point here. Keys are unique within a section: of a mesh edge e below
    the number of edges E, of a clip point on the segment that starts at e: E + 2 e (entering) or E + 2 e + 1
    (leaving), of patch corner k: 3 E + k.
    """

    section_start: wp.array[wp.int64]  # offsets into polylines, shape [section + 1]
    polyline_start: wp.array[wp.int64]  # offsets into points, shape [polyline + 1]
    closed: wp.array[wp.uint8]  # shape [polyline]
    side: wp.array[wp.vec2i]  # patch sides by which an open one enters and leaves, -1 for none, shape [polyline]
    point: wp.array[wp.vec2d]  # [m], shape [point]
    key: wp.array[wp.int32]  # shape [point]
    kind: wp.array[wp.uint8]  # of the segment that starts here, shape [point]


def offsets_of(count: wp.array) -> tuple[wp.array, int]:
    """Exclusive prefix sum of counts whose last entry is a spare 0, and the total."""
    start = wp.empty_like(count)
    wp.utils.array_scan(count, start, inclusive=False)
    return start, int(start[-1:].numpy()[0])


def empty_polylines(section_start: wp.array, polyline_count: int, point_count: int) -> Polylines:
    """Room for polylines whose sections are already counted."""
    device = section_start.device
    out = Polylines()
    out.section_start = section_start
    out.polyline_start = wp.zeros(polyline_count + 1, dtype=wp.int64, device=device)
    out.closed = wp.zeros(polyline_count, dtype=wp.uint8, device=device)
    out.side = wp.empty(polyline_count, dtype=wp.vec2i, device=device)
    out.point = wp.empty(point_count, dtype=wp.vec2d, device=device)
    out.key = wp.empty(point_count, dtype=wp.int32, device=device)
    out.kind = wp.zeros(point_count, dtype=wp.uint8, device=device)
    return out
