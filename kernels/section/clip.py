"""Clipping: where a contour's segment enters and leaves a patch, how it winds around the patch's corner 0, and the
pieces found from events, which are the segments that clipping must test.
"""

from functools import cache
from typing import Any

import warp as wp

from ..offsets import BLOCK
from ..patch import BOTTOM, EXACT, LEFT, corner
from .pieces import (
    CLOSED,
    LEAVE,
    NO_WRAP,
    PLACE,
    SIDE,
    UNLISTED,
    ContourPieces,
    StepLists,
    list_location,
    store_count,
    store_listed,
)

wp.set_module_options(EXACT)

NONE = wp.constant(-1)
HIGHEST = wp.constant(wp.uint32(0xFFFFAA50))  # bits 2 n: number of the highest bit of n, for n in 0..15


@wp.func
def blend(p: wp.vec2d, q: wp.vec2d, a: wp.float64, b: wp.float64):
    """Point between p and q where what runs from a to b is 0, from the nearer end: exact at both ends."""
    near = wp.abs(a) <= wp.abs(b)
    from_near = wp.where(near, p, q)
    to_far = wp.where(near, q, p) - from_near
    return from_near + (wp.where(near, a, -b) / (a - b)) * to_far


@wp.func
def left_of(p: wp.vec2d, q: wp.vec2d, c: wp.vec2d):
    """Whether corner c lies to the left of p -> q or on it.

    Monotone in each coordinate of c however it rounds, so the answers at a patch's four corners always fit one line.
    """
    return (q[0] - p[0]) * (c[1] - p[1]) - (q[1] - p[1]) * (c[0] - p[0]) >= wp.float64(0.0)


@wp.func
def corners_left(p: wp.vec2d, q: wp.vec2d, half: wp.vec2d):
    """Bit k is set where corner k of the patch lies to the left of p -> q or on it."""
    left = int(0)
    for k in range(4):
        if left_of(p, q, corner(k, half)):
            left = left | (1 << k)
    return left


@wp.func
def bits_after(code: int):
    """Bit k is set where that of side k + 1 is set in a word of sides."""
    return (code >> 1) | ((code & 1) << 3)


@wp.func
def bits_before(code: int):
    """Bit k is set where that of side k - 1 is set in a word of sides."""
    return ((code << 1) & 15) | (code >> 3)


@wp.func
def crossed_sides(code_p: int, code_q: int, left: int):
    """Bits of the sides of the patch that p -> q crosses, if no side has both of its ends beyond itself.

    A segment that passes a corner asks once for both sides whether that is to its left, so it crosses exactly one of
    them, or cuts the corner off by crossing both, or misses both:

        corner between p and q (both sides' bits differ)   side ending in it      side starting in it
        outward                                            crossed if left        crossed if not left
        inward                                             crossed if not left    crossed if left
    """
    apart = code_p ^ code_q
    outward = apart & code_q
    after = bits_after(apart)  # bit k: the corner in which side k ends lies between p and q, if side k does
    before = bits_before(apart)
    ends = (after & ~(bits_after(left) ^ outward)) | ~(after | bits_after(code_p))
    starts = (before & (left ^ outward)) | ~(before | bits_before(code_p))
    return apart & ends & starts


@wp.func
def highest_side(sides: int):
    """The highest side whose bit is set, NONE for none."""
    return wp.where(sides == 0, NONE, int((HIGHEST >> wp.uint32(2 * sides)) & wp.uint32(3)))


@wp.func
def winding_step(code_p: int, code_q: int, left: int):
    """Contribution of a segment to the winding number around corner 0, by a ray along side 0's line, off the patch.

        crosses that line   beyond the corner   adds
        downward            yes                 +1
        upward              yes                 -1
        anything else                            0

    Beyond is decided as `crossed_sides` decides it, so the state at the corner fits the crossings of both its sides.
    """
    if (code_p & BOTTOM) == (code_q & BOTTOM):
        return 0
    downward = (code_q & BOTTOM) != 0
    beyond = (code_p & LEFT) != 0
    if (code_p & LEFT) != (code_q & LEFT):
        beyond = (left & 1 != 0) == downward
    if not beyond:
        return 0
    if downward:
        return 1
    return -1


