"""Contours with some of their segments, or parts of segments, taken out.

A segment is divided into *parts*, each kept or removed. What is kept of a polyline falls into pieces:

| polyline | parts removed | becomes |
|---|---|---|
| any | none | itself, bit-identical: divisions inside it are dropped |
| open | some | open pieces, in its order |
| closed | some | open pieces, beginning after its first removed part; one goes on across the seam |
| any | all | nothing |

Directions, kinds and patches are kept; a piece that ends within a segment ends on it, with the intensity there.
"""

from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT, to_float32, to_float64

wp.set_module_options(EXACT)

WHOLE = float("inf")  # [m]; parts of this length are whole segments


class Cut(NamedTuple):
    """Device arrays of what is left of contours, and where it came from."""

    points: wp.array  # vec3 [m], shape [point]
    kind: wp.array  # uint8, shape [point]
    polyline_start: wp.array  # int64, shape [polyline + 1]
    polyline_patch: wp.array  # int32, shape [polyline]
    polyline_closed: wp.array  # uint8, shape [polyline]
    pose_start: wp.array  # int64, shape [pose + 1]
    intensity: wp.array | None  # float32, shape [point]
    source: wp.array  # int64, shape [point]: the point it was, or after which it lies
    share: wp.array  # float64, shape [point]: how far it lies on the way to the next one; 0: it was a point


@wp.struct
class Parts:
    """Parts of segments; the segment that starts at point i has the parts start[i]..start[i + 1]."""

    start: wp.array[wp.int64]  # shape [point + 1]; none at a polyline's last point
    segment: wp.array[wp.int64]  # which one it is of, shape [part]
    share: wp.array[wp.float64]  # where in its segment it begins, 0 for a segment's first, shape [part]


@wp.struct
class PartWriter:
    """Output arrays of the parts that stay."""

    source: wp.array[wp.int64]
    share: wp.array[wp.float64]
    kind: wp.array[wp.uint8]
    polyline_start: wp.array[wp.int64]
    polyline_patch: wp.array[wp.int32]
    polyline_closed: wp.array[wp.uint8]


@wp.func
def parts_of(parts: Parts, polyline_start: wp.array[wp.int64], line: int):
    """First part of a polyline, and how many it has."""
    first = parts.start[polyline_start[line]]
    return first, int(parts.start[polyline_start[line + 1] - wp.int64(1)] - first)


@wp.func
def share_end(parts: Parts, part: wp.int64):
    """Position in its segment where a part ends, 0..1."""
    if part + wp.int64(1) == parts.start[parts.segment[part] + wp.int64(1)]:
        return wp.float64(1.0)
    return parts.share[part + wp.int64(1)]


@wp.func
def segment_length(points: wp.array[wp.vec3], i: wp.int64):
    """Length of the segment that starts at point i [m]."""
    return wp.length(to_float64(points[i + wp.int64(1)]) - to_float64(points[i]))


@wp.func
def point_at(points: wp.array[wp.vec3], i: wp.int64, share: wp.float64):
    """Point of the segment that starts at point i [m]; a share of 0 gives that point bit-identically."""
    x = to_float64(points[i])
    if share > wp.float64(0.0):
        x = x + share * (to_float64(points[i + wp.int64(1)]) - x)
    return x


@wp.func
def draw_point(writer: PartWriter, i: wp.int64, source: wp.int64, share: wp.float64, kind: wp.uint8):
    """Write one point of a piece."""
    writer.source[i] = source
    writer.share[i] = share
    writer.kind[i] = kind


@wp.kernel
def _count_parts(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    longest: wp.float64,  # [m]
    # Out:
    count: wp.array[wp.int64],  # shape [point + 1]
):
    """Count the equal parts of each segment that are no longer than asked."""
    line = wp.tid()
    base = polyline_start[line]
    for k in range(int(polyline_start[line + 1] - base) - 1):
        i = base + wp.int64(k)
        count[i] = wp.max(wp.int64(wp.ceil(segment_length(points, i) / longest)), wp.int64(1))


@wp.kernel
def _divide_segments(
    # In:
    start: wp.array[wp.int64],
    # Out:
    segment: wp.array[wp.int64],
    share: wp.array[wp.float64],
):
    """Write the equal parts of each segment."""
    i = wp.tid()
    first = start[i]
    count = int(start[i + 1] - first)
    for k in range(count):
        segment[first + wp.int64(k)] = wp.int64(i)
        share[first + wp.int64(k)] = wp.float64(k) / wp.float64(count)


