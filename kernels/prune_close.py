"""Which parts of contours run too close beside others: of two, the one on the shorter polyline goes.

A part runs beside another one if from its start, middle or end to the nearest point of the other, or the other way
round, it is less than `distance`, their directions differ by less than an angle either way round, and the way between
them leads across, not along: within 45 degrees of square to both. Two pieces of a line, one behind the other, do not
run beside each other.

| the other part is on | compared |
|---|---|
| a longer polyline of the pose (of equal ones the first) | unless the two touch end to end, see below |
| the same polyline, further to its start | unless joined by what is kept of it, no more than `apart` along it |
| another patch | only if patches are to be compared with each other |

Open polylines whose ends touch are one line in two pieces: their parts are compared as those of the same polyline are,
along the way through the ends that touch.

What has been removed hides nothing: polylines are judged from the longest to the shortest, each from its start, and
again until nothing more is removed.
"""

from typing import Any

import warp as wp

from .cut import Parts, launch, parts_of, point_at, segment_length, share_end
from .patch import EXACT
from .prune import measure_lines

wp.set_module_options(EXACT)

FAR = wp.constant(wp.float64(1.0e30))  # [m]
TOUCH = wp.constant(wp.float64(1.0e-6))  # [m]; ends nearer than this touch: float32 of a contour is exact to 0.02 um
ACROSS = wp.constant(wp.float64(0.7071067811865476))  # cosine of 45 degrees


@wp.struct
class Beside:
    """When one part runs beside another."""

    distance: wp.float64  # [m]
    parallel: wp.float64  # least cosine between directions
    apart: wp.float64  # along the same polyline [m]
    patches: int  # 1: patches are compared with each other


@wp.struct
class Bits:
    """Parts as they are compared."""

    middle: wp.array[wp.vec3d]  # [m]
    way: wp.array[wp.vec3d]  # from start to end [m]
    along: wp.array[wp.float64]  # of the middle, from the polyline's start [m]
    broken: wp.array[wp.int64]  # parts removed before it on its polyline
    keep: wp.array[wp.uint8]


@wp.struct
class Lines:
    """Polylines by length."""

    patch: wp.array[wp.int32]
    closed: wp.array[wp.uint8]
    length: wp.array[wp.float64]  # [m]
    broken: wp.array[wp.int64]  # parts removed of it so far
    start: wp.array[wp.vec3d]  # its ends [m]
    end: wp.array[wp.vec3d]


@wp.kernel
def _measure_parts(
    # In:
    points: wp.array[wp.vec3],
    polyline_start: wp.array[wp.int64],
    parts: Parts,
    # Out:
    lines: Lines,
    bits: Bits,
):
    """Middle, way and place along its polyline of each part, and the polyline's ends."""
    line = wp.tid()
    lines.start[line] = point_at(points, polyline_start[line], wp.float64(0.0))
    lines.end[line] = point_at(points, polyline_start[line + 1] - wp.int64(1), wp.float64(0.0))
    first, count = parts_of(parts, polyline_start, line)
    passed = wp.float64(0.0)
    for k in range(count):
        part = first + wp.int64(k)
        i = parts.segment[part]
        span = share_end(parts, part) - parts.share[part]
        a = point_at(points, i, wp.float64(0.0))
        b = point_at(points, i + wp.int64(1), wp.float64(0.0))
        bits.way[part] = span * (b - a)
        bits.middle[part] = a + (parts.share[part] + wp.float64(0.5) * span) * (b - a)
        length = span * segment_length(points, i)
        bits.along[part] = passed + wp.float64(0.5) * length
        passed += length


@wp.func
def is_beside(x: wp.vec3d, a: wp.vec3d, middle: wp.vec3d, b: wp.vec3d, distance: wp.float64):
    """Whether a point of a part with direction a lies beside another part, given by its middle and way."""
    share = wp.dot(x - middle, b) / wp.max(wp.dot(b, b), wp.float64(1.0e-30))
    d = x - middle - wp.clamp(share, wp.float64(-0.5), wp.float64(0.5)) * b
    gap = wp.length(d)
    across = wp.abs(wp.dot(d, a)) <= ACROSS * gap * wp.length(a)
    return gap < distance and across and wp.abs(wp.dot(d, b)) <= ACROSS * gap * wp.length(b)


@wp.func
def runs_beside(bits: Bits, own: wp.int64, other: wp.int64, rule: Beside):
    """Whether start, middle or end of either of two parts lies beside the other."""
    a = bits.way[own]
    b = bits.way[other]
    p = bits.middle[own]
    q = bits.middle[other]
    reach = rule.distance + wp.float64(0.5) * (wp.length(a) + wp.length(b))
    if wp.length_sq(p - q) >= reach * reach or wp.abs(wp.dot(a, b)) < rule.parallel * wp.length(a) * wp.length(b):
        return False
    for k in range(3):
        at = wp.float64(0.5) * wp.float64(k - 1)
        if is_beside(p + at * a, a, q, b, rule.distance) or is_beside(q + at * b, b, p, a, rule.distance):
            return True
    return False


@wp.func
def is_joined(bits: Bits, lines: Lines, line: int, own: wp.int64, before: wp.int64, rule: Beside):
    """Whether two parts of a polyline are joined by a short way along what is kept of it."""
    gap = bits.along[own] - bits.along[before]
    if bits.broken[own] == bits.broken[before] and gap <= rule.apart:
        return True
    loops = lines.closed[line] != wp.uint8(0) and lines.length[line] - gap <= rule.apart
    return loops and bits.broken[before] == wp.int64(0) and bits.broken[own] == lines.broken[line]


