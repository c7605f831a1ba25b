"""Contours with some of their segments, or parts of segments, removed.

A segment is divided into *parts*, each of which stays or is removed. What stays of a polyline falls into pieces:

| polyline | parts removed | becomes |
|---|---|---|
| any | none | itself, bit-identical: divisions inside it are dropped |
| open | some | open pieces, in its order |
| closed | some | open pieces, beginning after its first removed part; one goes on across the seam |
| any | all | nothing |

Directions, kinds and patches stay; a piece that ends within a segment ends on it, with the intensity there.
"""

import warp as wp

from ..contours import Contours, move_offsets, segment_length, with_columns, with_room, write_point, write_polyline
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

WHOLE = float("inf")  # [m]; parts of this length are whole segments


@wp.struct
class Parts:
    """Parts of segments; the segment that starts at point i has the parts start[i]..start[i + 1]."""

    start: wp.array[wp.int64]  # shape [point + 1]; none at a polyline's last point
    segment: wp.array[wp.int64]  # which one it is of, shape [part]
    share: wp.array[wp.float64]  # where in its segment it begins, 0 for a segment's first, shape [part]


@wp.func
def parts_of(parts: Parts, c: Contours, line: int):
    """First part of a polyline, and how many it has."""
    first = parts.start[c.polyline_start[line]]
    return first, int(parts.start[c.polyline_start[line + 1] - wp.int64(1)] - first)


@wp.func
def share_end(parts: Parts, part: wp.int64):
    """Position in its segment where a part ends, 0..1."""
    if part + wp.int64(1) == parts.start[parts.segment[part] + wp.int64(1)]:
        return wp.float64(1.0)
    return parts.share[part + wp.int64(1)]


@wp.func
def draw_point(c: Contours, i: wp.int64, share: wp.float64, kind: wp.uint8, out: Contours, at: wp.int64):
    """Write one point of a piece; kind: of the segment that starts or ends there."""
    write_point(c, i, share, out, at)
    out.kind[at] = kind
    if out.intensity.shape[0] > 0 and share > wp.float64(0.0):  # rounded once: `write_point` rounds the step, too
        low = wp.float64(c.intensity[i])
        out.intensity[at] = wp.float32(low + share * (wp.float64(c.intensity[i + wp.int64(1)]) - low))


@wp.kernel
def _count_parts(c: Contours, longest: wp.float64, count: wp.array[wp.int64]):
    """Count the equal parts of each segment that are no longer than asked [m]."""
    line = wp.tid()
    base = c.polyline_start[line]
    for k in range(int(c.polyline_start[line + 1] - base) - 1):
        i = base + wp.int64(k)
        count[i] = wp.max(wp.int64(wp.ceil(segment_length(c.points, i) / longest)), wp.int64(1))


@wp.kernel
def _divide_segments(c: Contours, longest: wp.float64, start: wp.array[wp.int64], parts: Parts):
    """Write the equal parts of each segment."""
    line = wp.tid()
    base = c.polyline_start[line]
    for k in range(int(c.polyline_start[line + 1] - base) - 1):
        i = base + wp.int64(k)
        count = int(start[i + wp.int64(1)] - start[i])
        for n in range(count):
            parts.segment[start[i] + wp.int64(n)] = i
            parts.share[start[i] + wp.int64(n)] = wp.float64(n) / wp.float64(count)


@wp.kernel
def _spread_keep(parts: Parts, keep: wp.array[wp.uint8], part_keep: wp.array[wp.uint8]):
    """Keep a part if its segment stays."""
    part = wp.tid()
    part_keep[part] = keep[parts.segment[part]]


