"""The inside of a closed mesh as a field: signed crossings of the ray that runs up from a point.

A face counts where the point lies under it: +1 if the face looks up, -1 if it looks down. Their sum is the winding
number, above 0 inside, so what bodies share is inside too. Seen along the ray a face is a flat triangle, and whether a
point lies in it is asked edge by edge:

    the edge meets the point's horizontal line   where one end is at or below it and the other is above
    the crossing lies to the right of the point  by the sign of one product, from the lower end to the upper one

Both faces of an edge so get the same bits, and a closed surface never leaks, whatever rounds. Whether the face lies
above the point needs no such care: where that is rounding's to say, the point is on the face, and on counts as outside.
"""

from typing import Any

import numpy as np
import warp as wp

from ..offsets import launch
from ..patch import EXACT, ON, to_float32, to_float64
from ..section.half_edges import LEAF, Surface
from ..section.tree import node_after
from ..section.walk import load_vec4, vertex_of
from .field import Field, root_of

wp.set_module_options(EXACT)

ROUNDING = wp.constant(wp.float64(4.8e-7))  # 2^-21: of float32 boxes, against the surface's reach
FAR = wp.constant(wp.float64(1.0e30))  # [m]
BESIDE = wp.constant(wp.float64(1.0e-9))  # [m]; how far from a crossing both sides of it are asked
SLACK = wp.constant(wp.float64(1.0e-9))  # of a segment; an end may lie on the surface
ABOVE_0 = wp.constant(0)
ODD = wp.constant(1)
RULES = {"winding": 0, "even-odd": 1}  # of `MeshObject.solid`: ABOVE_0, ODD
CELLS = 48  # along the longest side of the bounds: classified cells answer for 3 points of 4 near a surface of 0.13 m


@wp.struct
class Inside:
    """A closed surface, and the sides of the cells of a grid around it."""

    surface: Surface
    low: wp.vec3d  # corner of the grid [m]
    cell: wp.float64  # side of a cell [m]
    cell_side: wp.array3d[wp.int8]  # 1: all of the cell is outside, -1: inside, 0: neither or not known
    rule: int  # which winding numbers are inside: ABOVE_0 or ODD


@wp.struct
class Triangle:
    """Corners of a face, seen from the point that is asked about [m]."""

    a: wp.vec3d
    b: wp.vec3d
    c: wp.vec3d


@wp.func
def face_from(surface: Surface, face: int, x: wp.vec3d):
    """A face's corners less x: the same bits in all faces that share a corner."""
    t = Triangle()
    t.a = to_float64(vertex_of(load_vec4(surface.corner, 3 * face))) - x
    t.b = to_float64(vertex_of(load_vec4(surface.corner, 3 * face + 1))) - x
    t.c = to_float64(vertex_of(load_vec4(surface.corner, 3 * face + 2))) - x
    return t


@wp.func
def edge_crossing(a: wp.vec3d, b: wp.vec3d):
    """Whether an edge meets the half-line from the origin along +x, seen along z: +1 going up in y, -1 down, 0 not."""
    zero = wp.float64(0.0)
    if (a[1] > zero) == (b[1] > zero):
        return 0
    low = a
    high = b
    turn = int(1)
    if a[1] > zero:
        low = b
        high = a
        turn = -1
    if (low[1] - high[1]) * low[0] - (low[0] - high[0]) * low[1] < zero:  # the upper end less the lower, turned
        return turn
    return 0


@wp.func
def turns_around(t: Triangle):
    """Winding of a face around the z axis: 1 or -1; 0 if the axis does not pass through it."""
    return edge_crossing(t.a, t.b) + edge_crossing(t.b, t.c) + edge_crossing(t.c, t.a)


@wp.func
def height_sign(t: Triangle, turns: int):
    """Whether the z axis meets a face above the origin: 1, below it: -1, or 0 within rounding of it."""
    zero = wp.float64(0.0)
    if wp.min(wp.min(t.a[2], t.b[2]), t.c[2]) > ON:
        return 1
    if wp.max(wp.max(t.a[2], t.b[2]), t.c[2]) < -ON:
        return -1
    normal = wp.cross(t.b - t.a, t.c - t.a)
    depth = wp.dot(normal, t.a)
    if wp.abs(depth) <= ON * wp.length(normal):
        return 0
    if (depth > zero) == (turns > 0):
        return 1
    return -1


@wp.func
def touches(t: Triangle):
    """Whether the origin lies on a face, its edges and corners included."""
    for axis in range(3):
        if wp.min(wp.min(t.a[axis], t.b[axis]), t.c[axis]) > ON:
            return False
        if wp.max(wp.max(t.a[axis], t.b[axis]), t.c[axis]) < -ON:
            return False
    ab = t.b - t.a
    ac = t.c - t.a
    normal = wp.cross(ab, ac)
    square = wp.dot(normal, normal)
    if square == wp.float64(0.0) or wp.abs(wp.dot(normal, t.a)) > ON * wp.sqrt(square):
        return False
    v = -wp.dot(normal, wp.cross(t.a, ac)) / square
    w = -wp.dot(normal, wp.cross(ab, t.a)) / square
    slack = ON * (wp.length(ab) + wp.length(ac)) / wp.sqrt(square)
    return v >= -slack and w >= -slack and v + w <= wp.float64(1.0) + slack


