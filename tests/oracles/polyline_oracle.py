"""Polylines of a whole batch in NumPy: arc lengths, points put in, points left out, intensities by segment."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from palpate.render import ContourBatch


@dataclass(frozen=True, eq=False, slots=True)
class Lines:
    """Where the polylines of a batch on the host run."""

    batch: ContourBatch
    points: np.ndarray
    """[m], float64, shape [point, 3]."""
    line: np.ndarray
    """Which polyline each point is of, shape [point]."""
    length: np.ndarray
    """Of the segment that starts at each point [m], 0 at a polyline's last, shape [point]."""
    arc: np.ndarray
    """From its polyline's first point [m], shape [point]."""
    total: np.ndarray
    """Length of each polyline [m], shape [polyline]."""
    is_segment: np.ndarray
    """Whether a segment starts at each point: all but a polyline's last, bool, shape [point]."""

    @classmethod
    def of(cls, batch: ContourBatch) -> "Lines":
        """The polylines of a batch on the host."""
        points = batch.points.astype(np.float64)
        line = np.repeat(np.arange(batch.polyline_count), np.diff(batch.polyline_start))
        is_segment, length = segment_lengths(batch)
        arc, total = np.zeros(len(points)), np.zeros(batch.polyline_count)
        start = batch.polyline_start.tolist()
        # line by line, so that a polyline's arc does not depend on the batch that it is in
        for k, (a, b) in enumerate(pairwise(start)):
            if b - a > 1:
                np.cumsum(length[a : b - 1], out=arc[a + 1 : b])
                total[k] = arc[b - 1]
        return cls(batch, points, line, length, arc, total, is_segment)

    @property
    def closed(self) -> np.ndarray:
        """Whether each polyline is closed, bool, shape [polyline]."""
        return self.batch.polyline_closed.astype(bool)

    def place(self, line: np.ndarray, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Segment and part 0..1 of it at arc lengths [m] of polylines: closed ones go round, open ones end."""
        total = self.total[line]
        arc = np.where(self.closed[line], np.mod(arc, np.maximum(total, 1e-30)), np.clip(arc, 0.0, total))
        count, asked = len(self.arc), np.repeat([0, 1], [len(self.arc), line.size])
        # points and places in one order, by polyline: what is found does not depend on the rest of the batch
        order = np.lexsort((asked, np.append(self.arc, arc), np.append(self.line, line)))
        behind = np.empty(len(order), np.int64)
        behind[order] = np.cumsum(asked[order] == 0)
        segment = behind[count:].reshape(line.shape) - 1
        first, last = self.batch.polyline_start[line], self.batch.polyline_start[line + 1] - 2
        segment = np.clip(segment, first, np.maximum(last, first))
        part = (arc - self.arc[segment]) / np.maximum(self.length[segment], 1e-30)
        return segment, np.clip(part, 0.0, 1.0)

    def at(self, line: np.ndarray, arc: np.ndarray) -> np.ndarray:
        """Points [m] at arc lengths of polylines, shape [..., 3]."""
        segment, part = self.place(line, arc)
        following = np.minimum(segment + 1, len(self.points) - 1)
        return self.points[segment] + part[..., None] * (self.points[following] - self.points[segment])


def segment_lengths(batch: ContourBatch) -> tuple[np.ndarray, np.ndarray]:
    """`is_segment` and `length` of `Lines`, without the rest, for a batch on the host."""
    points = batch.points.astype(np.float64)
    is_segment = np.ones(len(points), bool)
    is_segment[batch.polyline_start[1:][np.diff(batch.polyline_start) > 0] - 1] = False
    length = np.zeros(len(points))
    here = np.flatnonzero(is_segment)
    length[here] = np.linalg.norm(points[here + 1] - points[here], axis=1)
    return is_segment, length


def with_points(
    batch: ContourBatch, segment: np.ndarray, part: np.ndarray
) -> tuple[ContourBatch, np.ndarray, np.ndarray]:
    """A batch with points put into segments; for each of its points the one it was or comes after, and how far: 0..1.

    segment: number of the point at which it starts; part: 0..1 of it, the ends themselves left out. Points that
    rounding makes equal to a neighbour are left out. New points have no dwell.
    """
    inner = (part > 0) & (part < 1)
    base = np.append(np.arange(batch.point_count), segment[inner])
    part = np.append(np.zeros(batch.point_count), part[inner])
    order = np.lexsort((part, base))
    base, part = base[order], part[order]
    following = np.minimum(base + 1, max(batch.point_count - 1, 0))
    a = batch.points.astype(np.float64)
    new = part > 0
    points = batch.points[base]
    points[new] = a[base[new]] + part[new, None] * (a[following[new]] - a[base[new]])

    def same(others: np.ndarray) -> np.ndarray:
        return (points == others).all(axis=1)

    keep = ~(new & (same(batch.points[base]) | same(batch.points[following])))
    keep[1:] &= ~(new[1:] & new[:-1] & same(np.roll(points, 1, axis=0))[1:])
    base, part, following, new, points = base[keep], part[keep], following[keep], new[keep], points[keep]
    intensity = batch.intensity
    if intensity is not None:
        intensity = (intensity[base] + part * (intensity[following] - intensity[base])).astype(np.float32)
    dwell = None if batch.dwell is None else np.where(new, 0.0, batch.dwell[base]).astype(np.float32)
    start = np.searchsorted(base, batch.polyline_start).astype(np.int64)
    out = replace(batch, points=points, kind=batch.kind[base], polyline_start=start, intensity=intensity, dwell=dwell)
    return out, base, part


def selected(batch: ContourBatch, keep: np.ndarray) -> ContourBatch:
    """A batch without some points, and without polylines of which one point is left or none; keep: bool, [point].

    Last points then have the kind of the point before, and those of loops the values of the first.
    """
    index, count, lines = [], [], []
    for k, (a, b) in enumerate(pairwise(batch.polyline_start.tolist())):
        own = a + np.flatnonzero(keep[a:b])
        if len(own) > 1:
            index.append(own)
            count.append(len(own))
            lines.append(k)
    chosen = np.concatenate([*index, np.zeros(0, np.int64)])
    by_point = {
        name: values[chosen]
        for name, values in batch.by_name().items()
        if name in ("points", "kind", "intensity", "dwell")
    }
    for k, end in enumerate(np.cumsum(count)):
        by_point["kind"][end - 1] = by_point["kind"][end - 2]
        for name in ("intensity", "dwell"):
            if batch.polyline_closed[lines[k]] and name in by_point:
                by_point[name][end - 1] = by_point[name][end - count[k]]
    return replace(
        batch,
        **by_point,
        polyline_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        polyline_patch=batch.polyline_patch[lines],
        polyline_closed=batch.polyline_closed[lines],
        pose_start=np.searchsorted(lines, batch.pose_start).astype(np.int64),
    )


def without_repeats(batch: ContourBatch) -> ContourBatch:
    """A batch without segments of no length."""
    keep = np.ones(batch.point_count, bool)
    keep[1:] = (batch.points[1:] != batch.points[:-1]).any(axis=1)
    keep[batch.polyline_start[:-1][np.diff(batch.polyline_start) > 0]] = True
    return selected(batch, keep)


def divided(batch: ContourBatch, longest: float) -> ContourBatch:
    """A batch whose segments are at most so long [m]: longer ones fall into equal parts.

    Parts are longer by the rounding of their ends to float32 at most, and dividing again changes nothing.
    """
    _, length = segment_lengths(batch)
    spacing = np.spacing(np.abs(batch.points).max(axis=1, initial=0.0)).astype(np.float64)
    spacing[:-1] = np.maximum(spacing[:-1], spacing[1:])
    rounding = np.sqrt(3.0) * spacing  # of a part's length: both ends move by half a spacing along each axis
    new = np.maximum(np.ceil((length - 2.0 * rounding) / longest), 1.0) - 1.0
    new = new.astype(np.int64)
    segment = np.repeat(np.arange(len(new)), new)
    turn = np.arange(len(segment)) - np.repeat(np.cumsum(new) - new, new)
    return with_points(batch, segment, (turn + 1) / (new[segment] + 1))[0]


def levelled(batch: ContourBatch, level: np.ndarray, ramp: float) -> ContourBatch:
    """A batch whose segments have these intensities, times those it had.

    Where two segments of different intensity meet, the point between them has the higher one, and the weaker segment
    reaches its own within `ramp` [m], or in its middle if it is short. level: 0..1, shape [point], by segment.
    """
    lines = Lines.of(batch)
    here = np.flatnonzero(lines.is_segment)
    peak = np.zeros(batch.point_count)
    np.maximum.at(peak, here, level[here])
    np.maximum.at(peak, here + 1, level[here])
    closed = np.flatnonzero(lines.closed & (np.diff(batch.polyline_start) > 1))
    first, last = batch.polyline_start[closed], batch.polyline_start[closed + 1] - 1
    peak[first] = peak[last] = np.maximum(peak[first], peak[last])
    part = np.minimum(ramp / np.maximum(lines.length, 1e-30), 0.5)
    rises, falls = here[peak[here + 1] > level[here]], here[peak[here] > level[here]]
    segment = np.concatenate([falls, rises])
    out, base, part = with_points(batch, segment, np.concatenate([part[falls], 1.0 - part[rises]]))
    value = np.where(part > 0, level[base], peak[base])
    return times(out, value)


def times(batch: ContourBatch, value: np.ndarray) -> ContourBatch:
    """A batch with its intensity multiplied by 0..1 at each point."""
    before = 1.0 if batch.intensity is None else batch.intensity
    return replace(batch, intensity=np.clip(value * before, 0.0, 1.0).astype(np.float32))


def smooth(batch, *, rounds, reach=0.01):
    """A batch as the stage "smooth" leaves it."""
    for _ in range(rounds):
        batch = cut_corners(batch, reach)
    return without_repeats(batch)


def cut_corners(batch, reach):
    """Every segment without a quarter at each end, at most `reach`; ends of open polylines stay."""
    out = {name: [] for name in ("points", "kind", "intensity", "dwell") if getattr(batch, name) is not None}
    counts = []
    for k, (a, b) in enumerate(pairwise(batch.polyline_start.tolist())):
        own = {name: getattr(batch, name)[a:b] for name in out}
        rows = cut_line(own, batch.polyline_closed[k] != 0, reach)
        counts.append(len(rows["kind"]))
        for name in out:
            out[name].append(rows[name])
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    none = {name: getattr(batch, name)[:0] for name in out}
    return replace(batch, polyline_start=start, **{name: np.concatenate([*out[name], none[name]]) for name in out})


def cut_line(own, closed, reach):
    """The rows of one polyline, each of whose segments leaves two points."""
    if len(own["kind"]) < 2:
        return {name: values[:0] for name, values in own.items()}
    p = own["points"].astype(np.float64)
    step = p[1:] - p[:-1]
    cutoff = np.minimum(0.25, reach / np.maximum(np.linalg.norm(step, axis=1), 1e-30))
    part = np.stack([cutoff, 1.0 - cutoff], axis=1)
    if not closed:
        part[0, 0], part[-1, 1] = 0.0, 1.0
    out = {"points": (p[:-1, None] + part[..., None] * step[:, None]).astype(np.float32).reshape(-1, 3)}
    out["kind"] = np.repeat(own["kind"][:-1], 2)
    if "intensity" in own:
        value = own["intensity"]
        mixed = value[:-1, None] + part * (value[1:] - value[:-1])[:, None]
        out["intensity"] = mixed.astype(np.float32).reshape(-1)
    if "dwell" in own:
        out["dwell"] = np.stack([own["dwell"][:-1], np.zeros(len(step), np.float32)], axis=1).reshape(-1)
        if not closed:
            out["dwell"][-1] = own["dwell"][-1]
    if closed:
        out = {name: np.concatenate([values, values[:1]]) for name, values in out.items()}
        out["kind"][-1] = out["kind"][-2]
    return out
