"""Hatch lines over regions in plain NumPy, one region at a time."""

import math
from typing import NamedTuple

import numpy as np

SHORTEST = 1e-7  # [m]; a hatch line below this is a touch


class LineCrossings(NamedTuple):
    """Where hatch lines cross loops, by line, then along it; arrays of shape [crossing]."""

    row: np.ndarray
    point: np.ndarray  # [m], shape [crossing, 2]
    loop: np.ndarray
    along: np.ndarray  # number of the vertex before, and the part of the way to the next
    enters: np.ndarray  # 1 where a line comes to the left of the loop, -1 where it leaves it


def turned(points, c, s):
    """Points in axes that are turned by the angle whose cosine and sine these are, without fused multiply-adds."""
    return np.stack([points[:, 0] * c + points[:, 1] * s, points[:, 0] * -s + points[:, 1] * c], axis=1)


def hatch_lines(loops, spacing, angle, *, connected):
    """Lines over the region inside loops [m], each of shape [point, 2], in the same plane, through the origin.

    loops: counter-clockwise around the region, clockwise around holes, without their first point repeated.
    """
    c, s = math.cos(angle), math.sin(angle)
    loops = [turned(loop, c, s) for loop in loops]
    low, high = (float(f([f(loop[:, 1]) for loop in loops])) for f in (np.min, np.max))
    rows = spacing * np.arange(math.floor(low / spacing) + 1, math.ceil(high / spacing))
    if len(rows) == 0:
        rows = np.array([0.5 * (low + high)])
    found = crossings_of(loops, rows)
    spans = spans_of(found)
    lines = joined_spans(found, spans, loops) if connected else single_spans(found, spans)
    return [turned(line, c, -s) for line in lines]


def crossings_of(loops, rows):
    parts = []
    for k, a in enumerate(loops):
        b = np.roll(a, -1, axis=0)
        under_a, under_b = a[:, 1, None] <= rows, b[:, 1, None] <= rows  # a vertex on a line counts as below it
        i, row = np.nonzero(under_a != under_b)
        part = (rows[row] - a[i, 1]) / (b[i, 1] - a[i, 1])
        x = a[i, 0] + part * (b[i, 0] - a[i, 0])
        parts.append(
            (row, x, np.full(len(i), k), i + np.clip(part, 0.0, 1.0 - 1e-12), np.where(under_a[i, row], -1, 1))
        )
    row, x, loop, along, enters = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((along, loop, -enters, x, row))
    point = np.stack([x, rows[row]], axis=1)[order]
    return LineCrossings(row[order], point, loop[order], along[order], enters[order])


def spans_of(found):
    """First and last crossing of each stretch of a line inside the region, shape [span, 2]."""
    winding = np.cumsum(found.enters)  # 0 at the end of every line
    before = winding - found.enters
    first, last = np.flatnonzero((before <= 0) & (winding > 0)), np.flatnonzero((before > 0) & (winding <= 0))
    long = found.point[last, 0] - found.point[first, 0] > SHORTEST
    return np.stack([first, last], axis=1)[long]


def single_spans(found, spans):
    """Each stretch by itself, every other line backwards."""
    return [found.point[span[::-1] if found.row[span[0]] % 2 else span] for span in spans]


def joined_spans(found, spans, loops):
    """Stretches joined along the boundary: from the end of one to where the same loop next crosses the next line."""
    span_of = np.full(len(found.row), -1)
    span_of[spans] = np.arange(len(spans))[:, None]
    order = np.lexsort((found.along, found.loop))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    first = np.searchsorted(found.loop[order], np.arange(len(loops) + 1))
    drawn, lines = np.zeros(len(spans), bool), []

    def onward(at):
        """The neighbour of a crossing on its loop that is on the next line, and the boundary between; -1: none."""
        loop = int(found.loop[at])
        base, count = int(first[loop]), int(first[loop + 1] - first[loop])
        for way in (1, -1):
            to = int(order[base + (place[at] - base + way) % count])
            span = int(span_of[to])
            if found.row[to] == found.row[at] + 1 and span >= 0 and not drawn[span]:
                a, b = (at, to) if way > 0 else (to, at)
                return to, [vertices_between(loops[loop], found.along[a], found.along[b])[::way]]
        return -1, []

    for k in range(len(spans)):
        if drawn[k]:
            continue
        first_end, other_end = (int(end) for end in spans[k])
        leads_back = onward(other_end)[0] < 0 <= onward(first_end)[0]
        at, parts = (other_end if leads_back else first_end), []
        while at >= 0:
            span = int(span_of[at])
            drawn[span] = True
            end = int(spans[span].sum() - at)
            parts.append(found.point[[at, end]])
            at, corners = onward(end)
            parts.extend(corners)
        lines.append(np.concatenate(parts))
    return lines


def vertices_between(loop, a, b):
    """Vertices of a loop from one place to another, forwards, shape [point, 2]."""
    first, last = math.floor(a) + 1, math.floor(b)
    if b < a:
        last += len(loop)
    return loop[np.arange(first, last + 1) % len(loop)]
