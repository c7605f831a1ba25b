"""Pieces -> polylines: as they are (OC), or closed along the patch's own boundary where that is in the solid (CC)."""

from collections import deque
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import warp as wp

from ..offsets import BLOCK, PointLimitError, lasts_of, offsets_of
from ..patch import EXACT, Frame, Patch, corner, output_point, section_frame
from ..warps import (
    int_at,
    lane_of_warp,
    memory_of_warp,
    owner_of,
    set_int,
    sums_of_warp,
    sync_warp,
    threads_for,
    warp_size,
)
from .half_edges import Surface
from .piece_ends import (
    BY_KEY,
    DONE,
    FOLLOWER,
    LOST,
    NO_CORNERS,
    PASSED,
    PieceEnds,
    corners_after,
    is_clear,
    is_drawable,
    match_ends,
    place_end,
    set_slot_int,
    slot_int,
    slot_point,
    sort_slots,
    steps_most,
)
from .pieces import CLOSED, ContourPieces, enter_side, leave_side, room_of, section_of, start_of
from .warp_planes import PLANE_WORDS, SectionPlane, keep_plane, plane_memory, plane_of, start_at

wp.set_module_options(EXACT)

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

    entry: wp.array[wp.int32]  # slot, BEGIN, corners << CORNERS
    count: wp.array[wp.int32]  # entries, WALKED, BOUNDARY; shape [query]
    polylines: wp.array[wp.int64]  # of each section, shape [section + 1], the last one stays 0
    points: wp.array[wp.int64]


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
            set_slot_int(entries.entry, base + n * stride, slot | (corners << CORNERS) | begin)
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
            entries.entry[own] = BEGIN | (corners << CORNERS)
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


class Ordered(NamedTuple):
    """Polylines that are ordered."""

    blocks: list[tuple[Any, Any]]  # ContourPieces and Entries
    polylines: wp.array  # of each section, int64, shape [section + 1], the last one 0
    points: wp.array  # as polylines


class Joined(NamedTuple):
    """Polylines that are ordered and counted, not yet drawn."""

    blocks: list[tuple[Any, Any]]  # ContourPieces and Entries
    section_start: wp.array  # offsets of each section's polylines, int64, shape [section + 1]
    point_start: wp.array  # offsets of each section's points
    polyline_count: int
    point_count: int


def order_pieces(surface: Any, found: Iterable[Any], pose: wp.array, patch: wp.array, *, closes: bool) -> Ordered:
    """Order pieces into polylines, closed along the patches' boundaries or not.

    found: what `find_pieces` returned; closes needs a watertight surface and bounded patches.
    """
    return _last_of(_order_each(surface, found, pose, patch, closes))


def _order_each(surface: Any, found: Iterable, pose: wp.array, patch: wp.array, closes: bool) -> Iterator[Ordered]:
    """Order pieces as they are found; yields what is ordered so far, before it waits for a search that goes on."""
    sections, device, ordered = pose.shape[0] * patch.shape[0], pose.device, None
    for pieces in found:  # a search may begin here
        ordered = ordered or Ordered([], *(wp.zeros(sections + 1, dtype=wp.int64, device=device) for _ in range(2)))
        _order_block(surface, pieces, pose, patch, closes, ordered)
        yield ordered


def _order_block(surface: Any, pieces: Any, pose: wp.array, patch: wp.array, closes: bool, ordered: Ordered) -> None:
    """Order the pieces of further queries; memory that only this needs is free again after."""
    query_count, device = pieces.count.shape[0], pose.device
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    ends, entries = room_to_join(pieces, device)
    entries.polylines, entries.points = ordered.polylines, ordered.points
    rest, rest_count = wp.empty_like(entries.count), wp.zeros(1, dtype=wp.int32, device=device)
    launch(_join_single_pieces, query_count, inputs=[pieces, int(closes)], outputs=[entries, rest, rest_count])
    inputs = [surface, pieces, pose, patch, int(closes), rest, rest_count]
    outputs = [wp.empty(LANE_WORDS, dtype=wp.int64, device=device), ends, entries]
    launch(_join_pieces, threads_for(device, query_count), inputs=inputs, outputs=outputs)
    ordered.blocks.append((pieces, entries))


def join_pieces(
    surface: Any, found: Iterable[Any], pose: wp.array, patch: wp.array, *, closes: bool, limit: int | None = None
) -> Joined:
    """As `order_pieces`, and count polylines and points.

    Raises PointLimitError, before any memory is allocated for them, if there are more points than `limit`.
    """
    each = (_offsets(ordered) for ordered in _order_each(surface, found, pose, patch, closes))
    blocks, section_start, point_start, totals = _last_of(each)
    polyline_count, point_count = (int(total) for total in totals.numpy())
    if limit is not None and point_count > limit:
        raise PointLimitError(point_count, limit)
    return Joined(blocks, section_start, point_start, polyline_count, point_count)


def _last_of(each: Iterator[Any]) -> Any:
    """The last one; those before are freed. Raises ValueError for none."""
    last = deque(each, maxlen=1)
    if not last:
        raise ValueError("found has no pieces left: what find_pieces returns can be taken once")
    return last[0]


def _offsets(ordered: Ordered) -> tuple[list, wp.array, wp.array, wp.array]:
    """Blocks, offsets of each section's polylines and of its points, and both totals, which are not waited for."""
    starts = offsets_of(ordered.polylines), offsets_of(ordered.points)
    return ordered.blocks, *starts, lasts_of(starts)


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
