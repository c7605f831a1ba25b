"""The curves in which a solid's surface crosses skin: signs of vertices, curves that part them, points on these.

A triangle with both signs has two cut edges, so curves are chains of triangles that close or end on the rim. A curve is
walked with the inside to the right seen from outside the hand, which is the left seen from within it: into a face
through the half-edge that runs from outside to inside, out through the one that runs from inside to outside.

    at an inner edge    the walk goes on in the twin's face
    at the rim          an open curve ends; a closing one goes back along the rim, over vertices that are inside,
                        to the half-edge that runs from outside to inside

What comes next is a permutation, so walks end. Each search begins at every cut edge that is scanned and gives up at one
of a lower key: one search a curve is left, the one that begins at its lowest key. Rims that are wholly inside follow.
"""

from typing import Any

import numpy as np
import warp as wp

from ..contours import Contours, keep_rows, room_for, with_columns
from ..fields.field import Field
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT
from ..section.half_edges import OPEN
from ..section.walk import half_after, half_before
from .edges import Skin
from .sign import Posed, is_inside, place_points, sign_vertices

wp.set_module_options(EXACT)

SCANNED = 32  # scanned edges that one thread looks at
OBJECT_KIND = wp.constant(wp.uint8(0))
HAND_KIND = wp.constant(wp.uint8(1))


@wp.struct
class Drafts:
    """Contours whose points are not yet placed, before those that fall together are dropped."""

    spot: wp.array[wp.vec2i]  # of each point: pose, and 2 half-edge, plus 1 for the vertex where it starts
    c: Contours


@wp.func
def tail_inside(skin: Skin, inside: wp.array2d[wp.uint32], pose: int, half: int):
    """Whether the vertex where a half-edge starts lies inside the solid."""
    return is_inside(inside, pose, skin.half[half][0])


@wp.func
def exit_of(skin: Skin, inside: wp.array2d[wp.uint32], pose: int, half: int):
    """The half-edge through which a curve leaves the face that it enters through `half`."""
    before = half_before(half)
    if tail_inside(skin, inside, pose, before):
        return before
    return half_after(half)


@wp.func
def begins_at(skin: Skin, inside: wp.array2d[wp.uint32], pose: int, key: int):
    """The half-edge through which a curve crosses scanned edge `key` into a face; OPEN if none does."""
    scan = skin.scan[key]
    tail = is_inside(inside, pose, scan[1])
    half = scan[0]
    if tail == is_inside(inside, pose, scan[2]):
        return OPEN
    if tail:
        return skin.half[half][1]  # into the face on the other side; OPEN on the rim, where a curve ends
    return half


@wp.func
def points_from(skin: Skin, inside: wp.array2d[wp.uint32], pose: int, start: int, key: int, closes: int):
    """Number of points of the curve that starts at a half-edge; 0 if the curve has a lower key elsewhere."""
    half = int(start)
    count = int(0)
    while True:
        leave = exit_of(skin, inside, pose, half)
        count += 1
        half = skin.half[leave][1]
        if half == OPEN:
            if closes == 0:
                return wp.where(key < skin.rim_count, count + 1, 0)
            count += 2  # where it leaves, and the vertex before that
            half = skin.half[leave][3]
            while tail_inside(skin, inside, pose, half):
                half = skin.half[half][3]
                count += 1
        if half == start:
            return count + 1
        if skin.half[half][2] < key:
            return 0
    return 0


@wp.func
def rim_inside(skin: Skin, inside: wp.array2d[wp.uint32], pose: int, rim: int):
    """Whether every vertex of a rim lies inside."""
    half = skin.rim[rim][0]
    for _ in range(skin.rim[rim][1]):
        if not tail_inside(skin, inside, pose, half):
            return False
        half = skin.half[half][3]
    return True


@wp.kernel
def _count_curves(
    # In:
    skin: Skin,
    inside: wp.array2d[wp.uint32],
    closes: int,  # 1: CC, 0: OC
    group_count: int,  # of SCANNED scanned edges, and one more for whole rims
    # Out:
    points: wp.array[wp.int64],  # shape [pose group + 1]
    lines: wp.array[wp.int64],
):
    """Count the polylines of a group, and their points."""
    pose, group = wp.tid()
    line_count = int(0)
    point_count = wp.int64(0)
    if group == group_count - 1:
        for rim in range(closes * skin.rim.shape[0]):
            if rim_inside(skin, inside, pose, rim):
                line_count += 1
                point_count += wp.int64(skin.rim[rim][1] + 1)
    else:
        for key in range(group * SCANNED, wp.min((group + 1) * SCANNED, skin.scan.shape[0])):
            start = begins_at(skin, inside, pose, key)
            if start != OPEN:
                count = points_from(skin, inside, pose, start, key, closes)
                if count > 0:
                    line_count += 1
                    point_count += wp.int64(count)
    lines[pose * group_count + group] = wp.int64(line_count)
    points[pose * group_count + group] = point_count


