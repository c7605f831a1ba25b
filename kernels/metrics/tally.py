"""Contours -> numbers a pose -> sums and counts of many poses, in an order that does not depend on who adds them up.

Numbers stand in rows, float32, shape [metric, pose]; NaN where a metric does not apply. Sums go span by span, a thread
from a span's first pose to its last, then part by part, from a part's first span to its last.
"""

import math
from collections.abc import Sequence

import warp as wp

from ..contours import Contours
from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float32, to_float64

wp.set_module_options(EXACT)

METRICS = ("length", "length_object", "length_hand", "length_made", "polylines", "area", "length_intensity")
"""Rows that `tally_contours` writes, in this order."""
STATISTICS = ("count", "sum", "sum of squares", "least", "greatest", "positive")
"""Sums and bounds of a metric's finite values, float64; the last is the number of those above 0."""
NAN = wp.constant(wp.float32(float("nan")))
SOME = wp.constant(8)
Some = wp.types.vector(length=SOME, dtype=wp.float32)
INFINITY = wp.constant(wp.float64(float("inf")))


@wp.struct
class Pacing:
    """Parameters that convert lengths to the time of a cycle, and the time to a number of samples."""

    speed: wp.float64  # [m/s]
    return_speed: wp.float64  # [m/s] along chords; infinite where they take no time
    update_rate: wp.float64  # [Hz]
    turns: wp.float64  # times that all contours are drawn in a cycle
    again: wp.float64  # times that open polylines are drawn once more
    chord: wp.float64  # times that the chords of open polylines are drawn at the speed
    samples_least: wp.float64  # a cycle
    samples_most: wp.float64  # the same
    seam: wp.float64  # by so much of a sample a cycle may be longer than its samples
    nominal_lowest: wp.float64  # [Hz]
    nominal_highest: wp.float64  # [Hz]
    moves: wp.float64  # 0 for a focal point that stays where it is, else 1


@wp.func
def stored_sum(total: wp.vec3d) -> wp.float32:
    """Sum over kinds of what is stored by kind, so that the stored numbers agree."""
    stored = to_float64(to_float32(total))
    return wp.float32(stored[0] + stored[1] + stored[2])


@wp.func
def write_lengths(
    total: wp.vec3d, polylines: wp.int64, pose: int, value: wp.array2d[wp.float32], length: wp.array[wp.float64]
):
    """Write a pose's rows of all METRICS but the area, for an intensity of 1; total: by kind [m]."""
    by_kind = to_float32(total)
    value[0, pose] = stored_sum(total)
    for k in range(3):
        value[1 + k, pose] = by_kind[k]
    value[4, pose] = wp.float32(polylines)
    value[6, pose] = value[0, pose]
    length[pose] = total[0] + total[1] + total[2]


@wp.kernel
def _tally_contours(
    # In:
    c: Contours,
    measures: int,  # 0: leave all rows but the area as they are
    encloses: int,  # 0: leave the area as it is
    # Out:
    value: wp.array2d[wp.float32],  # shape [METRICS.., pose]
    length: wp.array[wp.float64],  # of all contours [m], shape [pose]
):
    """Measure a pose's contours, and what they enclose: on each patch half the sum of p x q over segments p q."""
    pose = wp.tid()
    total = wp.vec3d()
    area = wp.float64(0.0)
    swept = wp.vec3d()  # twice the area of a patch, along its normal
    patch = int(-1)
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        base = c.polyline_start[line]
        here = c.points[base]
        origin = to_float64(here)
        arm = wp.vec3d()
        own = wp.vec3d()
        for k in range(int(c.polyline_start[line + 1] - base) - 1):
            i = base + wp.int64(k)
            there = c.points[i + wp.int64(1)]
            segment = int(c.kind[i])
            total[segment] = total[segment] + wp.length(to_float64(there - here))
            further = to_float64(there) - origin
            own = own + wp.cross(arm, further)  # no += and no branch here: five times as slow on a CPU
            arm = further
            here = there
        if c.polyline_patch[line] != patch:
            area += wp.length(swept)
            swept = wp.vec3d()
            patch = c.polyline_patch[line]
        if c.polyline_closed[line] != wp.uint8(0):
            swept = swept + own
    if encloses != 0:
        value[5, pose] = wp.float32(wp.float64(0.5) * (area + wp.length(swept)))
    if measures != 0:
        write_lengths(total, c.pose_start[pose + 1] - c.pose_start[pose], pose, value, length)


