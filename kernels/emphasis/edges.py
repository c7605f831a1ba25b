"""Intensity of whole segments of polylines, by kind and by how long they run straight."""

from typing import NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT, to_float64
from ..section.row_walker import HAND, MADE, OBJECT
from ..stages.arc_length import SHORTEST
from ..stages.cut import segment_length
from ..stages.insertion import Inserted, insert_points, rows_from

wp.set_module_options(EXACT)


class KindLevels(NamedTuple):
    """Intensity of segments by kind, 0..1."""

    on_object: float
    on_hand: float
    on_made: float
    curved: float
    """Of the object's segments on straight runs that are too short."""


@wp.func
def direction(points: wp.array[wp.vec3], i: wp.int64, length: wp.float64):
    """Unit vector along the segment at point i."""
    return (to_float64(points[i + wp.int64(1)]) - to_float64(points[i])) / length


@wp.func
def extend_run(points: wp.array[wp.vec3], first: wp.int64, stop: wp.int64, total: wp.float64):
    """A run's length [m] with the segments first..stop - 1, one after the other."""
    out = total
    for k in range(int(stop - first)):
        out += segment_length(points, first + wp.int64(k))
    return out


@wp.func
def write_run(points: wp.array[wp.vec3], first: wp.int64, stop: wp.int64, total: wp.float64, run: wp.array[wp.float64]):
    """Write a run's length to its segments; those of no length are in no run."""
    for k in range(int(stop - first)):
        i = first + wp.int64(k)
        if segment_length(points, i) > wp.float64(0.0):
            run[i] = total


@wp.kernel
def _measure_runs(
    # In:
    points: wp.array[wp.vec3],
    kind: wp.array[wp.uint8],
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    cosine: wp.float64,  # of the angle by which a run turns from segment to segment at most
    # Out:
    run: wp.array[wp.float64],  # [m], shape [point], zero-initialised
):
    """Measure the straight runs of one kind of a polyline; on a loop, one may go on across the seam."""
    line = wp.tid()
    base = polyline_start[line]
    last = polyline_start[line + 1] - wp.int64(1)
    runs = int(0)
    start = base  # of the run that is being followed
    before = wp.vec3d()
    first_stop = base  # of the first run, which is written when it is known whether the last one goes on in it
    first_kind = wp.uint8(0)
    first_way = wp.vec3d()
    own_kind = wp.uint8(0)
    for k in range(int(last - base)):
        i = base + wp.int64(k)
        length = segment_length(points, i)
        if length > wp.float64(0.0):
            way = direction(points, i, length)
            if runs == 0:
                first_kind = kind[i]
                first_way = way
            if runs == 0 or wp.dot(way, before) < cosine or kind[i] != own_kind:
                if runs == 1:
                    first_stop = i
                if runs > 1:
                    write_run(points, start, i, extend_run(points, start, i, wp.float64(0.0)), run)
                runs += 1
                start = i
            before = way
            own_kind = kind[i]
    if runs == 1:
        write_run(points, base, last, extend_run(points, base, last, wp.float64(0.0)), run)
    if runs > 1:
        first_total = extend_run(points, base, first_stop, wp.float64(0.0))
        last_total = extend_run(points, start, last, wp.float64(0.0))
        goes_on = wp.dot(first_way, before) >= cosine and first_kind == own_kind
        if polyline_closed[line] != wp.uint8(0) and goes_on:
            first_total = extend_run(points, start, last, first_total)
            last_total = first_total
        write_run(points, base, first_stop, first_total, run)
        write_run(points, start, last, last_total, run)


@wp.kernel
def _level_segments(
    # In:
    kind: wp.array[wp.uint8],
    run: wp.array[wp.float64],  # [m]; of length 0 if runs do not count
    shortest: wp.float64,  # [m]
    level_of: wp.vec4d,  # of object, hand, made, curved
    # Out:
    level: wp.array[wp.float64],  # of the segment that starts at each point, shape [point]
):
    """Choose the intensity of a segment."""
    i = wp.tid()
    own = int(kind[i])
    level[i] = wp.float64(0.0)
    if own == OBJECT or own == HAND or own == MADE:
        level[i] = level_of[own]
    if own == OBJECT and run.shape[0] > 0:
        if run[i] < shortest:
            level[i] = level_of[3]


@wp.kernel
def _count_ramps(
    # In:
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    level: wp.array[wp.float64],
    # Out:
    peak: wp.array[wp.float64],  # at each point, shape [point]
    count: wp.array[wp.int64],  # rows of each point, shape [point + 1], zero-initialised
):
    """Find the larger level beside each point of a polyline, and count the ramps that segments need below it."""
    line = wp.tid()
    first = polyline_start[line]
    last = polyline_start[line + 1] - wp.int64(1)
    for k in range(int(last - first) + 1):
        i = first + wp.int64(k)
        value = wp.float64(0.0)
        if i < last:
            value = wp.max(value, level[i])
        if i > first:
            value = wp.max(value, level[i - wp.int64(1)])
        peak[i] = value
        count[i] = wp.int64(1)
    if polyline_closed[line] != wp.uint8(0) and last > first:
        peak[first] = wp.max(peak[first], peak[last])
        peak[last] = peak[first]
    for k in range(int(last - first)):
        i = first + wp.int64(k)
        if peak[i] > level[i]:
            count[i] = count[i] + wp.int64(1)
        if peak[i + wp.int64(1)] > level[i]:
            count[i] = count[i] + wp.int64(1)


