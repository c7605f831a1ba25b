"""Pieces -> polylines: as they are (OC), or closed along the patch's own boundary where that is in the solid (CC).

Pieces of a section are joined in three steps: where they enter and leave by the patch's sides; which piece follows
which along the boundary; loops in the order of their keys, and their numbers of points.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK, PointLimitError, lasts_of, offsets_of
from ..patch import EXACT, Frame, Patch, corner, outcode, output_point, section_frame
from .clip import NONE, side_point, side_position
from .half_edges import Surface
from .lanes import (
    int_at,
    lane_of_warp,
    long_at,
    memory_of_warp,
    owner_of,
    set_int,
    set_long,
    set_vec3d,
    sums_of_warp,
    sync_warp,
    threads_for,
    vec3d_at,
    warp_size,
)
from .pieces import (
    CLOSED,
    ContourPieces,
    CutPlanes,
    end_side,
    enter_side,
    is_listed,
    leave_side,
    room_of,
    section_of,
    start_of,
)
from .search import first_search
from .walk import crossing_after, crossing_at, point_of

wp.set_module_options(EXACT)

# CutPlanes of a warp's queries lie where all its lanes can read them: any lane computes points of any query.
PLANE_WORDS = 17  # of a query, 64 bits each: odd, so that lanes which read different queries seldom wait for each other


@wp.func_native(memory_of_warp(PLANE_WORDS))
def plane_memory(own: wp.array[wp.int64]) -> wp.uint64:
    """Address of the planes of the warp's queries; own: a CPU's memory."""


@wp.struct
class SectionPlane:
    """Frame, extents and place of a query, from which its points are computed."""

    f: Frame
    side: wp.vec2d  # half extents of the patch [m]
    start: wp.int64  # where the query begins, among points or slots


@wp.func
def keep_plane(memory: wp.uint64, lane: int, plane: SectionPlane):
    """Write the plane of a lane's query."""
    i = lane * PLANE_WORDS
    set_vec3d(memory, i, plane.f.origin)
    set_vec3d(memory, i + 3, plane.f.u)
    set_vec3d(memory, i + 6, plane.f.v)
    set_vec3d(memory, i + 9, plane.f.n)
    set_vec3d(memory, i + 12, wp.vec3d(plane.f.flush, plane.side[0], plane.side[1]))
    set_long(memory, i + 15, plane.start)
    set_long(memory, i + 16, wp.int64(plane.f.relative))


@wp.func
def start_at(memory: wp.uint64, lane: int):
    """Index at which a lane's query begins."""
    return long_at(memory, lane * PLANE_WORDS + 15)


@wp.func
def plane_of(memory: wp.uint64, lane: int):
    """The plane of a lane's query."""
    plane = SectionPlane()
    i = lane * PLANE_WORDS
    plane.f.origin = vec3d_at(memory, i)
    plane.f.u = vec3d_at(memory, i + 3)
    plane.f.v = vec3d_at(memory, i + 6)
    plane.f.n = vec3d_at(memory, i + 9)
    x = vec3d_at(memory, i + 12)
    plane.f.flush = x[0]
    plane.side = wp.vec2d(x[1], x[2])
    plane.start = start_at(memory, lane)
    plane.f.relative = int(long_at(memory, i + 16))
    return plane


BY_KEY = wp.constant(2)  # an order of pieces; 0 and 1: by where they enter, leave

# A link consists of the slot of the piece that the boundary leads to from where this one leaves, and these bits:
FOLLOWER = wp.constant((1 << 24) - 1)  # the slot's
PASSED = wp.constant(24)  # bits above: how many corners the boundary passes on the way
PASSES = wp.constant(15)
NO_CORNERS = wp.constant(15)  # instead of a number: contours are not closed, or the piece is a loop
LOST = wp.constant(28)  # bits above: steps of zero length at the piece's ends
DONE = wp.constant(1 << 30)  # the piece is in a loop that is entered or dropped


@wp.struct
class PieceEnds:
    """Ends of a query's open pieces, sorted along the boundary; scratch, by slot."""

    leaving: wp.array[wp.int32]  # piece, in the order of the places where pieces leave; in the end, by key
    entering: wp.array[wp.int32]  # piece, in the order of the places where pieces enter: `Entries.entry`, until entered
    link: wp.array[wp.int32]
    position: wp.array[wp.vec2d]  # how far along its side each piece enters and leaves [m]
    first: wp.array[wp.vec3]  # first and last point [m], array frame
    last: wp.array[wp.vec3]


