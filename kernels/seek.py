"""Contours of large surfaces: a hierarchy of boxes, traversed by the oriented patch, finds what lies in it."""

import warp as wp

from .clip import NONE, passage_of, winding_step
from .patch import EXACT, Frame, Patch, Plane, frame_at, is_above, outcode, plane_of
from .piece import (
    CLOSED,
    Pieces,
    begun_at_side,
    begun_inside,
    count_row,
    led_out,
    led_to,
    section_of,
    store_piece,
)
from .surface import LEAF, OPEN, Surface
from .trace import UNBOUNDED
from .walk import (
    crossing_after,
    crossing_at,
    is_first,
    link_of,
    loaded,
    point_of,
    vertex_of,
)

wp.set_module_options(EXACT)

ENTRY = wp.constant(1)  # the contour enters the patch, or starts in it, in this face
INNER = wp.constant(2)  # a scanned crossing strictly inside
OUTER = wp.constant(3)  # crosses the ray, anywhere: for the winding number


@wp.struct
class Window:
    """The rectangle that is looked for, in a patch's frame, in float32."""

    origin: wp.vec3  # [m]
    u: wp.vec3
    v: wp.vec3
    low: wp.vec2  # [m]
    high: wp.vec2
    margin: float  # [m]; what float32 may be wrong by


@wp.struct
class Cursor:
    """Where a traversal has come to, and what it found there."""

    node: int  # heap number; 0 at the end
    place: int  # of the next face in the leaf
    kind: int  # ENTRY, INNER, OUTER; NONE at the end
    half: int
    scanned: int  # 1 if the crossing is a scanned one inside the patch


@wp.func
def window_of(f: Frame, surface: Surface, low: wp.vec2d, high: wp.vec2d):
    """The window low..high of a patch's plane."""
    w = Window()
    w.origin = wp.vec3(wp.float32(f.origin[0]), wp.float32(f.origin[1]), wp.float32(f.origin[2]))
    w.u = wp.vec3(wp.float32(f.u[0]), wp.float32(f.u[1]), wp.float32(f.u[2]))
    w.v = wp.vec3(wp.float32(f.v[0]), wp.float32(f.v[1]), wp.float32(f.v[2]))
    w.low = wp.vec2(wp.float32(low[0]), wp.float32(low[1]))
    w.high = wp.vec2(wp.float32(high[0]), wp.float32(high[1]))
    w.margin = 2.0e-6 * (surface.reach + wp.abs(w.origin[0]) + wp.abs(w.origin[1]) + wp.abs(w.origin[2]))
    return w


@wp.func
def reach_along(axis: wp.vec3, half: wp.vec3):
    """How far a box of these half extents reaches along an axis."""
    return wp.abs(axis[0]) * half[0] + wp.abs(axis[1]) * half[1] + wp.abs(axis[2]) * half[2]


@wp.func
def meets(surface: Surface, plane: Plane, w: Window, node: int):
    """Whether a box may meet the window: separating axes n, u and v.

    The box's own axes would add little: a box is small against the patch where it matters, near the leaves.
    """
    e = loaded(surface.node_half, node)
    half = wp.vec3(e[0], e[1], e[2])
    centre = vertex_of(loaded(surface.node_centre, node))
    if half[0] < 0.0 or wp.abs(wp.dot(plane.n, centre) - plane.distance) > reach_along(plane.n, half) + w.margin:
        return False
    d = centre - w.origin
    x = wp.dot(w.u, d)
    r = reach_along(w.u, half) + w.margin
    if x - r > w.high[0] or x + r < w.low[0]:
        return False
    y = wp.dot(w.v, d)
    r = reach_along(w.v, half) + w.margin
    return y - r <= w.high[1] and y + r >= w.low[1]


@wp.func
def node_after(node: int):
    """The node that comes next once all below this one is done; 0 at the end."""
    n = node + 1
    while n % 2 == 0:
        n = n // 2
    if n == 1:
        return 0
    return n


@wp.func
def down_half(surface: Surface, f: Frame, plane: Plane, face: int):
    """The half-edge of a face that runs down through the plane; OPEN if none does."""
    half = 3 * face
    a = is_above(f, plane, vertex_of(loaded(surface.corner, half)))
    b = is_above(f, plane, vertex_of(loaded(surface.corner, half + 1)))
    c = is_above(f, plane, vertex_of(loaded(surface.corner, half + 2)))
    if a and not b:
        return half
    if b and not c:
        return half + 1
    if c and not a:
        return half + 2
    return OPEN


@wp.func
def judged(surface: Surface, f: Frame, side: wp.vec2d, half: int):
    """What a crossed face means for the patch: ENTRY, INNER or NONE."""
    found = Cursor()
    found.half = half
    found.kind = NONE
    c = crossing_at(surface, f, half)
    p = point_of(c)
    code_p = outcode(p, side)
    link = link_of(loaded(surface.corner, half))
    if code_p == 0:
        found.scanned = link & 1  # OPEN is odd
        if link == OPEN:
            found.kind = ENTRY
        elif found.scanned == 1:
            found.kind = INNER
    else:
        q = point_of(crossing_after(surface, f, c))
        if passage_of(p, q, code_p, outcode(q, side), side).enter != NONE:
            found.kind = ENTRY
    return found


