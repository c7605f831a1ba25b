"""Ellipses, circles and centroids of regions, each by itself in NumPy: eigenvectors by LAPACK, circles by lstsq."""

import math
from typing import NamedTuple

import numpy as np
from regions_oracle import FlatLines, Stroke, batch_of_strokes

LARGEST = 0.1  # [m] of a radius


class Spread(NamedTuple):
    """Where a group of polylines is and how it spreads: middle [m], height [m], area [m2], variances [m2], axis."""

    middle: np.ndarray
    height: float
    area: float
    variance: np.ndarray
    axis: np.ndarray


def spread_of(flat: FlatLines, group, of):
    """Moments of the area a group encloses, or of its lines, of "line" or where it encloses none; None: no length."""
    total = flat.areas[group].sum(axis=0)
    stroke = flat.strokes[group].sum(axis=0)
    area = float(total[0])
    if of == "line" or area <= 1e-9 * stroke[0] ** 2:  # a sliver that is all rounding
        area, total = max(area, 0.0), stroke
    if stroke[0] <= 0 or total[0] <= 0:
        return None
    middle = total[1:3] / total[0]
    xx, xy, yy = total[3:] / total[0]
    value, vector = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]) - np.outer(middle, middle))
    axis = vector[:, 1]
    axis = -axis if (axis[0] < 0 or (axis[0] == 0 and axis[1] < 0)) else axis
    height = float(flat.heights[group].sum() / stroke[0])
    return Spread(middle, height, area, np.maximum(value[::-1], 0.0), axis)


def ellipse(flat, group, *, of, scale, smallest):
    """Moments and semi-axes [m] of a group's ellipse."""
    found = spread_of(flat, group, of)
    if found is None:
        return None
    a, b = np.sqrt(found.variance)
    if of == "line" or found.area <= 0:
        axes = math.sqrt(2) * a, math.sqrt(2) * b
    elif of == "moments" or b <= 0:
        axes = 2 * a, 2 * b
    else:
        axes = math.sqrt(found.area / math.pi * a / b), math.sqrt(found.area / math.pi * b / a)
    return found, *(max(scale * axis, smallest) for axis in axes)


def circle(flat, group, *, of, scale, smallest):
    """Moments and radius [m], twice, of a group's circle."""
    found = spread_of(flat, group, of)
    if found is None:
        return None
    radius = math.sqrt(found.area / math.pi)
    if of == "line" or radius <= 0:
        found, radius = nearest_circle(flat, group, found)
    radius = max(scale * radius, smallest)
    return found, radius, radius


def centroid(flat, group, *, radius):
    """Moments and radius [m], twice, of the circle around a group's centroid."""
    found = spread_of(flat, group, "area")
    return None if found is None else (found, radius, radius)


def nearest_circle(flat, group, m):
    """Middle and radius of the circle nearest to the points of contours, each for the length about it."""
    rows, weights = [], []
    for line in group.tolist():
        points = flat.loop(line)
        if flat.closed[line]:
            points = np.concatenate([points, points[:1]])
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        ends = np.stack([points[:-1], 0.5 * (points[:-1] + points[1:]), points[1:]], axis=1)
        rows.append(ends.reshape(-1, 2))  # Simpson's rule along each segment
        weights.append((step[:, None] * np.array([1.0, 4.0, 1.0]) / 6).ravel())
    x, w = np.concatenate(rows) - m.middle, np.sqrt(np.concatenate(weights))
    matrix = np.column_stack([2 * x, np.ones(len(x))]) * w[:, None]
    (p, q, c), *_ = np.linalg.lstsq(matrix, (x * x).sum(axis=1) * w, rcond=1e-9)
    radius = math.sqrt(max(c + p * p + q * q, 0.0))
    if radius > LARGEST or m.variance[1] <= 1e-6 * m.variance[0]:  # a straight line: a circle around it
        return m, min(math.sqrt(2 * m.variance[0]), LARGEST)
    return m._replace(middle=m.middle + np.array([p, q])), radius


def oval_batch(name, batch, setting, *, per, points=32, **options):
    """The batch of ovals that the stage of this name makes."""
    flat, strokes = FlatLines(batch, setting), []
    for group in flat.groups(per):
        found = {"ellipse": ellipse, "circle": circle, "centroid": centroid}[name](flat, group, **options)
        if found is not None:
            pose, patch = int(flat.pose[group[0]]), int(batch.polyline_patch[group[0]])
            m, loop = found[0], polygon(*found, points)
            strokes.append(Stroke(pose, patch, flat.lifted(pose, patch, loop, m.height), True))
    return batch_of_strokes(strokes, batch.pose_count)


def polygon(m, a, b, count):
    """A polygon of exactly the ellipse's area, starting at an end of its longer axis, shape [corner, 2]."""
    angle = 2 * np.pi * np.arange(count) / count
    bulge = math.sqrt(2 * math.pi / (count * math.sin(2 * math.pi / count)))
    across = np.array([-m.axis[1], m.axis[0]])
    return m.middle + bulge * (a * np.cos(angle)[:, None] * m.axis + b * np.sin(angle)[:, None] * across)