@wp.struct
class PieceEnd:
    """Point at which a piece enters or leaves by a side, on a segment p -> q [m]."""

    p: wp.vec2d
    q: wp.vec2d
    at: wp.vec2d


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)];
""")
def slot_int(a: wp.array[wp.int32], i: int) -> int:
    """Entry of a slot, without a look at the index' sign."""


@wp.func_native("""
    a.data[static_cast<unsigned>(i)] = x;
""")
def set_slot_int(a: wp.array[wp.int32], i: int, x: int):
    """Write the entry of a slot."""


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)];
""")
def slot_point(a: wp.array[wp.vec3], i: int) -> wp.vec3:
    """Point of a slot."""


@wp.func_native("""
    a.data[static_cast<unsigned>(i)] = x;
""")
def set_slot_point(a: wp.array[wp.vec3], i: int, x: wp.vec3):
    """Write the point of a slot."""


@wp.func_native("""
    return a.data[static_cast<unsigned>(i)][end];
""")
def end_position(a: wp.array[wp.vec2d], i: int, end: int) -> wp.float64:
    """Position of an end of a slot's piece."""


@wp.func_native("""
    a.data[static_cast<unsigned>(i)][end] = x;
""")
def set_end_position(a: wp.array[wp.vec2d], i: int, end: int, x: wp.float64):
    """Write the position of an end of a slot's piece."""


@wp.func
def corners_after(link: int):
    """Corners that the boundary passes behind a piece; NO_CORNERS for no boundary."""
    return (link >> PASSED) & PASSES


@wp.func
def is_through(pieces: ContourPieces, i: int):
    """Whether an open piece enters and leaves with one segment."""
    side = slot_int(pieces.side, i)
    if enter_side(side) == NONE or leave_side(side) == NONE:
        return False
    return slot_int(pieces.half, i) == slot_int(pieces.out, i)


@wp.func
def is_clear(pieces: ContourPieces, i: int):
    """Whether no step at a piece's ends has zero length, for sure."""
    return (slot_int(pieces.steps, i) & 1) != 0


@wp.func
def piece_end(surface: Surface, f: Frame, half: wp.vec2d, pieces: ContourPieces, i: int, end: int):
    """The end of a piece where it enters (0) or leaves (1) by a side."""
    out = PieceEnd()
    crossing = slot_int(pieces.half, i)
    if end == 1:
        crossing = slot_int(pieces.out, i)
    c = crossing_at(surface, f, crossing)
    out.p = point_of(f, c, half)
    out.q = point_of(f, crossing_after(surface, f, c), half)
    out.at = side_point(end_side(slot_int(pieces.side, i), end), out.p, out.q, half)
    return out


@wp.func
def is_lost(placed: PieceEnd, f: Frame, half: wp.vec2d, side: int, end: int):
    """Whether the step at an end has zero length; side: `ContourPieces.side`.

    The step of a piece that passes through with one segment is that at the end where it leaves.
    """
    inner = placed.q
    if end == 1:
        inner = placed.p
    if outcode(inner, half) != 0:
        if end == 0:
            return False
        inner = side_point(enter_side(side), placed.p, placed.q, half)
    return output_point(f, placed.at) == output_point(f, inner)


@wp.func
def place_end(surface: Surface, f: Frame, half: wp.vec2d, pieces: ContourPieces, i: int, end: int, ends: PieceEnds):
    """Compute where an open piece enters (0) or leaves (1), and whether a step of zero length is lost there."""
    side = slot_int(pieces.side, i)
    if end_side(side, end) != NONE:
        placed = piece_end(surface, f, half, pieces, i, end)
        set_end_position(ends.position, i, end, side_position(end_side(side, end), placed.at))
        if end == 0:
            set_slot_point(ends.first, i, output_point(f, placed.at))
        else:
            set_slot_point(ends.last, i, output_point(f, placed.at))
        if not is_clear(pieces, i):
            if is_lost(placed, f, half, side, end):
                wp.atomic_add(ends.link, i, 1 << LOST)


@wp.func
def steps_most(pieces: ContourPieces, i: int):
    """Number of a piece's steps if none at the patch's sides has zero length."""
    steps = slot_int(pieces.steps, i) >> 1
    if slot_int(pieces.key, i) < CLOSED:
        side = slot_int(pieces.side, i)
        at_sides = wp.where(enter_side(side) != NONE, 1, 0) + wp.where(leave_side(side) != NONE, 1, 0)
        if slot_int(pieces.steps, i) < 2 and is_through(pieces, i):
            at_sides = 1
        steps += at_sides
    return steps


