"""Contour pieces: a piece is a part of a contour inside one patch, from where it enters or starts to where it leaves
or ends.

Scan searches on GPUs also list the half-edges at which the pieces' steps of non-zero length begin (`StepLists`), so
that contours are drawn from these lists point by point, without walking again.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..patch import Frame

FOUR = 4  # half-edges of 16 bits in a word: a surface with a scan path has fewer than 2^16
PLACE = wp.constant(2)  # bits of a half-edge's place in its word
BOUNDED = (4.0, 16)  # words of a query: by the square root of the number of triangles, and most
UNBOUNDED = (9.0, 36)  # the same if patches cut nothing off, so whole loops are listed; see `pieces.UNLISTED`


@wp.struct
class StepLists:
    """Lists of the steps of all queries: a query's loops one after the other, each from a whole word on."""

    words: wp.int32  # of a query; 0: nothing is listed
    steps: wp.int32  # that have room in them
    word: wp.array[wp.uint64]  # words of a query are adjacent


@wp.func_native("""
    const wp::uint64 filled = (word >> 16) | (static_cast<wp::uint64>(half) << 48);
    const unsigned words = static_cast<unsigned>(lists.words), own = static_cast<unsigned>(k) >> 2;
    const unsigned i = static_cast<unsigned>(query) * words + own;
#ifdef __CUDA_ARCH__
    const int stores = listed && (k & 3) == 3 && k < lists.steps;
    asm volatile("{.reg .pred p; setp.ne.s32 p, %2, 0; @p st.global.b64 [%0], %1;}" ::"l"(lists.word.data + i),
        "l"(filled), "r"(stores) : "memory");
#else
    if ((k & 3) == 3 && listed && k < lists.steps)
        lists.word.data[i] = filled;
#endif
    return listed ? filled : word;
""")
def list_half(lists: StepLists, query: int, k: int, word: wp.uint64, half: int, listed: wp.bool) -> wp.uint64:
    """List a half-edge as number k of a query, if there is room; returns the word that is filled so far.

    listed: False for nothing to be listed, which a GPU does without a branch.

    A word is written once it is full, which costs a GPU less than a store a step.
    """


@wp.func_native("""
    const int free = -k & 3;
    if (free != 0 && k < lists.steps)
        lists.word.data[static_cast<wp::int64>(query) * lists.words + (k >> 2)] = word >> (16 * free);
    return k + free;
""")
def end_list(lists: StepLists, query: int, k: int, word: wp.uint64) -> int:
    """Write a loop's last word if it is not full; returns the number with which the next loop's list begins."""


@wp.func_native("""
    const int* list = reinterpret_cast<const int*>(word.data + static_cast<long long>(query) * words);
    const int* at = last ? out.data + i : list + (k >> 1);
    const unsigned read = *at;  // one load for all lanes, wherever it is from
    return last ? read : (read >> ((k & 1) << 4)) & 0xffffu;
""")
def listed_half(
    word: wp.array[wp.uint64], words: int, query: int, k: int, out: wp.array[wp.int32], i: int, last: wp.bool
) -> int:
    """Number k of a query's list, which consists of so many words; or if it is the last, number i of `out`."""


def room_for_steps(query_count: int, face_count: int, *, bounded: bool, device: Any) -> Any:
    """StepLists for a surface's queries: enough for nearly all of them, others are drawn by walking."""
    factor, most = BOUNDED if bounded else UNBOUNDED
    lists = StepLists()
    lists.words = min(most, math.ceil(factor * math.sqrt(face_count) / FOUR))
    lists.steps = FOUR * lists.words
    lists.word = wp.empty(query_count * lists.words, dtype=wp.uint64, device=device)
    return lists


SLOTS = 8  # slots of a section in the first search; sections with more pieces are searched again with enough slots
CLOSED = wp.constant(1 << 30)  # in a piece's key: a closed loop inside the patch

# `ContourPieces.side` consists of these bits. Below LOCATION: 1 + the side by which the piece enters, and the same of
# the side by which it leaves << LEAVE; 0 for none. From LOCATION on, where `ContourPieces.lists` holds its steps:
LEAVE = wp.constant(3)
SIDE = wp.constant(7)  # bits of a side
LOCATION = wp.constant(6)
LIST = wp.constant(7)  # bits of the word with which the list of the piece's loop begins
# Bits above: number of the piece's first step in that list; above: how long the list is, if the piece goes on at its
# beginning
FIRST_STEP = wp.constant(9)
UNLISTED = wp.constant((1 << 7) - 1)  # for the word: nothing is listed, or not all
NO_WRAP = wp.constant((1 << 9) - 1)  # for the length: the piece ends before the list does


