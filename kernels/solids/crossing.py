"""Pairs of triangles that meet elsewhere than at a vertex or an edge that both have, decided exactly.

| corners in common | meet elsewhere if |
|---|---|
| 3 | always: they lie in one place |
| 2 | they are coplanar and lie on the same side of their edge |
| 1 | the side across the common corner of one meets the other; coplanar: the insides of their angles overlap |
| 0 | a side of one meets the other; coplanar: two sides meet or one holds the other's corner |

Sides and triangles hold their ends and borders. Triangles without area are passed over: their neighbours have what
they have.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from ..offsets import launch
from ..patch import SELDOM
from .orientation import line_side, plane_side

wp.set_module_options(SELDOM)

CHUNK = 2**17  # faces a launch: a second or so, then Ctrl-C is heard
ROOM_LARGEST = 2**22  # pairs a launch; fewer faces are tested at once where there are more


@wp.struct
class Triangles:
    """Triangles on a device, and a hierarchy over their boxes."""

    vertex: wp.array[wp.vec3d]
    face: wp.array[wp.vec3i]
    low: wp.array[wp.vec3]  # of each triangle's box, scaled
    high: wp.array[wp.vec3]
    tree: wp.uint64  # a wp.Bvh


@wp.struct
class Corners:
    """A triangle."""

    a: wp.vec3d
    b: wp.vec3d
    c: wp.vec3d


@wp.func
def corners_of(t: Triangles, f: wp.vec3i):
    """Corners of a face."""
    out = Corners()
    out.a = t.vertex[f[0]]
    out.b = t.vertex[f[1]]
    out.c = t.vertex[f[2]]
    return out


@wp.func
def project_along(x: wp.vec3d, axis: int):
    """Seen along an axis."""
    return wp.vec2d(x[(axis + 1) % 3], x[(axis + 2) % 3])


@wp.func
def widest_axis(t: Corners):
    """The axis along which a triangle certainly has an area when seen along it, or OPEN's -1 if it has none."""
    n = wp.cross(t.b - t.a, t.c - t.a)
    axis = int(0)
    if wp.abs(n[1]) > wp.abs(n[axis]):
        axis = 1
    if wp.abs(n[2]) > wp.abs(n[axis]):
        axis = 2
    for k in range(3):
        seen = (axis + k) % 3
        if line_side(project_along(t.a, seen), project_along(t.b, seen), project_along(t.c, seen)) != 0:
            return seen
    return -1


@wp.func
def segment_meets(p: wp.vec3d, q: wp.vec3d, side_p: int, side_q: int, t: Corners):
    """Whether p-q meets a triangle whose plane p and q lie on these sides of; not where p-q lies in that plane."""
    if side_p * side_q > 0 or (side_p == 0 and side_q == 0):
        return False
    one = plane_side(p, q, t.a, t.b)
    two = plane_side(p, q, t.b, t.c)
    if one * two < 0:
        return False
    three = plane_side(p, q, t.c, t.a)
    return one * three >= 0 and two * three >= 0


@wp.func
def segments_meet_flat(p: wp.vec2d, q: wp.vec2d, r: wp.vec2d, s: wp.vec2d):
    """Whether two segments of a plane meet."""
    one = line_side(p, q, r)
    two = line_side(p, q, s)
    three = line_side(r, s, p)
    four = line_side(r, s, q)
    if one == 0 and two == 0:  # on one line: by their extents
        for k in range(2):
            if wp.max(p[k], q[k]) < wp.min(r[k], s[k]) or wp.max(r[k], s[k]) < wp.min(p[k], q[k]):
                return False
        return True
    return one * two <= 0 and three * four <= 0


@wp.func
def holds_flat(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d, x: wp.vec2d):
    """Whether a triangle of a plane, of either turn, holds a point."""
    one = line_side(a, b, x)
    two = line_side(b, c, x)
    three = line_side(c, a, x)
    return (one >= 0 and two >= 0 and three >= 0) or (one <= 0 and two <= 0 and three <= 0)


@wp.func
def corner_of(t: Corners, k: int):
    """Corner k, counted around."""
    if k % 3 == 0:
        return t.a
    if k % 3 == 1:
        return t.b
    return t.c


@wp.func
def overlap_flat(s: Corners, t: Corners, axis: int):
    """Whether two triangles of one plane meet."""
    for i in range(3):
        p = project_along(corner_of(s, i), axis)
        q = project_along(corner_of(s, i + 1), axis)
        for k in range(3):
            if segments_meet_flat(p, q, project_along(corner_of(t, k), axis), project_along(corner_of(t, k + 1), axis)):
                return True
    if holds_flat(
        project_along(s.a, axis), project_along(s.b, axis), project_along(s.c, axis), project_along(t.a, axis)
    ):
        return True
    return holds_flat(
        project_along(t.a, axis), project_along(t.b, axis), project_along(t.c, axis), project_along(s.a, axis)
    )