@wp.kernel
def _cut_lines(
    # In:
    c: Contours,
    parts: Parts,
    keep: wp.array[wp.uint8],
    piece_start: wp.array[wp.int64],  # offsets of each polyline's pieces and points; empty: count them
    point_start: wp.array[wp.int64],
    # Out:
    piece_count: wp.array[wp.int64],
    point_count: wp.array[wp.int64],
    out: Contours,
):
    """Walk a polyline's parts and count its pieces, or write them."""
    line = wp.tid()
    writes = piece_start.shape[0] > 0
    first, count = parts_of(parts, c, line)
    turn = int(0)
    while turn < count and keep[first + wp.int64(turn)] != wp.uint8(0):
        turn += 1
    whole = turn == count
    if whole or c.polyline_closed[line] == wp.uint8(0):
        turn = int(0)
    piece = wp.int64(0)
    at = wp.int64(0)
    if writes:
        piece = piece_start[line]
        at = point_start[line]
    drawing = int(0)
    for j in range(count):
        part = first + wp.int64((turn + j) % count)
        after = first + wp.int64((turn + j + 1) % count)
        if keep[part] != wp.uint8(0):
            segment = parts.segment[part]
            kind = c.kind[segment]
            if drawing == 0:
                if writes:
                    write_polyline(c, wp.int64(line), out, piece)
                    out.polyline_start[piece] = at
                    out.polyline_closed[piece] = c.polyline_closed[line] * wp.uint8(int(whole))
                piece += wp.int64(1)
            if drawing == 0 or parts.share[part] == wp.float64(0.0):
                if writes:
                    draw_point(c, segment, parts.share[part], kind, out, at)
                at += wp.int64(1)
            drawing = int(1)
            if j + 1 == count or keep[after] == wp.uint8(0):
                if writes:
                    end = share_end(parts, part)
                    if end == wp.float64(1.0):
                        draw_point(c, segment + wp.int64(1), wp.float64(0.0), kind, out, at)
                    else:
                        draw_point(c, segment, end, kind, out, at)
                at += wp.int64(1)
                drawing = int(0)
    if not writes:
        piece_count[line] = piece
        point_count[line] = at


@wp.kernel
def _measure_removed(c: Contours, parts: Parts, keep: wp.array[wp.uint8], removed: wp.array[wp.float32]):
    """Sum the removed parts of each pose [m], in float64."""
    pose = wp.tid()
    total = wp.float64(0.0)
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        first, count = parts_of(parts, c, line)
        for k in range(count):
            part = first + wp.int64(k)
            if keep[part] == wp.uint8(0):
                span = share_end(parts, part) - parts.share[part]
                total += span * segment_length(c.points, parts.segment[part])
    removed[pose] = wp.float32(total)


def divide_segments(contours: Contours, longest: float = WHOLE) -> Parts:
    """Every segment in equal parts no longer than `longest` [m]; WHOLE: one part each."""
    lines, device = contours.polyline_closed.shape[0], contours.points.device
    (parts,), (parts.start,) = count_then_fill(
        _count_parts,
        _divide_segments,
        lines,
        [contours, wp.float64(longest)],
        lambda total: [room_for_parts(total, device)],
        rows=contours.points.shape[0],
    )
    return parts


def room_for_parts(count: int, device: wp.Device) -> Parts:
    """Memory for so many parts; their offsets are to be set."""
    parts = Parts()
    parts.segment = wp.empty(count, dtype=wp.int64, device=device)
    parts.share = wp.empty(count, dtype=wp.float64, device=device)
    return parts


@on_one_device
def spread_keep(parts: Parts, keep: wp.array) -> wp.array:
    """Keep or remove parts as their segments are: uint8 [point] -> uint8 [part]."""
    out = wp.empty(parts.segment.shape[0], dtype=wp.uint8, device=keep.device)
    launch(_spread_keep, out.shape[0], [parts, keep], [out])
    return out


@on_one_device
def cut_contours(contours: Contours, keep: wp.array, parts: Parts) -> Contours:
    """Contours without the parts whose `keep` is 0: uint8, shape [part]."""
    lines = contours.polyline_closed.shape[0]
    (out,), (piece_start, _) = count_then_fill(
        _cut_lines,
        None,
        lines,
        [contours, parts, keep],
        lambda pieces, points: [with_room(contours, points, pieces)],
        rows=lines,
        columns=2,
        blank=[Contours()],
    )
    return with_columns(out, pose_start=move_offsets(contours.pose_start, piece_start))


@on_one_device
def measure_removed(contours: Contours, parts: Parts, keep: wp.array) -> wp.array:
    """Length of each pose's parts whose `keep` is 0 [m], float32, shape [pose]."""
    removed = wp.empty(contours.pose_start.shape[0] - 1, dtype=wp.float32, device=contours.points.device)
    launch(_measure_removed, removed.shape[0], [contours, parts, keep], [removed])
    return removed
