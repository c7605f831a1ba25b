"""Walking loops of a closed surface in float32, with bounds of the errors: what is not sure is left to float64.

All numbers of this module are of a patch's frame. A coordinate of a vertex is wrong by at most e = `Coarse.unsure`,
which includes the shift of flush vertices. A crossing of an edge from u above the plane to l below lies at t / d with
t = l h(u) - u h(l) and d = h(u) - h(l). It is a mean of u and l, whose weights are wrong by at most 2 e / d if both
heights exceed 2 e. So t / d is wrong by at most e + 2 e |u - l| / d, and by 2.4 e with the rounding of t.

Corner C of the patch is to the left of a segment P -> Q if (P - C) x (Q - C) is not negative. If P and Q are wrong by
at most p and q along each axis, this product is wrong by at most p |Q - C| + q |P - C| + 2 p q, where |.| sums absolute
coordinates. Only corners between P and Q matter. So C is not farther away than the farthest vertex, where half a
spacing of float32 is e / 8 at most. `Float32Crossing.room` / d exceeds the error of P by 2.6 e, which contains the
rounding of P - C, and it exceeds 6 e, so that a quarter more of the bound contains the rounding of the product.
"""

import warp as wp

from ..patch import Frame, coarse_frame
from ..warps import in_step
from .clip_events import BEGIN, CLEAR, CORNERS, END, FROM, HALF, Events, is_quiet, write_event
from .edge_pairing import OPEN
from .float32_scan import clear_bit, float32_sum, half_at, lowest_left
from .half_edges import Surface
from .segment_clipping import needs_left
from .step_lists import end_list, list_half
from .triangle_walk import half_after, load_vec4, vertex_of

REST = wp.constant(1 << 16)  # more than a query's events: a surface with a scan path has 24,000 half-edges at most
# In `Float32Walk.steps`: no loop has so many steps, so that some may be added.
ENDED = wp.constant(1 << 29)  # the lane is on no loop
UNSURE = wp.constant(-(1 << 30))  # neither, as float32 could not decide


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return fmaf(a, b, -(c * d));
#else
    return a * b - c * d;
#endif
""")
def float32_difference(a: float, b: float, c: float, d: float) -> float:
    """About a b - c d."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return fmaf(a, b, c);
#else
    return a * b + c;
#endif
""")
def float32_product(a: float, b: float, c: float) -> float:
    """About a b + c."""


@wp.func_native("""
    const unsigned in_u = reinterpret_cast<const unsigned&>(right), in_v = reinterpret_cast<const unsigned&>(top);
    const unsigned u = reinterpret_cast<const unsigned&>(x), v = reinterpret_cast<const unsigned&>(y);
    const unsigned left = ~in_u & u, bottom = ~in_v & v;
#ifdef __CUDA_ARCH__
    unsigned right_of, top_of;  // neither: one instruction each, for which the compiler takes two
    asm("lop3.b32 %0, %1, %2, 0, 0x03;" : "=r"(right_of) : "r"(in_u), "r"(u));
    asm("lop3.b32 %0, %1, %2, 0, 0x03;" : "=r"(top_of) : "r"(in_v), "r"(v));
    unsigned code = __funnelshift_l(left, 0u, 1);
    code = __funnelshift_l(top_of, code, 1);
    code = __funnelshift_l(right_of, code, 1);
    return __funnelshift_l(bottom, code, 1);
#else
    const unsigned right_of = ~(in_u | u), top_of = ~(in_v | v);
    return (left >> 31) << 3 | (top_of >> 31) << 2 | (right_of >> 31) << 1 | bottom >> 31;
#endif
""")
def code_of_signs(right: float, x: float, top: float, y: float) -> int:
    """Outcode of a point (x, y): beyond a side along u if `right` is not negative, along v if `top` is not."""


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)];
""")
def load_int(a: wp.array[wp.int32], i: int) -> int:
    """Entry i of an array."""


@wp.func_native("""
    return a & b;
""")
def both(a: wp.bool, b: wp.bool) -> wp.bool:
    """Whether both are true; unlike `and`, it never branches."""


@wp.func_native("""
    return a | b;
""")
def either(a: wp.bool, b: wp.bool) -> wp.bool:
    """Whether one is true; unlike `or`, it never branches."""