@wp.func
def between_flat(apex: wp.vec2d, one: wp.vec2d, two: wp.vec2d, x: wp.vec2d):
    """Whether x lies strictly inside the angle at the apex between one and two."""
    turn = line_side(apex, one, two)
    return line_side(apex, one, x) == turn and line_side(apex, x, two) == turn


@wp.func
def along_flat(apex: wp.vec2d, one: wp.vec2d, x: wp.vec2d):
    """Whether x lies in the same direction from the apex as one."""
    if line_side(apex, one, x) != 0:
        return False
    d = one - apex
    if wp.abs(d[0]) >= wp.abs(d[1]):
        return (one[0] > apex[0]) == (x[0] > apex[0]) and x[0] != apex[0]
    return (one[1] > apex[1]) == (x[1] > apex[1]) and x[1] != apex[1]


@wp.func
def angles_overlap(s: Corners, t: Corners, axis: int):
    """Whether two triangles of one plane, corner a in common, overlap."""
    apex = project_along(s.a, axis)
    b = project_along(s.b, axis)
    c = project_along(s.c, axis)
    d = project_along(t.b, axis)
    e = project_along(t.c, axis)
    if between_flat(apex, b, c, d) or between_flat(apex, b, c, e):
        return True
    if between_flat(apex, d, e, b) or between_flat(apex, d, e, c):
        return True
    return (along_flat(apex, b, d) and along_flat(apex, c, e)) or (along_flat(apex, b, e) and along_flat(apex, c, d))


@wp.func
def rotate_corners(f: wp.vec3i, k: int):
    """A face counted from its corner k."""
    return wp.vec3i(f[k % 3], f[(k + 1) % 3], f[(k + 2) % 3])


@wp.func
def common_corner(f: wp.vec3i, g: wp.vec3i, skip: int):
    """The first corner of f, `skip` left out, that g has too; -1 if there is none."""
    for k in range(3):
        if k != skip and (f[k] == g[0] or f[k] == g[1] or f[k] == g[2]):
            return k
    return -1


@wp.func
def place_in(f: wp.vec3i, vertex: int):
    """Corner number of a vertex in face f."""
    if f[0] == vertex:
        return 0
    if f[1] == vertex:
        return 1
    return 2


@wp.func
def folds(t: Triangles, f: wp.vec3i, g: wp.vec3i, one: int, two: int):
    """Whether faces with two corners in common lie on each other: f's third corner is neither `one` nor `two`."""
    x = t.vertex[f[3 - one - two]]
    y = t.vertex[g[3 - place_in(g, f[one]) - place_in(g, f[two])]]
    a = t.vertex[f[one]]
    b = t.vertex[f[two]]
    if plane_side(a, b, x, y) != 0:
        return False
    s = Corners()
    s.a = a
    s.b = b
    s.c = x
    axis = widest_axis(s)
    p = project_along(a, axis)
    q = project_along(b, axis)
    return line_side(p, q, project_along(x, axis)) * line_side(p, q, project_along(y, axis)) > 0


@wp.func
def meets_across(s: Corners, t: Corners):
    """Whether triangles with corner a, and only that, in common meet elsewhere."""
    one = plane_side(t.a, t.b, t.c, s.b)
    two = plane_side(t.a, t.b, t.c, s.c)
    if one * two > 0:
        return False
    if one == 0 and two == 0:
        return angles_overlap(s, t, widest_axis(t))
    three = plane_side(s.a, s.b, s.c, t.b)
    four = plane_side(s.a, s.b, s.c, t.c)
    if three * four > 0:
        return False
    return segment_meets(s.b, s.c, one, two, t) or segment_meets(t.b, t.c, three, four, s)


@wp.func
def sides_of_plane(s: Corners, t: Corners):
    """Sides of the plane of t on which the corners of s lie."""
    return wp.vec3i(plane_side(t.a, t.b, t.c, s.a), plane_side(t.a, t.b, t.c, s.b), plane_side(t.a, t.b, t.c, s.c))


@wp.func
def is_apart(side: wp.vec3i):
    """Whether all three lie strictly on one side."""
    return side[0] * side[1] > 0 and side[0] * side[2] > 0