@wp.kernel
def _write_ramps(
    # In:
    points: wp.array[wp.vec3],
    level: wp.array[wp.float64],
    peak: wp.array[wp.float64],
    ramp: wp.float64,  # [m]
    row_start: wp.array[wp.int64],
    # Out:
    share: wp.array[wp.float64],
):
    """Write where on its segment a ramp ends that falls from its first point, and where one begins to its last."""
    p = wp.tid()
    i = wp.int64(p)
    row = row_start[p]
    count = int(row_start[p + 1] - row)
    share[row] = wp.float64(0.0)
    if count > 1:
        part = wp.min(ramp / wp.max(segment_length(points, i), SHORTEST), wp.float64(0.5))
        if peak[i] > level[i]:
            row += wp.int64(1)
            share[row] = part
        if peak[i + wp.int64(1)] > level[i]:
            share[row + wp.int64(1)] = wp.float64(1.0) - part


@wp.kernel
def _weigh_ramps(
    # In:
    level: wp.array[wp.float64],
    peak: wp.array[wp.float64],
    place: wp.array[wp.int64],  # where each old point is now
    # Out:
    intensity: wp.array[wp.float32],  # is multiplied
):
    """Weigh a point by the larger level beside it, and those put in behind it by the level of its segment."""
    p = wp.tid()
    first = place[p]
    for k in range(int(place[p + 1] - first)):
        i = first + wp.int64(k)
        value = wp.where(k == 0, peak[p], level[p]) * wp.float64(intensity[i])
        intensity[i] = wp.float32(wp.clamp(value, wp.float64(0.0), wp.float64(1.0)))


@on_one_device
def measure_runs(
    points: wp.array, kind: wp.array, polyline_start: wp.array, polyline_closed: wp.array, cosine: float
) -> wp.array:
    """Length of the straight run of one kind that each segment is part of [m], float64, shape [point].

    cosine: of the angle by which a run turns from segment to segment at most. 0 for segments of no length.
    """
    run = wp.zeros(points.shape[0], dtype=wp.float64, device=points.device)
    inputs = [points, kind, polyline_start, polyline_closed, wp.float64(cosine)]
    line_count = polyline_closed.shape[0]
    wp.launch(_measure_runs, line_count, inputs=inputs, outputs=[run], device=points.device, block_dim=BLOCK)
    return run


@on_one_device
def level_by_kind(kind: wp.array, levels: KindLevels, run: wp.array | None = None, shortest: float = 0.0) -> wp.array:
    """Intensity of each segment, float64, shape [point].

    run: see `measure_runs`; the object's segments on runs below `shortest` [m] are curved.
    """
    device = kind.device
    level = wp.empty(kind.shape[0], dtype=wp.float64, device=device)
    run = wp.empty(0, dtype=wp.float64, device=device) if run is None else run
    inputs = [kind, run, wp.float64(shortest), wp.vec4d(*levels)]
    wp.launch(_level_segments, kind.shape[0], inputs=inputs, outputs=[level], device=device, block_dim=BLOCK)
    return level


@on_one_device
def ramp_between_levels(
    points: wp.array,
    kind: wp.array,
    polyline_start: wp.array,
    polyline_closed: wp.array,
    *,
    level: wp.array,
    ramp: float,
    intensity: wp.array | None = None,
    dwell: wp.array | None = None,
    point_limit: int | None = None,
) -> Inserted:
    """Polylines whose segments have these intensities, times those they had.

    Where two segments of different intensity meet, the point between them has the higher one, and the weaker segment
    reaches its own within `ramp` [m], or in its middle if it is short. level: 0..1, float64, shape [point], by segment.
    Raises PointLimitError before memory is taken for more points than `point_limit`.
    """
    device, count = points.device, points.shape[0]
    peak = wp.empty(count, dtype=wp.float64, device=device)
    rows = wp.zeros(count + 1, dtype=wp.int64, device=device)
    inputs, outputs = [polyline_start, polyline_closed, level], [peak, rows]
    line_count = polyline_closed.shape[0]
    wp.launch(_count_ramps, line_count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    row_start, share = rows_from(rows, point_limit)
    inputs = [points, level, peak, wp.float64(ramp), row_start]
    wp.launch(_write_ramps, count, inputs=inputs, outputs=[share], device=device, block_dim=BLOCK)
    if intensity is None:
        intensity = wp.full(count, 1.0, dtype=wp.float32, device=device)
    out = insert_points(points, kind, polyline_start, row_start, share, intensity=intensity, dwell=dwell)
    inputs, outputs = [level, peak, out.place], [out.intensity]
    wp.launch(_weigh_ramps, count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
    return out