@wp.func
def next_found(surface: Surface, f: Frame, plane: Plane, w: Window, side: wp.vec2d, at: Cursor, ray: bool):
    """Go on with a traversal up to the next face that means something; of a ray's, to the next face crossed."""
    found = Cursor()
    found.kind = NONE
    node = int(at.node)
    place = int(at.place)
    while node != 0:
        if place == 0 and not meets(surface, plane, w, node):
            node = node_after(node)
        elif node < surface.leaf_first:
            node = 2 * node
        elif place == LEAF:
            place = 0
            node = node_after(node)
        else:
            face = (node - surface.leaf_first) * LEAF + place
            place += 1
            half = int(OPEN)
            if 3 * face < surface.corner.shape[0]:
                half = down_half(surface, f, plane, face)
            if half != OPEN:
                if ray:
                    found.kind = OUTER
                    found.half = half
                else:
                    found = judged(surface, f, side, half)
                if found.kind != NONE:
                    break
    found.node = node
    found.place = place
    return found


@wp.func
def walked_out(surface: Surface, f: Frame, side: wp.vec2d, half: int, pieces: Pieces, row: int, slot: int):
    """Walk an open piece from where it enters or starts, and store it; returns the scanned crossings inside, passed."""
    c = crossing_at(surface, f, half)
    p = point_of(c)
    code_p = outcode(p, side)
    scanned = int(0)
    piece = begun_inside(f, half, p)
    if code_p == 0:
        scanned = 1  # it starts at an open edge
    while True:
        n = crossing_after(surface, f, c)
        q = point_of(n)
        code_q = outcode(q, side)
        if code_p == 0 and code_q == 0:
            piece = led_to(f, piece, q)
        else:
            t = passage_of(p, q, code_p, code_q, side)
            if code_p != 0:
                piece = begun_at_side(f, c.half, p, q, t.enter, side)
            if code_q == 0:
                piece = led_to(f, piece, q)
            else:
                piece = led_out(f, piece, p, q, t.leave, side)
                break
        if n.half == OPEN:
            break
        scanned += n.scanned
        c = n
        p = q
        code_p = code_q
    store_piece(pieces, row, slot, piece, half)
    return scanned


@wp.func
def walked_loop(surface: Surface, f: Frame, half: int, pieces: Pieces, row: int, slot: int):
    """Walk a loop that never leaves the patch, and store it; returns the scanned crossings passed."""
    c = crossing_at(surface, f, half)
    piece = begun_inside(f, half, point_of(c))
    scanned = int(0)
    while True:
        c = crossing_after(surface, f, c)
        piece = led_to(f, piece, point_of(c))
        scanned += c.scanned
        if c.half == half:
            break
    store_piece(pieces, row, slot, piece, CLOSED + surface.rank[half])
    return scanned


@wp.func
def wound(surface: Surface, f: Frame, plane: Plane, side: wp.vec2d):
    """Winding number around corner 0: what crosses the line of side 0 beyond it, away from the patch."""
    w = window_of(f, surface, wp.vec2d(-UNBOUNDED, -side[1]), wp.vec2d(-side[0], -side[1]))
    winding = int(0)
    at = Cursor()
    at.node = 1
    while at.node != 0:
        at = next_found(surface, f, plane, w, side, at, True)
        if at.kind == OUTER:
            c = crossing_at(surface, f, at.half)
            p = point_of(c)
            q = point_of(crossing_after(surface, f, c))
            winding += winding_step(p, q, outcode(p, side), outcode(q, side), side)
    return winding


@wp.kernel
def _seek_pieces(
    # In:
    surface: Surface,
    pose: wp.array[wp.transform],  # hand frame -> array frame, shape [pose]
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: the winding number is asked for
    # Out:
    pieces: Pieces,
):
    """Find the pieces of each row's section: first those that enter, then loops that nothing has passed."""
    row = wp.tid()
    section = section_of(pieces, row)
    own = patch[section % patch.shape[0]]
    f = frame_at(pose[section // patch.shape[0]], own)
    side = own.half
    if bounded == 0:
        side = wp.vec2d(UNBOUNDED, UNBOUNDED)
    plane = plane_of(f, surface.reach)
    w = window_of(f, surface, -side, side)
    count = int(0)
    total = int(0)
    passed = int(0)
    at = Cursor()
    at.node = 1
    while at.node != 0:
        at = next_found(surface, f, plane, w, side, at, False)
        total += at.scanned
        if at.kind == ENTRY:
            passed += walked_out(surface, f, side, at.half, pieces, row, count)
            count += 1
    at = Cursor()
    at.node = 1
    while at.node != 0 and passed < total:
        at = next_found(surface, f, plane, w, side, at, False)
        if at.kind == INNER:
            if is_first(surface, f, at.half, side):
                passed += walked_loop(surface, f, at.half, pieces, row, count)
                count += 1
    winding = int(0)
    if closes == 1:
        winding = wound(surface, f, plane, side)
    count_row(pieces, row, count, winding)
