"""Removal of contour parts that run too close beside others; of two, the one on the shorter line is removed.

A part runs beside another one if from its start, middle or end to the nearest point of the other, or from the other's
to its own, it is less than `distance`, their directions or opposites differ by less than an angle, and the vector
between them leads across, not along: within 45 degrees of square to both. Two pieces of a line, one behind the other,
do not run beside each other.

| the other part is on | compared |
|---|---|
| a longer line of the pose (of equal ones the first) | always |
| the same line, further to its start | unless joined by what stays of it, no more than `apart` along it |
| another patch | only if patches are to be compared with each other |

A *line* is a closed polyline, or open polylines that touch end to end, one after the other, so that the result is the
same however a line is cut into polylines. It runs as the first of them in the batch does; it is closed if its last
end touches its first. Where more than two ends touch, the two that go on most straightly are joined; a third end is
joined to none.

What has been removed hides nothing: lines are processed from the longest to the shortest, each from its start, and
again until nothing more is removed.
"""

import warp as wp

from ..contours import Contours, point_at, segment_length
from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT
from .cut import Parts, parts_of, share_end

wp.set_module_options(EXACT)

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
    """Parts as they are compared, in the order of their lines."""

    part: wp.array[wp.int64]  # which one of all parts
    patch: wp.array[wp.int32]
    middle: wp.array[wp.vec3d]  # [m]
    chord: wp.array[wp.vec3d]  # from start to end, as its polyline runs [m]
    along: wp.array[wp.float64]  # of the middle, from the line's start [m]
    broken: wp.array[wp.int64]  # parts removed before it on its line
    keep: wp.array[wp.uint8]


@wp.struct
class Lines:
    """Lines, each at the number of its first polyline in the batch; the numbers of its others have no parts."""

    first: wp.array[wp.int64]  # its first part, as Bits counts them
    count: wp.array[wp.int32]  # its parts
    closed: wp.array[wp.uint8]
    length: wp.array[wp.float64]  # [m]
    broken: wp.array[wp.int64]  # parts removed of it so far


@wp.struct
class Ends:
    """Ends of polylines: 2 i is the start of polyline i, 2 i + 1 its end."""

    at: wp.array[wp.vec3d]  # [m]
    out: wp.array[wp.vec3d]  # unit vector from the end into its polyline
    partner: wp.array[wp.int32]  # the end that it goes on at, -1 for none; joined if each is the other's


@wp.func
def other_end(end: int):
    """The other end of the same polyline."""
    return end + 1 - 2 * (end % 2)


@wp.kernel
def _find_ends(c: Contours, ends: Ends):
    """Find the ends of each polyline and the directions there."""
    line = wp.tid()
    first = c.polyline_start[line]
    last = c.polyline_start[line + 1] - wp.int64(1)
    a = point_at(c.points, first, wp.float64(0.0))
    b = point_at(c.points, last, wp.float64(0.0))
    ends.at[2 * line] = a
    ends.at[2 * line + 1] = b
    ends.out[2 * line] = wp.normalize(point_at(c.points, first + wp.int64(1), wp.float64(0.0)) - a)
    ends.out[2 * line + 1] = wp.normalize(point_at(c.points, last - wp.int64(1), wp.float64(0.0)) - b)


@wp.func
def partner_of(ends: Ends, c: Contours, end: int, begin: int, stop: int):
    """The end of another open polyline that touches this one and goes on most straightly; else its own other end."""
    best = int(-1)
    least = wp.float64(2.0)
    for other in range(2 * begin, 2 * stop):
        if other // 2 != end // 2 and c.polyline_closed[other // 2] == wp.uint8(0):
            if wp.length(ends.at[end] - ends.at[other]) < TOUCH:
                turn = wp.dot(ends.out[end], ends.out[other])
                if turn < least:
                    least = turn
                    best = other
    own = other_end(end)
    if best < 0 and wp.length(ends.at[end] - ends.at[own]) < TOUCH:
        best = own
    return best


@wp.func
def joined_to(ends: Ends, end: int):
    """The end that this one is joined to, -1 for none."""
    partner = ends.partner[end]
    if partner >= 0:
        if ends.partner[partner] != end:
            partner = int(-1)
    return partner