@wp.func
def way_to_end(bits: Bits, lines: Lines, line: int, part: wp.int64, at_end: int):
    """How far a part is from the start or the end of its polyline; infinite where something between was removed [m]."""
    way = bits.along[part]
    broken = bits.broken[part]
    if at_end == 1:
        way = lines.length[line] - way
        broken = lines.broken[line] - broken
    return wp.where(broken == wp.int64(0), way, FAR)


@wp.func
def is_joined_by_ends(bits: Bits, lines: Lines, line: int, own: wp.int64, other: int, part: wp.int64, rule: Beside):
    """Whether parts of two open polylines are joined by a short way through ends that touch."""
    if lines.closed[line] != wp.uint8(0) or lines.closed[other] != wp.uint8(0):
        return False
    for k in range(4):
        a = wp.where(k < 2, lines.start[line], lines.end[line])
        b = wp.where(k % 2 == 0, lines.start[other], lines.end[other])
        if wp.length(a - b) < TOUCH:
            way = way_to_end(bits, lines, line, own, k // 2) + way_to_end(bits, lines, other, part, k % 2)
            if way <= rule.apart:
                return True
    return False


@wp.func
def is_longer(lines: Lines, one: int, other: int):
    """Whether one polyline is judged before another."""
    a = lines.length[one]
    b = lines.length[other]
    return a > b or (a == b and one < other)


@wp.func
def is_crowded(
    polyline_start: wp.array[wp.int64],
    parts: Parts,
    bits: Bits,
    lines: Lines,
    line: int,
    own: wp.int64,
    other: int,
    rule: Beside,
):
    """Whether a part runs beside a kept one of a polyline: a longer one, or its own further to the start."""
    first, count = parts_of(parts, polyline_start, other)
    if other == line:
        count = int(own - first)
    for k in range(count):
        part = first + wp.int64(k)
        if bits.keep[part] != wp.uint8(0) and runs_beside(bits, own, part, rule):
            if other == line:
                if not is_joined(bits, lines, line, own, part, rule):
                    return True
            elif not is_joined_by_ends(bits, lines, line, own, other, part, rule):
                return True
    return False


@wp.func
def judge_line(
    polyline_start: wp.array[wp.int64],
    parts: Parts,
    bits: Bits,
    lines: Lines,
    line: int,
    begin: int,
    end: int,
    rule: Beside,
):
    """Remove the parts of a polyline that run beside kept ones; 1 if there were any."""
    first, count = parts_of(parts, polyline_start, line)
    removed = int(0)
    broken = wp.int64(0)
    for k in range(count):
        part = first + wp.int64(k)
        bits.broken[part] = broken
        if bits.keep[part] != wp.uint8(0):
            for other in range(begin, end):
                if bits.keep[part] != wp.uint8(0) and (other == line or is_longer(lines, other, line)):
                    if rule.patches != 0 or lines.patch[other] == lines.patch[line]:
                        if is_crowded(polyline_start, parts, bits, lines, line, part, other, rule):
                            bits.keep[part] = wp.uint8(0)
                            lines.broken[line] = lines.broken[line] + wp.int64(1)
                            removed = int(1)
        if bits.keep[part] == wp.uint8(0):
            broken += wp.int64(1)
    return removed


@wp.kernel
def _thin_poses(
    # In:
    polyline_start: wp.array[wp.int64],
    pose_start: wp.array[wp.int64],
    parts: Parts,
    rule: Beside,
    # Out:
    lines: Lines,
    bits: Bits,
):
    """Judge a pose's polylines from the longest to the shortest, until nothing more is removed."""
    pose = wp.tid()
    begin = int(pose_start[pose])
    end = int(pose_start[pose + 1])
    changed = int(1)
    while changed == 1:
        changed = int(0)
        last = int(-1)
        for _rank in range(begin, end):
            line = int(-1)
            for other in range(begin, end):
                if last < 0 or (other != last and is_longer(lines, last, other)):
                    if line < 0 or is_longer(lines, other, line):
                        line = other
            if judge_line(polyline_start, parts, bits, lines, line, begin, end, rule) == 1:
                changed = int(1)
            last = line


def thin_contours(
    points: wp.array,
    polyline_start: wp.array,
    polyline_patch: wp.array,
    polyline_closed: wp.array,
    pose_start: wp.array,
    parts: Any,
    rule: Any,
) -> wp.array:
    """Which parts stay where contours run too close beside others, uint8, shape [part].

    parts: Parts, short beside the distance; rule: Beside. One thread a pose; the work grows with the square of its
    parts.
    """
    device, count, line_count = points.device, parts.segment.shape[0], polyline_start.shape[0] - 1
    bits, lines = Bits(), Lines()
    bits.middle = wp.empty(count, dtype=wp.vec3d, device=device)
    bits.way = wp.empty(count, dtype=wp.vec3d, device=device)
    bits.along = wp.empty(count, dtype=wp.float64, device=device)
    bits.broken = wp.zeros(count, dtype=wp.int64, device=device)
    bits.keep = wp.full(count, 1, dtype=wp.uint8, device=device)
    lines.patch, lines.closed = polyline_patch, polyline_closed
    lines.length = measure_lines(points, polyline_start)
    lines.broken = wp.zeros(line_count, dtype=wp.int64, device=device)
    lines.start = wp.empty(line_count, dtype=wp.vec3d, device=device)
    lines.end = wp.empty(line_count, dtype=wp.vec3d, device=device)
    launch(_measure_parts, line_count, [points, polyline_start, parts], [lines, bits])
    launch(_thin_poses, pose_start.shape[0] - 1, [polyline_start, pose_start, parts, rule], [lines, bits])
    return bits.keep
