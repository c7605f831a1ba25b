"""A block of rows of sections, and how much room a search begins with."""

from typing import Any, NamedTuple

import warp as wp

from ..lanes import group_count
from ..patch import Frame
from ..section.pieces import ContourPieces, section_of
from .flat_boxes import PackedFrame
from .flat_links import CROSSINGS_MOST
from .lane_space import WORDS, FarSpace, room_for_groups

LISTED_FIRST = 2**26  # half-edges of the first block of rows, about
LISTED_MOST = 2**28  # of later ones, about, each of which may be larger than the one before
GROWTH = 4
LACKING_MOST = 64  # one row of so many may lack room before later blocks have more
SHARE = 1.15  # of what the block before suggests
SLOTS_FIRST = 3.0  # pieces of a row, mean
SLOTS_LEAST = 64  # of a block
SPACE_BYTES = 2**29  # of all groups
OF_PATCH, OF_CORNER = wp.constant(0), wp.constant(1)  # windows of a row: `patch_window`, `corner_window`
WINDINGS, LISTS, RANKS = (wp.constant(kernel) for kernel in range(3))  # numbers of a block: rows that a kernel took
SPACE = wp.constant(3)  # crossings for which a section needs more room than it has; 0 if none does
LISTED = wp.constant(4)  # half-edges listed
STORED = wp.constant(5)  # pieces stored
LACKING = wp.constant(6)  # rows without room
NUMBERS = 7
NO_SPACE = wp.constant(-(1 << 30))  # added to the winding number of a row by each warp whose boxes found no space


class FlatSize(NamedTuple):
    """Capacities of a flat search; rows for which they are too small are searched again with larger ones."""

    space: int
    """Crossings of a section."""
    listed: float
    """Half-edges of a row, mean."""
    block: int
    """Half-edges of a block of rows."""
    slots: float = SLOTS_FIRST
    """Pieces of a row, mean."""

    @classmethod
    def for_surface(cls, face_count: int, bounded: bool) -> "FlatSize":
        """Capacities for planes through a round body: one through its middle crosses 2.6 sqrt(face_count) faces.

        Each warp has its share of the space, and not all have equal numbers of crossings. With this much, of 1,000,000
        sections of smooth bodies none lacked space; a search that must be done again costs a batch of 200,000 1 ms.
        """
        root, share = face_count**0.5, 1.0 if bounded else 2.0
        return cls(int(max(512.0, (6.0 + 3.0 * share) * root)), 16.0 + share * root, LISTED_FIRST)

    def rows(self) -> int:
        """Rows of a block."""
        return max(1, int(self.block / self.listed))

    def after(self, rows: int, numbers: Any) -> "FlatSize":
        """Capacities after a block with these numbers; for more rows, as the mean is known, if few lacked room."""
        many = LACKING_MOST * numbers[LACKING] > rows
        space = self.enlarged(numbers).space if many else self.space
        block = self.block if many else min(GROWTH * self.block, LISTED_MOST)
        listed, slots = (max(1.0, SHARE * float(numbers[of]) / max(1, rows)) for of in (LISTED, STORED))
        return FlatSize(space, listed, block, slots)

    def enlarged(self, numbers: Any) -> "FlatSize":
        """Capacities for the rows of a block that lacked room."""
        space = max(int(numbers[SPACE]), min(2 * self.space, CROSSINGS_MOST)) if numbers[SPACE] else self.space
        return FlatSize(space, max(2.0 * self.listed, float(numbers[SPACE])), self.block, 2.0 * self.slots)


@wp.struct
class RowBlock:
    """What the groups share that search a block of rows, and their memory."""

    window: wp.array2d[PackedFrame]  # of each row, by OF_PATCH and, if contours are closed, OF_CORNER
    groups: int
    far: FarSpace
    count: wp.array[wp.int32]  # crossings of each row, 0 where there was no room
    stored: wp.array[wp.int64]  # pieces << 32 | steps of non-zero length, of each group's row so far
    lacking: wp.array[wp.int32]  # sections of rows without room, in any order
    numbers: wp.array[wp.int64]  # by WINDINGS to LACKING, zero-initialised, shape [NUMBERS]


@wp.func
def note_lacking(block: RowBlock, pieces: ContourPieces, row: int):
    """Note that a row has no room; until it is searched again it has neither pieces nor a boundary."""
    block.lacking[int(wp.atomic_add(block.numbers, LACKING, wp.int64(1)))] = section_of(pieces, row)
    pieces.winding[row] = 0


def framed_rows(rows: range, section: wp.array | None, device: Any) -> Any:
    """ContourPieces of rows with room for their frames and winding numbers; rows: of `section`, or sections."""
    pieces = ContourPieces()
    pieces.stride = 1
    pieces.first = rows.start if section is None else 0
    if section is not None:
        pieces.section = section[rows.start : rows.stop]
    pieces.frame = wp.empty(len(rows), dtype=Frame, device=device)
    pieces.winding = wp.empty(len(rows), dtype=wp.int32, device=device)
    return pieces


def room_for_groups_of(rows: int, size: FlatSize, device: Any) -> Any:
    """RowBlock for as many groups as work at once, but for the arrays that `add_lists` and `add_slots` add."""
    block = RowBlock()
    block.groups = min(group_count(device, rows), max(1, SPACE_BYTES // (4 * WORDS * size.space)))
    block.far = room_for_groups(block.groups, size.space, device)
    block.numbers = wp.zeros(NUMBERS, dtype=wp.int64, device=device)
    return block


def add_lists(block: Any, pieces: Any, rows: int, size: FlatSize, device: Any) -> None:
    """Add room for the crossings of rows; so that one row finds room, too, for one section more than the mean."""
    listed = int(rows * size.listed) + size.space
    pieces.listed = wp.empty(listed, dtype=wp.int32, device=device)
    pieces.row_start = wp.empty(rows, dtype=wp.int64, device=device)
    block.count = wp.empty(rows, dtype=wp.int32, device=device)
    block.lacking = wp.empty(rows, dtype=wp.int32, device=device)


def add_slots(block: Any, pieces: Any, rows: int, size: FlatSize, device: Any) -> None:
    """Add slots for the pieces of rows; each row takes as many as it needs."""
    block.stored = wp.empty(block.groups, dtype=wp.int64, device=device)
    slots = int(rows * size.slots) + SLOTS_LEAST
    pieces.count = pieces.room = wp.empty(rows, dtype=wp.int32, device=device)
    pieces.start = wp.empty(rows, dtype=wp.int64, device=device)
    pieces.side = wp.empty(slots, dtype=wp.int32, device=device)
    pieces.place = wp.empty(slots, dtype=wp.int64, device=device)
    for field in ("half", "out", "key", "steps", "begin"):
        setattr(pieces, field, wp.empty(slots, dtype=wp.int32, device=device))