@wp.kernel
def _spread_keep(
    # In:
    segment: wp.array[wp.int64],
    keep: wp.array[wp.uint8],  # by point
    # Out:
    part_keep: wp.array[wp.uint8],
):
    """Keep a part as its segment is kept."""
    part = wp.tid()
    part_keep[part] = keep[segment[part]]


@wp.kernel
def _cut_lines(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline_patch: wp.array[wp.int32],
    polyline_closed: wp.array[wp.uint8],
    kind: wp.array[wp.uint8],
    parts: Parts,
    keep: wp.array[wp.uint8],
    piece_start: wp.array[wp.int64],  # offsets of each polyline's pieces and points; empty: count them
    point_start: wp.array[wp.int64],
    # Out:
    piece_count: wp.array[wp.int64],
    point_count: wp.array[wp.int64],
    writer: PartWriter,
):
    """Walk a polyline's parts and count its pieces, or write them."""
    line = wp.tid()
    writes = piece_start.shape[0] > 0
    first, count = parts_of(parts, polyline_start, line)
    turn = int(0)
    while turn < count and keep[first + wp.int64(turn)] != wp.uint8(0):
        turn += 1
    whole = turn == count
    if whole or polyline_closed[line] == wp.uint8(0):
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
            if drawing == 0:
                if writes:
                    writer.polyline_start[piece] = at
                    writer.polyline_patch[piece] = polyline_patch[line]
                    writer.polyline_closed[piece] = polyline_closed[line] * wp.uint8(int(whole))
                piece += wp.int64(1)
            if drawing == 0 or parts.share[part] == wp.float64(0.0):
                if writes:
                    draw_point(writer, at, segment, parts.share[part], kind[segment])
                at += wp.int64(1)
            drawing = int(1)
            if j + 1 == count or keep[after] == wp.uint8(0):
                if writes:
                    end = share_end(parts, part)
                    if end == wp.float64(1.0):
                        draw_point(writer, at, segment + wp.int64(1), wp.float64(0.0), kind[segment])
                    else:
                        draw_point(writer, at, segment, end, kind[segment])
                at += wp.int64(1)
                drawing = int(0)
    if not writes:
        piece_count[line] = piece
        point_count[line] = at


@wp.kernel
def _gather_points(
    # In:
    points: wp.array[wp.vec3],
    source: wp.array[wp.int64],
    share: wp.array[wp.float64],
    # Out:
    gathered: wp.array[wp.vec3],
):
    """Each point at its place on its segment."""
    i = wp.tid()
    gathered[i] = to_float32(point_at(points, source[i], share[i]))


@wp.kernel
def _gather_values(
    # In:
    values: wp.array[wp.float32],
    source: wp.array[wp.int64],
    share: wp.array[wp.float64],
    between: int,  # 1: linear within a segment, 0: nothing there
    # Out:
    gathered: wp.array[wp.float32],
):
    """Each point's value."""
    i = wp.tid()
    value = wp.float64(values[source[i]])
    if share[i] > wp.float64(0.0):
        value = wp.float64(between) * (value + share[i] * (wp.float64(values[source[i] + wp.int64(1)]) - value))
    gathered[i] = wp.float32(value)


@wp.kernel
def _start_poses(
    # In:
    pose_start: wp.array[wp.int64],
    piece_start: wp.array[wp.int64],
    # Out:
    start: wp.array[wp.int64],
):
    """Write the first polyline of each pose."""
    pose = wp.tid()
    start[pose] = piece_start[pose_start[pose]]


@wp.kernel
def _measure_removed(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    pose_start: wp.array[wp.int64],
    parts: Parts,
    keep: wp.array[wp.uint8],
    # Out:
    removed: wp.array[wp.float32],  # [m], shape [pose]
):
    """Sum the removed parts of each pose, in float64."""
    pose = wp.tid()
    total = wp.float64(0.0)
    for line in range(int(pose_start[pose]), int(pose_start[pose + 1])):
        first, count = parts_of(parts, polyline_start, line)
        for k in range(count):
            part = first + wp.int64(k)
            if keep[part] == wp.uint8(0):
                span = share_end(parts, part) - parts.share[part]
                total += span * segment_length(points, parts.segment[part])
    removed[pose] = wp.float32(total)


@on_one_device
def divide_segments(points: wp.array, polyline_start: wp.array, longest: float = WHOLE) -> Parts:
    """Every segment in equal parts no longer than `longest` [m]; WHOLE: one part each."""
    count = wp.zeros(points.shape[0] + 1, dtype=wp.int64, device=points.device)
    lines = polyline_start.shape[0] - 1
    launch(_count_parts, lines, [points, polyline_start, wp.float64(longest)], [count])
    return parts_from(offsets_of(count))


