"""Scanning and walking a closed surface in float32, with bounds of the errors: what is not sure is left to float64.

A scan notes the steps of the scan path that cross the plane as bits of a few words. A walk clears the bits of the
crossings that it passes, and the next loop begins at the lowest bit that is still set. On larger surfaces neighbouring
steps share a bit. So a walk may clear the bit of a crossing that it does not pass. Then the loops pass fewer crossings
than the scan counted, or one of them passes a lower bit than that of its first crossing. Such a section is left to
float64.

All numbers of walks are of a patch's frame. A coordinate of a vertex is wrong by at most e = `Coarse.unsure`,
which includes the shift of flush vertices. A crossing of an edge from u above the plane to l below lies at t / d with
t = l h(u) - u h(l) and d = h(u) - h(l). It is a mean of u and l, whose weights are wrong by at most 2 e / d if both
heights exceed 2 e. So t / d is wrong by at most e + 2 e |u - l| / d, and by 2.4 e with the rounding of t.

Corner C of the patch is to the left of a segment P -> Q if (P - C) x (Q - C) is not negative. If P and Q are wrong by
at most p and q along each axis, this product is wrong by at most p |Q - C| + q |P - C| + 2 p q, where |.| sums absolute
coordinates. Only corners between P and Q matter. So C is not farther away than the farthest vertex, where half a
spacing of float32 is e / 8 at most. `Float32Crossing.room` / d exceeds the error of P by 2.6 e, which contains the
rounding of P - C, and it exceeds 6 e, so that a quarter more of the bound contains the rounding of the product.
"""

from typing import Any

import warp as wp

from ..offsets import BLOCK
from ..patch import Frame, coarse_frame
from .clip import BEGIN, CLEAR, CORNERS, END, FROM, HALF, Events, is_quiet, needs_left, write_event
from .half_edges import OPEN, SCAN_WORDS, Surface
from .lanes import in_step
from .pieces import end_list, list_half
from .walk import half_after, load_vec4, vertex_of

ALL = wp.constant(wp.uint32(0xFFFFFFFF))
NONE_SET = wp.constant(wp.uint32(0))


@wp.struct
class Scans:
    """Scans of queries, and those whose planes cross the surface. Word k of query q has index q * stride + k * step."""

    word: wp.array[wp.uint32]
    stride: wp.int64
    step: wp.int64
    listed: wp.array[wp.vec2i]  # queries that have crossings, and how many, in any order, shape [query]
    count: wp.array[wp.int32]  # number of these queries, zero-initialised, shape [1]
    claimed: wp.array[wp.int32]  # how many of them lanes of a GPU have claimed, zero-initialised, shape [1]


@wp.struct
class Float32Scan:
    """Result of a scan."""

    count: int  # crossings
    least: float  # smallest distance of a vertex from the plane [m]


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return fmaf(a[0], b[0], fmaf(a[1], b[1], fmaf(a[2], b[2], c)));
#else
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + c;
#endif
""")
def float32_sum(a: wp.vec3, b: wp.vec3, c: float) -> float:
    """About the scalar product of a and b, plus c."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    asm volatile("" : "+f"(x));
#endif
    return x;
""")
def held(x: float) -> float:
    """The same number, which a GPU keeps, and does not convert from float64 again wherever it is used."""


@wp.func
def held_vec3(x: wp.vec3):
    """The same vector, as `held`."""
    return wp.vec3(held(x[0]), held(x[1]), held(x[2]))


@wp.func_native("""
    return (reinterpret_cast<const unsigned&>(a) ^ reinterpret_cast<const unsigned&>(b)) >> 31;
""")
def signs_differ(a: float, b: float) -> wp.uint32:
    """1 if one of two numbers is negative (-0 is), else 0."""


@wp.func_native("""
    const unsigned bit = reinterpret_cast<const unsigned&>(x.c[3]);
    const int apart = reinterpret_cast<const int&>(a) ^ reinterpret_cast<const int&>(b);
#ifdef __CUDA_ARCH__
    return apart < 0 ? bit : 0u;
#else
    return bit & static_cast<unsigned>(apart >> 31);  // no branch, which a CPU would often mispredict
#endif
""")
def bit_of_crossing(a: float, b: float, x: wp.vec4) -> wp.uint32:
    """The last number's bits if one of a and b is negative (-0 is) and the other is not, else 0."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __ffs(x) - 1;
#else
    return x ? __builtin_ctz(x) : -1;
#endif
""")
def lowest_bit(x: wp.uint32) -> int:
    """Number of the lowest bit that is set, -1 for none."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __funnelshift_l(0u, 1u, bit);  // masks the shift
#else
    return 1u << (bit & 31);
#endif
""")
def bit_in_word(bit: int) -> wp.uint32:
    """A number with one bit set, by its number from bit 0 of word 0 on."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    __shared__ unsigned int near[{SCAN_WORDS}][{BLOCK}];
    unsigned address = static_cast<unsigned>(__cvta_generic_to_shared(&near[0][threadIdx.x]));
    asm volatile("" : "+r"(address));  // computed once, not wherever it is used
    return address;
#else
    return reinterpret_cast<wp::uint64>(far.data + first);