@wp.func
def write_parts(c: Contours, parts: Parts, end: int, rank: wp.int64, passed: wp.float64, bits: Bits):
    """Write a polyline's parts from one of its ends on, `passed` metres along its line; how far that is then."""
    first, count = parts_of(parts, c, end // 2)
    for k in range(count):
        part = first + wp.int64(wp.where(end % 2 == 0, k, count - 1 - k))
        i = parts.segment[part]
        span = share_end(parts, part) - parts.share[part]
        a = point_at(c.points, i, wp.float64(0.0))
        b = point_at(c.points, i + wp.int64(1), wp.float64(0.0))
        own = rank + wp.int64(k)
        bits.part[own] = part
        bits.patch[own] = c.polyline_patch[end // 2]
        bits.chord[own] = span * (b - a)
        bits.middle[own] = a + (parts.share[part] + wp.float64(0.5) * span) * (b - a)
        length = span * segment_length(c.points, i)
        bits.along[own] = passed + wp.float64(0.5) * length
        passed += length
    return passed, count


@wp.kernel
def _join_lines(
    # In:
    c: Contours,
    parts: Parts,
    # Out:
    ends: Ends,
    joined: wp.array[wp.uint8],  # polylines that have a line, shape [polyline]
    lines: Lines,
    bits: Bits,
):
    """Follow each line of a pose through the ends that touch, and write its parts one after the other."""
    pose = wp.tid()
    begin = int(c.pose_start[pose])
    stop = int(c.pose_start[pose + 1])
    for end in range(2 * begin, 2 * stop):
        if c.polyline_closed[end // 2] == wp.uint8(0):
            ends.partner[end] = partner_of(ends, c, end, begin, stop)
    rank = wp.int64(0)
    if begin < stop:
        rank = parts.start[c.polyline_start[begin]]
    for line in range(begin, stop):
        if joined[line] == wp.uint8(0):
            closed = c.polyline_closed[line]
            start = int(2 * line)
            before = joined_to(ends, start)
            while before >= 0 and before != 2 * line + 1:
                start = other_end(before)
                before = joined_to(ends, start)
            if before >= 0:  # all the way round
                closed = wp.uint8(1)
                start = 2 * line
            lines.first[line] = rank
            passed = wp.float64(0.0)
            total = int(0)
            end = int(start)
            while end >= 0:
                joined[end // 2] = wp.uint8(1)
                passed, count = write_parts(c, parts, end, rank, passed, bits)
                rank += wp.int64(count)
                total += count
                end = joined_to(ends, other_end(end))
                if end == start:
                    end = int(-1)
            lines.closed[line] = closed
            lines.count[line] = total
            lines.length[line] = passed


@wp.func
def is_beside(x: wp.vec3d, a: wp.vec3d, middle: wp.vec3d, b: wp.vec3d, distance: wp.float64):
    """Whether a point of a part with direction a lies beside another part, given by its middle and chord."""
    share = wp.dot(x - middle, b) / wp.max(wp.dot(b, b), wp.float64(1.0e-30))
    d = x - middle - wp.clamp(share, wp.float64(-0.5), wp.float64(0.5)) * b
    gap = wp.length(d)
    across = wp.abs(wp.dot(d, a)) <= ACROSS * gap * wp.length(a)
    return gap < distance and across and wp.abs(wp.dot(d, b)) <= ACROSS * gap * wp.length(b)


@wp.func
def runs_beside(bits: Bits, own: wp.int64, other: wp.int64, rule: Beside):
    """Whether start, middle or end of either of two parts lies beside the other."""
    a = bits.chord[own]
    b = bits.chord[other]
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
    """Whether two parts of a line are joined by a short distance along what stays of it."""
    gap = bits.along[own] - bits.along[before]
    if bits.broken[own] == bits.broken[before] and gap <= rule.apart:
        return True
    loops = lines.closed[line] != wp.uint8(0) and lines.length[line] - gap <= rule.apart
    return loops and bits.broken[before] == wp.int64(0) and bits.broken[own] == lines.broken[line]


@wp.func
def is_longer(lines: Lines, one: int, other: int):
    """Whether one line is processed before another."""
    a = lines.length[one]
    b = lines.length[other]
    return a > b or (a == b and one < other)


@wp.func
def is_crowded(bits: Bits, lines: Lines, line: int, own: wp.int64, other: int, rule: Beside):
    """Whether a part runs beside a part of a line that stays: a longer one, or its own further to the start."""
    first = lines.first[other]
    count = int(lines.count[other])
    if other == line:
        count = int(own - first)
    for k in range(count):
        part = first + wp.int64(k)
        if bits.keep[part] != wp.uint8(0) and (rule.patches != 0 or bits.patch[part] == bits.patch[own]):
            if runs_beside(bits, own, part, rule):
                if other != line or not is_joined(bits, lines, line, own, part, rule):
                    return True
    return False


@wp.func
def prune_line(bits: Bits, lines: Lines, line: int, begin: int, end: int, rule: Beside):
    """Remove the parts of a line that run beside parts that stay; 1 if there were any."""
    removed = int(0)
    broken = wp.int64(0)
    for k in range(lines.count[line]):
        part = lines.first[line] + wp.int64(k)
        bits.broken[part] = broken
        if bits.keep[part] != wp.uint8(0):
            for other in range(begin, end):
                if bits.keep[part] != wp.uint8(0) and (other == line or is_longer(lines, other, line)):
                    if is_crowded(bits, lines, line, part, other, rule):
                        bits.keep[part] = wp.uint8(0)
                        lines.broken[line] = lines.broken[line] + wp.int64(1)
                        removed = int(1)
        if bits.keep[part] == wp.uint8(0):
            broken += wp.int64(1)
    return removed


@wp.kernel
def _thin_poses(c: Contours, rule: Beside, lines: Lines, bits: Bits):
    """Process a pose's lines from the longest to the shortest, until nothing more is removed."""
    pose = wp.tid()
    begin = int(c.pose_start[pose])
    end = int(c.pose_start[pose + 1])
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
            if prune_line(bits, lines, line, begin, end, rule) == 1:
                changed = int(1)
            last = line


@wp.kernel
def _write_keep(bits: Bits, keep: wp.array[wp.uint8]):
    """Write what stays in the order of all parts."""
    i = wp.tid()
    keep[bits.part[i]] = bits.keep[i]


@on_one_device
def thin_contours(contours: Contours, parts: Parts, rule: Beside) -> wp.array:
    """Whether parts stay if contours run too close beside others, uint8, shape [part].

    parts: short beside the distance. One thread a pose; the work grows with the square of its parts.
    """
    device, line_count = contours.points.device, contours.polyline_closed.shape[0]
    pose_count, count = contours.pose_start.shape[0] - 1, parts.segment.shape[0]
    bits, lines, ends = Bits(), Lines(), Ends()
    bits.part = wp.empty(count, dtype=wp.int64, device=device)
    bits.patch = wp.empty(count, dtype=wp.int32, device=device)
    bits.middle, bits.chord = (wp.empty(count, dtype=wp.vec3d, device=device) for _ in range(2))
    bits.along = wp.empty(count, dtype=wp.float64, device=device)
    bits.broken = wp.zeros(count, dtype=wp.int64, device=device)
    bits.keep = wp.full(count, 1, dtype=wp.uint8, device=device)
    for name, dtype in (("first", wp.int64), ("count", wp.int32), ("length", wp.float64), ("broken", wp.int64)):
        setattr(lines, name, wp.zeros(line_count, dtype=dtype, device=device))
    lines.closed, joined = (wp.zeros(line_count, dtype=wp.uint8, device=device) for _ in range(2))
    ends.at, ends.out = (wp.empty(2 * line_count, dtype=wp.vec3d, device=device) for _ in range(2))
    ends.partner = wp.full(2 * line_count, -1, dtype=wp.int32, device=device)
    launch(_find_ends, line_count, [contours], [ends])
    launch(_join_lines, pose_count, [contours, parts], [ends, joined, lines, bits])
    launch(_thin_poses, pose_count, [contours, rule], [lines, bits])
    keep = wp.empty_like(bits.keep)
    launch(_write_keep, count, [bits], [keep])
    return keep
