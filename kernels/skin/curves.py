"""The curves in which a solid's surface crosses skin: signs of vertices, curves between them, points on them."""

from typing import Any

import numpy as np
import warp as wp

from ..contours import Contours, keep_rows, with_columns
from ..fields.field import Field
from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT
from .sign import Posed, place_points, sign_vertices
from .walk import list_curves

wp.set_module_options(EXACT)


@wp.kernel
def _mark_apart(c: Contours, point_keep: wp.array[wp.int64], polyline_keep: wp.array[wp.int64]):
    """Mark the points of a polyline that differ from the next one, and its last, if any does; else write nothing."""
    line = wp.tid()
    first = c.polyline_start[line]
    last = c.polyline_start[line + 1] - wp.int64(1)
    for k in range(int(last - first)):
        i = first + wp.int64(k)
        if not (c.points[i] == c.points[i + wp.int64(1)]):
            point_keep[i] = wp.int64(1)
            point_keep[last] = wp.int64(1)
            polyline_keep[line] = wp.int64(1)


@wp.kernel
def _match_kinds(c: Contours):
    """Let the last point of a polyline have the kind of the one before it."""
    last = c.polyline_start[wp.tid() + 1] - wp.int64(1)
    c.kind[last] = c.kind[last - wp.int64(1)]


@on_one_device
def skin_contours(
    field: Field,
    pose: wp.array,
    skin: Any,
    vertex: wp.array,
    *,
    closes: bool,
    bounds: np.ndarray | None = None,
    limit: int | None = None,
) -> Contours:
    """Find where the surface of a solid crosses a region of skin, at many poses.

    field: the solid, on the poses' device. pose: transform, hand frame -> array frame, shape [pose, 1].
    skin: see `upload_skin`. vertex: vec3 [m], hand frame, shape [1 or pose, vertex]: those of `SkinEdges.used`.
    closes: whether curves are closed along the region's rim where that is inside (CC). bounds: of the solid [m], shape
    [2, 3]: vertices beyond them are taken to be outside. All points are of patch 0; a section is a pose.
    The inside lies to the left seen from inside the hand. Points lie on edges of the (refined) triangles; between
    them a curve is straight, so it is right to the triangles' size where skin or surface bend.
    Raises PointLimitError before memory for points is taken; `limit` counts points that may then fall together, too.
    """
    posed = Posed(pose, skin, vertex)
    inside = sign_vertices(field, posed, bounds)
    drafts = list_curves(skin, inside, closes=closes, limit=limit)
    contours = with_columns(drafts.c, points=place_points(field, posed, drafts.spot))
    device, line_count = pose.device, contours.polyline_closed.shape[0]
    point_keep = wp.zeros(contours.points.shape[0] + 1, dtype=wp.int64, device=device)
    polyline_keep = wp.zeros(line_count + 1, dtype=wp.int64, device=device)
    launch(_mark_apart, line_count, [contours], [point_keep, polyline_keep])
    out = keep_rows(contours, point_keep, polyline_keep)
    launch(_match_kinds, out.polyline_closed.shape[0], [], [out])
    return out
