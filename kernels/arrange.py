"""Polylines in patch frames -> contours in the array's frame, in the one order that results are compared in."""

from typing import NamedTuple

import warp as wp

from .patch import EXACT, Frame, Patch, frame_at, lifted
from .ragged import Polylines, offsets_of

wp.set_module_options(EXACT)


class Contours(NamedTuple):
    """Device arrays of a contour batch (design: ContourBatch)."""

    points: wp.array  # vec3 [m], array frame, shape [point]
    kind: wp.array  # uint8, shape [point]
    polyline_start: wp.array  # int64, shape [polyline + 1]
    polyline_patch: wp.array  # int32, shape [polyline]
    polyline_closed: wp.array  # uint8, shape [polyline]
    section_start: wp.array  # int64, shape [section + 1]


@wp.struct
class Turn:
    """The place of a polyline's smallest key, and that key."""

    first: int
    key: int


@wp.func
def turn_of(lines: Polylines, line: wp.int64):
    """Where a polyline starts: at its smallest key if it is closed."""
    base = lines.polyline_start[line]
    t = Turn()
    t.key = lines.key[base]
    for k in range(1, int(lines.polyline_start[line + wp.int64(1)] - base)):
        if lines.key[base + wp.int64(k)] < t.key:
            t.key = lines.key[base + wp.int64(k)]
            t.first = k
    if lines.closed[line] == wp.uint8(0):
        t.first = 0
    return t


@wp.func
def kept_count(lines: Polylines, frame: Frame, line: wp.int64):
    """Points that begin a segment of some length, plus the last; 0 if none does."""
    base = lines.polyline_start[line]
    count = int(lines.polyline_start[line + wp.int64(1)] - base)
    segments = int(count)
    if lines.closed[line] == wp.uint8(0):
        segments = count - 1
    kept = int(0)
    p = lifted(frame, lines.point[base])
    for k in range(segments):
        q = lifted(frame, lines.point[base + wp.int64((k + 1) % count)])
        if not (p == q):
            kept += 1
        p = q
    if kept > 0:
        kept += 1
    return kept


