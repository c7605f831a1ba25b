"""Events of a contour (the segments that clipping must test), and the pieces found from them."""

from typing import Any

import warp as wp

from ..patch import EXACT, Patch, section_frame
from .edge_pairing import OPEN
from .half_edges import Surface
from .pieces import CLOSED, NO_WRAP, UNLISTED, ContourPieces, count_row, list_location, section_of, store_listed
from .segment_clipping import NONE, Segment, needs_left, segment_of
from .step_lists import PLACE, StepLists, no_steps
from .triangle_walk import corners_left_from, link_of, load_vec4

wp.set_module_options(EXACT)

# An event is a segment that clipping must test, as two numbers: `what`, and the number of steps of non-zero length
# inside the patch since the event before. `what` is the half-edge of the segment's first crossing << HALF | these bits:
TO = wp.constant(15)  # outcode where the segment ends
FROM = wp.constant(4)  # bits above it: outcode where it starts
BEGIN = wp.constant(256)  # a loop begins here; both outcodes are of its first crossing
END = wp.constant(512)  # the loop is back at its first crossing
STOP = wp.constant(1024)  # the contour ends at an open edge
CLEAR = wp.constant(2048)  # in float32 neither of its crossings lies on the line of a patch side
HALF = wp.constant(12)


@wp.struct
class Events:
    """Events of each row's section, loop by loop; event k of row r has index r * room + k."""

    room: wp.int32  # most events of a row
    event: wp.array[wp.vec2i]
    count: wp.array[wp.int32]  # events of each row, also those beyond its room
    lists: StepLists
    listed: wp.array[wp.int32]  # length of each row's list, also what is beyond its room, in whole words


@wp.func
def write_event(events: Events, row: int, k: int, what: int, steps: int):
    """Write event k of a row, if there is room."""
    if k < events.room:
        events.event[wp.int64(row) * wp.int64(events.room) + wp.int64(k)] = wp.vec2i(what, steps)


@wp.func_native("""
    return reinterpret_cast<wp::uint64>(events.event.data + static_cast<wp::int64>(row) * events.room);
""")
def address_of_events(events: Events, row: int) -> wp.uint64:
    """Address of the first event of a row."""


@wp.func_native("""
    if (k < events.room) {
#ifdef __CUDA_ARCH__
        const wp::uint64 at = address + 8ull * static_cast<unsigned>(k);
        asm volatile("st.global.v2.s32 [%0], {%1, %2};" ::"l"(at), "r"(what), "r"(steps) : "memory");
#else
        reinterpret_cast<wp::vec2i*>(address)[k] = wp::vec2i(what, steps);
#endif
    }
""")
def add_event(events: Events, address: wp.uint64, k: int, what: int, steps: int):
    """`write_event` for a row whose events begin at an address."""


@wp.func_native("""
    const unsigned apart = code_p ^ code_q;
    return (apart == 0) | ((code_p & code_q & ((apart & 1u) - 1u)) != 0);  // bit 0: BOTTOM
""")
def is_quiet(code_p: int, code_q: int) -> wp.bool:
    """Whether a segment stays inside, or outside without winding around the patch."""


@wp.struct
class EventTour:
    """State of reading one loop's events, and the piece that is being read."""

    begin: int  # event with which the loop begins
    first: int  # half-edge with which it begins
    half: int  # the piece: of the crossing before it enters, or where the tour starts
    enter: int
    steps: int
    inside: int  # 1 while on a piece
    partial: int  # 1 while on a piece that the tour started in the middle of: it is read at the end
    whole: int  # 1 if the loop has not left the patch so far
    again: int  # 1 once the tour has come back to where it started
    done: int  # 1 between loops
    pieces: int
    winding: int
    clear: int  # 1 if the end where the piece entered is clear
    word: int  # with which the list of the loop's steps begins; UNLISTED if the row's list has no room
    passed: int  # steps of the loop so far
    first_step: int  # of the piece, in the loop's list