@wp.struct
class Segment:
    """Result of clipping a contour's segment p -> q at the patch."""

    enter: int  # sides by which it enters and leaves, NONE for none
    leave: int
    winding: int  # what it adds to the winding number around corner 0


@wp.func
def needs_left(code_p: int, code_q: int):
    """Whether what p -> q does depends on the corners to its left: two sides that meet lie between p and q."""
    apart = code_p ^ code_q
    if (code_p & code_q) != 0:
        return (apart & BOTTOM) != 0 and (apart & LEFT) != 0
    return (apart & ((apart << 1) | (apart >> 3))) != 0


@wp.func
def segment_of(code_p: int, code_q: int, left: int):
    """Clip p -> q by its ends' outcodes and, if `needs_left`, by the corners to its left."""
    segment = Segment()
    segment.enter = NONE
    segment.leave = NONE
    if (code_p & code_q) == 0:
        crossed = crossed_sides(code_p, code_q, left)
        segment.leave = highest_side(crossed & code_q)
        segment.enter = highest_side(crossed & code_p)
    segment.winding = winding_step(code_p, code_q, left)
    return segment


@wp.func
def side_point(k: int, p: wp.vec2d, q: wp.vec2d, half: wp.vec2d):
    """Point where p -> q crosses side k, clamped to its corners [m]: that of `blend`, alike for all sides."""
    upright = (k & 1) != 0
    at = wp.where(upright, half[0], half[1])
    most = wp.where(upright, half[1], half[0])
    if k == 0 or k == 3:
        at = -at
    a = wp.where(upright, p[0], p[1]) - at
    b = wp.where(upright, q[0], q[1]) - at
    x = wp.where(upright, p[1], p[0])
    y = wp.where(upright, q[1], q[0])
    near = wp.abs(a) <= wp.abs(b)
    from_near = wp.where(near, x, y)
    to_far = wp.where(near, y, x) - from_near
    along = wp.clamp(from_near + (wp.where(near, a, -b) / (a - b)) * to_far, -most, most)
    return wp.vec2d(wp.where(upright, at, along), wp.where(upright, along, at))


@wp.func
def side_position(k: int, p: wp.vec2d):
    """Position of a point along side k, counter-clockwise [m]."""
    if k == 0:
        return p[0]
    if k == 1:
        return p[1]
    if k == 2:
        return -p[0]
    return -p[1]


# An event is a segment that clipping must test, as two numbers: `what`, and the number of steps of non-zero length
# inside the patch since the event before. `what` is the half-edge of the segment's first crossing << HALF | these bits:
TO = wp.constant(15)  # outcode where the segment ends
FROM = wp.constant(4)  # bits above it: outcode where it starts
CORNERS = wp.constant(8)  # bits above: the patch's corners to its left (`corners_left`), 0 unless it `needs_left`
CLIP = wp.constant((1 << 12) - 1)  # all these bits, which decide how the patch clips the segment
# A loop begins here, or a chain if STOP is set, too; both outcodes are of its first crossing:
BEGIN = wp.constant(1 << 12)
END = wp.constant(1 << 13)  # the loop is back at its first crossing
STOP = wp.constant(1 << 14)  # the contour ends at an open edge
CLEAR = wp.constant(1 << 15)  # in float32 the segment meets no side near a corner or a crossing
HALF = wp.constant(16)
EVENTS_MOST = 2**32  # of all queries: kernels count them in 32 bits
WINDING = wp.constant(6)  # in `Events.clip`: bits below are those of `ContourPieces.side`, bits above 1 + the winding


@wp.struct
class Events:
    """Events of each query's section, loop by loop; event k of query q has index q * room + k."""

    room: wp.int32  # most events of a query
    event: wp.array[wp.vec2i]
    count: wp.array[wp.int32]  # events of each query, also those beyond its room
    lists: StepLists
    listed: wp.array[wp.int32]  # length of each query's list, also what is beyond its room, in whole words
    clip: wp.array[wp.uint8]  # how the patch clips a segment (`segment_of`), by the bits CLIP of its event


