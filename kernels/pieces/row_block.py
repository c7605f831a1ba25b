"""A block of rows of sections, and how much room a search begins with."""

from typing import Any, NamedTuple

import warp as wp

from ..lanes import group_count
from .lane_space import WORDS, FarSpace, room_for_groups

LISTED_FIRST = 2**26  # half-edges of the first block of rows, about
LISTED_MOST = 2**28  # of later ones, each of which may be larger than the one before
GROWTH = 4
SHARE = 1.15  # of the half-edges that the block before suggests
SPACE_BYTES = 2**29  # of all groups
SPACE, LISTED = range(2)  # numbers of a search: crossings for which a section needs room, half-edges listed


class FlatSize(NamedTuple):
    """First capacities of a flat search; those that prove too small are enlarged."""

    space: int
    """Crossings of a section."""
    listed: float
    """Half-edges of a row, mean."""
    block: int
    """Half-edges of a block of rows."""

    @classmethod
    def for_surface(cls, face_count: int, bounded: bool) -> "FlatSize":
        """Capacities for planes through a round body: one through its middle crosses 2.6 sqrt(face_count) faces."""
        root, share = face_count**0.5, 1.0 if bounded else 2.0
        return cls(int(max(256.0, (2.0 + 2.0 * share) * root)), 16.0 + share * root, LISTED_FIRST)

    def after(self, listed: float) -> "FlatSize":
        """Capacities for the block after one of so many half-edges a row: larger, as their number is known better."""
        return FlatSize(self.space, max(1.0, SHARE * listed), min(GROWTH * self.block, LISTED_MOST))


@wp.struct
class RowBlock:
    """A block of rows, what the groups that search it share, and their memory."""

    first: int  # row
    rows: int
    listed_before: wp.int64  # half-edges that blocks before have listed
    taken: wp.array[wp.int32]  # rows that groups took, by kernel, zero-initialised, shape [3]
    far: FarSpace
    count: wp.array[wp.int32]  # crossings of each row, 0 where there was no room, shape [row of the block]
    steps: wp.array[wp.int32]  # of non-zero length that the pieces of each group's row have so far, shape [group]
    numbers: wp.array[wp.int64]  # by SPACE, LISTED, zero-initialised


def room_for_rows(rows: range, size: FlatSize, listed_before: int, device: Any) -> Any:
    """RowBlock of some rows."""
    groups = min(group_count(device, len(rows)), max(1, SPACE_BYTES // (4 * WORDS * size.space)))
    block = RowBlock()
    block.first, block.rows, block.listed_before = rows.start, len(rows), listed_before
    block.far = room_for_groups(groups, size.space, device)
    block.taken = wp.zeros(3, dtype=wp.int32, device=device)
    block.count = wp.empty(len(rows), dtype=wp.int32, device=device)
    block.steps = wp.empty(groups, dtype=wp.int32, device=device)
    block.numbers = wp.zeros(2, dtype=wp.int64, device=device)
    return block