@wp.func
def is_drawable(pieces: ContourPieces, i: int):
    """Whether all points of a piece are those of listed steps, of its last crossing and of where it meets sides."""
    side = slot_int(pieces.side, i)
    return is_listed(side) and (leave_side(side) != NONE or slot_int(pieces.key, i) >= CLOSED)


@wp.func
def comes_before(pieces: ContourPieces, a: int, b: int, by: int, ends: PieceEnds):
    """Whether a piece comes before another: by where they enter or leave, then by key; a, b: their indices."""
    if by != BY_KEY:
        side_a = end_side(slot_int(pieces.side, a), by)
        side_b = end_side(slot_int(pieces.side, b), by)
        if side_a != side_b:
            return side_a < side_b
        one = end_position(ends.position, a, by)
        two = end_position(ends.position, b, by)
        if one != two:
            return one < two
    return slot_int(pieces.key, a) < slot_int(pieces.key, b)


@wp.func
def sort_slots(pieces: ContourPieces, base: int, count: int, by: int, ends: PieceEnds, order: wp.array[wp.int32]):
    """Shell sort of a query's slots, by ends of open pieces only; returns how many there are. For a few it is an
    insertion sort."""
    stride = int(pieces.stride)
    n = int(0)
    for slot in range(count):
        if by == BY_KEY or slot_int(pieces.key, base + slot * stride) < CLOSED:
            set_slot_int(order, base + n * stride, slot)
            n += 1
    gap = int(1)
    while 3 * gap + 3 <= n:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            slot = slot_int(order, base + i * stride)
            place = int(i)
            while place >= gap:
                other = slot_int(order, base + (place - gap) * stride)
                if not comes_before(pieces, base + slot * stride, base + other * stride, by, ends):
                    break
                set_slot_int(order, base + place * stride, other)
                place -= gap
            set_slot_int(order, base + place * stride, slot)
        gap = gap // 3
    return n


@wp.func
def match_ends(pieces: ContourPieces, base: int, count: int, winding: int, ends: PieceEnds):
    """Match leaving and entering ends; returns how many open pieces there are.

    Along the boundary a solid interval begins where a piece leaves and ends where one enters. At corner 0, `winding`
    solid intervals are already open, and the first `winding` entering ends close them. So leaving end k pairs with
    entering end (k + winding) mod n, all ends sorted along the boundary. Pairing uses sort rank, not distances: two
    ends that rounding has swapped still pair, and no spurious corner is inserted between them.
    """
    stride = int(pieces.stride)
    n = sort_slots(pieces, base, count, 1, ends, ends.leaving)
    sort_slots(pieces, base, count, 0, ends, ends.entering)
    for k in range(n):
        own = base + slot_int(ends.leaving, base + k * stride) * stride
        entering = slot_int(ends.entering, base + (k + wp.max(winding, 0)) % n * stride)
        gap = enter_side(slot_int(pieces.side, base + entering * stride)) - leave_side(slot_int(pieces.side, own))
        if k + wp.max(winding, 0) >= n:
            gap += 4
        lost = slot_int(ends.link, own) >> LOST
        set_slot_int(ends.link, own, entering | (wp.max(gap, 0) << PASSED) | (lost << LOST))
    return n


BEGIN = wp.constant(1 << 24)  # in an entry: a polyline begins with this piece
CORNERS = wp.constant(25)  # bits above it: how many corners of the patch follow the piece
SLOT = wp.constant((1 << 24) - 1)  # bits of the piece's slot
COUNT = wp.constant((1 << 29) - 1)  # bits of a query's number of entries
WALKED = wp.constant(1 << 29)  # above them: not all points are those that steps, sides and corners have in general
BOUNDARY = wp.constant(1 << 30)  # above them: the patch's whole boundary follows as a polyline


LANE_WORDS = PLANE_WORDS + 1  # of a lane's memory on a CPU


@wp.func_native(memory_of_warp(1, begin=PLANE_WORDS))
def number_memory(own: wp.array[wp.int64]) -> wp.uint64:
    """Address of numbers of 32 bits, one for each lane."""


@wp.struct
class Entries:
    """Pieces in the order in which they are drawn; a query's entry e stands where its slot e does."""

    entry: wp.array[wp.int32]  # `entry_of`
    count: wp.array[wp.int32]  # number of entries (`entry_count`), WALKED, BOUNDARY; shape [query]
    polylines: wp.array[wp.int64]  # of each section, shape [section + 1], the last one stays 0
    points: wp.array[wp.int64]


