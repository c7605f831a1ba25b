"""Memory of a flat search: of a block of queries, each of one section, and of each group of lanes for one section.

Crossings lie near the lanes (a GPU's shared memory) if a section has few of them, else in the device's memory. For each
there are five words of 32 bits: its half-edge, a link, a state of 64 bits, and a beginning. While crossings are looked
for, each warp has its share of the memory; three of the words are those of lists of boxes.
"""

from typing import Any, NamedTuple

import warp as wp

from ..patch import Frame
from .flat_boxes import PackedFrame
from .lanes import Warp, group_count, int_at, long_at, set_int, set_long
from .pieces import ContourPieces, section_of

WORDS = wp.constant(5)  # of a crossing
NEAR_FEW = 512  # crossings near the lanes: more groups of few lanes, and more cache, find room beside little memory
NEAR_MANY = 1536  # or fewer groups of many lanes
CROSSINGS_MOST = 2 ** (31 - 10) - 4  # of a section: links of crossings have room for their places; a multiple of EVEN
EVEN = 4  # capacities of warps are even, so that states lie at multiples of 8 bytes
LINKS = wp.constant(1)  # parts of a memory
BEGINNINGS = wp.constant(4)


@wp.struct
class FarSpace:
    """Memory of all groups in the device's memory."""

    most: int  # crossings of a group, a multiple of EVEN
    word: wp.array[wp.int32]  # shape [group * WORDS * most]


@wp.struct
class LaneSpace:
    """Memory of one group."""

    address: wp.uint64
    most: int  # crossings for which there is room


ADDRESS = """
#ifdef __CUDA_ARCH__
    __shared__ __align__(16) int words[{}];
    wp::uint64 address = reinterpret_cast<wp::uint64>(words);
    asm volatile("" : "+l"(address));  // computed once, not wherever it is used
    return address;
#else
    return 0;
#endif
"""


@wp.func_native(ADDRESS.format(WORDS * NEAR_FEW))
def address_of_few() -> wp.uint64:
    """Address of memory near the lanes for NEAR_FEW crossings; 0 where there is none."""


@wp.func_native(ADDRESS.format(WORDS * NEAR_MANY))
def address_of_many() -> wp.uint64:
    """Address of memory near the lanes for NEAR_MANY crossings; 0 where there is none."""


@wp.func_native("""
    wp::uint64 address = reinterpret_cast<wp::uint64>(word.data + i);
#ifdef __CUDA_ARCH__
    asm volatile("" : "+l"(address));  // computed once, not wherever it is used
#endif
    return address;
""")
def address_of(word: wp.array[wp.int32], i: wp.int64) -> wp.uint64:
    """Address of an entry."""


@wp.func
def near_space(address: wp.uint64, most: int):
    """The memory near the lanes at an address, or with no room where there is none."""
    space = LaneSpace()
    space.address = address
    space.most = wp.where(address != wp.uint64(0), most, 0)
    return space


@wp.func
def far_space(far: FarSpace, group: int):
    """A group's memory in the device's memory."""
    space = LaneSpace()
    space.address = address_of(far.word, wp.int64(group) * wp.int64(WORDS * far.most))
    space.most = far.most
    return space


@wp.func
def warp_space(s: LaneSpace, warp: Warp):
    """A warp's share of the memory of its group."""
    space = LaneSpace()
    space.most = s.most >> warp.bits
    space.address = address_after(s.address, warp.own * WORDS * space.most)
    return space


@wp.func_native("""
    return address + 4 * static_cast<wp::int64>(words);
""")
def address_after(address: wp.uint64, words: int) -> wp.uint64:
    """The address so many words after one."""


@wp.func
def half_at(s: LaneSpace, i: int):
    """Half-edge of crossing i."""
    return int_at(s.address, i)


@wp.func
def set_half(s: LaneSpace, i: int, half: int):
    """Write the half-edge of crossing i."""
    set_int(s.address, i, half)


