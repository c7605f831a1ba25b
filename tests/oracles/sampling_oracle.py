"""The slow and obvious way to sample contours, sample by sample in plain Python, to compare with."""

import itertools
import math

import numpy as np
from contour_shapes import still
from numpy_sampler.sampler import Sampler
from numpy_sampler.sampling import sample_contours


def distance(a, b):
    return math.sqrt(sum((x - y) ** 2 for x, y in zip(a, b, strict=True)))


def turns_sharply(a, b, c, angle):
    u, v = [y - x for x, y in zip(a, b, strict=True)], [y - x for x, y in zip(b, c, strict=True)]
    cosine = sum(x * y for x, y in zip(u, v, strict=True)) / (distance(a, b) * distance(b, c))
    return math.acos(max(-1.0, min(1.0, cosine))) > angle


def corner_flags(points, closed, angle):
    """Whether the focal point pauses at each vertex; at a closed line's start it does at its end."""
    last = len(points) - 1
    flags = [0 < i < last and turns_sharply(points[i - 1], points[i], points[i + 1], angle) for i in range(last + 1)]
    if closed:
        flags[last] = turns_sharply(points[last - 1], points[last], points[1], angle)
    else:
        flags[0] = flags[last] = True
    return flags


def there_and_back(nodes):
    """Nodes (time to get there, point, pauses) once forth and once back."""
    back = [(nodes[i + 1][0], nodes[i][1], nodes[i][2]) for i in range(len(nodes) - 2, -1, -1)]
    return [(nodes[0][0], nodes[0][1], False), *nodes[1:], *back]


def timetable(lines, strategy):
    """Times and points of a cycle: [(time, point), ...]; a jump is two points at one time."""
    nodes = []
    for points, closed in lines:
        points = [tuple(float(np.float32(x)) for x in p) for p in points]
        if closed or strategy.gap.kind == "close":
            points, closed = [*points, points[0]], True
        flags = corner_flags(points, closed, strategy.dwell.angle)
        times = [0.0] + [distance(a, b) / strategy.speed for a, b in itertools.pairwise(points)]
        piece = list(zip(times, points, flags, strict=True))
        if strategy.gap.kind == "pendulum" and not closed:
            piece = there_and_back(piece)
        if nodes and strategy.gap.kind == "return":
            piece[0] = (distance(nodes[-1][1], points[0]) / strategy.gap.speed, *piece[0][1:])
        nodes += piece
    if strategy.order.kind == "pendulum":
        nodes = there_and_back(nodes)
    elif strategy.gap.kind == "return":
        nodes.append((distance(nodes[-1][1], nodes[0][1]) / strategy.gap.speed, nodes[0][1], False))
    moving, pauses = sum(n[0] for n in nodes), sum(n[2] for n in nodes)
    share = strategy.dwell.share
    pause = strategy.dwell.time or (share / (1 - share) * moving / pauses if pauses else 0.0)
    table, time = [], 0.0
    for duration, point, pauses_here in nodes:
        time += duration
        table.append((time, point))
        if pauses_here and pause > 0:
            time += pause
            table.append((time, point))
    return table


def place_at(table, time):
    for (t0, a), (t1, b) in reversed(list(itertools.pairwise(table))):
        if t0 <= time and t1 > t0:
            part = (time - t0) / (t1 - t0)
            return [x + part * (y - x) for x, y in zip(a, b, strict=True)]
    raise AssertionError(f"time {time} is before the table")


def sampled_slowly(lines, strategy, count):
    """The first `count` focal points of a pose that stays, shape [count, 3]."""
    table = timetable(lines, strategy)
    total = table[-1][0]
    cycle = strategy.samples_of(total)
    out = []
    for k in range(count):
        time = (k % cycle) * total / cycle
        if strategy.pace.points is not None:
            n = strategy.pace.points
            i = math.floor(time / total * n + 1e-9)
            if strategy.order.kind == "step":
                i = i * strategy.order.step % n
            elif strategy.order.kind == "random":
                i = list(np.random.default_rng(strategy.order.seed).permutation(n))[i]
            time = i * total / n
        out.append(place_at(table, time))
    return np.array(out)


def drawn_slowly(poses, counts, speed, rate, slack):
    """Constant speed over poses of one closed contour each: [(corners, samples), ...], the default strategy."""
    out, arc, length, direction = [], None, None, None
    for corners, count in zip(poses, counts, strict=True):
        ring = [tuple(float(np.float32(x)) for x in p) for p in [*corners, corners[0]]]
        arcs = [0.0]
        for a, b in itertools.pairwise(ring):
            arcs.append(arcs[-1] + distance(a, b))
        length = arcs[-1]
        step = length / math.ceil(length * rate / speed - 1e-3)
        arc = (
            0.0 if direction is None else nearest_slowly(ring, arcs, out[-1], direction, slack, 3 * speed / rate) + step
        )
        for _ in range(count):
            arc %= length
            table = list(zip(arcs, ring, strict=True))
            out.append(place_at(table, arc))
            i = max(j for j in range(len(ring) - 1) if arcs[j] <= arc)
            direction = [y - x for x, y in zip(ring[i], ring[i + 1], strict=True)]
            arc += step
    return np.array(out)


def nearest_slowly(ring, arcs, point, direction, slack, reach):
    """Arc length of the nearest point in the same direction; beyond `reach`, if anything is nearer, in any."""
    segments = []
    for a, b, arc in zip(ring[:-1], ring[1:], arcs[:-1], strict=True):
        segment = [y - x for x, y in zip(a, b, strict=True)]
        long = distance(a, b)
        part = sum((p - x) * w for p, x, w in zip(point, a, segment, strict=True)) / long**2
        part = min(max(part, 0.0), 1.0)
        off = distance(point, [x + part * w for x, w in zip(a, segment, strict=True)])
        against = sum(x * y for x, y in zip(segment, direction, strict=True)) < -1e-9 * long * math.hypot(*direction)
        segments.append((off, against, arc + part * long))
    beyond = reach if min(off for off, _, _ in segments) <= reach else math.inf
    return min((off + slack * (against or off > beyond), k, at) for k, (off, against, at) in enumerate(segments))[2]


class NotingSampler(Sampler):
    """The sampler in NumPy, which notes the cycle, parameter and index of each pose's contours that it enters."""

    def __init__(self, strategy):
        super().__init__(strategy)
        self.entries = []

    def _enter(self, path, silent):
        cursor = super()._enter(path, silent)
        self.entries.append((cursor.cycle, cursor._anchor, cursor._index))
        return cursor


def entered_by_numpy(batch, time, duration, strategy):
    """Cycle, parameter and index of the first sample on the contours of each pose that has some and samples."""
    sampler = NotingSampler(strategy)
    list(sample_contours([batch], still(len(time)), time, duration, sampler))
    return sampler.entries
