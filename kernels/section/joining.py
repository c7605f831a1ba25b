"""Pieces -> polylines: as they are (OC), or closed along the patch's own boundary where that is in the solid (CC)."""

from functools import partial
from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK, PointLimitError, last_of, offsets_of
from ..patch import EXACT, Frame, Patch, corner, outcode, output_point, section_frame
from .half_edges import Surface
from .pieces import CLOSED, ContourPieces, end_side, enter_side, is_listed, leave_side, room_of, section_of, start_of
from .segment_clipping import NONE, side_point, side_position
from .triangle_walk import crossing_after, crossing_at, point_of

wp.set_module_options(EXACT)

BY_KEY = wp.constant(2)  # an order of pieces; 0 and 1: by where they enter, leave
BEGIN = wp.constant(1 << 24)  # in an entry: a polyline begins with this piece
CORNERS = wp.constant(25)  # bits above it: how many corners of the patch follow the piece
SLOT = wp.constant((1 << 24) - 1)  # bits of the piece's slot
COUNT = wp.constant((1 << 29) - 1)  # bits of a row's number of entries
WALKED = wp.constant(1 << 29)  # above them: not all points are those that steps, sides and corners have in general
BOUNDARY = wp.constant(1 << 30)  # above them: the patch's whole boundary follows as a polyline


@wp.struct
class Entries:
    """Pieces in the order in which they are drawn; a row's entry e stands where its slot e does."""

    entry: wp.array[wp.int32]  # slot, BEGIN, corners << CORNERS
    count: wp.array[wp.int32]  # entries, WALKED, BOUNDARY; shape [row]
    polylines: wp.array[wp.int64]  # of each section, shape [section + 1], the last one stays 0
    points: wp.array[wp.int64]


@wp.struct
class PieceEnds:
    """Ends of a row's open pieces, sorted along the boundary; scratch, by slot."""

    leaving: wp.array[wp.int32]  # piece, in the order of the places where pieces leave; in the end, by key
    entering: wp.array[wp.int32]  # piece, in the order of the places where pieces enter
    follower: wp.array[wp.int32]  # the piece that the boundary leads to from where this one leaves; NONE once drawn
    corners: wp.array[wp.int32]  # how many corners it passes on the way
    position: wp.array[wp.vec2d]  # how far along its side each piece enters and leaves [m]
    steps: wp.array[wp.int32]  # steps of non-zero length
    first: wp.array[wp.vec3]  # first and last point [m], array frame
    last: wp.array[wp.vec3]


@wp.func
def place_ends(surface: Surface, f: Frame, half: wp.vec2d, pieces: ContourPieces, i: wp.int64, ends: PieceEnds):
    """Compute where an open piece enters and leaves its patch; add its steps of non-zero length there."""
    side = pieces.side[i]
    position = wp.vec2d()
    steps = pieces.steps[i] // 2
    x = wp.vec3()
    enter = enter_side(side)
    leave = leave_side(side)
    if enter != NONE:
        c = crossing_at(surface, f, pieces.half[i])
        q = point_of(f, crossing_after(surface, f, c), half)
        p = side_point(enter, point_of(f, c, half), q, half)
        x = output_point(f, p)
        position[0] = side_position(enter, p)
        ends.first[i] = x
        if outcode(q, half) == 0 and not (x == output_point(f, q)):
            steps += 1
    if leave != NONE:
        c = crossing_at(surface, f, pieces.out[i])
        p = point_of(f, c, half)
        q = side_point(leave, p, point_of(f, crossing_after(surface, f, c), half), half)
        y = output_point(f, q)
        position[1] = side_position(leave, q)
        ends.last[i] = y
        if outcode(p, half) == 0:
            x = output_point(f, p)
        if not (x == y):
            steps += 1
    ends.position[i] = position
    ends.steps[i] = steps


@wp.func
def is_through(pieces: ContourPieces, i: wp.int64):
    """Whether an open piece enters and leaves with one segment."""
    side = pieces.side[i]
    return enter_side(side) != NONE and leave_side(side) != NONE and pieces.half[i] == pieces.out[i]