@wp.kernel
def _weigh_contours(c: Contours, value: wp.array2d[wp.float32]):
    """Integrate the intensity, which is linear from point to point, along a pose's contours."""
    pose = wp.tid()
    total = wp.vec3d()
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        base = c.polyline_start[line]
        for k in range(int(c.polyline_start[line + 1] - base) - 1):
            i = base + wp.int64(k)
            j = i + wp.int64(1)
            middle = wp.float64(0.5) * (wp.float64(c.intensity[i]) + wp.float64(c.intensity[j]))
            segment = int(c.kind[i])
            total[segment] = total[segment] + middle * wp.length(to_float64(c.points[j] - c.points[i]))
    value[6, pose] = stored_sum(total)


@wp.kernel
def _measure_gaps(
    # In:
    c: Contours,
    # Out:
    open_length: wp.array[wp.float64],  # of open polylines [m]
    chord: wp.array[wp.float64],  # from their ends back to their starts [m]
    piece_count: wp.array[wp.int32],  # polylines that have a length
):
    """Lengths that a focal point jumps or retraces in a pose's contours."""
    pose = wp.tid()
    length = wp.float64(0.0)
    back = wp.float64(0.0)
    count = int(0)
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        first = c.polyline_start[line]
        last = c.polyline_start[line + 1] - wp.int64(1)
        own = wp.float64(0.0)
        for k in range(int(last - first)):
            i = first + wp.int64(k)
            own += wp.length(to_float64(c.points[i + wp.int64(1)]) - to_float64(c.points[i]))
        if own > wp.float64(0.0):
            count += 1
            if c.polyline_closed[line] == wp.uint8(0):
                length += own
                back += wp.length(to_float64(c.points[last]) - to_float64(c.points[first]))
    open_length[pose] = length
    chord[pose] = back
    piece_count[pose] = count


@wp.kernel
def _pace_poses(
    # In:
    pacing: Pacing,
    length: wp.array[wp.float64],  # [m], shape [pose]
    open_length: wp.array[wp.float64],  # the same, or no rows where nothing is asked of them
    chord: wp.array[wp.float64],
    # Out:
    value: wp.array2d[wp.float32],  # draw frequency nominal and actual [Hz], shape [2, pose]
):
    """Draw frequency of a pose's contours, without pauses: as requested, and rounded to whole samples [Hz]."""
    pose = wp.tid()
    own = length[pose]
    if own <= wp.float64(0.0):
        value[0, pose] = NAN
        value[1, pose] = NAN
        return
    nominal = wp.min(wp.max(pacing.speed / own, pacing.nominal_lowest), pacing.nominal_highest)
    drawn = own
    back = wp.float64(0.0)
    if open_length.shape[0] > 0:
        drawn += pacing.again * open_length[pose] + pacing.chord * chord[pose]
        back = chord[pose] / pacing.return_speed
    seconds = pacing.turns * drawn / pacing.speed + back
    samples = wp.ceil(seconds * pacing.update_rate - pacing.seam)
    samples = wp.min(wp.max(samples, pacing.samples_least), pacing.samples_most)
    value[0, pose] = wp.float32(nominal)
    value[1, pose] = wp.float32(pacing.moves * pacing.update_rate / samples)


@wp.kernel
def _sum_spans(
    # In:
    value: wp.array2d[wp.float32],  # shape [metric, pose]
    span_first: wp.array[wp.int64],  # first pose, shape [span]
    span_count: wp.array[wp.int64],  # poses
    # Out:
    statistic: wp.array3d[wp.float64],  # shape [span, metric, statistic]
):
    """Sum one metric of one span, pose by pose."""
    span, metric = wp.tid()
    first = int(span_first[span])
    pose_count = int(span_count[span])
    count = int(0)
    positive = int(0)
    total = wp.float64(0.0)
    square = wp.float64(0.0)
    least = wp.float64(INFINITY)
    greatest = -wp.float64(INFINITY)
    some = Some()
    for start in range(0, pose_count, SOME):
        for k in range(SOME):  # read before any is added, since a GPU waits long for each
            some[k] = value[metric, first + wp.min(start + k, pose_count - 1)]
        for k in range(SOME):
            x = wp.float64(some[k])
            if x - x == wp.float64(0.0) and start + k < pose_count:  # finite
                count = count + 1
                total = total + x
                square = square + x * x
                least = wp.min(least, x)
                greatest = wp.max(greatest, x)
                positive = positive + int(x > wp.float64(0.0))
    statistic[span, metric, 0] = wp.float64(count)
    statistic[span, metric, 1] = total
    statistic[span, metric, 2] = square
    statistic[span, metric, 3] = least
    statistic[span, metric, 4] = greatest
    statistic[span, metric, 5] = wp.float64(positive)