@wp.func
def entry_of(slot: int, corners: int, begin: int):
    """Entry of a piece that so many corners of the patch follow; begin: BEGIN if a polyline begins with it, else 0."""
    return slot | (corners << CORNERS) | begin


@wp.func
def entry_slot(entry: int):
    """Slot of an entry's piece."""
    return entry & SLOT


@wp.func
def entry_corners(entry: int):
    """How many corners of the patch follow an entry's piece."""
    return entry >> CORNERS


@wp.func
def begins_line(entry: int):
    """Whether a polyline begins with an entry's piece."""
    return (entry & BEGIN) != 0


@wp.func
def entry_count(counted: int):
    """Number of a query's entries, from `Entries.count`."""
    return counted & COUNT


@wp.func
def has_boundary(counted: int):
    """Whether the patch's whole boundary is a polyline of a query, from `Entries.count`."""
    return counted >= BOUNDARY


@wp.func
def joint_steps(f: Frame, half: wp.vec2d, x: wp.vec3, y: wp.vec3, side: int, corners: int):
    """Number of steps of non-zero length from x, on a side, past that many corners to y."""
    steps = int(0)
    p = x
    for k in range(corners):
        q = output_point(f, corner((side + 1 + k) % 4, half))
        if not (p == q):
            steps += 1
        p = q
    if not (p == y):
        steps += 1
    return steps


@wp.func
def joint_lost(pieces: ContourPieces, own: int, following: int, corners: int, planes: wp.uint64, ends: PieceEnds):
    """Number of steps of zero length among those from where a piece leaves past corners to where another enters."""
    if corners > 0 and is_clear(pieces, own) and is_clear(pieces, following):
        return 0
    x = slot_point(ends.last, own)
    y = slot_point(ends.first, following)
    if corners == 0:
        return wp.where(x == y, 1, 0)
    plane = plane_of(planes, lane_of_warp())
    side = leave_side(slot_int(pieces.side, own))
    return corners + 1 - joint_steps(plane.f, plane.side, x, y, side, corners)


@wp.func
def loop_steps(pieces: ContourPieces, base: int, first: int, planes: wp.uint64, ends: PieceEnds):
    """Number of steps around the loop of a piece, and how many of them have zero length."""
    stride = int(pieces.stride)
    own = base + first * stride
    link = slot_int(ends.link, own)
    steps = steps_most(pieces, own)
    lost = link >> LOST
    while corners_after(link) != NO_CORNERS:
        slot = link & FOLLOWER
        following = base + slot * stride
        steps += corners_after(link) + 1
        lost += joint_lost(pieces, own, following, corners_after(link), planes, ends)
        if slot == first:
            break
        own = following
        link = slot_int(ends.link, own)
        steps += steps_most(pieces, own)
        lost += link >> LOST
    return wp.vec2i(steps, lost)


@wp.func
def enter_loop(
    pieces: ContourPieces, base: int, first: int, drawn: bool, ends: PieceEnds, entries: Entries, entry: int
):
    """Mark the pieces of a loop as done, and enter them from entry on if it is drawn; returns the next free entry."""
    stride = int(pieces.stride)
    n = int(entry)
    slot = int(first)
    while True:
        link = slot_int(ends.link, base + slot * stride)
        set_slot_int(ends.link, base + slot * stride, link | DONE)
        if drawn:
            corners = wp.where(corners_after(link) == NO_CORNERS, 0, corners_after(link))
            begin = wp.where(slot == first, BEGIN, 0)
            set_slot_int(entries.entry, base + n * stride, entry_of(slot, corners, begin))
            n += 1
        slot = link & FOLLOWER
        if slot == first:
            break
    return n