@wp.func
def steps_most(pieces: ContourPieces, i: wp.int64):
    """Number of a piece's steps if none at the patch's sides has zero length."""
    steps = pieces.steps[i] // 2
    if pieces.key[i] < CLOSED:
        side = pieces.side[i]
        steps += wp.where(enter_side(side) != NONE, 1, 0) + wp.where(leave_side(side) != NONE, 1, 0)
        steps -= wp.where(is_through(pieces, i), 1, 0)
    return steps


@wp.func
def is_drawable(pieces: ContourPieces, i: wp.int64):
    """Whether all points of a piece are those of listed steps, of its last crossing and of where it meets sides."""
    side = pieces.side[i]
    return is_listed(side) and (pieces.key[i] >= CLOSED or leave_side(side) != NONE)


@wp.func
def comes_before(pieces: ContourPieces, base: wp.int64, one: int, two: int, by: int, ends: PieceEnds):
    """Whether a slot's piece comes before another's: by where they enter or leave, then by key."""
    a = base + wp.int64(one) * pieces.stride
    b = base + wp.int64(two) * pieces.stride
    if by != BY_KEY:
        side_a = end_side(pieces.side[a], by)
        side_b = end_side(pieces.side[b], by)
        if side_a != side_b:
            return side_a < side_b
        if ends.position[a][by] != ends.position[b][by]:
            return ends.position[a][by] < ends.position[b][by]
    return pieces.key[a] < pieces.key[b]


@wp.func
def sort_slots(
    pieces: ContourPieces,
    base: wp.int64,
    count: int,
    by: int,
    only_open: bool,
    ends: PieceEnds,
    order: wp.array[wp.int32],
):
    """Shell sort of a row's slots; returns how many there are. For a few it is an insertion sort."""
    n = int(0)
    for slot in range(count):
        if not only_open or pieces.key[base + wp.int64(slot) * pieces.stride] < CLOSED:
            order[base + wp.int64(n) * pieces.stride] = slot
            n += 1
    gap = int(1)
    while gap < n // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            slot = order[base + wp.int64(i) * pieces.stride]
            place = int(i)
            while place >= gap:
                other = order[base + wp.int64(place - gap) * pieces.stride]
                if not comes_before(pieces, base, slot, other, by, ends):
                    break
                order[base + wp.int64(place) * pieces.stride] = other
                place -= gap
            order[base + wp.int64(place) * pieces.stride] = slot
        gap = gap // 3
    return n


@wp.func
def match_ends(pieces: ContourPieces, base: wp.int64, count: int, winding: int, ends: PieceEnds):
    """Match leaving and entering ends; returns how many open pieces there are.

    Along the boundary a solid interval begins where a piece leaves and ends where one enters. At corner 0, `winding`
    solid intervals are already open, and the first `winding` entering ends close them. So leaving end k pairs with
    entering end (k + winding) mod n, all ends sorted along the boundary. Pairing uses sort rank, not distances: two
    ends that rounding has swapped still pair, and no spurious corner is inserted between them.
    """
    n = sort_slots(pieces, base, count, 1, True, ends, ends.leaving)
    sort_slots(pieces, base, count, 0, True, ends, ends.entering)
    for k in range(n):
        leaving = ends.leaving[base + wp.int64(k) * pieces.stride]
        entering = ends.entering[base + wp.int64((k + wp.max(winding, 0)) % n) * pieces.stride]
        own = base + wp.int64(leaving) * pieces.stride
        gap = enter_side(pieces.side[base + wp.int64(entering) * pieces.stride]) - leave_side(pieces.side[own])
        if k + wp.max(winding, 0) >= n:
            gap += 4
        ends.follower[own] = entering
        ends.corners[own] = wp.max(gap, 0)
    return n


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
def loop_steps(pieces: ContourPieces, base: wp.int64, first: int, f: Frame, half: wp.vec2d, ends: PieceEnds):
    """Number of steps of non-zero length around the loop of a piece, and of all steps that its pieces have."""
    own = base + wp.int64(first) * pieces.stride
    steps = ends.steps[own]
    most = steps_most(pieces, own)
    if pieces.key[own] >= CLOSED or leave_side(pieces.side[own]) == NONE or ends.corners[own] == NONE:
        return wp.vec2i(steps, most)
    slot = ends.follower[own]
    while True:
        following = base + wp.int64(slot) * pieces.stride
        side = leave_side(pieces.side[own])
        steps += joint_steps(f, half, ends.last[own], ends.first[following], side, ends.corners[own])
        most += ends.corners[own] + 1
        if slot == first:
            break
        own = following
        steps += ends.steps[own]
        most += steps_most(pieces, own)
        slot = ends.follower[own]
    return wp.vec2i(steps, most)