@wp.struct
class ContourPieces:
    """Pieces in slots. A query is one section that is searched; slot s of query q has index start[q] + s * stride."""

    section: wp.array[wp.int32]  # section of each query; empty: section of query q = first + q
    first: int  # 0 unless `section` is empty
    start: wp.array[wp.int64]  # index of each query's slot 0, shape [query]; empty: start[q] = q
    room: wp.array[wp.int32]  # number of slots of each query; empty: SLOTS
    stride: wp.int64
    count: wp.array[wp.int32]  # pieces found, also those without a slot, shape [query]
    winding: wp.array[wp.int32]  # of the solid around the patch's corner 0, shape [query]
    excess: wp.array[wp.int32]  # number of queries with more pieces than slots, shape [1]
    half: wp.array[wp.int32]  # half-edge of the crossing before the piece enters, or of its first crossing inside
    key: wp.array[wp.int32]  # sort key of the pieces of a section: half, or CLOSED + rank
    out: wp.array[wp.int32]  # half-edge of the crossing before the piece leaves
    side: wp.array[wp.int32]  # patch sides by which the piece enters and leaves, and its place in `lists`: see LEAVE
    steps: wp.array[wp.int32]  # 2 * (steps of non-zero length between crossings inside) + 1 if both ends are clear.
    # An end is clear if in float32 it differs from the neighbouring crossings and corners, so steps there are not zero
    lists: (
        StepLists  # half-edges at which the steps of non-zero length begin, by query; without room if none are listed
    )
    listed: wp.array[wp.int32]  # half-edges at which the steps of non-zero length begin, piece by piece; or empty
    query_start: wp.array[wp.int64]  # where a query's pieces begin in `listed`, shape [query]
    begin: wp.array[wp.int32]  # where a piece begins among those of its query
    frame: wp.array[Frame]  # of each query's section; with `listed`
    place: wp.array[wp.int64]  # where the first of a piece's listed crossings is drawn, among the points of all queries


@wp.func
def room_of(pieces: ContourPieces, query: int):
    """Number of slots of a query."""
    if pieces.room.shape[0] == 0:
        return SLOTS
    return pieces.room[query]


@wp.func
def start_of(pieces: ContourPieces, query: int):
    """Index of a query's slot 0."""
    if pieces.start.shape[0] == 0:
        return wp.int64(query)
    return pieces.start[query]


@wp.func
def section_at(section: wp.array[wp.int32], query: int):
    """Section of a query: see `ContourPieces.section`."""
    if section.shape[0] == 0:
        return query
    return section[query]


@wp.func
def section_of(pieces: ContourPieces, query: int):
    """Section of a query."""
    return pieces.first + section_at(pieces.section, query)


@wp.func
def enter_side(side: int):
    """Side by which a piece enters, from `ContourPieces.side`; -1 for none."""
    return (side & SIDE) - 1


@wp.func
def leave_side(side: int):
    """Side by which a piece leaves."""
    return ((side >> LEAVE) & SIDE) - 1


@wp.func
def end_side(side: int, end: int):
    """Side by which a piece enters (0) or leaves (1)."""
    return ((side >> (LEAVE * end)) & SIDE) - 1


@wp.func
def sides_word(enter: int, leave: int, location: int):
    """`ContourPieces.side` of a piece that enters and leaves by these sides, -1 for none."""
    return (enter + 1) | ((leave + 1) << LEAVE) | (location << LOCATION)


@wp.func
def list_location(word: int, begin: int, length: int):
    """A piece's place in `ContourPieces.lists`; length: NO_WRAP, or of the list of its loop."""
    return word | (begin << LIST) | (length << (LIST + FIRST_STEP))


@wp.func
def is_listed(side: int):
    """Whether a piece's steps are listed."""
    return (side >> LOCATION) & UNLISTED != UNLISTED


@wp.func
def listed_step(pieces: ContourPieces, query: int, i: int, side: int, k: int, last: wp.bool):
    """Half-edge at which step k of piece i begins, by its `ContourPieces.side`; or if it is the last, `out`."""
    word = (side >> LOCATION) & UNLISTED
    place = ((side >> (LOCATION + LIST)) & NO_WRAP) + k
    length = side >> (LOCATION + LIST + FIRST_STEP)
    if place >= length:
        place -= length
    lists = pieces.lists
    return listed_half(lists.word, lists.words, query, (word << PLACE) + place, pieces.out, i, last)


