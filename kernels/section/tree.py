"""Tree search, for large surfaces: traverse the box hierarchy for the faces that the patch crosses."""

from typing import Any

import warp as wp

from ..offsets import BLOCK
from ..patch import (
    EXACT,
    UNBOUNDED,
    Coarse,
    Frame,
    Patch,
    coarse_frame,
    half_extents,
    is_above,
    outcode,
    output_point,
    section_frame,
)
from .clip import NONE, corners_left, segment_of, winding_step
from .half_edges import LEAF, OPEN, Surface
from .pieces import (
    CLOSED,
    ContourPieces,
    CutPlanes,
    room_for_rest,
    room_for_sections,
    section_of,
    store_count,
    store_piece,
)
from .walk import crossing_after, crossing_at, is_first, link_of, load_vec4, point_of, vertex_of

wp.set_module_options(EXACT)

LISTED = 8  # crossed faces that a traversal lists before they are processed


@wp.struct
class Window:
    """The rectangle that is searched, along u and v of a patch's frame [m]."""

    low: wp.vec2
    high: wp.vec2


@wp.struct
class Cursor:
    """Position of a traversal."""

    node: int  # heap number; 0 at the end
    place: int  # of the next face in the leaf
    listed: int  # crossed faces listed since the last call


@wp.func
def reach_along(axis: wp.vec3, half: wp.vec3):
    """Half extent of a box along an axis."""
    return wp.abs(axis[0]) * half[0] + wp.abs(axis[1]) * half[1] + wp.abs(axis[2]) * half[2]


@wp.func
def meets(surface: Surface, g: Coarse, w: Window, node: int):
    """Whether a box may meet the window: separating axes n, u and v.

    The box's own axes would add little: a box is small against the patch where it matters, near the leaves.
    """
    e = load_vec4(surface.node_half, node)
    half = wp.vec3(e[0], e[1], e[2])
    d = vertex_of(load_vec4(surface.node_centre, node)) - g.origin
    margin = 4.0 * g.unsure
    if half[0] < 0.0 or wp.abs(wp.dot(g.n, d)) > reach_along(g.n, half) + margin:
        return False
    x = wp.dot(g.u, d)
    r = reach_along(g.u, half) + margin
    if x - r > w.high[0] or x + r < w.low[0]:
        return False
    y = wp.dot(g.v, d)
    r = reach_along(g.v, half) + margin
    return y - r <= w.high[1] and y + r >= w.low[1]


@wp.func
def node_after(node: int):
    """The next node in the traversal that is not below this one; 0 at the end."""
    n = node + 1
    while n % 2 == 0:
        n = n // 2
    if n == 1:
        return 0
    return n


@wp.func
def leaf_from(surface: Surface, g: Coarse, w: Window, node: int):
    """The next leaf that may meet the window, from a node on in the heap's order; 0 if there is none."""
    n = int(node)
    while n != 0:
        if meets(surface, g, w, n):
            if n >= surface.leaf_first:
                break
            n = 2 * n
        else:
            n = node_after(n)
    return n


@wp.func
def down_half(surface: Surface, f: Frame, g: Coarse, face: int):
    """The half-edge of a face that runs down through the plane; OPEN if none does."""
    half = 3 * face
    if half >= surface.corner.shape[0]:
        return OPEN
    a = is_above(f, g, vertex_of(load_vec4(surface.corner, half)))
    b = is_above(f, g, vertex_of(load_vec4(surface.corner, half + 1)))
    c = is_above(f, g, vertex_of(load_vec4(surface.corner, half + 2)))
    if a and not b:
        return half
    if b and not c:
        return half + 1
    if c and not a:
        return half + 2
    return OPEN


