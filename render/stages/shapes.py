"""Simple shapes in the place of contours: ellipse, circle, a point at the centroid."""

import math

import numpy as np

from ..contour_batch import ContourBatch
from .patch_regions import Moments, Sections, moments_of
from .polyline_arrays import Drawn, batch_of
from .registry import Option, Setting, transform_stage

PER = Option("region", choices=("region", "patch"))
SMALLEST = Option(None, 1e-6, 0.1, "m", widths=0.25)
CORNERS = Option(64, 8, 4096)
LARGEST = 0.1  # [m] of a radius


@transform_stage(
    "ellipse",
    of=Option("area", choices=("area", "moments", "line")),
    per=PER,
    scale=Option(1.0, 0.1, 10.0),
    smallest=SMALLEST,
    points=CORNERS,
)
def draw_ellipses(
    batch: ContourBatch, setting: Setting, *, of: str, per: str, scale: float, smallest: float, points: int
) -> ContourBatch:
    """An ellipse in the place of each region: its area, middle, direction and proportions.

    | of | semi-axes |
    |---|---|
    | area | those of the region's second moments, scaled to its area: exactly the same area |
    | moments | those of the ellipse that has the region's second moments, 2 standard deviations |
    | line | the same for the contours themselves, not what they enclose, sqrt(2) standard deviations |

    What encloses nothing (open contours) is taken as of "line". per "region": an outer loop and its holes; "patch": all
    of a patch. scale: factor on the axes. smallest: no semi-axis is below [m]. points: corners of the polygon drawn.
    Counter-clockwise seen from +n, of kind "made".
    """

    def axes_of(m: Moments) -> tuple[float, float]:
        a, b = np.sqrt(m.spread)
        if of == "line" or m.area <= 0:
            return math.sqrt(2) * a, math.sqrt(2) * b
        if of == "moments" or b <= 0:
            return 2 * a, 2 * b
        return math.sqrt(m.area / math.pi * a / b), math.sqrt(m.area / math.pi * b / a)

    drawn = []
    sections = Sections(batch, setting)
    for group in sections.groups(per):
        found = moments_of(sections, group, of)
        if found is not None:
            a, b = (max(scale * axis, smallest) for axis in axes_of(found))
            drawn.append(_oval(sections, found, a, b, points))
    return batch_of(drawn, batch.pose_count)


@transform_stage(
    "circle",
    of=Option("area", choices=("area", "line")),
    per=PER,
    scale=Option(1.0, 0.1, 10.0),
    smallest=SMALLEST,
    points=CORNERS,
)
def draw_circles(
    batch: ContourBatch, setting: Setting, *, of: str, per: str, scale: float, smallest: float, points: int
) -> ContourBatch:
    """A circle in the place of each region: its area and middle.

    of "area": exactly the region's area; "line", and for what encloses nothing: the circle that lies nearest to the
    contours, by least squares (Kasa 1976), at most 0.1 m in radius. Other options as for "ellipse".
    """
    drawn = []
    sections = Sections(batch, setting)
    for group in sections.groups(per):
        found = moments_of(sections, group, of)
        if found is None:
            continue
        radius = math.sqrt(found.area / math.pi)
        if of == "line" or radius <= 0:
            found, radius = _nearest_circle(sections, group, found)
        radius = max(scale * radius, smallest)
        drawn.append(_oval(sections, found, radius, radius, points))
    return batch_of(drawn, batch.pose_count)


@transform_stage("centroid", per=Option("patch", choices=("region", "patch")), radius=Option(0.003, 1e-5, 0.05, "m"))
def draw_centroids(batch: ContourBatch, setting: Setting, *, per: str, radius: float) -> ContourBatch:
    """A point at the centroid of each patch's contact, drawn as a small circle.

    The circle has the radius of lateral modulation, 3 mm by default, since a focal point needs somewhere to go; 1e-5 m
    is as good as still. The centroid is that of the area, of what encloses nothing that of the contours; it may lie in
    a hole. per: "patch", or "region".
    """
    drawn = []
    sections = Sections(batch, setting)
    for group in sections.groups(per):
        found = moments_of(sections, group, "area")
        if found is not None:
            drawn.append(_oval(sections, found, radius, radius, 32))
    return batch_of(drawn, batch.pose_count)


def _oval(sections: Sections, m: Moments, a: float, b: float, count: int) -> Drawn:
    """A polygon of exactly the ellipse's area, starting at an end of its longer axis."""
    angle = 2 * np.pi * np.arange(count) / count
    bulge = math.sqrt(2 * math.pi / (count * math.sin(2 * math.pi / count)))
    across = np.array([-m.axis[1], m.axis[0]])
    flat = m.middle + bulge * (a * np.cos(angle)[:, None] * m.axis + b * np.sin(angle)[:, None] * across)
    return Drawn(m.pose, m.patch, sections.lifted(m.pose, m.patch, flat, m.height), True)


def _nearest_circle(sections: Sections, group: np.ndarray, m: Moments) -> tuple[Moments, float]:
    """Middle and radius of the circle nearest to the points of contours, each for the length about it."""
    rows, weights = [], []
    for line in group.tolist():
        points = sections.loop(line)
        if sections.closed[line]:
            points = np.concatenate([points, points[:1]])
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        ends = np.stack([points[:-1], 0.5 * (points[:-1] + points[1:]), points[1:]], axis=1)
        rows.append(ends.reshape(-1, 2))  # Simpson's rule along each segment
        weights.append((step[:, None] * np.array([1.0, 4.0, 1.0]) / 6).ravel())
    x, w = np.concatenate(rows) - m.middle, np.sqrt(np.concatenate(weights))
    matrix = np.column_stack([2 * x, np.ones(len(x))]) * w[:, None]
    (p, q, c), *_ = np.linalg.lstsq(matrix, (x * x).sum(axis=1) * w, rcond=1e-9)
    radius = math.sqrt(max(c + p * p + q * q, 0.0))
    if radius > LARGEST or m.spread[1] <= 1e-6 * m.spread[0]:  # a straight line: a circle around it
        return m, min(math.sqrt(2 * m.spread[0]), LARGEST)
    middle = m.middle + np.array([p, q])
    return Moments(m.pose, m.patch, middle, m.height, m.area, m.spread, m.axis), radius