@wp.func_native("""
    if (k < events.room) {
        const unsigned i = static_cast<unsigned>(query) * static_cast<unsigned>(events.room) + static_cast<unsigned>(k);
#ifdef __CUDA_ARCH__
        asm volatile("st.global.v2.s32 [%0], {%1, %2};" ::"l"(events.event.data + i), "r"(what), "r"(steps) : "memory");
#else
        events.event.data[i] = wp::vec2i(what, steps);
#endif
    }
""")
def write_event(events: Events, query: int, k: int, what: int, steps: int):
    """Write event k of a query, if there is room."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    const int4 r = __ldg(reinterpret_cast<const int4*>(event.data) + pair);
    return wp::vec_t<4, int>(r.x, r.y, r.z, r.w);
#else
    const wp::vec2i &a = event.data[2 * pair], &b = event.data[2 * pair + 1];
    return wp::vec_t<4, int>(a[0], a[1], b[0], b[1]);
#endif
""")
def load_pair(event: wp.array[wp.vec2i], pair: int) -> wp.vec4i:
    """Events 2 pair and 2 pair + 1 of all queries, read with one load on a GPU."""


@wp.func_native("""
    return clip.data[what & 0xfff];
""")
def load_clip(clip: wp.array[wp.uint8], what: int) -> int:
    """Entry of `Events.clip` for an event."""


@wp.func_native("""
    const unsigned apart = code_p ^ code_q;
    return (apart == 0) | ((code_p & code_q & ((apart & 1u) - 1u)) != 0);  // bit 0: BOTTOM
""")
def is_quiet(code_p: int, code_q: int) -> wp.bool:
    """Whether a segment stays inside, or outside without winding around the patch."""


@wp.struct
class EventTour:
    """State of reading a query's events, loop by loop, and the piece that is being read."""

    pieces: int  # of the query so far
    winding: int
    word: int  # with which the list of the loop's steps begins; UNLISTED if the query's list has no room
    passed: int  # steps of the loop so far
    inside: int  # 1 while on a piece
    partial: int  # 1 while on a piece in whose middle the loop begins, or on a closed loop
    half: int  # the piece: half-edge of the crossing before it enters, or with which the loop begins
    enter: int  # 1 + the side by which it enters, 0 for none
    first_step: int  # number of its first step in the loop's list
    clear: int  # CLEAR if its beginning is clear
    cut: int  # if the loop began in the middle of a piece: the event at which that leaves, or the first one, made CLEAR
    cut_steps: int  # steps of the loop up to there


@wp.func
def begin_tour(what: int, old: EventTour):
    """Start reading the loop that begins with an event."""
    t = EventTour()
    t.pieces = old.pieces
    t.winding = old.winding
    t.word = wp.where(old.word == UNLISTED, UNLISTED, old.word + ((old.passed + 3) >> PLACE))
    t.half = what >> HALF
    if (what & TO) == 0:
        t.inside = 1
        t.clear = CLEAR
        t.cut = what | CLEAR
        t.partial = wp.where((what & STOP) == 0, 1, 0)  # a chain's first piece begins with it
    return t


@wp.func
def end_piece(
    tour: EventTour, what: int, leave: int, rank: wp.array[wp.int32], events: Events, pieces: ContourPieces, query: int
):
    """End a piece where it leaves or its loop ends."""
    t = tour
    t.inside = 0
    if t.partial == 1 and (what & END) == 0:
        t.cut = what
        t.cut_steps = t.passed
        t.partial = 0
    else:
        last = int(what)
        length = int(NO_WRAP)
        steps = t.passed - t.first_step
        if (what & END) != 0 and leave == 0:  # goes on where the loop begins
            last = t.cut
            length = t.passed
            steps += t.cut_steps
        by = (load_clip(events.clip, last) >> LEAVE) & SIDE
        key = t.half
        if t.partial == 1:
            key = CLOSED + rank[t.half]
        location = list_location(t.word, t.first_step, length)
        clear = wp.where((t.clear & last & CLEAR) != 0, 1, 0)
        store_listed(pieces, query, t.pieces, t.half, last >> HALF, t.enter - 1, by - 1, steps, key, clear, location)
        t.pieces += 1
    return t