@wp.kernel
def _sum_parts(
    # In:
    span_statistic: wp.array3d[wp.float64],  # shape [span, metric, statistic]
    part_start: wp.array[wp.int64],  # offsets into spans, shape [part + 1]
    begun: wp.array3d[wp.float64],  # of the spans before, shape [part, metric, statistic]; or none at all
    # Out:
    statistic: wp.array3d[wp.float64],  # of these too
):
    """Add the spans of one part to what there is, one statistic of one metric, span by span."""
    part, metric, which = wp.tid()
    out = wp.float64(0.0)
    if which == 3:
        out = wp.float64(INFINITY)
    elif which == 4:
        out = -wp.float64(INFINITY)
    if begun.shape[0] > 0:
        out = begun[part, metric, which]
    for span in range(int(part_start[part]), int(part_start[part + 1])):
        x = span_statistic[span, metric, which]
        if which == 3:
            out = wp.min(out, x)
        elif which == 4:
            out = wp.max(out, x)
        else:
            out = out + x
    statistic[part, metric, which] = out


@on_one_device
def tally_contours(contours: Contours, value: wp.array, length: wp.array, *, measures: bool, encloses: bool) -> None:
    """Measure each pose of contours on the device of its arrays into rows METRICS of `value`, float32 [metric.., pose].

    Polylines of a pose must be in the order of their patches. length: takes the length of all contours in float64 [m],
    shape [pose]. measures: writes that and all rows but the area; length_intensity is the integral of the contours'
    intensity along them [m], and bit-identical to length if that is None or 1 everywhere.
    encloses: writes the area of what closed polylines bound on their patches [m^2], outer boundaries one way round and
    holes the other.
    """
    pose_count = contours.pose_start.shape[0] - 1
    if value.shape[0] < len(METRICS) or value.shape[1] != pose_count or length.shape[0] != pose_count:
        raise ValueError(f"values must have shape [{len(METRICS)}.., {pose_count}], not {list(value.shape)}")
    launch(_tally_contours, pose_count, [contours, int(measures), int(encloses)], [value, length])
    if measures and contours.intensity is not None:
        launch(_weigh_contours, pose_count, [contours], [value])


def measure_gaps(contours: Contours) -> tuple[wp.array, wp.array, wp.array]:
    """Of each pose the length of open polylines, and of their chords [m], float64, and its polylines, int32.

    Polylines without length are left out.
    """
    pose_count, device = contours.pose_start.shape[0] - 1, contours.points.device
    open_length, chord = (wp.empty(pose_count, dtype=wp.float64, device=device) for _ in range(2))
    piece_count = wp.empty(pose_count, dtype=wp.int32, device=device)
    launch(_measure_gaps, pose_count, [contours], [open_length, chord, piece_count])
    return open_length, chord, piece_count


@on_one_device
def pace_poses(
    pacing: Pacing, length: wp.array, gaps: tuple[wp.array, wp.array] | None, value: wp.array | None = None
) -> wp.array:
    """Draw frequency nominal and actual of contours of these lengths [Hz], float32, shape [2, pose]; NaN without any.

    length: [m], float64, shape [pose]. gaps: open lengths and chords (`measure_gaps`), where the pacing asks for them.
    value: takes them, if given.
    """
    if value is None:
        value = wp.empty((2, length.shape[0]), dtype=wp.float32, device=length.device)
    launch(_pace_poses, length.shape[0], [pacing, length, *(gaps or (None, None))], [value])
    return value


