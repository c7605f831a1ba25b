"""Emphasis: what of contours is strong and what is weak, by corners and by kind; and pauses at corners."""

import math
from dataclasses import replace

import numpy as np

from ..contour_batch import HAND, MADE, OBJECT, ContourBatch
from .polyline_arrays import Lines, levelled, times, with_points
from .registry import Option, Setting, transform_stage

STRAIGHT = math.radians(5.0)  # a straight edge turns by less from segment to segment
RAMP = 1e-3  # [m] over which intensity changes between segments


@transform_stage(
    "corners",
    angle=Option(math.pi / 6, 0.0, math.pi, "rad"),
    window=Option(None, 1e-5, 0.1, "m", widths=0.5),
    reach=Option(None, 1e-5, 0.1, "m", widths=1.0),
    level=Option(0.4, 0.0, 1.0),
    dwell=Option(0.0, 0.0, 10.0, "s"),
)
def emphasise_corners(
    batch: ContourBatch, setting: Setting, *, angle: float, window: float, reach: float, level: float, dwell: float
) -> ContourBatch:
    """Corners at full intensity, the rest weaker; with an option the focal point pauses there.

    A corner is a vertex where the way within `window` [m] behind it turns by more than `angle` [rad] from that within
    `window` before it; of several within a window the sharpest. Rounded corners count, finely drawn arcs do not. From a
    corner the intensity stays at 1 for half of `reach` [m] and falls to `level` over the other half. dwell: pause at
    each corner [s].
    """
    lines = Lines.of(batch)
    at, line = find_corners(lines, angle, window)
    out = batch
    if len(at):
        base = _tent_bases(lines, at, line, reach)
        out, _, part = with_points(batch, *base)
        corner_arc = lines.arc[at]
        at = np.flatnonzero(part == 0)[at]
        lines = Lines.of(out)
        nearest = _arc_to_nearest(lines, corner_arc, line)
        value = level + (1.0 - level) * np.clip(2.0 * (1.0 - nearest / reach), 0.0, 1.0)
    else:
        value = np.full(batch.point_count, level)
    out = times(out, value)
    if dwell == 0:
        return out
    pause = np.zeros(out.point_count, np.float32) if out.dwell is None else out.dwell.copy()
    pause[at] += np.float32(dwell)
    first, last = out.polyline_start[:-1], out.polyline_start[1:] - 1
    seam = lines.closed & (last > first)
    pause[last[seam]] = pause[first[seam]]
    return replace(out, dwell=pause)


def find_corners(lines: Lines, angle: float, window: float) -> tuple[np.ndarray, np.ndarray]:
    """Points that are corners, and their polylines, in order; a loop's seam is its first point. See `corners`."""
    stays = lines.is_segment.copy()  # not the last of a polyline, which ends there or repeats the first
    first = lines.batch.polyline_start[:-1][np.diff(lines.batch.polyline_start) > 0]
    stays[first] &= lines.closed[lines.line[first]]
    here = np.flatnonzero(stays)
    line, arc = lines.line[here], lines.arc[here]
    reach = np.where(lines.closed[line], np.minimum(window, lines.total[line] / 6), window)
    behind = lines.points[here] - lines.at(line, arc - reach)
    ahead = lines.at(line, arc + reach) - lines.points[here]
    size = np.linalg.norm(behind, axis=1) * np.linalg.norm(ahead, axis=1)
    cosine = np.einsum("ij,ij->i", behind, ahead) / np.maximum(size, 1e-30)
    turn = np.where(size > 0, np.arccos(np.clip(cosine, -1.0, 1.0)), 0.0)
    sharp = np.flatnonzero(turn > angle)
    taken: dict[int, list[float]] = {}
    found = []
    for k in sharp[np.lexsort((sharp, -np.round(turn[sharp], 6)))].tolist():
        others = taken.setdefault(int(line[k]), [])
        apart = [abs(float(arc[k]) - other) for other in others]
        if lines.closed[line[k]]:
            apart = [min(d, float(lines.total[line[k]]) - d) for d in apart]
        if all(d > reach[k] for d in apart):
            others.append(float(arc[k]))
            found.append(int(here[k]))
    at = np.sort(np.array(found, np.int64))
    return at, lines.line[at]