@wp.func
def traverse(surface: Surface, f: Frame, g: Coarse, w: Window, at: Cursor, halves: wp.array[wp.int32]):
    """Continue a traversal: list the downward half-edges of crossed faces until the list is full or the end."""
    out = Cursor()
    out.node = at.node
    out.place = at.place
    while out.node != 0 and out.listed < LISTED:
        if out.place == 0:
            out.node = leaf_from(surface, g, w, out.node)
        if out.node != 0:
            half = down_half(surface, f, g, (out.node - surface.leaf_first) * LEAF + out.place)
            if half != OPEN:
                halves[out.listed] = half
                out.listed += 1
            out.place += 1
            if out.place == LEAF:
                out.place = 0
                out.node = node_after(out.node)
    return out


@wp.struct
class TreeResult:
    """Pieces and scanned crossings of a section found so far."""

    count: int  # pieces
    total: int  # scanned crossings inside the patch
    passed: int  # those of them that lie on pieces


@wp.func
def piece_from(
    surface: Surface, f: Frame, side: wp.vec2d, half: int, enter: int, pieces: ContourPieces, query: int, slot: int
):
    """Walk an open piece from where it enters or starts, and store it; returns the scanned crossings inside, passed."""
    c = crossing_at(surface, f, half)
    p = point_of(f, c, side)
    code = outcode(p, side)
    passed = wp.where(code == 0, 1, 0)  # it starts inside at an open edge, which is scanned
    out = half
    steps = int(0)
    n = crossing_after(surface, f, c)
    q = point_of(f, n, side)
    code_q = outcode(q, side)
    x = output_point(f, p)
    while code_q == 0:
        y = output_point(f, q)
        if code == 0 and not (x == y):
            steps += 1
        if n.half == OPEN:
            break
        passed += n.scanned
        out = n.half
        x = y
        p = q
        code = 0
        n = crossing_after(surface, f, n)
        q = point_of(f, n, side)
        code_q = outcode(q, side)
    leave = int(NONE)
    if code_q != 0:
        leave = segment_of(code, code_q, corners_left(p, q, side)).leave
    store_piece(pieces, query, slot, half, out, enter, leave, steps, half, 0)
    return passed


@wp.func
def loop_from(surface: Surface, f: Frame, side: wp.vec2d, half: int, pieces: ContourPieces, query: int, slot: int):
    """Walk a loop that never leaves the patch, and store it; returns the scanned crossings passed."""
    c = crossing_at(surface, f, half)
    x = output_point(f, point_of(f, c, side))
    steps = int(0)
    passed = int(0)
    done = int(0)
    while done == 0:
        c = crossing_after(surface, f, c)
        y = output_point(f, point_of(f, c, side))
        if not (x == y):
            steps += 1
        x = y
        passed += c.scanned
        if c.half == half:
            done = 1
    store_piece(pieces, query, slot, half, half, NONE, NONE, steps, CLOSED + surface.rank[half], 1)
    return passed


@wp.func
def process_crossing(
    surface: Surface, f: Frame, side: wp.vec2d, half: int, found: TreeResult, pieces: ContourPieces, query: int
):
    """Process a crossed face: count its crossing if scanned and inside; walk the piece that begins there, if any."""
    out = found
    link = link_of(load_vec4(surface.corner, half))
    c = crossing_at(surface, f, half)
    p = point_of(f, c, side)
    code_p = outcode(p, side)
    enter = int(NONE)
    if code_p == 0:
        out.total += link & 1  # OPEN is odd
    else:
        q = point_of(f, crossing_after(surface, f, c), side)
        enter = segment_of(code_p, outcode(q, side), corners_left(p, q, side)).enter
    if enter != NONE or (code_p == 0 and link == OPEN):
        out.passed += piece_from(surface, f, side, half, enter, pieces, query, out.count)
        out.count += 1
    return out


@wp.func
def is_candidate(surface: Surface, f: Frame, side: wp.vec2d, half: int):
    """Whether a crossing is a scanned one inside the patch."""
    link = link_of(load_vec4(surface.corner, half))
    if link == OPEN or link & 1 == 0:
        return False
    return outcode(point_of(f, crossing_at(surface, f, half), side), side) == 0