@wp.func
def store_piece(
    pieces: ContourPieces,
    query: int,
    slot: int,
    half: int,
    out: int,
    enter: int,
    leave: int,
    steps: int,
    key: int,
    clear: int,
):
    """`store_listed` for a piece that is not listed."""
    store_listed(pieces, query, slot, half, out, enter, leave, steps, key, clear, UNLISTED)


@wp.func
def store_listed(
    pieces: ContourPieces,
    query: int,
    slot: int,
    half: int,
    out: int,
    enter: int,
    leave: int,
    steps: int,
    key: int,
    clear: int,
    location: int,
):
    """Store a piece if its query has the slot; clear: 1 if its ends are (`ContourPieces.steps`), 0 if unknown."""
    if slot < room_of(pieces, query):
        i = start_of(pieces, query) + wp.int64(slot) * pieces.stride
        pieces.half[i] = half
        pieces.out[i] = out
        pieces.key[i] = key
        pieces.side[i] = sides_word(enter, leave, location)
        pieces.steps[i] = 2 * steps + clear


@wp.func
def store_count(pieces: ContourPieces, query: int, count: int, winding: int):
    """Write a query's number of pieces and winding number; count the query in `excess` if it has too few slots."""
    pieces.count[query] = count
    pieces.winding[query] = winding
    if count > room_of(pieces, query):
        wp.atomic_add(pieces.excess, 0, 1)


class CutPlanes(NamedTuple):
    """A surface and the planes that cut it, a section for each pose and patch; all on one device."""

    surface: Any
    pose: wp.array  # wp.transform, of the hand or of each patch -> array frame, shape [pose, 1 or patch]
    patch: wp.array  # Patch, shape [patch]
    bounded: bool  # whether patches cut contours off, else planes are whole
    closes: bool  # whether contours are closed along the patches' boundaries

    @property
    def section_count(self) -> int:
        """Number of sections."""
        return self.pose.shape[0] * self.patch.shape[0]

    @property
    def inputs(self) -> list[Any]:
        """What a kernel that searches takes first."""
        return [self.surface, self.pose, self.patch, int(self.bounded)]


def room_for_sections(section_count: int, device: Any, section: wp.array | None = None) -> Any:
    """ContourPieces with a query per section and SLOTS slots per query; equal slots of all queries are adjacent.

    section: those of the queries if they are not all.
    """
    pieces = ContourPieces()
    pieces.section = wp.empty(0, dtype=wp.int32, device=device) if section is None else section
    pieces.start = wp.empty(0, dtype=wp.int64, device=device)
    pieces.room = wp.empty(0, dtype=wp.int32, device=device)
    pieces.stride = section_count
    return with_slots(pieces, section_count, section_count * SLOTS, device)


def room_for_rest(found: Any, device: Any) -> Any:
    """ContourPieces for the queries of `found` with too few slots, None if there are none; waits for the device.

    Each query gets as many slots as it has pieces.
    """
    if found.excess.numpy()[0] == 0:
        return None
    count = found.count.numpy()
    query = np.flatnonzero(count > SLOTS)
    section = query if found.section.shape[0] == 0 else found.section.numpy()[query]
    start = np.concatenate([[0], np.cumsum(count[query], dtype=np.int64)])
    pieces = ContourPieces()
    pieces.section = wp.array(section.astype(np.int32), device=device)
    pieces.start = wp.array(start[:-1], dtype=wp.int64, device=device)
    pieces.room = wp.array(count[query], dtype=wp.int32, device=device)
    pieces.stride = 1
    return with_slots(pieces, len(query), int(start[-1]), device)


def with_slots(pieces: Any, query_count: int, slot_count: int, device: Any) -> Any:
    """Allocate the arrays of `pieces`; returns it."""
    pieces.count = wp.empty(query_count, dtype=wp.int32, device=device)
    pieces.winding = wp.empty(query_count, dtype=wp.int32, device=device)
    pieces.excess = wp.zeros(1, dtype=wp.int32, device=device)
    for field in ("half", "out", "key", "side", "steps"):
        setattr(pieces, field, wp.empty(slot_count, dtype=wp.int32, device=device))
    return pieces