@wp.func_native("""
    const unsigned bits = reinterpret_cast<const unsigned&>(hop.c[3]);
    return up ? bits & 0xffffu : bits >> 16;
""")
def link_after(hop: wp.vec4, up: wp.bool) -> int:
    """Link of the half-edge by which a contour leaves a triangle, from `Surface.hop`; up: third vertex above."""


@wp.struct
class Float32Frame:
    """A patch's frame in float32."""

    u: wp.vec3
    v: wp.vec3
    n: wp.vec3
    from_origin: wp.vec3  # minus the scalar products of u, v and n with the origin [m]
    minus_half: wp.vec2  # minus the half extents [m]
    flat: float  # 2 e: a height below it is not sure [m]
    near: float  # 6 e and the rounding of half extents [m]


@wp.struct
class Float32Crossing:
    """A crossing's point (x / d, y / d), where it may be instead, and its outcode."""

    x: float  # [m^2]
    y: float
    d: float  # [m]
    room: float  # d times the bound of the error of x / d and y / d, and of a move onto a side [m^2]
    code: int
    sure: wp.bool  # whether the code is right, and the crossing is CLEAR


@wp.struct
class Float32Corners:
    """Corners of the patch."""

    left: int  # bits as of `corners_left`
    sure: wp.bool


@wp.struct
class Float32Walk:
    """State of a walk around the loops of a query, one after another."""

    query: int  # OPEN for none
    events: int  # of the query, and above them REST times the crossings that the scan counted and no walk has passed
    words: wp.uint64  # address of what is left of its scan
    first: int  # half-edge of the loop's first crossing
    bit: int  # its bit in the scan
    now: int  # half-edge of the latest crossing
    upper: wp.vec3  # its ends
    lower: wp.vec3
    crossing: Float32Crossing
    steps: int  # of non-zero length since the latest event, ENDED or UNSURE, or more than these
    listed: int  # steps of the query that are listed so far, and of the loops before
    word: wp.uint64  # what is filled of the list's latest word


@wp.func
def is_walking(walk: Float32Walk):
    """Whether a lane is on a loop."""
    return wp.uint32(walk.steps) < wp.uint32(ENDED)


@wp.func
def float32_frame(f: Frame, half: wp.vec2d, reach: float):
    """The frame in float32; arguments as of `coarse_frame`."""
    g = coarse_frame(f, half, reach)
    out = Float32Frame()
    out.u = g.u
    out.v = g.v
    out.n = g.n
    out.from_origin = wp.vec3(-wp.float32(wp.dot(f.u, f.origin)), -wp.float32(wp.dot(f.v, f.origin)), -g.distance)
    out.minus_half = -g.half
    out.flat = 2.0 * g.unsure
    rounding = 2.0e-7 * wp.max(g.half[0], g.half[1])  # of a side; if it is larger, the sides lie beyond the surface
    out.near = 3.0 * out.flat + wp.min(rounding, out.flat)
    return out


@wp.func
def float32_position(g: Float32Frame, x: wp.vec3):
    """Coordinates of a vertex along u, v and n [m]."""
    o = g.from_origin
    return wp.vec3(float32_sum(g.u, x, o[0]), float32_sum(g.v, x, o[1]), float32_sum(g.n, x, o[2]))


@wp.func
def float32_crossing(g: Float32Frame, upper: wp.vec3, lower: wp.vec3):
    """The crossing of an edge."""
    c = Float32Crossing()
    c.d = upper[2] - lower[2]
    c.x = float32_difference(lower[0], upper[2], upper[0], lower[2])
    c.y = float32_difference(lower[1], upper[2], upper[1], lower[2])
    wide = wp.abs(upper[0] - lower[0]) + wp.abs(upper[1] - lower[1])
    c.room = float32_product(g.near, c.d, g.flat * wide)
    right = float32_product(g.minus_half[0], c.d, wp.abs(c.x))
    top = float32_product(g.minus_half[1], c.d, wp.abs(c.y))
    c.code = code_of_signs(right, c.x, top, c.y)
    c.sure = wp.min(wp.abs(right), wp.abs(top)) > c.room
    return c


