"""Simplification of polylines after Douglas and Peucker (1973): removed vertices lie within a tolerance."""

from typing import Any

import warp as wp

from ..offsets import BLOCK, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT, to_float64

wp.set_module_options(EXACT)


@wp.struct
class Strokes:
    """Polylines to simplify; arrays of length 0 stand for what the batch does not have."""

    points: wp.array[wp.vec3]  # [m]
    kind: wp.array[wp.uint8]
    intensity: wp.array[wp.float32]
    dwell: wp.array[wp.float32]  # [s]
    tolerance: wp.float64  # [m]
    level: wp.float64  # of intensity


@wp.func
def excess_of(s: Strokes, a: wp.int64, b: wp.int64, i: wp.int64):
    """Distance of vertex i from the segment a..b, in tolerances: the larger of position and intensity."""
    p = to_float64(s.points[a])
    d = to_float64(s.points[b]) - p
    x = to_float64(s.points[i]) - p
    square = wp.dot(d, d)
    part = wp.float64(0.0)
    if square > wp.float64(0.0):
        part = wp.clamp(wp.dot(x, d) / square, wp.float64(0.0), wp.float64(1.0))
    out = wp.length(x - part * d) / s.tolerance
    if s.intensity.shape[0] > 0:
        low = wp.float64(s.intensity[a])
        level = low + part * (wp.float64(s.intensity[b]) - low)
        out = wp.max(out, wp.abs(wp.float64(s.intensity[i]) - level) / s.level)
    return out


@wp.func
def farthest(s: Strokes, a: wp.int64, b: wp.int64, low: wp.int64, high: wp.int64):
    """The vertex of low..high - 1 that is farthest from the segment a..b, the first of equals, and its excess."""
    best = wp.float64(-1.0)
    at = low
    i = low
    while i < high:
        e = excess_of(s, a, b, i)
        if e > best:
            best = e
            at = i
        i += wp.int64(1)
    return at, best


@wp.func
def keep_fixed(s: Strokes, first: wp.int64, last: wp.int64, keep: wp.array[wp.int64]):
    """Mark the ends, where the kind changes, and where the focal point pauses."""
    i = first
    while i <= last:
        fixed = i == first or i == last
        if not fixed:
            fixed = s.kind[i] != s.kind[i - wp.int64(1)]
        if not fixed and s.dwell.shape[0] > 0:
            fixed = s.dwell[i] > 0.0
        keep[i] = wp.int64(0)
        if fixed:
            keep[i] = wp.int64(1)
        i += wp.int64(1)


@wp.func
def keep_triangle(s: Strokes, first: wp.int64, last: wp.int64, keep: wp.array[wp.int64]):
    """Mark the vertex of a loop that is farthest from its start, and the one farthest from the line between them."""
    far, _e = farthest(s, first, first, first + wp.int64(1), last)
    keep[far] = wp.int64(1)
    before, e = farthest(s, first, far, first + wp.int64(1), far)
    after, f = farthest(s, far, last, far + wp.int64(1), last)
    if f > e:
        before = after
        e = f
    if e > wp.float64(0.0):
        keep[before] = wp.int64(1)


@wp.kernel
def _simplify_polylines(
    # In:
    s: Strokes,
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    # Out:
    keep: wp.array[wp.int64],  # 1: the vertex stays
):
    """Keep the farthest vertex between two that are kept, until none is farther than the tolerance."""
    line = wp.tid()
    first = polyline_start[line]
    last = polyline_start[line + 1] - wp.int64(1)
    if last < first:
        return
    keep_fixed(s, first, last, keep)
    if int(polyline_closed[line]) != 0 and last - first > wp.int64(2):
        keep_triangle(s, first, last, keep)
    a = first
    while a < last:
        b = a + wp.int64(1)
        while keep[b] == wp.int64(0):
            b += wp.int64(1)
        at, excess = farthest(s, a, b, a + wp.int64(1), b)
        if excess > wp.float64(1.0):
            keep[at] = wp.int64(1)
        else:
            a = b