@wp.func
def enter_loop(
    pieces: ContourPieces, base: wp.int64, first: int, kept: bool, ends: PieceEnds, entries: Entries, entry: int
):
    """Mark the pieces of a loop as drawn, and enter them from entry on if it is kept; returns the next free entry."""
    n = int(entry)
    slot = int(first)
    while True:
        own = base + wp.int64(slot) * pieces.stride
        corners = wp.max(ends.corners[own], 0)
        follower = ends.follower[own]
        ends.follower[own] = NONE
        if kept:
            code = slot | (corners << CORNERS)
            if slot == first:
                code = code | BEGIN
            entries.entry[base + wp.int64(n) * pieces.stride] = code
            n += 1
        if follower == first:
            break
        slot = follower
    return n


@wp.func
def write_row(entries: Entries, row: int, section: int, entry: int, lines: int, points: int):
    """Write a row's number of entries, and its section's number of polylines and points."""
    entries.count[row] = entry
    entries.polylines[section] = wp.int64(lines)
    entries.points[section] = wp.int64(points)


@wp.kernel
def _join_single_pieces(
    # In:
    pieces: ContourPieces,
    closes: int,  # 1: CC, 0: OC
    # Out:
    entries: Entries,
    rest: wp.array[wp.int32],  # rows for `_join_pieces`, in any order, shape [row]
    rest_count: wp.array[wp.int32],  # number of these rows, zero-initialised, shape [1]
):
    """Join rows with at most one piece if its steps at sides surely have non-zero length; list the others."""
    row = wp.tid()
    count = pieces.count[row]
    inside = closes == 1 and pieces.winding[row] > 0
    entry = int(0)
    lines = int(0)
    points = int(0)
    listed = count > 1
    if count == 1:
        own = start_of(pieces, row)
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
            entries.entry[own] = BEGIN | (corners << CORNERS)
            entry = 1 | wp.where(is_drawable(pieces, own), 0, WALKED)
            lines = 1
            points = steps + 1
    if inside:
        entry = entry | BOUNDARY
        lines += 1
        points += 5
    if listed:
        rest[wp.atomic_add(rest_count, 0, 1)] = row
    else:
        write_row(entries, row, section_of(pieces, row), entry, lines, points)


@wp.kernel
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
    ends: PieceEnds,  # scratch
    entries: Entries,
):
    """Order each row's pieces, loop by loop, and count polylines and points without steps of zero length."""
    if wp.tid() >= rest_count[0]:
        return
    row = rest[wp.tid()]
    section = section_of(pieces, row)
    count = pieces.count[row]
    base = start_of(pieces, row)
    lines = int(0)
    points = int(0)
    entry = int(0)
    walked = int(0)
    if count <= room_of(pieces, row):  # else it has a row with more room elsewhere
        f = section_frame(pose, patch, section)
        half = patch[section % patch.shape[0]].half
        for slot in range(count):
            own = base + wp.int64(slot) * pieces.stride
            ends.follower[own] = slot
            ends.corners[own] = NONE
            ends.steps[own] = pieces.steps[own] // 2
            if pieces.key[own] < CLOSED:
                place_ends(surface, f, half, pieces, own, ends)
            if not is_drawable(pieces, own):
                walked = WALKED
        open_count = int(0)
        if closes == 1:
            open_count = match_ends(pieces, base, count, pieces.winding[row], ends)
        sort_slots(pieces, base, count, BY_KEY, False, ends, ends.leaving)
        for rank in range(count):
            slot = ends.leaving[base + wp.int64(rank) * pieces.stride]
            if ends.follower[base + wp.int64(slot) * pieces.stride] != NONE:
                steps = loop_steps(pieces, base, slot, f, half, ends)
                entry = enter_loop(pieces, base, slot, steps[0] > 0, ends, entries, entry)
                if steps[0] > 0:
                    lines += 1
                    points += steps[0] + 1
                    walked = wp.where(steps[0] == steps[1], walked, WALKED)
        if closes == 1 and open_count == 0 and pieces.winding[row] > 0:
            entry = entry | BOUNDARY
            lines += 1
            points += 5
        entry = entry | walked
    write_row(entries, row, section, entry, lines, points)


