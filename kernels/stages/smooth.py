"""Smooth polylines: corners cut after Chaikin (1974), or vertices moved towards the middle of their neighbours."""

import warp as wp

from ..offsets import BLOCK, PointLimitError, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT, to_float32, to_float64
from .cut import point_at, segment_length
from .insertion import Vertices, empty_vertices, vertices_of

wp.set_module_options(EXACT)

SHARE = wp.constant(wp.float64(0.25))  # of a segment that is cut off at each of its ends


@wp.kernel
def _count_cuts(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    times: wp.int64,  # 2 to the power of rounds
    # Out:
    count: wp.array[wp.int64],  # shape [polyline + 1], zero-initialised
):
    """Count the points of a polyline after some rounds; one without a segment has none."""
    line = wp.tid()
    one = wp.int64(1)
    segments = polyline_start[line + 1] - polyline_start[line] - one
    if segments > wp.int64(0):
        if polyline_closed[line] != wp.uint8(0):
            count[line] = segments * times + one
        else:
            count[line] = (segments - one) * times + wp.int64(2)


@wp.func
def write_cut(old: Vertices, written: Vertices, i: wp.int64, part: wp.float64, at: wp.int64):
    """Write the place at a part of the segment at point i, without a dwell."""
    written.points[at] = to_float32(point_at(old.points, i, part))
    written.kind[at] = old.kind[i]
    if old.intensity.shape[0] > 0:
        step = old.intensity[i + wp.int64(1)] - old.intensity[i]
        written.intensity[at] = wp.float32(wp.float64(old.intensity[i]) + part * wp.float64(step))
    if old.dwell.shape[0] > 0:
        written.dwell[at] = wp.float32(0.0)


@wp.kernel
def _cut_corners(
    # In:
    old: Vertices,
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    new_start: wp.array[wp.int64],
    reach: wp.float64,  # most that is cut off a segment's end [m]
    # Out:
    written: Vertices,
):
    """Write every segment of a polyline without its ends; the ends of an open polyline stay."""
    line = wp.tid()
    one = wp.int64(1)
    first = polyline_start[line]
    segments = int(polyline_start[line + 1] - first) - 1
    closed = polyline_closed[line] != wp.uint8(0)
    has_dwell = old.dwell.shape[0] > 0
    start = new_start[line]
    for k in range(segments):
        i = first + wp.int64(k)
        at = start + wp.int64(2 * k)
        cutoff = wp.min(SHARE, reach / wp.max(segment_length(old.points, i), wp.float64(1e-30)))
        low = cutoff
        high = wp.float64(1.0) - cutoff
        if not closed and k == 0:
            low = wp.float64(0.0)
        ends = not closed and k == segments - 1
        if ends:
            high = wp.float64(1.0)
        write_cut(old, written, i, low, at)
        write_cut(old, written, i, high, at + one)
        if has_dwell:
            written.dwell[at] = old.dwell[i]
            if ends:
                written.dwell[at + one] = old.dwell[i + one]
    if closed and segments > 0:
        seam = start + wp.int64(2 * segments)
        written.points[seam] = written.points[start]
        written.kind[seam] = written.kind[seam - one]
        if old.intensity.shape[0] > 0:
            written.intensity[seam] = written.intensity[start]
        if has_dwell:
            written.dwell[seam] = written.dwell[start]


@wp.kernel
def _relax_points(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    strength: wp.float64,  # 0..1
    rounds: wp.int32,
    # Out:
    points: wp.array[wp.vec3],
):
    """Move every point of a polyline but open ends towards the middle of its neighbours, all at once in each round."""
    line = wp.tid()
    one = wp.int64(1)
    first = polyline_start[line]
    last = polyline_start[line + 1] - one
    closed = polyline_closed[line] != wp.uint8(0) and last > first
    for _r in range(rounds):
        i = first
        if not closed:
            i = first + one
        before = wp.vec3d()
        if i < last:
            before = to_float64(points[wp.where(closed, last - one, first)])
        while i < last:
            x = to_float64(points[i])
            middle = wp.float64(0.5) * (before + to_float64(points[i + one]))
            points[i] = to_float32(x + strength * (middle - x))
            before = x
            i += one
        if closed:
            points[last] = points[first]


@on_one_device
def cut_offsets(polyline_start: wp.array, polyline_closed: wp.array, rounds: int) -> wp.array:
    """Offsets of polylines whose corners were cut in some rounds, int64 [polyline + 1]."""
    count, device = wp.zeros_like(polyline_start), polyline_start.device
    inputs = [polyline_start, polyline_closed, wp.int64(2**rounds)]
    line_count = polyline_closed.shape[0]
    wp.launch(_count_cuts, line_count, inputs=inputs, outputs=[count], device=device, block_dim=BLOCK)
    return offsets_of(count)


@on_one_device
def cut_corners(
    points: wp.array,
    kind: wp.array,
    polyline_start: wp.array,
    polyline_closed: wp.array,
    *,
    reach: float,
    rounds: int,
    intensity: wp.array | None = None,
    dwell: wp.array | None = None,
    point_limit: int | None = None,
) -> tuple[wp.array, wp.array, wp.array, wp.array | None, wp.array | None]:
    """Polylines whose every segment has lost a quarter at each end, at most `reach` [m], in each round.

    Ends of open polylines stay. A cut at a corner is of the kind of the segment before it, and a pause at the corner
    comes behind the cut. Polylines without a segment get no points.
    Returns points, kind, polyline_start, intensity and dwell. Raises PointLimitError before memory is taken for more
    points than `point_limit`.
    """
    device = points.device
    starts = [cut_offsets(polyline_start, polyline_closed, k + 1) for k in range(rounds)]
    totals = [last_of(start) for start in starts]
    if point_limit is not None and totals[-1] > point_limit:
        raise PointLimitError(totals[-1], point_limit)
    old = vertices_of(points, kind, intensity, dwell)
    for start, total in zip(starts, totals, strict=True):
        written = empty_vertices(total, device, intensity is not None, dwell is not None)
        inputs = [old, polyline_start, polyline_closed, start, wp.float64(reach)]
        line_count = polyline_closed.shape[0]
        wp.launch(_cut_corners, line_count, inputs=inputs, outputs=[written], device=device, block_dim=BLOCK)
        old, polyline_start = written, start
    weights = (None if intensity is None else old.intensity, None if dwell is None else old.dwell)
    return old.points, old.kind, polyline_start, *weights


@on_one_device
def relax_points(
    points: wp.array, polyline_start: wp.array, polyline_closed: wp.array, *, strength: float, rounds: int
) -> wp.array:
    """Points of polylines [m], each moved in every round by `strength` towards the middle of its neighbours.

    Ends of open polylines stay; rounding to float32 ends each round.
    """
    moved = wp.clone(points)
    inputs = [polyline_start, polyline_closed, wp.float64(strength), rounds]
    line_count = polyline_closed.shape[0]
    wp.launch(_relax_points, line_count, inputs=inputs, outputs=[moved], device=points.device, block_dim=BLOCK)
    return moved