@wp.func
def meets_apart(s: Corners, t: Corners):
    """Whether triangles without a common corner meet."""
    u = sides_of_plane(s, t)
    if is_apart(u):
        return False
    v = sides_of_plane(t, s)
    if is_apart(v):
        return False
    if u[0] == 0 and u[1] == 0 and u[2] == 0:
        return overlap_flat(s, t, widest_axis(t))
    for k in range(3):
        if segment_meets(corner_of(s, k), corner_of(s, k + 1), u[k], u[(k + 1) % 3], t):
            return True
        if segment_meets(corner_of(t, k), corner_of(t, k + 1), v[k], v[(k + 1) % 3], s):
            return True
    return False


@wp.func
def faces_meet(t: Triangles, f: wp.vec3i, g: wp.vec3i):
    """Whether two faces meet elsewhere than at corners and edges that both have."""
    one = common_corner(f, g, -1)
    if one < 0:
        return meets_apart(corners_of(t, f), corners_of(t, g))
    two = common_corner(f, g, one)
    if two < 0:
        return meets_across(
            corners_of(t, rotate_corners(f, one)), corners_of(t, rotate_corners(g, place_in(g, f[one])))
        )
    third = 3 - one - two
    if f[third] == g[0] or f[third] == g[1] or f[third] == g[2]:
        return True
    return folds(t, f, g, one, two)


@wp.kernel
def _find_crossings(
    triangles: Triangles,
    first: int,  # face of the first thread
    pair: wp.array[wp.vec2i],  # faces that cross, in any order
    count: wp.array[wp.int32],  # their number, also beyond the room; zero-initialised, shape [1]
):
    """Find the faces after each face that cross it. Once the room is used up no more are looked for."""
    own = first + wp.tid()
    f = triangles.face[own]
    if count[0] <= pair.shape[0] and widest_axis(corners_of(triangles, f)) >= 0:
        query = wp.bvh_query_aabb(triangles.tree, triangles.low[own], triangles.high[own])
        other = int(0)
        while wp.bvh_query_next(query, other):
            if other > own:
                g = triangles.face[other]
                if widest_axis(corners_of(triangles, g)) >= 0 and faces_meet(triangles, f, g):
                    place = wp.atomic_add(count, 0, 1)
                    if place >= pair.shape[0]:
                        return
                    pair[place] = wp.vec2i(own, other)


def upload_triangles(vertices: np.ndarray, faces: np.ndarray, device: str) -> tuple[Any, wp.Bvh]:
    """Triangles on a device, and the hierarchy that they refer to and must not outlive.

    vertices: float64, shape [vertex, 3]; faces: int, shape [face, 3]. Boxes are float32 of scaled coordinates: rounding
    keeps order, so boxes that meet still do.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scaled = ((vertices - 0.5 * (low + high)) / (np.max(high - low) or 1.0)).astype(np.float32)[faces]
    out = Triangles()
    out.vertex = wp.array(vertices, dtype=wp.vec3d, device=device)
    out.face = wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=device)
    out.low = wp.array(scaled.min(axis=1), dtype=wp.vec3, device=device)
    out.high = wp.array(scaled.max(axis=1), dtype=wp.vec3, device=device)
    tree = wp.Bvh(out.low, out.high, constructor="median")
    out.tree = tree.id
    return out, tree


def find_crossings(
    vertices: np.ndarray, faces: np.ndarray, *, device: str = "cpu", first: int = 0
) -> Iterator[tuple[int, np.ndarray]]:
    """Pairs of faces that cross or overlap, by the table above, each pair once; some faces at a time.

    vertices: float64, shape [vertex, 3], equal coordinates in one vertex only; faces: int, shape [face, 3].
    Yields how many faces are done and the pairs that were found among them and all after them, int32, shape [pair, 2].
    Of a face that crosses more than ROOM_LARGEST others, so many pairs are given.
    """
    triangles, tree = upload_triangles(vertices, faces, device)
    step, room = CHUNK, min(4 * CHUNK, ROOM_LARGEST)
    while first < len(faces):
        count = min(step, len(faces) - first)
        pair = wp.empty(room, dtype=wp.vec2i, device=device)
        found = wp.zeros(1, dtype=wp.int32, device=device)
        launch(_find_crossings, count, [triangles, first], [pair, found])
        crossing_count = int(found.numpy()[0])
        if crossing_count > room and room < ROOM_LARGEST:
            room = min(8 * room, ROOM_LARGEST)
            continue
        if crossing_count > room and count > 1:
            step = count // 2
            continue
        first, step = first + count, min(2 * step, CHUNK)
        pairs = pair.numpy()[: min(crossing_count, room)]
        yield first, pairs[np.lexsort(pairs.T[::-1])]
    del tree  # the kernels' hierarchy, until here
