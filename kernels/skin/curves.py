"""The curves in which a solid's surface crosses skin: signs of vertices, curves between them, points on them."""

from typing import Any

import numpy as np
import warp as wp

from ..fields.field import Field
from ..offsets import BLOCK, last_of, offsets_of
from ..one_device import on_one_device
from ..patch import EXACT
from ..section.contour_writing import SectionContours
from .sign import Posed, place_points, sign_vertices
from .walk import Drafts, Listed, list_curves

wp.set_module_options(EXACT)


@wp.kernel
def _count_kept(
    point: wp.array[wp.vec3],
    drafts: Drafts,
    lines: wp.array[wp.int64],  # 1 for a polyline of non-zero length, shape [polyline + 1]
    points: wp.array[wp.int64],  # points of it that the next one differs from, and the last
):
    """Count what of a polyline is left without segments of no length."""
    line = wp.tid()
    count = int(0)
    for k in range(int(drafts.polyline_start[line + 1] - drafts.polyline_start[line]) - 1):
        i = drafts.polyline_start[line] + wp.int64(k)
        if not (point[i] == point[i + wp.int64(1)]):
            count += 1
    lines[line] = wp.int64(wp.where(count > 0, 1, 0))
    points[line] = wp.int64(wp.where(count > 0, count + 1, 0))


@wp.kernel
def _keep_points(
    # In:
    point: wp.array[wp.vec3],
    drafts: Drafts,
    line_start: wp.array[wp.int64],  # which number each polyline gets, shape [polyline + 1]
    point_start: wp.array[wp.int64],
    # Out:
    kept: wp.array[wp.vec3],
    out: Drafts,  # but for spot
):
    """Copy a polyline without segments of no length; its last point's kind repeats the one before."""
    line = wp.tid()
    new = line_start[line]
    if new == line_start[line + 1]:
        return
    place = point_start[line]
    out.polyline_start[new] = place
    out.polyline_closed[new] = drafts.polyline_closed[line]
    last = drafts.polyline_start[line + 1] - wp.int64(1)
    for k in range(int(last - drafts.polyline_start[line])):
        i = drafts.polyline_start[line] + wp.int64(k)
        if not (point[i] == point[i + wp.int64(1)]):
            kept[place] = point[i]
            out.kind[place] = drafts.kind[i]
            place += wp.int64(1)
    kept[place] = point[last]
    out.kind[place] = out.kind[place - wp.int64(1)]


@wp.kernel
def _start_poses(
    group_start: wp.array[wp.int64],  # offsets of the groups' polylines
    group_count: int,
    line_start: wp.array[wp.int64],
    pose_start: wp.array[wp.int64],  # shape [pose + 1]
):
    """Set where a pose's polylines begin."""
    pose = wp.tid()
    pose_start[pose] = line_start[int(group_start[pose * group_count])]


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
) -> SectionContours:
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
    listed = list_curves(skin, inside, closes=closes, limit=limit)
    return without_repeats(place_points(field, posed, listed.drafts.spot), listed, pose.shape[0])


def without_repeats(point: wp.array, listed: Listed, pose_count: int) -> SectionContours:
    """Contours of placed points, segments of no length dropped and polylines of nothing else."""
    device, drafts = point.device, listed.drafts
    line_count = drafts.polyline_closed.shape[0]
    lines = wp.zeros(line_count + 1, dtype=wp.int64, device=device)
    points = wp.zeros(line_count + 1, dtype=wp.int64, device=device)
    launch = {"dim": line_count, "device": device, "block_dim": BLOCK}
    wp.launch(_count_kept, inputs=[point, drafts], outputs=[lines, points], **launch)
    line_start, point_start = offsets_of(lines), offsets_of(points)
    point_count, line_count = last_of(point_start), last_of(line_start)
    if point_count != point.shape[0]:
        kept, out = wp.empty(point_count, dtype=wp.vec3, device=device), Drafts()
        out.kind = wp.empty(point_count, dtype=wp.uint8, device=device)
        out.polyline_start = wp.full(line_count + 1, wp.int64(point_count), dtype=wp.int64, device=device)
        out.polyline_closed = wp.empty(line_count, dtype=wp.uint8, device=device)
        wp.launch(_keep_points, inputs=[point, drafts, line_start, point_start], outputs=[kept, out], **launch)
        point, drafts = kept, out
    pose_start = wp.empty(pose_count + 1, dtype=wp.int64, device=device)
    starts = [listed.line_start, listed.group_count, line_start]
    wp.launch(_start_poses, pose_count + 1, inputs=starts, outputs=[pose_start], device=device, block_dim=BLOCK)
    return SectionContours(
        points=point,
        kind=drafts.kind,
        polyline_start=drafts.polyline_start,
        polyline_patch=wp.zeros(line_count, dtype=wp.int32, device=device),
        polyline_closed=drafts.polyline_closed,
        section_start=pose_start,
    )