@wp.func
def begin_tour(surface: Surface, k: int, what: int, old: EventTour):
    """Start reading the loop that begins with event k."""
    t = EventTour()
    t.pieces = old.pieces
    t.winding = old.winding
    t.word = wp.where(old.word == UNLISTED, UNLISTED, old.word + ((old.passed + 3) >> PLACE))
    t.begin = k
    t.first = what >> HALF
    t.half = t.first
    t.enter = NONE
    if (what & TO) == 0:
        t.inside = 1
        t.clear = 1
        if link_of(load_vec4(surface.corner, t.half)) != OPEN:  # else a chain: its first piece is one
            t.whole = 1
            t.partial = 1
    return t


@wp.func
def advance(tour: EventTour, what: int, steps: int, segment: Segment, clear: int, pieces: ContourPieces, row: int):
    """Read one event; clear: 1 if the segment meets no side near a corner or a crossing."""
    t = tour
    at = what >> HALF
    t.steps += steps
    if t.again == 0:
        t.passed += steps
        t.winding += segment.winding
        if segment.enter != NONE:
            t.half = at
            t.enter = segment.enter
            t.clear = clear
            t.first_step = t.passed
            t.steps = 0
            t.inside = 1
            t.partial = 0
    if (what & TO) != 0:
        t.whole = 0
    if t.inside == 1 and (segment.leave != NONE or (what & STOP) != 0):
        if t.partial == 0:
            location = list_location(t.word, t.first_step, wp.where(t.again == 1, t.passed, NO_WRAP))
            clear = t.clear & clear
            store_listed(pieces, row, t.pieces, t.half, at, t.enter, segment.leave, t.steps, t.half, clear, location)
            t.pieces += 1
        t.inside = 0
    if (what & (END | STOP)) != 0:
        t.again = 1
    t.done = wp.where(t.again == 1 and (t.whole == 1 or t.inside == 0 or (what & STOP) != 0), 1, 0)
    return t


@wp.kernel
def _clip_loops(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    events: Events,
    # Out:
    pieces: ContourPieces,
):
    """Find the pieces of each row's section in its events."""
    row = wp.tid()
    section = section_of(pieces, row)
    own = patch[section % patch.shape[0]]
    count = events.count[row]
    tour = EventTour()
    tour.pieces = wp.where(count > events.room, count, 0)  # no more pieces than events
    tour.word = wp.where(events.listed[row] <= events.lists.words << PLACE, 0, UNLISTED)
    count = wp.where(count > events.room, 0, count)
    k = int(0)
    after = int(0)  # the event behind the loop
    while k < count:
        event = events.event[wp.int64(row) * wp.int64(events.room) + wp.int64(k)]
        what = event[0]
        k += 1
        if (what & BEGIN) != 0:
            tour = begin_tour(surface, k, what, tour)
        else:
            left = int(0)
            clear = wp.where((what & CLEAR) != 0, 1, 0)
            if needs_left((what >> FROM) & TO, what & TO):
                f = section_frame(pose, patch, section)
                left = corners_left_from(surface, f, what >> HALF, own.half)
                clear = 0
            tour = advance(tour, what, event[1], segment_of((what >> FROM) & TO, what & TO, left), clear, pieces, row)
            if tour.done == 1 and tour.whole == 1:
                half = tour.first
                location = list_location(tour.word, 0, NO_WRAP)
                rank = surface.rank[half]
                store_listed(pieces, row, tour.pieces, half, half, NONE, NONE, tour.steps, CLOSED + rank, 1, location)
                tour.pieces += 1
            if (what & (END | STOP)) != 0:
                after = k
                if tour.done == 0:
                    k = tour.begin
            elif tour.done == 1:
                k = after
    count_row(pieces, row, tour.pieces, tour.winding)


def room_for_events(row_count: int, room: int, device: Any, lists: Any = None) -> Any:
    """Allocate `room` events per row. lists: takes the steps between events, if any."""
    events = Events()
    events.room = room
    events.event = wp.empty(row_count * room, dtype=wp.vec2i, device=device)
    events.count = wp.empty(row_count, dtype=wp.int32, device=device)
    events.lists = lists or no_steps(device)
    events.listed = wp.empty(row_count, dtype=wp.int32, device=device)
    return events