@wp.func
def join_section(pieces: ContourPieces, query: int, planes: wp.uint64, closes: int, ends: PieceEnds, entries: Entries):
    """Order a query's pieces, whose ends are placed; returns its number of entries, of polylines and of points."""
    stride = int(pieces.stride)
    base = int(start_at(planes, lane_of_warp()))
    count = pieces.count[query]
    lines = int(0)
    points = int(0)
    entry = int(0)
    walked = int(0)
    open_count = int(0)
    if closes == 1:
        open_count = match_ends(pieces, base, count, pieces.winding[query], ends)
    sort_slots(pieces, base, count, BY_KEY, ends, ends.leaving)
    for rank in range(count):
        slot = slot_int(ends.leaving, base + rank * stride)
        if not is_drawable(pieces, base + slot * stride):
            walked = WALKED
        if (slot_int(ends.link, base + slot * stride) & DONE) == 0:
            steps = loop_steps(pieces, base, slot, planes, ends)
            entry = enter_loop(pieces, base, slot, steps[0] > steps[1], ends, entries, entry)
            if steps[0] > steps[1]:
                lines += 1
                points += steps[0] - steps[1] + 1
                walked = wp.where(steps[1] == 0, walked, WALKED)
    if closes == 1 and open_count == 0 and pieces.winding[query] > 0:
        entry = entry | BOUNDARY
        lines += 1
        points += 5
    return wp.vec3i(entry | walked, lines, points)


@wp.func
def place_ends_of_warp(
    surface: Surface,
    pieces: ContourPieces,
    closes: int,
    planes: wp.uint64,
    firsts: wp.uint64,
    total: int,
    ends: PieceEnds,
):
    """Place the ends of all pieces of a warp's queries; firsts: number, in the warp, of each query's first end."""
    k = lane_of_warp()
    while k < total:
        lane = owner_of(firsts, k)
        number = k - int_at(firsts, lane)
        i = int(start_at(planes, lane)) + (number >> 1) * int(pieces.stride)
        if slot_int(pieces.key, i) < CLOSED:
            if closes == 1 or not is_clear(pieces, i):
                plane = plane_of(planes, lane)
                place_end(surface, plane.f, plane.side, pieces, i, number & 1, ends)
        k += warp_size()


@wp.func
def write_section(entries: Entries, query: int, section: int, entry: int, lines: int, points: int):
    """Write a query's number of entries, and its section's number of polylines and points."""
    entries.count[query] = entry
    entries.polylines[section] = wp.int64(lines)
    entries.points[section] = wp.int64(points)


@wp.kernel
def _join_single_pieces(
    pieces: ContourPieces,
    closes: int,  # 1: CC, 0: OC
    entries: Entries,
    rest: wp.array[wp.int32],  # queries for `_join_pieces`, in any order, shape [query]
    rest_count: wp.array[wp.int32],  # number of these queries, zero-initialised, shape [1]
):
    """Join the piece of queries with at most one if its steps at sides surely have non-zero length; list the others."""
    query = wp.tid()
    count = pieces.count[query]
    inside = closes == 1 and pieces.winding[query] > 0
    entry = int(0)
    lines = int(0)
    points = int(0)
    listed = count > 1
    if count == 1:
        own = int(start_of(pieces, query))
        steps = pieces.steps[own] // 2
        corners = int(0)
        listed = pieces.steps[own] & 1 == 0
        if pieces.key[own] < CLOSED:
            side = pieces.side[own]
            steps = steps_most(pieces, own)
            if closes == 1:
                corners = wp.max(enter_side(side) - leave_side(side) + wp.where(inside, 4, 0), 0)
                steps += corners + 1
                listed = listed or corners == 0  # it may leave where it entered
            inside = False
        if steps > 0:
            entries.entry[own] = entry_of(0, corners, BEGIN)
            entry = 1 | wp.where(is_drawable(pieces, own), 0, WALKED)
            lines = 1
            points = steps + 1
    if inside:
        entry = entry | BOUNDARY
        lines += 1
        points += 5
    if listed:
        rest[wp.atomic_add(rest_count, 0, 1)] = query
    else:
        write_section(entries, query, section_of(pieces, query), entry, lines, points)


