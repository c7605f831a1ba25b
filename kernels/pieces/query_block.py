"""A block of queries, each of one section, and how much room a search begins with."""

from typing import Any, NamedTuple

import warp as wp

from ..lanes import group_count
from ..patch import Frame
from ..section.pieces import ContourPieces, section_of
from .flat_boxes import PackedFrame
from .flat_links import CROSSINGS_MOST
from .lane_space import WORDS, FarSpace, room_for_groups

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