def _tent_bases(lines: Lines, at: np.ndarray, line: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Where intensity changes its slope: half of `reach` from each corner, all of it, and midway between near ones."""
    arc = lines.arc[at]
    wanted = [(line, arc + part * reach) for part in (-1.0, -0.5, 0.5, 1.0)]
    following = np.roll(arc, -1)
    other = np.roll(line, -1) != line
    first = np.concatenate([[0], np.flatnonzero(other[:-1]) + 1]) if len(at) else np.zeros(0, np.int64)
    following[other | (np.arange(len(at)) == len(at) - 1)] = arc[first] + lines.total[line[first]]
    near = (following - arc < 2 * reach) & ((following < lines.total[line]) | lines.closed[line])
    wanted.append((line[near], 0.5 * (arc + following)[near]))
    lined, arcs = (np.concatenate(part) for part in zip(*wanted, strict=True))
    on = lines.closed[lined] | ((arcs > 0) & (arcs < lines.total[lined]))
    return lines.place(lined[on], arcs[on])


def _arc_to_nearest(lines: Lines, arc: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Arc from each point to the nearest of some places on its polyline [m]; infinite where there is none."""
    out = np.full(len(lines.points), np.inf)
    for k in np.unique(line).tolist():
        a, b = lines.batch.polyline_start[k], lines.batch.polyline_start[k + 1]
        apart = np.abs(lines.arc[a:b, None] - arc[None, line == k])
        if lines.closed[k]:
            apart = np.minimum(apart, np.abs(lines.total[k] - apart))
        out[a:b] = apart.min(axis=1)
    return out


@transform_stage(
    "edges",
    on_object=Option(1.0, 0.0, 1.0),
    on_hand=Option(0.4, 0.0, 1.0),
    on_made=Option(1.0, 0.0, 1.0),
    curved=Option(0.4, 0.0, 1.0),
    shortest=Option(0.0, 0.0, 1.0, "m"),
)
def emphasise_edges(
    batch: ContourBatch,
    setting: Setting,
    *,
    on_object: float,
    on_hand: float,
    on_made: float,
    curved: float,
    shortest: float,
) -> ContourBatch:
    """Edges of the object at full intensity, those of the hand weaker, or as options say by kind.

    shortest: of the object's contours only straight runs this long [m] have the intensity `on_object`, the others
    `curved`; a run ends where the contour turns by 5 degrees. Between kinds the intensity changes within 1 mm of the
    weaker one.
    """
    lines = Lines.of(batch)
    level = np.zeros(batch.point_count)
    for kind, value in ((OBJECT, on_object), (HAND, on_hand), (MADE, on_made)):
        level[batch.kind == kind] = value
    if shortest > 0:
        short = straight_runs(lines) < shortest
        level[(batch.kind == OBJECT) & short] = curved
    return levelled(batch, level, RAMP)


def straight_runs(lines: Lines) -> np.ndarray:
    """Length of the straight run that each segment is part of [m], shape [point]; kinds do not share a run."""
    batch = lines.batch
    run = np.zeros(batch.point_count)
    here = np.flatnonzero(lines.is_segment & (lines.length > 0))
    if len(here) == 0:
        return run
    unit = (lines.points[here + 1] - lines.points[here]) / lines.length[here, None]
    line, kind = lines.line[here], batch.kind[here]
    cosine = np.einsum("ij,ij->i", unit[1:], unit[:-1])
    breaks = np.concatenate([[True], (cosine < math.cos(STRAIGHT)) | (np.diff(line) != 0) | (np.diff(kind) != 0)])
    number = np.cumsum(breaks) - 1
    ends = np.append(np.flatnonzero(np.diff(line)), len(here) - 1)
    starts = np.concatenate([[0], ends[:-1] + 1])
    for a, b in zip(starts.tolist(), ends.tolist(), strict=True):  # a run goes on across a loop's seam
        if lines.closed[line[a]] and unit[a] @ unit[b] >= math.cos(STRAIGHT) and kind[a] == kind[b]:
            own = number[a : b + 1]
            own[own == own[-1]] = own[0]
    run[here] = np.bincount(number, weights=lines.length[here])[number]
    return run
