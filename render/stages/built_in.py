"""Transformation stages: contours into what is drawn of them. Importing this registers them.

| stage | gives | of what |
|---|---|---|
| close | done by the raw intersection, see `intersect` | the object's section |
| identity, resample, smooth, simplify | `curves` | any contours |
| corners, edges | `emphasis` | any contours |
| depth | `depth` | any contours |
| ellipse, circle, centroid | `shapes` | any contours; what encloses nothing is taken as lines |
| hatch, inset | `fill` | closed contours on planes |
"""

from .curves import keep_contours, resample_contours, simplify_contours, smooth_contours
from .depth import weigh_by_depth
from .emphasis import emphasise_corners, emphasise_edges
from .fill import hatch_regions, inset_regions
from .shapes import draw_centroids, draw_circles, draw_ellipses

__all__ = [
    "draw_centroids",
    "draw_circles",
    "draw_ellipses",
    "emphasise_corners",
    "emphasise_edges",
    "hatch_regions",
    "inset_regions",
    "keep_contours",
    "resample_contours",
    "simplify_contours",
    "smooth_contours",
    "weigh_by_depth",
]