@wp.func
def link_at(s: LaneSpace, i: int):
    """Link of crossing i (`flat_links`)."""
    return int_at(s.address, LINKS * s.most + i)


@wp.func
def set_link(s: LaneSpace, i: int, link: int):
    """Write the link of crossing i."""
    set_int(s.address, LINKS * s.most + i, link)


@wp.func
def state_at(s: LaneSpace, i: int):
    """State of crossing i: its output point, x and y (`flat_links`), then its rank (`flat_ranks`)."""
    return long_at(s.address, s.most + i)


@wp.func
def set_state(s: LaneSpace, i: int, state: wp.int64):
    """Write the state of crossing i."""
    set_long(s.address, s.most + i, state)


@wp.func
def begin_at(s: LaneSpace, i: int):
    """Beginning of the steps of the piece whose first crossing is i; before that is set, z of its output point."""
    return int_at(s.address, BEGINNINGS * s.most + i)


@wp.func
def set_begin(s: LaneSpace, i: int, begin: int):
    """Write what `begin_at` gives."""
    set_int(s.address, BEGINNINGS * s.most + i, begin)


def room_for_groups(groups: int, most: int, device: Any) -> Any:
    """FarSpace of so many groups, for so many crossings each."""
    far = FarSpace()
    far.most = -(-most // EVEN) * EVEN
    far.word = wp.empty(groups * WORDS * far.most, dtype=wp.int32, device=device)
    return far


LISTED_FIRST = 2**26  # half-edges of the first block of queries, about
LISTED_MOST = 2**28  # of later ones, about, each of which may be larger than the one before
GROWTH = 4
LACKING_MOST = 64  # one query of so many may lack room before later blocks have more
SHARE = 1.15  # of what the block before suggests
SLOTS_FIRST = 3.0  # pieces of a query, mean
SLOTS_LEAST = 64  # of a block
SPACE_BYTES = 2**29  # of all groups
OF_PATCH, OF_CORNER = wp.constant(0), wp.constant(1)  # windows of a query: `patch_window`, `corner_window`
WINDINGS, LISTS, RANKS = (wp.constant(kernel) for kernel in range(3))  # numbers of a block: queries claimed
SPACE = wp.constant(3)  # crossings for which a section needs more room than it has; 0 if none does
LISTED = wp.constant(4)  # half-edges listed
STORED = wp.constant(5)  # pieces stored
LACKING = wp.constant(6)  # queries without room
NUMBERS = 7
NO_SPACE = wp.constant(-(1 << 30))  # added to the winding number of a query by each warp whose boxes found no space


class FlatSize(NamedTuple):
    """Capacities of a flat search; queries for which they are too small are searched again with larger ones."""

    space: int
    """Crossings of a section."""
    listed: float
    """Half-edges of a query, mean."""
    block: int
    """Half-edges of a block of queries."""
    slots: float = SLOTS_FIRST
    """Pieces of a query, mean."""

    @classmethod
    def for_surface(cls, face_count: int, bounded: bool) -> "FlatSize":
        """Capacities for planes through a round body: one through its middle crosses 2.6 sqrt(face_count) faces.

        Each warp has its share of the space, and not all have equal numbers of crossings. With this much, of 1,000,000
        sections of smooth bodies none lacked space; a search that must be done again costs a batch of 200,000 1 ms.
        """
        root, share = face_count**0.5, 1.0 if bounded else 2.0
        return cls(int(max(512.0, (6.0 + 3.0 * share) * root)), 16.0 + share * root, LISTED_FIRST)

    def queries(self) -> int:
        """Queries of a block."""
        return max(1, int(self.block / self.listed))

    def after(self, queries: int, numbers: Any) -> "FlatSize":
        """Capacities after a block with these numbers; for more queries, as the mean is known, if few lacked room."""
        many = LACKING_MOST * numbers[LACKING] > queries
        space = self.enlarged(numbers).space if many else self.space
        block = self.block if many else min(GROWTH * self.block, LISTED_MOST)
        listed, slots = (max(1.0, SHARE * float(numbers[of]) / max(1, queries)) for of in (LISTED, STORED))
        return FlatSize(space, listed, block, slots)

    def enlarged(self, numbers: Any) -> "FlatSize":
        """Capacities for the queries of a block that lacked room."""
        space = max(int(numbers[SPACE]), min(2 * self.space, CROSSINGS_MOST)) if numbers[SPACE] else self.space
        return FlatSize(space, max(2.0 * self.listed, float(numbers[SPACE])), self.block, 2.0 * self.slots)


@wp.struct
class QueryBlock:
    """Memory of the groups that search a block of queries."""

    window: wp.array2d[PackedFrame]  # of each query, by OF_PATCH and, if contours are closed, OF_CORNER
    groups: int
    far: FarSpace
    count: wp.array[wp.int32]  # crossings of each query, 0 where there was no room
    stored: wp.array[wp.int64]  # pieces << 32 | steps of non-zero length, of each group's query so far
    lacking: wp.array[wp.int32]  # sections of queries without room, in any order
    numbers: wp.array[wp.int64]  # by WINDINGS to LACKING, zero-initialised, shape [NUMBERS]


@wp.func
def note_lacking(block: QueryBlock, pieces: ContourPieces, query: int):
    """Note that a query has no room; until it is searched again it has neither pieces nor a boundary."""
    block.lacking[int(wp.atomic_add(block.numbers, LACKING, wp.int64(1)))] = section_of(pieces, query)
    pieces.winding[query] = 0


def framed_queries(queries: range, section: wp.array | None, device: Any) -> Any:
    """ContourPieces of queries with room for their frames and winding numbers; queries: of `section`, or sections."""
    pieces = ContourPieces()
    pieces.stride = 1
    pieces.first = queries.start if section is None else 0
    if section is not None:
        pieces.section = section[queries.start : queries.stop]
    pieces.frame = wp.empty(len(queries), dtype=Frame, device=device)
    pieces.winding = wp.empty(len(queries), dtype=wp.int32, device=device)
    return pieces


def room_for_groups_of(queries: int, size: FlatSize, device: Any) -> Any:
    """QueryBlock for as many groups as work at once, but for the arrays that `add_lists` and `add_slots` add."""
    block = QueryBlock()
    block.groups = min(group_count(device, queries), max(1, SPACE_BYTES // (4 * WORDS * size.space)))
    block.far = room_for_groups(block.groups, size.space, device)
    block.numbers = wp.zeros(NUMBERS, dtype=wp.int64, device=device)
    return block


def add_lists(block: Any, pieces: Any, queries: int, size: FlatSize, device: Any) -> None:
    """Add room for the crossings of queries; so that one query finds room, too, for one section more than the mean."""
    listed = int(queries * size.listed) + size.space
    pieces.listed = wp.empty(listed, dtype=wp.int32, device=device)
    pieces.query_start = wp.empty(queries, dtype=wp.int64, device=device)
    block.count = wp.empty(queries, dtype=wp.int32, device=device)
    block.lacking = wp.empty(queries, dtype=wp.int32, device=device)


def add_slots(block: Any, pieces: Any, queries: int, size: FlatSize, device: Any) -> None:
    """Add slots for the pieces of queries; each query takes as many as it needs."""
    block.stored = wp.empty(block.groups, dtype=wp.int64, device=device)
    slots = int(queries * size.slots) + SLOTS_LEAST
    pieces.count = pieces.room = wp.empty(queries, dtype=wp.int32, device=device)
    pieces.start = wp.empty(queries, dtype=wp.int64, device=device)
    pieces.side = wp.empty(slots, dtype=wp.int32, device=device)
    pieces.place = wp.empty(slots, dtype=wp.int64, device=device)
    for field in ("half", "out", "key", "steps", "begin"):
        setattr(pieces, field, wp.empty(slots, dtype=wp.int32, device=device))
