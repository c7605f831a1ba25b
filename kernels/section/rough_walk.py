"""Walking loops of a closed surface in float32, with bounds of the errors: what is not sure is left to float64.

All numbers of this module are of a patch's frame. A coordinate of a vertex is wrong by at most e = `Coarse.unsure`,
which includes the shift of flush vertices. A crossing of an edge from u above the plane to l below lies at t / d with
t = l h(u) - u h(l) and d = h(u) - h(l). It is a mean of u and l, whose weights are wrong by at most 2 e / d if both
heights exceed 2 e. So t / d is wrong by at most e + 2 e |u - l| / d, and by 2.4 e with the rounding of t.
"""

import warp as wp

from ..patch import BOTTOM, LEFT, RIGHT, TOP, Coarse
from .clip_events import BEGIN, CLEAR, END, FROM, HALF, Events, is_quiet, write_event
from .edge_pairing import OPEN
from .half_edges import Surface
from .step_lists import PLACE, end_list, list_address, list_half
from .triangle_walk import half_after, half_before, link_of, load_vec4, vertex_of


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return fmaf(a[0], b[0], fmaf(a[1], b[1], fmaf(a[2], b[2], c)));
#else
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + c;
#endif
""")
def rough_sum(a: wp.vec3, b: wp.vec3, c: float) -> float:
    """About the scalar product of a and b, plus c."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return fmaf(a, b, -(c * d));
#else
    return a * b - c * d;
#endif
""")
def rough_difference(a: float, b: float, c: float, d: float) -> float:
    """About a b - c d."""


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)];
""")
def load_int(a: wp.array[wp.int32], i: int) -> int:
    """Entry i of an array."""


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


@wp.func
def held_frame(g: Coarse):
    """The same frame, as `held`."""
    out = Coarse()
    out.origin = held_vec3(g.origin)
    out.u = held_vec3(g.u)
    out.v = held_vec3(g.v)
    out.n = held_vec3(g.n)
    out.distance = held(g.distance)
    out.half = wp.vec2(held(g.half[0]), held(g.half[1]))
    out.unsure = held(g.unsure)
    return out


@wp.struct
class RoughScan:
    """Crossings of scanned edges along the scan path, and the first of them."""

    count: int
    step: int  # of the first one
    above: wp.bool  # whether that step starts above the plane
    least: float  # smallest distance of a vertex from the plane [m]


@wp.struct
class ScanPlace:
    """A place on the scan path."""

    step: int
    above: wp.bool  # whether it ends above the plane
    half: int  # half-edge of its crossing if no mark is set for it, else OPEN


@wp.struct
class RoughCrossing:
    """A crossing's point (x / d, y / d), where it may be instead, and its outcode."""

    x: float  # [m^2]
    y: float
    d: float  # [m]
    room: float  # d times the bound of the error of x / d and y / d [m^2]
    code: int
    sure: wp.bool  # whether the code is right, and the crossing is CLEAR


@wp.struct
class RoughWalk:
    """Result of a walk around one loop."""

    events: int  # number of events
    scanned: int  # scanned crossings passed
    listed: int  # steps of the row that are listed so far, and of the loops before
    sure: wp.bool  # whether all of it is right; else it ended too early


@wp.func
def rough_position(g: Coarse, x: wp.vec3):
    """Coordinates of a vertex along u, v and n [m]."""
    y = x - g.origin
    return wp.vec3(rough_sum(g.u, y, 0.0), rough_sum(g.v, y, 0.0), rough_sum(g.n, y, 0.0))


@wp.func
def scan_height(g: Coarse, x: wp.vec4):
    """Height of a vertex above the plane [m]."""
    return rough_sum(g.n, vertex_of(x), -g.distance)


@wp.func
def scan_roughly(surface: Surface, g: Coarse):
    """Count the scanned crossings of a closed surface."""
    found = RoughScan()
    height = scan_height(g, load_vec4(surface.scan_path, 0))
    above = height > 0.0
    found.least = wp.abs(height)
    for i in range(1, surface.scan_path.shape[0]):
        x = load_vec4(surface.scan_path, i)
        height = scan_height(g, x)
        found.least = wp.min(found.least, wp.abs(height))
        if (height > 0.0) != above and link_of(x) != OPEN:
            if found.count == 0:
                found.step = i
                found.above = above
            found.count += 1
        above = height > 0.0
    return found


@wp.func
def half_of_step(surface: Surface, step: int, above: wp.bool):
    """Half-edge of a step's crossing, if the step starts above the plane or below."""
    return surface.scan_path_half[step][wp.where(above, 0, 1)]


