"""Walking a contour from triangle to triangle through half-edge links, without comparing coordinates."""

import warp as wp

from ..patch import Frame, above, outcode, patch_coordinates, snap_to_sides
from .clip import blend
from .half_edges import OPEN, Surface


@wp.struct
class Crossing:
    """A crossing of an edge with the plane; contours have the solid on their left, seen from +n.

    The half-edge is that of the triangle which the contour enters; it runs from above the plane to below.
    """

    half: int  # OPEN if there is no such triangle
    scanned: int  # 1 if the edge is scanned (open edges are)
    upper: wp.vec3d  # its ends in the patch's frame [m]
    lower: wp.vec3d


@wp.func_native("""
#ifdef __CUDA_ARCH__
    const float4 r = __ldg(reinterpret_cast<const float4*>(a.data) + i);  // one load, not four
    return wp::vec_t<4, wp::float32>(r.x, r.y, r.z, r.w);
#else
    return a.data[i];
#endif
""")
def load_vec4(a: wp.array[wp.vec4], i: int) -> wp.vec4:
    """Entry i of a 16-byte aligned array, read with one load on a GPU."""


@wp.func
def vertex_of(x: wp.vec4):
    """Position [m]."""
    return wp.vec3(x[0], x[1], x[2])


@wp.func
def link_of(x: wp.vec4):
    """Link of a half-edge (`HalfEdges.link`) from its entry in `Surface.corner`."""
    return wp.cast(x[3], wp.int32)


@wp.func
def corner_of(half: int):
    """Number of a half-edge within its triangle; unsigned numbers need no look at the sign."""
    return wp.uint32(half) % wp.uint32(3)


@wp.func
def half_after(half: int):
    """Next half-edge of the triangle."""
    return wp.where(corner_of(half) == wp.uint32(2), half - 2, half + 1)


@wp.func
def half_before(half: int):
    """Previous half-edge of the triangle."""
    return wp.where(corner_of(half) == wp.uint32(0), half + 2, half - 1)


@wp.func
def crossing_at(surface: Surface, f: Frame, half: int):
    """The crossing of a half-edge that runs down through the plane."""
    c = Crossing()
    c.half = half
    c.upper = patch_coordinates(f, vertex_of(load_vec4(surface.corner, half)))
    c.lower = patch_coordinates(f, vertex_of(load_vec4(surface.corner, half_after(half))))
    return c


@wp.func
def crossing_after(surface: Surface, f: Frame, c: Crossing):
    """The crossing by which the contour leaves the triangle of c.half.

    the triangle's third vertex   the contour leaves through
    above                         the next half-edge (from the lower end to the third vertex)
    below                         the previous one (from the third vertex to the upper end)
    """
    n = Crossing()
    third = load_vec4(surface.corner, half_before(c.half))
    down = link_of(load_vec4(surface.corner, half_after(c.half)))  # read already, for it may be needed
    x = patch_coordinates(f, vertex_of(third))
    up = above(x[2])
    n.upper = wp.where(up, x, c.upper)
    n.lower = wp.where(up, c.lower, x)
    link = wp.where(up, down, link_of(third))
    n.half = link >> 1  # of OPEN: OPEN
    n.scanned = link & 1
    return n


@wp.func
def crossing_before(surface: Surface, f: Frame, c: Crossing):
    """The crossing before c, through the triangle on the other side of c's edge; OPEN if a chain begins with c."""
    n = Crossing()
    n.half = OPEN
    own = link_of(load_vec4(surface.corner, c.half))
    if own != OPEN:
        half = own >> 1  # runs up through the plane
        third = load_vec4(surface.corner, half_before(half))
        x = patch_coordinates(f, vertex_of(third))
        if above(x[2]):
            n.half = half_before(half)
            n.upper = x
            n.lower = c.lower
        else:
            n.half = half_after(half)
            n.upper = c.upper
            n.lower = x
        n.scanned = link_of(load_vec4(surface.corner, n.half)) & 1  # OPEN is odd: an open edge is scanned
    return n


@wp.func
def chain_start(surface: Surface, f: Frame, half: int):
    """Half-edge of the first crossing of the chain through `half`."""
    c = crossing_at(surface, f, half)
    first = half
    while True:
        c = crossing_before(surface, f, c)
        if c.half == OPEN:
            break
        first = c.half
    return first


@wp.func
def point_of(f: Frame, c: Crossing, side: wp.vec2d):
    """Point of a crossing in the patch's plane [m], moved onto the sides that it is flush with (`snap_to_sides`)."""
    p = wp.vec2d(c.upper[0], c.upper[1])
    q = wp.vec2d(c.lower[0], c.lower[1])
    return snap_to_sides(blend(p, q, c.upper[2], c.lower[2]), side, f.flush)


@wp.func
def is_first(surface: Surface, f: Frame, half: int, side: wp.vec2d):
    """Whether a scanned crossing has the lowest rank of its loop and the loop stays inside the patch.

    Walks both ways in turn until it meets a lower rank, leaves the patch or has passed the loop. For all crossings of
    a loop of n together this takes at most n log n steps, for any order of the ranks.
    """
    rank = surface.rank[half]
    ahead = crossing_at(surface, f, half)
    back = crossing_at(surface, f, half)
    while True:
        ahead = crossing_after(surface, f, ahead)
        if ahead.half == OPEN or ahead.half == half:
            return ahead.half == half
        if outcode(point_of(f, ahead, side), side) != 0:
            return False
        if ahead.scanned == 1:
            if surface.rank[ahead.half] < rank:
                return False
        back = crossing_before(surface, f, back)
        if back.half == OPEN:
            return False
        if outcode(point_of(f, back, side), side) != 0:
            return False
        if back.scanned == 1:
            if surface.rank[back.half] < rank:
                return False
    return False