@wp.func
def read_event(
    tour: EventTour, what: int, steps: int, rank: wp.array[wp.int32], events: Events, pieces: ContourPieces, query: int
):
    """Read one event."""
    if (what & BEGIN) != 0:
        return begin_tour(what, tour)
    t = tour
    clip = load_clip(events.clip, what)
    t.passed += steps
    t.winding += (clip >> WINDING) - 1
    if (clip & SIDE) != 0:
        t.half = what >> HALF
        t.enter = clip & SIDE
        t.clear = what
        t.first_step = t.passed
        t.inside = 1
    leave = (clip >> LEAVE) & SIDE
    if t.inside == 1 and (leave != 0 or (what & (END | STOP)) != 0):
        t = end_piece(t, what, leave, rank, events, pieces, query)
    return t


@wp.kernel
def _clip_loops(
    rank: wp.array[wp.int32],  # `Surface.rank`
    events: Events,
    pieces: ContourPieces,
):
    """Find the pieces of each query's section in its events."""
    query = wp.tid()
    count = events.count[query]
    tour = EventTour()
    tour.pieces = count  # no more pieces than events
    if count <= events.room:
        tour.pieces = 0
        tour.word = wp.where(events.listed[query] <= events.lists.steps, 0, UNLISTED)
        k = int(0)
        first = query * (events.room / 2)
        pair = wp.vec4i()
        if count > 0:
            pair = load_pair(events.event, first)
        while k < count:
            after = pair
            if k + 2 < count:  # is read before it is needed
                after = load_pair(events.event, first + (k >> 1) + 1)
            tour = read_event(tour, pair[0], pair[1], rank, events, pieces, query)
            if k + 1 < count:
                tour = read_event(tour, pair[2], pair[3], rank, events, pieces, query)
            pair = after
            k += 2
    store_count(pieces, query, tour.pieces, tour.winding)


@wp.kernel
def _tabulate_clips(
    # In: nothing
    clip: wp.array[wp.uint8],  # shape [CLIP + 1]
):
    """Tabulate how a patch clips segments: see `Events.clip`."""
    k = wp.tid()
    s = segment_of((k >> FROM) & TO, k & TO, k >> CORNERS)
    clip[k] = wp.uint8((s.enter + 1) | ((s.leave + 1) << LEAVE) | ((s.winding + 1) << WINDING))


@cache
def clips_on(device: str) -> wp.array:
    """`Events.clip` on a device."""
    clip = wp.empty(int(CLIP) + 1, dtype=wp.uint8, device=device)
    wp.launch(_tabulate_clips, len(clip), outputs=[clip], device=device, block_dim=BLOCK)
    wp.synchronize_device(device)  # other streams read it, too
    return clip


def clip_events(surface: Any, events: Any, pieces: Any) -> None:
    """Find the pieces in Events of the same queries; more events than there is room for count as too few slots."""
    queries, device = events.count.shape[0], events.count.device
    wp.launch(_clip_loops, queries, inputs=[surface.rank, events], outputs=[pieces], device=device, block_dim=BLOCK)


def room_for_events(count: wp.array, room: int, lists: Any = None) -> Any:
    """Events with room for so many a query, or one more to have pairs.

    count: takes the number of each query's events; lists: takes the steps between them, if any.
    """
    events = Events()
    query_count, device = count.shape[0], count.device
    room += room % 2
    if query_count * room >= EVENTS_MOST:
        raise MemoryError(f"{query_count} queries of {room} events each exceed the limit of {EVENTS_MOST} events")
    events.room = room
    events.count = count
    events.event = wp.empty(query_count * room, dtype=wp.vec2i, device=device)
    if lists is not None:
        events.lists = lists
    events.listed = wp.empty(query_count, dtype=wp.int32, device=device)
    events.clip = clips_on(str(device))
    return events
