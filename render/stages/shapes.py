"""Simple shapes in the place of contours: ellipse, circle, a point at the centroid."""

from ...kernels.stages.ovals import Ovals, draw_ovals, find_centroids, fit_circles, fit_ellipses
from ...kernels.stages.regions import find_regions
from ..contour_batch import ContourBatch
from .registry import Option, transform_stage
from .setting import Setting

PER = Option("region", choices=("region", "patch"))
SMALLEST = Option(None, 1e-6, 0.1, "m", widths=0.25)
CORNERS = Option(64, 8, 4096)
CENTROID_CORNERS = 32


def _drawn(batch: ContourBatch, setting: Setting, ovals: Ovals, corners: int) -> ContourBatch:
    """The batch of some ovals of a batch's regions."""
    limit = setting.point_limit
    return ContourBatch.from_struct(draw_ovals(ovals, corners, setting.patches, batch.pose_count, point_limit=limit))


@transform_stage(
    "ellipse",
    on="device",
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
    ovals = fit_ellipses(find_regions(batch.struct, setting.patches, per=per), of=of, scale=scale, smallest=smallest)
    return _drawn(batch, setting, ovals, points)


@transform_stage(
    "circle",
    on="device",
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
    ovals = fit_circles(find_regions(batch.struct, setting.patches, per=per), of=of, scale=scale, smallest=smallest)
    return _drawn(batch, setting, ovals, points)


@transform_stage(
    "centroid",
    on="device",
    per=Option("patch", choices=("region", "patch")),
    radius=Option(0.003, 1e-5, 0.05, "m"),
)
def draw_centroids(batch: ContourBatch, setting: Setting, *, per: str, radius: float) -> ContourBatch:
    """A point at the centroid of each patch's contact, drawn as a small circle.

    The circle has the radius of lateral modulation, 3 mm by default, since a focal point needs somewhere to go; 1e-5 m
    is as good as still. It is a polygon of 32 corners with the circle's area, so corners lie 0.3 % outside the radius
    and the middles of sides 0.2 % inside. The centroid is that of the area, of what encloses nothing that of the
    contours; it may lie in a hole. per: "patch", or "region".
    """
    ovals = find_centroids(find_regions(batch.struct, setting.patches, per=per), radius)
    return _drawn(batch, setting, ovals, CENTROID_CORNERS)