def parts_from(start: wp.array) -> Parts:
    """Equal parts of every segment, as many as the offsets give: int64, shape [point + 1]; callers may set shares."""
    parts = Parts()
    parts.start = start
    total = last_of(start)
    parts.segment = wp.empty(total, dtype=wp.int64, device=start.device)
    parts.share = wp.empty(total, dtype=wp.float64, device=start.device)
    launch(_divide_segments, start.shape[0] - 1, [start], [parts.segment, parts.share])
    return parts


@on_one_device
def spread_keep(parts: Parts, keep: wp.array) -> wp.array:
    """Keep or remove parts as their segments are: uint8 [point] -> uint8 [part]."""
    out = wp.empty(parts.segment.shape[0], dtype=wp.uint8, device=keep.device)
    launch(_spread_keep, out.shape[0], [parts.segment, keep], [out])
    return out


@on_one_device
def cut_contours(
    points: wp.array,
    kind: wp.array,
    polyline_start: wp.array,
    polyline_patch: wp.array,
    polyline_closed: wp.array,
    pose_start: wp.array,
    intensity: wp.array | None,
    keep: wp.array,
    parts: Any = None,  # Parts, which is no type to Python
) -> Cut:
    """Contours without the segments whose `keep` is 0: uint8, shape [point], that of the segment that starts there.

    parts: parts of the segments; `keep` is then per part, uint8, shape [part].
    All arrays as in a contour batch, on one device.
    """
    if parts is None:
        parts = divide_segments(points, polyline_start)
        keep = spread_keep(parts, keep)
    device, line_count = points.device, polyline_start.shape[0] - 1
    none, writer = wp.empty(0, dtype=wp.int64, device=device), PartWriter()
    piece_count, point_count = (wp.zeros(line_count + 1, dtype=wp.int64, device=device) for _ in range(2))
    lines = [polyline_start, polyline_patch, polyline_closed, kind, parts, keep]
    launch(_cut_lines, line_count, [*lines, none, none], [piece_count, point_count, writer])
    piece_start, point_start = offsets_of(piece_count), offsets_of(point_count)
    pieces, total = last_of(piece_start), last_of(point_start)
    writer.source = wp.empty(total, dtype=wp.int64, device=device)
    writer.share = wp.empty(total, dtype=wp.float64, device=device)
    writer.kind = wp.empty(total, dtype=wp.uint8, device=device)
    writer.polyline_start = wp.full(pieces + 1, total, dtype=wp.int64, device=device)
    writer.polyline_patch = wp.empty(pieces, dtype=wp.int32, device=device)
    writer.polyline_closed = wp.empty(pieces, dtype=wp.uint8, device=device)
    launch(_cut_lines, line_count, [*lines, piece_start, point_start], [none, none, writer])
    start, moved = wp.empty_like(pose_start), wp.empty(total, dtype=wp.vec3, device=device)
    launch(_start_poses, start.shape[0], [pose_start, piece_start], [start])
    launch(_gather_points, total, [points, writer.source, writer.share], [moved])
    cut = Cut(
        moved,
        writer.kind,
        writer.polyline_start,
        writer.polyline_patch,
        writer.polyline_closed,
        start,
        None,
        writer.source,
        writer.share,
    )
    return cut if intensity is None else cut._replace(intensity=gather_values(intensity, cut))


@on_one_device
def gather_values(values: wp.array, cut: Cut, *, between: bool = True) -> wp.array:
    """Values, float32, of the points that are left; interpolated within segments, or 0 there if not `between`."""
    out = wp.empty(cut.source.shape[0], dtype=wp.float32, device=values.device)
    launch(_gather_values, out.shape[0], [values, cut.source, cut.share, int(between)], [out])
    return out


@on_one_device
def measure_removed(
    points: wp.array, polyline_start: wp.array, pose_start: wp.array, parts: Parts, keep: wp.array
) -> wp.array:
    """Length of each pose's parts whose `keep` is 0 [m], float32, shape [pose]."""
    removed = wp.empty(pose_start.shape[0] - 1, dtype=wp.float32, device=points.device)
    launch(_measure_removed, removed.shape[0], [points, polyline_start, pose_start, parts, keep], [removed])
    return removed


def launch(kernel: wp.Kernel, count: int | tuple[int, ...], inputs: list, outputs: list) -> None:
    """Launch on the device of the arrays, in blocks as everywhere."""
    device = next(value.device for value in [*inputs, *outputs] if isinstance(value, wp.array))
    wp.launch(kernel, count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