@wp.kernel
def _gather_points(
    # In:
    keep: wp.array[wp.int64],
    place: wp.array[wp.int64],
    # Out:
    index: wp.array[wp.int64],
):
    """Numbers of the points that stay."""
    i = wp.tid()
    if keep[i] != wp.int64(0):
        index[place[i]] = wp.int64(i)


@wp.kernel
def _move_offsets(
    # In:
    polyline_start: wp.array[wp.int64],
    place: wp.array[wp.int64],
    # Out:
    moved: wp.array[wp.int64],
):
    """Offsets among the points that stay."""
    i = wp.tid()
    moved[i] = place[polyline_start[i]]


@wp.kernel
def _gather_rows(
    # In:
    source: wp.array[Any],
    index: wp.array[wp.int64],
    # Out:
    out: wp.array[Any],
):
    """Rows by number."""
    i = wp.tid()
    out[i] = source[index[i]]


for _row in (wp.vec3, wp.uint8, wp.int32, wp.float32):  # else the module would be compiled again for each type it meets
    wp.overload(_gather_rows, {"source": wp.array(dtype=_row), "out": wp.array(dtype=_row)})


@on_one_device
def gather_rows(source: wp.array, index: wp.array) -> wp.array:
    """Rows of a device array by number, int64."""
    out = wp.empty(index.shape[0], dtype=source.dtype, device=source.device)
    wp.launch(_gather_rows, len(index), inputs=[source, index], outputs=[out], device=source.device, block_dim=BLOCK)
    return out


def number_kept(keep: wp.array) -> tuple[wp.array, wp.array]:
    """Numbers of the rows whose `keep` is 1, int64, and how many of them come before each row, int64 [row + 1].

    keep: 1 or 0, int64, shape [row + 1]; the last must be 0.
    """
    place = offsets_of(keep)
    index = wp.empty(last_of(place), dtype=wp.int64, device=keep.device)
    inputs = [keep, place]
    wp.launch(_gather_points, place.shape[0] - 1, inputs=inputs, outputs=[index], device=keep.device, block_dim=BLOCK)
    return index, place


@on_one_device
def move_offsets(start: wp.array, place: wp.array) -> wp.array:
    """Offsets into rows after each row has gone to its `place`, int64 [row + 1]."""
    moved = wp.empty_like(start)
    inputs = [start, place]
    wp.launch(_move_offsets, moved.shape[0], inputs=inputs, outputs=[moved], device=start.device, block_dim=BLOCK)
    return moved


@on_one_device
def simplify_polylines(
    points: wp.array,
    kind: wp.array,
    polyline_start: wp.array,
    polyline_closed: wp.array,
    *,
    tolerance: float,
    level: float,
    intensity: wp.array | None = None,
    dwell: wp.array | None = None,
) -> tuple[wp.array, wp.array]:
    """Numbers of the points that stay, int64, and the polylines' offsets among them, int64 [polyline + 1].

    Every vertex left out is within `tolerance` [m] of the segment that replaces it, its intensity within `level` of
    the one there. Ends, starts of loops, vertices where the kind changes and vertices with a dwell stay; a loop keeps
    three vertices if it has three that are no line.
    """
    device = points.device
    strokes = Strokes()
    strokes.points, strokes.kind = points, kind
    strokes.intensity = wp.empty(0, dtype=wp.float32, device=device) if intensity is None else intensity
    strokes.dwell = wp.empty(0, dtype=wp.float32, device=device) if dwell is None else dwell
    strokes.tolerance, strokes.level = wp.float64(tolerance), wp.float64(level)
    keep = wp.zeros(points.shape[0] + 1, dtype=wp.int64, device=device)
    wp.launch(
        _simplify_polylines,
        polyline_closed.shape[0],
        inputs=[strokes, polyline_start, polyline_closed],
        outputs=[keep],
        device=device,
        block_dim=BLOCK,
    )
    index, place = number_kept(keep)
    return index, move_offsets(polyline_start, place)
