"""Flat search, for large surfaces on a GPU: the lanes of a group share the work of each section."""

from typing import Any, NamedTuple

import warp as wp

from ..lanes import group_count
from ..patch import Frame
from .flat_crossings import KEPT, SPACE, USED, CrossingLists, LaneSpace, list_crossings
from .flat_pieces import rank_crossings
from .tree_search import prepare_rows

BLOCK_MOST = 2**26  # of a block of rows, about: lists take 8 bytes for each
SPACE_BYTES = 2**29  # of all groups
CROSSING_BYTES = 36  # in a group's space
SHARE = 1.15  # of the crossings that the block before suggests


class FlatSize(NamedTuple):
    """First capacities of a flat search; those that prove too small are enlarged."""

    space: int
    """Crossings of a section."""
    crossings: float
    """Crossings of a row, mean."""
    block: int
    """Crossings of a block of rows."""

    @classmethod
    def for_surface(cls, face_count: int, bounded: bool) -> "FlatSize":
        """Capacities for planes through a round body: one through its middle crosses 2.6 sqrt(face_count) faces."""
        root, share = face_count**0.5, 1.0 if bounded else 2.0
        return cls(int(max(256.0, (2.0 + 2.0 * share) * root)), 16.0 + share * root, BLOCK_MOST)


def flat_search_pieces(
    surface: Any,
    pose: wp.array,
    patch: wp.array,
    pieces: Any,
    *,
    bounded: bool,
    closes: bool,
    size: FlatSize | None = None,
) -> None:
    """Find the pieces of a surface of any size, and list the half-edges of their steps.

    Rows are searched in blocks. A block whose crossings need more memory than there is, is searched again with more.
    """
    device, row_count = pose.device, pieces.count.shape[0]
    size = size or FlatSize.for_surface(surface.corner.shape[0] // 3, bounded)
    with_steps(pieces, device)
    prepare_rows(surface, pose, patch, pieces, bounded=bounded, closes=closes)
    found: list[wp.array] = []
    first = 0
    while first < row_count:
        rows = min(row_count - first, max(1, int(size.block / size.crossings)))
        listed_before = sum(array.shape[0] for array in found)
        listed, size = _search_block(surface, patch, pieces, first, rows, listed_before, bounded, size)
        found.append(listed)
        first += rows
    pieces.listed = joined_arrays(found, device)


def _search_block(
    surface: Any,
    patch: wp.array,
    pieces: Any,
    first: int,
    rows: int,
    listed_before: int,
    bounded: bool,
    size: FlatSize,
) -> tuple[wp.array, FlatSize]:
    """Half-edges of the steps of a block of rows, and the capacities for the next block."""
    device = patch.device
    capacity = int(rows * size.crossings) + 1
    excess = wp.clone(pieces.excess)
    while True:
        groups = min(group_count(device, rows), max(1, SPACE_BYTES // (CROSSING_BYTES * size.space)))
        space, lists = space_for(groups, size.space, device), lists_for(rows, capacity, device)
        listed = wp.empty(capacity, dtype=wp.int32, device=device)
        shared: dict[str, Any] = {"bounded": bounded, "groups": groups, "space": space}
        list_crossings(surface, patch, pieces, first, lists=lists, **shared)
        rank_crossings(surface, patch, first, lists, listed_before, pieces=pieces, listed=listed, **shared)
        numbers = lists.numbers.numpy()
        if numbers[SPACE] == 0 and numbers[USED] <= capacity:
            break
        wp.copy(pieces.excess, excess)
        capacity = max(capacity, int(numbers[USED]))
        if numbers[SPACE]:
            size = size._replace(space=max(2 * size.space, int(numbers[SPACE])))
    count = int(numbers[KEPT])
    exact = wp.clone(listed[:count]) if count else wp.empty(0, dtype=wp.int32, device=device)
    return exact, size._replace(crossings=max(1.0, SHARE * numbers[USED] / rows))


def space_for(groups: int, most: int, device: Any) -> Any:
    """LaneSpace of so many groups."""
    space = LaneSpace()
    space.most = most
    space.word = wp.empty(groups * 2 * most, dtype=wp.int32, device=device)
    space.half = wp.empty(groups * most, dtype=wp.int32, device=device)
    space.state = wp.empty(groups * most, dtype=wp.int64, device=device)
    space.point = wp.empty(groups * most, dtype=wp.vec4, device=device)
    return space


def lists_for(rows: int, capacity: int, device: Any) -> Any:
    """CrossingLists of so many rows."""
    lists = CrossingLists()
    lists.half = wp.empty(capacity, dtype=wp.int32, device=device)
    lists.start = wp.empty(rows, dtype=wp.int64, device=device)
    lists.count = wp.empty(rows, dtype=wp.int32, device=device)
    lists.steps = wp.empty(rows, dtype=wp.int32, device=device)
    lists.numbers = wp.zeros(3, dtype=wp.int64, device=device)
    return lists


def with_steps(pieces: Any, device: Any) -> None:
    """Allocate the arrays of `pieces` for listed steps, but `listed` itself."""
    slots = pieces.half.shape[0]
    pieces.row_start = wp.empty(pieces.count.shape[0], dtype=wp.int64, device=device)
    pieces.frame = wp.empty(pieces.count.shape[0], dtype=Frame, device=device)
    pieces.begin = wp.empty(slots, dtype=wp.int32, device=device)
    pieces.place = wp.empty(slots, dtype=wp.int64, device=device)


def joined_arrays(arrays: list, device: Any) -> wp.array:
    """Arrays of numbers behind each other."""
    if len(arrays) == 1:
        return arrays[0]
    joined = wp.empty(sum(array.shape[0] for array in arrays), dtype=wp.int32, device=device)
    start = 0
    for array in (array for array in arrays if array.shape[0]):
        wp.copy(joined, array, dest_offset=start, count=array.shape[0])
        start += array.shape[0]
    return joined
