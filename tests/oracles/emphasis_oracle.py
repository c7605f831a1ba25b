"""Emphasis of corners and edges in NumPy, which sorts all points of a batch at once."""

import math
from dataclasses import replace

import numpy as np
from polyline_oracle import Lines, levelled, times, with_points

RAMP = 1e-3  # [m] over which intensity changes between segments


def emphasise_corners(batch, *, angle=math.pi / 6, window=0.005, reach=0.01, level=0.4, dwell=0.0):
    """A batch as the stage "corners" leaves it."""
    lines = Lines.of(batch)
    at, line = find_corners(lines, angle, window)
    out = batch
    if len(at):
        out, _, part = with_points(batch, *ramp_ends(lines, at, line, reach))
        corner_arc = lines.arc[at]
        at = np.flatnonzero(part == 0)[at]
        lines = Lines.of(out)
        nearest = arc_to_nearest(lines, corner_arc, line)
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


def ramp_ends(lines: Lines, at: np.ndarray, line: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
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


def arc_to_nearest(lines: Lines, arc: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Arc from each point to the nearest of some places on its polyline [m]; infinite where there is none."""
    out = np.full(len(lines.points), np.inf)
    for k in np.unique(line).tolist():
        a, b = lines.batch.polyline_start[k], lines.batch.polyline_start[k + 1]
        apart = np.abs(lines.arc[a:b, None] - arc[None, line == k])
        if lines.closed[k]:
            apart = np.minimum(apart, np.abs(lines.total[k] - apart))
        out[a:b] = apart.min(axis=1)
    return out


def emphasise_edges(batch, *, on_object=1.0, on_hand=0.4, on_made=1.0):
    """A batch as the stage "edges" leaves it."""
    level = np.zeros(batch.point_count)
    for kind, value in enumerate((on_object, on_hand, on_made)):
        level[batch.kind == kind] = value
    return levelled(batch, level, RAMP)