@on_one_device
def sum_parts(
    value: wp.array, span_first: wp.array, span_count: wp.array, part_start: wp.array, begun: wp.array | None = None
) -> wp.array:
    """STATISTICS of each metric and part, float64, shape [part, metric, statistic]; least and greatest of none are inf.

    value: float32, shape [metric, pose]. span_first, span_count: poses of each span, int64, shape [span].
    part_start: offsets into spans, int64, shape [part + 1]. begun: the same statistics of the spans of each part that
    an earlier batch had; None if there were none.
    """
    device, span_total = value.device, span_first.shape[0]
    shape = part_start.shape[0] - 1, value.shape[0], len(STATISTICS)
    if begun is not None and begun.shape != shape:
        raise ValueError(f"statistics must have shape {list(shape)}, not {list(begun.shape)}")
    spans = wp.empty((span_total, *shape[1:]), dtype=wp.float64, device=device)
    statistic = wp.empty(shape, dtype=wp.float64, device=device)
    launch(_sum_spans, spans.shape[:2], [value, span_first, span_count], [spans])
    launch(_sum_parts, shape, [spans, part_start, begun], [statistic])
    return statistic


@wp.kernel
def _count_bins(
    # In:
    value: wp.array[wp.float32],  # shape [pose]
    span_first: wp.array[wp.int64],  # first pose, shape [span]
    span_count: wp.array[wp.int64],  # poses
    part_start: wp.array[wp.int64],  # offsets into spans, shape [part + 1]
    shift: int,  # bits that are dropped
    first: int,  # leading bits of bin 2
    # Out:
    count: wp.array2d[wp.int32],  # zero-initialised, shape [part, bin]
):
    """Count the numbers of one span in the bins of its part."""
    span = wp.tid()
    part = wp.lower_bound(part_start, wp.int64(span + 1)) - 1
    last = count.shape[1] - 1
    for k in range(int(span_count[span])):
        x = value[int(span_first[span]) + k]
        if x - x == wp.float32(0.0):  # finite
            own = int(0)
            if x > wp.float32(0.0):
                own = wp.clamp((wp.cast(x, wp.int32) >> shift) - first + 2, 1, last)
            wp.atomic_add(count, part, own, 1)


@on_one_device
def count_bins(
    value: wp.array,
    span_first: wp.array,
    span_count: wp.array,
    part_start: wp.array,
    *,
    lowest: int,
    highest: int,
    bits: int,
) -> wp.array:
    """Numbers of finite values in each bin, by part, int32, shape [part, bin].

    Bin 0: values up to 0. Bin 1: above 0 and below 2^lowest. Then every factor of two up to 2^highest is divided into
    2^bits bins of equal width; each holds its lower edge. The last bin: 2^highest and more.

    value: float32, shape [pose]. span_first, span_count, part_start: as of `sum_parts`.
    """
    shape = part_start.shape[0] - 1, (highest - lowest) * 2**bits + 3
    count = wp.zeros(shape, dtype=wp.int32, device=value.device)
    inputs = [value, span_first, span_count, part_start, 23 - bits, (127 + lowest) << bits]  # float32: 23 and 8 bits
    launch(_count_bins, span_first.shape[0], inputs, [count])
    return count


@wp.kernel
def _count_facing(
    # In:
    pose: wp.array[wp.transform],  # hand frame -> array frame
    drawn: wp.array[wp.float32],  # length of contours [m]
    cosine: wp.float64,  # of the angle
    # Out:
    facing: wp.array[wp.float32],
):
    """Compare the angle between the skin's normal and the direction to the array's centre by its cosine."""
    row = wp.tid()
    if not (drawn[row] > 0.0):
        facing[row] = NAN
        return
    position = to_float64(wp.transform_get_translation(pose[row]))
    q = wp.transform_get_rotation(pose[row])
    x = wp.float64(q[0])
    y = wp.float64(q[1])
    z = wp.float64(q[2])
    w = wp.float64(q[3])
    two = wp.float64(2.0)
    # The hand's -y, on which its skin lies.
    skin = wp.vec3d(two * (w * z - x * y), two * (x * x + z * z) - wp.float64(1.0), -two * (y * z + w * x))
    along = -wp.dot(skin, position)
    facing[row] = wp.float32(wp.where(along >= cosine * wp.length(position), 1.0, 0.0))


@on_one_device
def count_facing(pose: wp.array, drawn: wp.array, degrees: Sequence[float], out: wp.array) -> None:
    """Write a row for each angle: 1 where a palm that draws faces the array's centre within it, 0 beyond, else NaN.

    pose: wp.transform [pose], hand frame -> array frame; the skin faces -y of the hand. drawn: length of the pose's
    contours [m], float32 [pose]. degrees: angles. out: float32, shape [angle, pose].
    """
    for row, angle in enumerate(degrees):
        inputs = [pose, drawn, wp.float64(math.cos(math.radians(angle)))]
        launch(_count_facing, len(pose), inputs, [out[row]])