class Ordered(NamedTuple):
    """Polylines that are ordered."""

    rows: list[tuple[Any, Any]]  # ContourPieces and Entries
    polylines: wp.array  # of each section, int64, shape [section + 1], the last one 0
    points: wp.array


class Joined(NamedTuple):
    """Polylines that are ordered and counted, not yet drawn."""

    rows: list[tuple[Any, Any]]  # ContourPieces and Entries
    section_start: wp.array  # offsets of each section's polylines, int64, shape [section + 1]
    point_start: wp.array  # offsets of each section's points
    polyline_count: int
    point_count: int


def order_pieces(surface: Any, found: list, pose: wp.array, patch: wp.array, *, closes: bool) -> Ordered:
    """Order pieces into polylines, closed along the patches' boundaries or not.

    found: what `find_pieces` returned; closes needs a watertight surface and bounded patches.
    """
    section_count = pose.shape[0] * patch.shape[0]
    device = pose.device
    polylines = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    points = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    rows = []
    for pieces in found:
        row_count = pieces.count.shape[0]
        ends, entries = room_to_join(pieces, device)
        entries.polylines, entries.points = polylines, points
        rest = wp.empty(row_count, dtype=wp.int32, device=device)
        rest_count = wp.zeros(1, dtype=wp.int32, device=device)
        launch(_join_single_pieces, row_count, inputs=[pieces, int(closes)], outputs=[entries, rest, rest_count])
        inputs = [surface, pieces, pose, patch, int(closes), rest, rest_count]
        launch(_join_pieces, row_count, inputs=inputs, outputs=[ends, entries])
        rows.append((pieces, entries))
    return Ordered(rows, polylines, points)


def join_pieces(
    surface: Any, found: list, pose: wp.array, patch: wp.array, *, closes: bool, limit: int | None = None
) -> Joined:
    """As `order_pieces`, and count polylines and points.

    Raises PointLimitError, before any memory is taken for them, if there are more points than `limit`.
    """
    rows, polylines, points = order_pieces(surface, found, pose, patch, closes=closes)
    section_start, point_start = offsets_of(polylines), offsets_of(points)
    polyline_count, point_count = last_of(section_start), last_of(point_start)
    if limit is not None and point_count > limit:
        raise PointLimitError(point_count, limit)
    return Joined(rows, section_start, point_start, polyline_count, point_count)


def room_to_join(pieces: Any, device: Any) -> tuple[Any, Any]:
    """Ends and Entries for as many pieces."""
    ends, entries = PieceEnds(), Entries()
    slot_count = pieces.half.shape[0]
    for field in ("leaving", "entering", "follower", "corners", "steps"):
        setattr(ends, field, wp.empty(slot_count, dtype=wp.int32, device=device))
    for field, dtype in (("position", wp.vec2d), ("first", wp.vec3), ("last", wp.vec3)):
        setattr(ends, field, wp.empty(slot_count, dtype=dtype, device=device))
    entries.entry = wp.empty(slot_count, dtype=wp.int32, device=device)
    entries.count = wp.empty(pieces.count.shape[0], dtype=wp.int32, device=device)
    return ends, entries