@wp.struct
class Span:
    """A box to look for faces in, widened by what float32 may be wrong by [m]."""

    low: wp.vec3
    high: wp.vec3


@wp.func
def span_of(surface: Surface, low: wp.vec3d, high: wp.vec3d):
    """A box in float32 that meets every node's box which the exact one meets."""
    slack = wp.float64(surface.reach) * ROUNDING + ON
    by = wp.vec3d(slack, slack, slack)
    s = Span()
    s.low = to_float32(low - by)
    s.high = to_float32(high + by)
    return s


@wp.func
def apart(surface: Surface, node: int, s: Span):
    """Whether a node's box lies apart from a span; an empty one, of half extents -1 m, lies so or has no faces."""
    centre = load_vec4(surface.node_centre, node)
    half = load_vec4(surface.node_half, node)
    if centre[0] + half[0] < s.low[0] or centre[0] - half[0] > s.high[0]:
        return True
    if centre[1] + half[1] < s.low[1] or centre[1] - half[1] > s.high[1]:
        return True
    return centre[2] + half[2] < s.low[2] or centre[2] - half[2] > s.high[2]


@wp.func
def leaf_meeting(surface: Surface, s: Span, node: int):
    """The next leaf that may meet a span, from a node on in the heap's order; 0 if there is none."""
    n = int(node)
    while n != 0:
        if apart(surface, n, s):
            n = node_after(n)
        elif n >= surface.leaf_first:
            break
        else:
            n = 2 * n
    return n