@wp.func
def patch_window(g: Coarse):
    """The window of the patch itself."""
    w = Window()
    w.low = -g.half
    w.high = g.half
    return w


@wp.func
def corner_window(g: Coarse):
    """The window of the line of side 0, beyond corner 0."""
    w = Window()
    w.low = wp.vec2(-wp.float32(UNBOUNDED), -g.half[1])
    w.high = -g.half
    return w


@wp.func
def winding_across(surface: Surface, f: Frame, side: wp.vec2d, half: int):
    """Share of the winding number around corner 0 that the segment from a half-edge's crossing adds."""
    c = crossing_at(surface, f, half)
    p = point_of(f, c, side)
    q = point_of(f, crossing_after(surface, f, c), side)
    return winding_step(outcode(p, side), outcode(q, side), corners_left(p, q, side))


@wp.func
def winding_at_corner(surface: Surface, f: Frame, g: Coarse, side: wp.vec2d, halves: wp.array[wp.int32]):
    """Winding number around corner 0, from crossings of the line of side 0, beyond corner 0 and outside the patch."""
    w = corner_window(g)
    winding = int(0)
    at = Cursor()
    at.node = 1
    while at.node != 0:
        at = traverse(surface, f, g, w, at, halves)
        for k in range(at.listed):
            winding += winding_across(surface, f, side, halves[k])
    return winding


@wp.kernel
def _tree_search_pieces(
    surface: Surface,
    pose: wp.array2d[wp.transform],  # of the hand or of each patch -> array frame, shape [pose, 1 or patch]
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    closes: int,  # 1: compute the winding number
    pieces: ContourPieces,
):
    """Find the pieces of each query's section: first open pieces, then loops whose crossings lie on no piece yet."""
    query = wp.tid()
    section = section_of(pieces, query)
    f = section_frame(pose, patch, section)
    side = half_extents(patch[section % patch.shape[0]], bounded)
    g = coarse_frame(f, side, surface.reach)
    halves = wp.zeros(shape=LISTED, dtype=wp.int32)
    w = patch_window(g)
    found = TreeResult()
    at = Cursor()
    at.node = 1
    while at.node != 0:
        at = traverse(surface, f, g, w, at, halves)
        for k in range(at.listed):
            found = process_crossing(surface, f, side, halves[k], found, pieces, query)
    at = Cursor()
    at.node = 1
    while at.node != 0 and found.passed < found.total:
        at = traverse(surface, f, g, w, at, halves)
        k = int(0)
        while k < at.listed and found.passed < found.total:
            half = halves[k]
            if is_candidate(surface, f, side, half) and is_first(surface, f, half, side):
                found.passed += loop_from(surface, f, side, half, pieces, query, found.count)
                found.count += 1
            k += 1
    winding = int(0)
    if closes == 1:
        winding = winding_at_corner(surface, f, g, side, halves)
    store_count(pieces, query, found.count, winding)


class TreeSearch:
    """A tree search of all sections, of some, or of the queries of `pieces`, which have room for all of theirs."""

    def __init__(self, planes: CutPlanes, section: wp.array | None = None, pieces: Any = None) -> None:
        self.planes, self.section, self.pieces = planes, section, pieces

    def launch(self) -> Any:
        """ContourPieces of the queries, which the device may not have found yet."""
        planes, device = self.planes, self.planes.pose.device
        if self.pieces is None:
            query_count = planes.section_count if self.section is None else self.section.shape[0]
            self.pieces = room_for_sections(query_count, device, self.section)
        inputs = [*planes.inputs, int(planes.closes)]
        query_count = self.pieces.count.shape[0]
        outputs = [self.pieces]
        wp.launch(_tree_search_pieces, query_count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)
        return self.pieces

    def rest(self) -> list["TreeSearch"]:
        """The search of queries that had too little room, if any; waits for the device."""
        pieces = room_for_rest(self.pieces, self.planes.pose.device)
        return [] if pieces is None else [TreeSearch(self.planes, pieces=pieces)]