@wp.kernel(launch_bounds=(BLOCK, 12))
def _join_pieces(
    # In:
    surface: Surface,
    pieces: ContourPieces,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    closes: int,  # 1: CC, 0: OC
    rest: wp.array[wp.int32],
    rest_count: wp.array[wp.int32],
    # Out:
    own: wp.array[wp.int64],  # a CPU's memory of the lane, shape [LANE_WORDS]
    ends: PieceEnds,  # scratch
    entries: Entries,
):
    """Order each query's pieces, loop by loop, and count polylines and points without steps of zero length.

    The lanes of a warp share out the pieces of its queries to place their ends.
    """
    lane = lane_of_warp()
    is_query = wp.tid() < rest_count[0]
    query = int(0)
    count = int(0)
    planes = plane_memory(own)
    firsts = number_memory(own)
    plane = SectionPlane()
    section = int(0)
    if is_query:
        query = rest[wp.tid()]
        section = section_of(pieces, query)
        if pieces.count[query] <= room_of(pieces, query):  # else a later query with more room repeats it
            count = pieces.count[query]
            plane.f = section_frame(pose, patch, section)
            plane.side = patch[section % patch.shape[0]].half
            plane.start = start_of(pieces, query)
            keep_plane(planes, lane, plane)
    for slot in range(count):
        i = int(plane.start) + slot * int(pieces.stride)
        set_slot_int(ends.link, i, slot | (NO_CORNERS << PASSED))
    numbers = sums_of_warp(2 * count)
    set_int(firsts, lane, numbers[0])
    sync_warp()
    place_ends_of_warp(surface, pieces, closes, planes, firsts, numbers[1], ends)
    sync_warp()
    if is_query:
        joined = wp.vec3i()
        if count > 0:
            joined = join_section(pieces, query, planes, closes, ends, entries)
        write_section(entries, query, section, joined[0], joined[1], joined[2])


class Joined(NamedTuple):
    """Polylines that are ordered and counted, not yet drawn."""

    planes: CutPlanes
    blocks: list[tuple[Any, Any]]  # ContourPieces and Entries
    section_start: wp.array  # offsets of each section's polylines, int64, shape [section + 1]
    point_start: wp.array  # offsets of each section's points
    polyline_count: int
    point_count: int


def join_sections(
    planes: CutPlanes,
    *,
    draws: bool = True,
    limit: int | None = None,
    stage: Callable[[str], AbstractContextManager[Any]] = nullcontext,
) -> Joined:
    """Find the pieces of all sections, order them into polylines, and count polylines and points.

    To close contours needs a watertight surface and bounded patches. draws: see `first_search`. stage: the context of
    the launches of "find" and "join".
    Raises PointLimitError, before any memory is allocated for them, if there are more points than `limit`.
    """
    device = planes.pose.device
    polylines, points = (wp.zeros(planes.section_count + 1, dtype=wp.int64, device=device) for _ in range(2))
    blocks: list[tuple[Any, Any]] = []
    searches = [first_search(planes, draws=draws)]
    while True:  # nearly always once: `rest` is empty unless room was too small
        search = searches.pop()
        with stage("find"):
            pieces = search.launch()
        with stage("join"):
            blocks.append((pieces, order_pieces(planes, pieces, polylines, points)))
            starts = [offsets_of(polylines), offsets_of(points)]
            totals = lasts_of(starts)
        searches += search.rest()  # all that the device can do meanwhile is launched
        if not searches:
            break
    polyline_count, point_count = (int(total) for total in totals.numpy())
    if limit is not None and point_count > limit:
        raise PointLimitError(point_count, limit)
    return Joined(planes, blocks, *starts, polyline_count, point_count)


def order_pieces(planes: CutPlanes, pieces: Any, polylines: wp.array, points: wp.array) -> Any:
    """Order the pieces of further queries into polylines, and count them and their points; returns Entries."""
    surface, pose, patch, _, closes = planes
    query_count, device = pieces.count.shape[0], pose.device
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    ends, entries = room_to_join(pieces, device)
    entries.polylines, entries.points = polylines, points
    rest, rest_count = wp.empty_like(entries.count), wp.zeros(1, dtype=wp.int32, device=device)
    launch(_join_single_pieces, query_count, inputs=[pieces, int(closes)], outputs=[entries, rest, rest_count])
    inputs = [surface, pieces, pose, patch, int(closes), rest, rest_count]
    outputs = [wp.empty(LANE_WORDS, dtype=wp.int64, device=device), ends, entries]
    launch(_join_pieces, threads_for(device, query_count), inputs=inputs, outputs=outputs)
    return entries


def room_to_join(pieces: Any, device: Any) -> tuple[Any, Any]:
    """Ends and Entries for as many pieces."""
    ends, entries = PieceEnds(), Entries()
    slot_count = pieces.half.shape[0]
    entries.entry = wp.empty(slot_count, dtype=wp.int32, device=device)
    entries.count = wp.empty(pieces.count.shape[0], dtype=wp.int32, device=device)
    ends.entering = entries.entry
    for field, dtype in (
        ("leaving", wp.int32),
        ("link", wp.int32),
        ("position", wp.vec2d),
        ("first", wp.vec3),
        ("last", wp.vec3),
    ):
        setattr(ends, field, wp.empty(slot_count, dtype=dtype, device=device))
    return ends, entries