@wp.func
def float32_corners(g: Float32Frame, p: Float32Crossing, q: Float32Crossing):
    """The patch's corners between the ends of the segment p -> q and to the left of it."""
    out = Float32Corners()
    out.sure = True
    apart = p.code ^ q.code
    between = apart & ((apart << 1) | (apart >> 3))
    while between != 0:
        corner = between & -between
        x = wp.where((corner & 6) != 0, g.minus_half[0], -g.minus_half[0])  # minus the corner's coordinates
        y = wp.where((corner & 12) != 0, g.minus_half[1], -g.minus_half[1])
        from_p = wp.vec2(float32_product(x, p.d, p.x), float32_product(y, p.d, p.y))
        from_q = wp.vec2(float32_product(x, q.d, q.x), float32_product(y, q.d, q.y))
        turn = float32_difference(from_p[0], from_q[1], from_p[1], from_q[0])
        room = p.room * (wp.abs(from_q[0]) + wp.abs(from_q[1]))
        room += q.room * float32_product(2.0, p.room, wp.abs(from_p[0]) + wp.abs(from_p[1]))
        out.sure = both(out.sure, wp.abs(turn) > 1.25 * room)
        out.left |= wp.where(turn > 0.0, corner, 0)
        between ^= corner
    return out


@wp.func
def begin_loop(surface: Surface, g: Float32Frame, events: Events, walk: Float32Walk):
    """Begin the query's next loop, at its lowest crossing that no walk has passed."""
    t = walk
    t.listed = end_list(events.lists, t.query, t.listed, t.word)
    t.bit = lowest_left(surface, t.words)
    t.first = OPEN
    if t.bit != OPEN:
        t.first = half_at(surface, g.n, -g.from_origin[2], t.bit)
    t.steps = UNSURE
    if t.first != OPEN:
        t.upper = float32_position(g, vertex_of(load_vec4(surface.corner, t.first)))
        t.lower = float32_position(g, vertex_of(load_vec4(surface.corner, half_after(t.first))))
        t.crossing = float32_crossing(g, t.upper, t.lower)
        code = t.crossing.code
        write_event(events, t.query, t.events & (REST - 1), (t.first << HALF) | BEGIN | (code << FROM) | code, 0)
        t.events += 1
        t.now = t.first
        if t.crossing.sure and wp.min(t.upper[2], -t.lower[2]) > g.flat:
            t.steps = 0
    return t


@wp.func
def step_in_float32(surface: Surface, g: Float32Frame, events: Events, walk: Float32Walk):
    """Walk to the loop's next crossing; writes the events that `walk_loop` writes.

    A lane that does not walk goes on around its loop and leaves no trace: that takes fewer instructions than to stand.
    """
    t = walk
    walks = is_walking(t)
    p = t.crossing
    hop = load_vec4(surface.hop, t.now)
    x = float32_position(g, vertex_of(hop))
    up = x[2] > 0.0
    t.upper = wp.where(up, x, t.upper)
    t.lower = wp.where(up, t.lower, x)
    q = float32_crossing(g, t.upper, t.lower)
    inside = (p.code | q.code) == 0
    # Whether the float32 output points of p and q surely differ, though each may be moved onto a side.
    apart = wp.max(wp.abs(float32_difference(p.x, q.d, q.x, p.d)), wp.abs(float32_difference(p.y, q.d, q.y, p.d)))
    moves = apart > float32_product(p.room, q.d, q.room * p.d)
    sure = both(both(q.sure, wp.abs(x[2]) > g.flat), either(not inside, moves))
    t.steps += wp.where(inside, 1, 0)
    listed = both(inside, walks)
    t.word = list_half(events.lists, t.query, t.listed, t.word, t.now, listed)
    t.listed += wp.where(listed, 1, 0)
    link = link_after(hop, up)
    now = t.now
    t.now = link >> 1
    t.crossing = q
    last = wp.where(t.now == t.first, END, 0)
    if both(walks, either(last != 0, not is_quiet(p.code, q.code))):
        what = (now << HALF) | last | (p.code << FROM) | q.code
        if needs_left(p.code, q.code):
            corners = float32_corners(g, p, q)
            what |= corners.left << CORNERS
            sure = both(sure, corners.sure)
        else:
            what |= CLEAR
        write_event(events, t.query, t.events & (REST - 1), what, t.steps)
        t.events += 1
        t.steps = wp.where(last != 0, ENDED, 0)
    scanned = both(walks, (link & 1) != 0)
    if either(scanned, not in_step()):  # a CPU would often mispredict this branch, so it has none
        bit = load_int(surface.scan_bit, t.now)
        clear_bit(t.words, bit, scanned)
        t.events -= wp.where(scanned, REST, 0)
        sure = both(sure, either(not scanned, bit >= t.bit))
    t.steps = wp.where(sure, t.steps, UNSURE)
    return t