@wp.func
def next_unmarked(surface: Surface, g: Coarse, mask: wp.array[wp.uint32], place: ScanPlace):
    """The next step after a place whose crossing is not marked, if `scan_roughly` was sure."""
    out = place
    out.half = OPEN
    while out.half == OPEN and out.step + 1 < surface.scan_path.shape[0]:
        out.step += 1
        x = load_vec4(surface.scan_path, out.step)
        above = scan_height(g, x) > 0.0
        if above != out.above and link_of(x) != OPEN:
            if not is_marked(mask, link_of(x)):
                out.half = half_of_step(surface, out.step, out.above)
        out.above = above
    return out


@wp.func
def rough_crossing(g: Coarse, upper: wp.vec3, lower: wp.vec3, at_sides: float):
    """The crossing of an edge; at_sides: bound of the error of a side's distance, and what makes a crossing CLEAR."""
    c = RoughCrossing()
    c.d = upper[2] - lower[2]
    c.x = rough_difference(lower[0], upper[2], upper[0], lower[2])
    c.y = rough_difference(lower[1], upper[2], upper[1], lower[2])
    wide = wp.abs(upper[0] - lower[0]) + wp.abs(upper[1] - lower[1])
    c.room = g.unsure * (4.0 * c.d + 2.0 * wide)
    right = wp.abs(c.x) - g.half[0] * c.d
    top = wp.abs(c.y) - g.half[1] * c.d
    c.code = wp.where(right > 0.0, wp.where(c.x > 0.0, RIGHT, LEFT), 0)
    c.code += wp.where(top > 0.0, wp.where(c.y > 0.0, TOP, BOTTOM), 0)
    c.sure = wp.min(wp.abs(right), wp.abs(top)) > c.room + at_sides * c.d
    return c


@wp.func
def surely_move(g: Coarse, p: RoughCrossing, q: RoughCrossing):
    """Whether the float32 output points of two crossings differ for sure: each may be moved onto a side."""
    room = 3.0 * g.unsure * p.d * q.d + p.room * q.d + q.room * p.d
    x = wp.abs(rough_difference(p.x, q.d, q.x, p.d))
    y = wp.abs(rough_difference(p.y, q.d, q.y, p.d))
    return wp.max(x, y) > room


@wp.func
def walk_roughly(surface: Surface, g: Coarse, half: int, events: Events, row: int, start: int, listed: int):
    """Walk from a crossing around its loop; writes events from number `start` on, as `walk_loop` does.

    listed: with which number of the row's list the steps' half-edges begin.
    """
    out = RoughWalk()
    at_sides = 2.0 * g.unsure + 2.0e-7 * wp.max(g.half[0], g.half[1])
    upper = rough_position(g, vertex_of(load_vec4(surface.corner, half)))
    lower = rough_position(g, vertex_of(load_vec4(surface.corner, half_after(half))))
    p = rough_crossing(g, upper, lower, at_sides)
    out.sure = p.sure and wp.min(upper[2], -lower[2]) > 2.0 * g.unsure
    write_event(events, row, start, (half << HALF) | BEGIN | (p.code << FROM) | p.code, 0)
    out.events = 1
    now = half
    steps = int(0)
    word = wp.uint64(0)
    k = int(listed)
    most = events.lists.words << PLACE
    address = list_address(events.lists.word, events.lists.words, row)
    last = int(0)
    while last == 0 and out.sure:
        third = load_vec4(surface.corner, half_before(now))
        down = link_of(load_vec4(surface.corner, half_after(now)))  # where the loop goes on if the third is above
        x = rough_position(g, vertex_of(third))
        up = x[2] > 0.0
        upper = wp.where(up, x, upper)
        lower = wp.where(up, lower, x)
        link = wp.where(up, down, link_of(third))
        q = rough_crossing(g, upper, lower, at_sides)
        out.sure = q.sure and wp.abs(x[2]) > 2.0 * g.unsure
        out.scanned += link & 1
        last = wp.where(link >> 1 == half, END, 0)
        if (p.code | q.code) == 0:
            steps += 1
            word = list_half(address, most, k, word, now)
            k += 1
            out.sure = out.sure and surely_move(g, p, q)
        if last != 0 or not is_quiet(p.code, q.code):
            write_event(
                events, row, start + out.events, (now << HALF) | last | CLEAR | (p.code << FROM) | q.code, steps
            )
            out.events += 1
            steps = 0
        now = link >> 1
        p = q
    out.listed = end_list(address, most, k, word)
    return out


@wp.func
def mark_roughly(surface: Surface, g: Coarse, half: int, mask: wp.array[wp.uint32]):
    """Mark the scanned crossings of a loop for which `walk_roughly` was sure."""
    now = half
    done = int(0)
    while done == 0:
        third = load_vec4(surface.corner, half_before(now))
        down = link_of(load_vec4(surface.corner, half_after(now)))
        link = wp.where(rough_sum(g.n, vertex_of(third) - g.origin, 0.0) > 0.0, down, link_of(third))
        now = link >> 1
        if (link & 1) != 0:
            mark(mask, load_int(surface.rank, now))
        if now == half:
            done = 1