#endif
""")
def address_of_words(far: wp.array[wp.uint32], first: wp.int64) -> wp.uint64:
    """Address of the words of the query that a lane walks.

    A GPU keeps such words near its lanes; a CPU changes those of `Scans`, where the query's first has index `first`.
    """


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    asm volatile("st.shared.u32 [%0], %1;" ::"r"(static_cast<unsigned>(address) + {4 * BLOCK} * k), "r"(x) : "memory");
#else
    reinterpret_cast<unsigned*>(address)[k] = x;
#endif
""")
def set_word(address: wp.uint64, k: int, x: wp.uint32):
    """Set word k of those of `address_of_words`."""


@wp.func_native(f"""
    unsigned x;
#ifdef __CUDA_ARCH__
    const unsigned at = static_cast<unsigned>(address) + {4 * BLOCK} * k;
    asm volatile("ld.shared.u32 %0, [%1];" : "=r"(x) : "r"(at) : "memory");
#else
    x = reinterpret_cast<unsigned*>(address)[k];
#endif
    return x;
""")
def get_word(address: wp.uint64, k: int) -> wp.uint32:
    """Word k of those of `address_of_words`."""


@wp.func
def fetch_words(surface: Surface, scans: Scans, query: int):
    """Fetch the words of a query to walk it; returns their address."""
    first = wp.int64(query) * scans.stride
    address = address_of_words(scans.word, first)
    for k in range(surface.scan_words):
        set_word(address, k, scans.word[first + wp.int64(k) * scans.step])
    return address


@wp.func
def lowest_left(surface: Surface, address: wp.uint64):
    """The lowest bit that is set in the words of a query; OPEN for none."""
    out = int(OPEN)
    k = int(0)
    while out == OPEN and k < surface.scan_words:
        low = lowest_bit(get_word(address, k))
        if low >= 0:
            out = 32 * k + low
        k += 1
    return out


@wp.func
def scan_height(n: wp.vec3, distance: float, x: wp.vec4):
    """Height of a vertex above the plane [m]."""
    return float32_sum(n, vertex_of(x), -distance)


@wp.func
def scan_in_float32(surface: Surface, n: wp.vec3, distance: float, scans: Scans, query: int):
    """Note and count the crossings of the scan path with a plane."""
    height = scan_height(n, distance, load_vec4(surface.scan_path, 0))
    least = wp.abs(height)
    count = int(0)
    size = 32 * surface.scan_group
    for k in range(surface.scan_words):
        word = wp.uint32(0)
        for i in range(k * size + 1, wp.min((k + 1) * size + 1, surface.scan_path.shape[0])):
            x = load_vec4(surface.scan_path, i)
            now = scan_height(n, distance, x)
            least = wp.min(least, wp.abs(now))
            bit = bit_of_crossing(now, height, x)
            word |= bit
            count += wp.where(bit != NONE_SET, 1, 0)
            height = now
        scans.word[wp.int64(query) * scans.stride + wp.int64(k) * scans.step] = word
    found = Float32Scan()
    found.count = count
    found.least = least
    return found


@wp.func
def half_at(surface: Surface, n: wp.vec3, distance: float, bit: int):
    """Half-edge of the first crossing among the steps of a bit, if `scan_in_float32` was sure; OPEN for none."""
    half = int(OPEN)
    i = bit * surface.scan_group
    stop = wp.min(i + surface.scan_group + 1, surface.scan_path.shape[0])
    height = scan_height(n, distance, load_vec4(surface.scan_path, i))
    i += 1
    while half == OPEN and i < stop:
        x = load_vec4(surface.scan_path, i)
        now = scan_height(n, distance, x)
        if signs_differ(now, height) != NONE_SET:
            half = surface.scan_path_half[i][wp.where(height > 0.0, 0, 1)]
        height = now
        i += 1
    return half


@wp.func_native("""
    const unsigned k = static_cast<unsigned>(rank);
    return (mask.data[k >> 5] >> (k & 31u)) & 1u;
""")
def is_marked(mask: wp.array[wp.uint32], rank: int) -> wp.bool:
    """Whether the scanned edge of that rank is marked as passed."""


@wp.func_native("""
    const unsigned k = static_cast<unsigned>(rank);
    mask.data[k >> 5] |= 1u << (k & 31u);
""")
def mark(mask: wp.array[wp.uint32], rank: int):
    """Mark the scanned edge of that rank as passed."""


def room_for_scans(surface: Any, query_count: int, counters: Any, device: Any) -> Any:
    """Memory for scans of queries; counters: two of int32, zero-initialised, shape [2]."""
    scans = Scans()
    words = surface.scan_words
    scans.stride, scans.step = (words, 1) if device.is_cpu else (1, query_count)
    scans.word = wp.empty(query_count * words, dtype=wp.uint32, device=device)
    scans.listed = wp.empty(query_count, dtype=wp.vec2i, device=device)
    scans.count, scans.claimed = counters[:1], counters[1:2]
    return scans


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
        # The bit of a crossing that the walk passes is cleared; other lanes write what was there, without a branch.
        passed = wp.where(scanned, bit_in_word(bit), NONE_SET)
        set_word(t.words, bit >> 5, get_word(t.words, bit >> 5) & (ALL ^ passed))
        t.events -= wp.where(scanned, REST, 0)
        sure = both(sure, either(not scanned, bit >= t.bit))
    t.steps = wp.where(sure, t.steps, UNSURE)
    return t