@wp.func
def is_wound(surface: Surface, x: wp.vec3d, rule: int):
    """Whether the surface's winding number around x is inside by a rule; not where it passes through x."""
    winding = int(0)
    span = span_of(surface, x, wp.vec3d(x[0], x[1], FAR))
    node = leaf_meeting(surface, span, 1)
    while node != 0:
        first = (node - surface.leaf_first) * LEAF
        for face in range(first, wp.min(first + LEAF, surface.corner.shape[0] // 3)):
            t = face_from(surface, face, x)
            turns = turns_around(t)
            if turns != 0:
                side = height_sign(t, turns)
                if side == 0:
                    return False
                if side > 0:
                    winding += turns
            elif touches(t):
                return False
        node = leaf_meeting(surface, span, node_after(node))
    if rule == ODD:
        return (winding & 1) != 0
    return winding > 0


@wp.func
def mesh_value(inside: Inside, x: wp.vec3d):
    """`Field.value` of a closed surface: -1 inside, 1 outside and on the surface."""
    at = (x - inside.low) / inside.cell
    zero = wp.float64(0.0)
    if not (at[0] >= zero and at[1] >= zero and at[2] >= zero):
        return wp.float64(1.0)
    shape = inside.cell_side.shape
    if at[0] >= wp.float64(shape[0]) or at[1] >= wp.float64(shape[1]) or at[2] >= wp.float64(shape[2]):
        return wp.float64(1.0)
    known = inside.cell_side[int(at[0]), int(at[1]), int(at[2])]
    if known != wp.int8(0):
        return wp.float64(known)
    if is_wound(inside.surface, x, inside.rule):
        return wp.float64(-1.0)
    return wp.float64(1.0)


@wp.struct
class Hits:
    """Intersections of a line segment with a surface."""

    count: int  # faces
    last: wp.float64  # share of the segment up to the face that was found last
    exit: wp.float64  # up to the first through which it leaves the solid; beyond 1 if there is none


@wp.func
def hit_face(hits: Hits, t: Triangle, d: wp.vec3d):
    """The hits and one face more: t seen from the start of the segment, d from there to its end [m]."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    va = wp.dot(d, wp.cross(t.b, t.c))
    vb = wp.dot(d, wp.cross(t.c, t.a))
    vc = wp.dot(d, wp.cross(t.a, t.b))
    leaves = va >= zero and vb >= zero and vc >= zero
    if leaves == (va <= zero and vb <= zero and vc <= zero):  # beside the face, or along it
        return hits
    normal = wp.cross(t.b - t.a, t.c - t.a)
    across = wp.dot(normal, d)
    if (across > zero) != leaves or across == zero:
        return hits
    share = wp.dot(normal, t.a) / across
    if share < -SLACK or share > one + SLACK:
        return hits
    out = Hits()
    out.count = hits.count + 1
    out.last = wp.clamp(share, zero, one)
    out.exit = hits.exit
    if leaves:
        out.exit = wp.min(out.exit, out.last)
    return out


@wp.func
def hits_between(surface: Surface, start: wp.vec3d, end: wp.vec3d):
    """Intersections of the segment between two points with the surface."""
    hits = Hits()
    hits.exit = FAR
    span = span_of(surface, wp.min(start, end), wp.max(start, end))
    node = leaf_meeting(surface, span, 1)
    while node != 0:
        first = (node - surface.leaf_first) * LEAF
        for face in range(first, wp.min(first + LEAF, surface.corner.shape[0] // 3)):
            hits = hit_face(hits, face_from(surface, face, start), end - start)
        node = leaf_meeting(surface, span, node_after(node))
    return hits


_halved = root_of(mesh_value)


@wp.func
def precedes(a: wp.vec3d, b: wp.vec3d):
    """Order of points by their coordinates: which end of a segment is asked first must not matter."""
    if a[0] != b[0]:
        return a[0] < b[0]
    if a[1] != b[1]:
        return a[1] < b[1]
    return a[2] < b[2]


@wp.func
def mesh_root(inside: Inside, a: wp.vec3d, b: wp.vec3d):
    """`Field.root` of a closed surface: where the segment from a to b passes through a face.

    A single face on it is where it turns. With more, the inside may go on behind one (bodies that overlap), or two
    share an edge that is met: then the first that leads out counts if both its sides agree. What fails is halved.
    """
    start = a
    end = b
    if precedes(b, a):
        start = b
        end = a
    hits = hits_between(inside.surface, start, end)
    if hits.count == 1:
        return start + hits.last * (end - start)
    if mesh_value(inside, start) >= wp.float64(0.0):
        other = start
        start = end
        end = other
        hits = hits_between(inside.surface, start, end)
    if hits.exit <= wp.float64(1.0):
        x = start + hits.exit * (end - start)
        beside = wp.normalize(end - start) * BESIDE
        if mesh_value(inside, x - beside) < wp.float64(0.0) and mesh_value(inside, x + beside) >= wp.float64(0.0):
            return x
    return _halved(inside, start, end)


@wp.func
def is_near(t: Triangle, radius: wp.float64):
    """Whether a face may come as near to the origin as this: by the axes and its own normal."""
    for axis in range(3):
        if wp.min(wp.min(t.a[axis], t.b[axis]), t.c[axis]) > radius:
            return False
        if wp.max(wp.max(t.a[axis], t.b[axis]), t.c[axis]) < -radius:
            return False
    normal = wp.cross(t.b - t.a, t.c - t.a)
    return wp.abs(wp.dot(normal, t.a)) <= radius * wp.length(normal)


@wp.func
def side_of_ball(surface: Surface, x: wp.vec3d, radius: wp.float64, rule: int):
    """1 (outside) or -1 (inside) if no face is nearer to x than radius; otherwise 0."""
    room = radius * (wp.float64(1.0) + wp.float64(1.0e-6)) + wp.float64(1.0e-9)  # and rounding
    by = wp.vec3d(room, room, room)
    span = span_of(surface, x - by, x + by)
    node = leaf_meeting(surface, span, 1)
    while node != 0:
        first = (node - surface.leaf_first) * LEAF
        for face in range(first, wp.min(first + LEAF, surface.corner.shape[0] // 3)):
            if is_near(face_from(surface, face, x), room):
                return 0
        node = leaf_meeting(surface, span, node_after(node))
    if is_wound(surface, x, rule):
        return -1
    return 1


@wp.func
def mesh_ball(inside: Inside, x: wp.vec3d, radius: wp.float64):
    """`Field.ball` of a closed surface."""
    return side_of_ball(inside.surface, x, radius, inside.rule)


@wp.kernel
def _classify_cells(surface: Surface, low: wp.vec3d, cell: wp.float64, rule: int, cell_side: wp.array3d[wp.int8]):
    """Classify a cell by the ball around it."""
    i, j, k = wp.tid()
    half = wp.float64(0.5)
    at = wp.vec3d(wp.float64(i) + half, wp.float64(j) + half, wp.float64(k) + half)
    cell_side[i, j, k] = wp.int8(side_of_ball(surface, low + cell * at, wp.float64(0.8661) * cell, rule))


def mesh_field(surface: Any, bounds: np.ndarray, *, solid: str = "winding") -> Field:
    """The inside of a closed surface (`upload_surface`) as a field on its device.

    bounds: lowest and highest coordinates of the surface [m], shape [2, 3]. solid: which winding numbers are inside.
    "winding": those above 0, so faces must look outwards, overlapping bodies count as their union and cavities as
    holes. "even-odd": odd ones, whichever way faces look. Of a surface with open edges the inside is that of the ray
    that runs up, which leaks. Raises KeyError for another rule.
    """
    device = surface.corner.device
    low, high = np.asarray(bounds, np.float64)
    inside = Inside()
    cell = max(np.ptp(np.stack([low, high]), axis=0).max() / CELLS, 1e-9)
    shape = np.floor((high - low) / cell).astype(int) + 3
    inside.surface, inside.cell, inside.rule = surface, cell, RULES[solid]
    inside.low = wp.vec3d(*(0.5 * (low + high - shape * cell)))
    inside.cell_side = wp.empty(tuple(shape.tolist()), dtype=wp.int8, device=device)
    inputs = [surface, inside.low, inside.cell, inside.rule]
    launch(_classify_cells, inside.cell_side.shape, inputs, [inside.cell_side])
    return Field(mesh_value, Inside, inside, mesh_root, mesh_ball)