@wp.func
def set_spot(drafts: Drafts, i: wp.int64, pose: int, code: int, kind: wp.uint8):
    """Enter a point; returns the place of the next one."""
    drafts.spot[i] = wp.vec2i(pose, code)
    drafts.c.kind[i] = kind
    return i + wp.int64(1)


@wp.func
def list_curve(
    skin: Skin, inside: wp.array2d[wp.uint32], pose: int, start: int, closes: int, drafts: Drafts, first: wp.int64
):
    """Enter the points of the curve that starts at a half-edge; returns the place behind them."""
    half = int(start)
    i = wp.int64(first)
    while True:
        i = set_spot(drafts, i, pose, 2 * half, OBJECT_KIND)
        leave = exit_of(skin, inside, pose, half)
        half = skin.half[leave][1]
        if half == OPEN:
            if closes == 0:
                return set_spot(drafts, i, pose, 2 * leave, OBJECT_KIND)
            i = set_spot(drafts, i, pose, 2 * leave, HAND_KIND)
            i = set_spot(drafts, i, pose, 2 * leave + 1, HAND_KIND)
            half = skin.half[leave][3]
            while tail_inside(skin, inside, pose, half):
                i = set_spot(drafts, i, pose, 2 * half + 1, HAND_KIND)
                half = skin.half[half][3]
        if half == start:
            return set_spot(drafts, i, pose, 2 * half, drafts.c.kind[i - wp.int64(1)])
    return i


@wp.func
def list_rim(skin: Skin, pose: int, rim: int, drafts: Drafts, first: wp.int64):
    """Enter a whole rim; returns the place behind it."""
    half = skin.rim[rim][0]
    i = wp.int64(first)
    for _ in range(skin.rim[rim][1] + 1):
        i = set_spot(drafts, i, pose, 2 * half + 1, HAND_KIND)
        half = skin.half[half][3]
    return i


@wp.kernel
def _list_curves(
    # In:
    skin: Skin,
    inside: wp.array2d[wp.uint32],
    closes: int,  # 1: CC, 0: OC
    group_count: int,
    point_start: wp.array[wp.int64],  # offsets of the groups' points and polylines, shape [pose group + 1]
    line_start: wp.array[wp.int64],
    # Out:
    drafts: Drafts,
):
    """Enter the polylines of a group in order of their keys."""
    pose, group = wp.tid()
    own = pose * group_count + group
    line = line_start[own]
    i = point_start[own]
    if group == group_count - 1:
        for rim in range(closes * skin.rim.shape[0]):
            if rim_inside(skin, inside, pose, rim):
                drafts.c.polyline_start[line] = i
                drafts.c.polyline_closed[line] = wp.uint8(1)
                line += wp.int64(1)
                i = list_rim(skin, pose, rim, drafts, i)
    elif line != line_start[own + 1]:
        for key in range(group * SCANNED, wp.min((group + 1) * SCANNED, skin.scan.shape[0])):
            start = begins_at(skin, inside, pose, key)
            if start != OPEN:
                if points_from(skin, inside, pose, start, key, closes) > 0:
                    drafts.c.polyline_start[line] = i
                    is_closed = closes == 1 or key >= skin.rim_count
                    drafts.c.polyline_closed[line] = wp.where(is_closed, wp.uint8(1), wp.uint8(0))
                    line += wp.int64(1)
                    i = list_curve(skin, inside, pose, start, closes, drafts, i)


def list_curves(skin: Any, inside: wp.array, *, closes: bool, limit: int | None = None) -> Drafts:
    """Find all curves between the vertices inside and outside, in order.

    inside: see `sign_vertices`. Raises PointLimitError, before memory for points is allocated, beyond `limit` of them.
    """
    device, pose_count = inside.device, inside.shape[0]
    group_count = -(-skin.scan.shape[0] // SCANNED) + 1

    def room(points: int, lines: int) -> list[Drafts]:
        drafts = Drafts()
        drafts.spot = wp.empty(points, dtype=wp.vec2i, device=device)
        drafts.c = room_for(points, lines, device)
        return [drafts]

    (drafts,), (_, line_start) = count_then_fill(
        _count_curves,
        _list_curves,
        (pose_count, group_count),
        [skin, inside, int(closes), group_count],
        room,
        rows=pose_count * group_count,
        columns=2,
        limit=limit,
    )
    drafts.c.polyline_patch.zero_()
    drafts.c.pose_start = line_start[::group_count].contiguous()
    return drafts


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
    Raises PointLimitError before memory for them is allocated; `limit` counts points that may then fall together, too.
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