@wp.kernel
def _count_points(
    # In:
    lines: Polylines,
    pose: wp.array[wp.transform],
    patch: wp.array[Patch],
    # Out:
    kept: wp.array[wp.int32],  # points of each polyline that stay, shape [polyline]
    polyline_count: wp.array[wp.int64],  # shape [section + 1]
    point_count: wp.array[wp.int64],  # shape [section + 1]
):
    """Count what is left without segments of zero length."""
    section = wp.tid()
    frame = frame_at(pose[section // patch.shape[0]], patch[section % patch.shape[0]])
    polylines = int(0)
    points = int(0)
    for line in range(int(lines.section_start[section]), int(lines.section_start[section + 1])):
        n = kept_count(lines, frame, wp.int64(line))
        kept[line] = n
        points += n
        if n > 0:
            polylines += 1
    polyline_count[section] = wp.int64(polylines)
    point_count[section] = wp.int64(points)


@wp.kernel
def _sort_polylines(
    # In:
    lines: Polylines,
    kept: wp.array[wp.int32],
    # Out:
    order: wp.array[wp.int64],  # polyline at each rank of its section, shape [polyline]
    first: wp.array[wp.int32],  # place at which to start it, by rank, shape [polyline]
    key: wp.array[wp.int32],  # scratch: its smallest key, by rank, shape [polyline]
):
    """Insertion sort of each section's polylines by their smallest key."""
    section = wp.tid()
    base = int(lines.section_start[section])
    n = int(0)
    for line in range(base, int(lines.section_start[section + 1])):
        if kept[line] > 0:
            t = turn_of(lines, wp.int64(line))
            slot = base + n
            while slot > base and key[slot - 1] > t.key:
                order[slot] = order[slot - 1]
                first[slot] = first[slot - 1]
                key[slot] = key[slot - 1]
                slot -= 1
            order[slot] = wp.int64(line)
            first[slot] = t.first
            key[slot] = t.key
            n += 1


@wp.kernel
def _arrange_polylines(
    # In:
    lines: Polylines,
    pose: wp.array[wp.transform],
    patch: wp.array[Patch],
    order: wp.array[wp.int64],
    first: wp.array[wp.int32],
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    section_start: wp.array[wp.int64],  # offsets of the sections' polylines, shape [section + 1]
    # Out:
    points: wp.array[wp.vec3],
    kind: wp.array[wp.uint8],
    polyline_start: wp.array[wp.int64],
    polyline_patch: wp.array[wp.int32],
    polyline_closed: wp.array[wp.uint8],
):
    """Write each section's polylines, turned to their start, a closed one with its first point again at its end."""
    section = wp.tid()
    frame = frame_at(pose[section // patch.shape[0]], patch[section % patch.shape[0]])
    i = point_start[section]
    for rank in range(int(section_start[section + 1] - section_start[section])):
        slot = lines.section_start[section] + wp.int64(rank)
        line = order[slot]
        target = section_start[section] + wp.int64(rank)
        polyline_start[target] = i
        polyline_patch[target] = section % patch.shape[0]
        polyline_closed[target] = lines.closed[line]
        base = lines.polyline_start[line]
        count = int(lines.polyline_start[line + wp.int64(1)] - base)
        segments = int(count)
        if lines.closed[line] == wp.uint8(0):
            segments = count - 1
        start = i
        p = lifted(frame, lines.point[base + wp.int64(first[slot])])
        q = p
        for k in range(segments):
            q = lifted(frame, lines.point[base + wp.int64((first[slot] + k + 1) % count)])
            if not (p == q):
                points[i] = p
                kind[i] = lines.kind[base + wp.int64((first[slot] + k) % count)]
                i += wp.int64(1)
            p = q
        if lines.closed[line] != wp.uint8(0):
            q = points[start]
        points[i] = q
        kind[i] = kind[i - wp.int64(1)]
        i += wp.int64(1)
    if section == section_start.shape[0] - 2:
        polyline_start[section_start[section + 1]] = i


def arrange_polylines(lines: Polylines, pose: wp.array, patch: wp.array) -> Contours:
    """Lift polylines into the array's frame, drop segments of zero length, and put all in order.

    Within a section by the smallest key; a closed polyline starts at its smallest key, an open one where it enters.
    """
    section_count = lines.section_start.shape[0] - 1
    device = lines.closed.device
    line_count = lines.closed.shape[0]
    kept = wp.zeros(line_count, dtype=wp.int32, device=device)
    polylines = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    point_counts = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    wp.launch(
        _count_points,
        section_count,
        inputs=[lines, pose, patch],
        outputs=[kept, polylines, point_counts],
        device=device,
    )
    section_start, polyline_count = offsets_of(polylines)
    point_start, point_count = offsets_of(point_counts)
    order = wp.empty(line_count, dtype=wp.int64, device=device)
    first = wp.empty(line_count, dtype=wp.int32, device=device)
    key = wp.empty(line_count, dtype=wp.int32, device=device)
    wp.launch(_sort_polylines, section_count, inputs=[lines, kept], outputs=[order, first, key], device=device)
    out = Contours(
        points=wp.empty(point_count, dtype=wp.vec3, device=device),
        kind=wp.empty(point_count, dtype=wp.uint8, device=device),
        polyline_start=wp.zeros(polyline_count + 1, dtype=wp.int64, device=device),
        polyline_patch=wp.empty(polyline_count, dtype=wp.int32, device=device),
        polyline_closed=wp.empty(polyline_count, dtype=wp.uint8, device=device),
        section_start=section_start,
    )
    wp.launch(
        _arrange_polylines,
        section_count,
        inputs=[lines, pose, patch, order, first, point_start, section_start],
        outputs=[out.points, out.kind, out.polyline_start, out.polyline_patch, out.polyline_closed],
        device=device,
    )
    return out
