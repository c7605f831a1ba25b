"""A piece: what of a contour lies in a patch, from where it enters (or starts) to where it leaves (or ends)."""

from typing import Any

import numpy as np
import warp as wp

SLOTS = 8  # pieces a section has room for at first; one with more is searched again, with as much room as it needs
CLOSED = wp.constant(1 << 30)  # in a piece's key: a loop that never leaves the patch


@wp.struct
class ContourPieces:
    """Pieces by slot; slot s of row r stands at start[r] + s * stride."""

    section: wp.array[wp.int32]  # of each row; empty if rows are sections
    start: wp.array[wp.int64]  # shape [row]; empty if it is the row
    room: wp.array[wp.int32]  # slots of each row; empty if it is SLOTS
    stride: wp.int64
    count: wp.array[wp.int32]  # pieces found, also those that had no room, shape [row]
    winding: wp.array[wp.int32]  # of the solid around the patch's corner 0, shape [row]
    excess: wp.array[wp.int32]  # rows without room for all of their pieces, shape [1]
    half: wp.array[wp.int32]  # of the crossing before it enters, or the first inside
    key: wp.array[wp.int32]  # orders the pieces of a section: half, or CLOSED + rank
    out: wp.array[wp.int32]  # of the crossing before it leaves
    side: wp.array[wp.vec2i]  # patch sides by which it enters and leaves, NONE for none
    steps: wp.array[wp.int32]  # twice the steps of some length between crossings inside, plus 1 if its ends are clear:
    # apart from the crossings and corners next to them in float32, so that the steps there are of some length, too


@wp.func
def room_of(pieces: ContourPieces, row: int):
    """Slots of a row."""
    if pieces.room.shape[0] == 0:
        return SLOTS
    return pieces.room[row]


@wp.func
def start_of(pieces: ContourPieces, row: int):
    """Place of a row's slot 0."""
    if pieces.start.shape[0] == 0:
        return wp.int64(row)
    return pieces.start[row]


@wp.func
def section_at(section: wp.array[wp.int32], row: int):
    """Section of a row: see `Pieces.section`."""
    if section.shape[0] == 0:
        return row
    return section[row]


@wp.func
def section_of(pieces: ContourPieces, row: int):
    """Section of a row."""
    return section_at(pieces.section, row)


@wp.func
def store_piece(
    pieces: ContourPieces,
    row: int,
    slot: int,
    half: int,
    out: int,
    enter: int,
    leave: int,
    steps: int,
    key: int,
    clear: int,
):
    """Put a piece where there is room for it; clear: 1 if its ends are (see `Pieces.steps`), 0 if nobody knows."""
    if slot < room_of(pieces, row):
        i = start_of(pieces, row) + wp.int64(slot) * pieces.stride
        pieces.half[i] = half
        pieces.out[i] = out
        pieces.key[i] = key
        pieces.side[i] = wp.vec2i(enter, leave)
        pieces.steps[i] = 2 * steps + clear


@wp.func
def count_row(pieces: ContourPieces, row: int, count: int, winding: int):
    """Write how many pieces a row has, and whether it has room for them."""
    pieces.count[row] = count
    pieces.winding[row] = winding
    if count > room_of(pieces, row):
        wp.atomic_add(pieces.excess, 0, 1)


def room_for_sections(section_count: int, device: str) -> Any:
    """Pieces with a row a section and SLOTS slots a row, slot by slot, so that neighbouring rows are neighbours."""
    pieces = ContourPieces()
    pieces.section = wp.empty(0, dtype=wp.int32, device=device)
    pieces.start = wp.empty(0, dtype=wp.int64, device=device)
    pieces.room = wp.empty(0, dtype=wp.int32, device=device)
    pieces.stride = section_count
    return with_slots(pieces, section_count, section_count * SLOTS, device)


def room_for_excess(found: Any, device: str) -> Any:
    """Pieces for the rows of `found` that had no room, as many slots as each has pieces."""
    count = found.count.numpy()
    section = np.flatnonzero(count > SLOTS)
    start = np.concatenate([[0], np.cumsum(count[section], dtype=np.int64)])
    pieces = ContourPieces()
    pieces.section = wp.array(section.astype(np.int32), device=device)
    pieces.start = wp.array(start[:-1], dtype=wp.int64, device=device)
    pieces.room = wp.array(count[section], dtype=wp.int32, device=device)
    pieces.stride = 1
    return with_slots(pieces, len(section), int(start[-1]), device)


def with_slots(pieces: Any, row_count: int, slot_count: int, device: str) -> Any:
    """The pieces with their arrays."""
    pieces.count = wp.empty(row_count, dtype=wp.int32, device=device)
    pieces.winding = wp.empty(row_count, dtype=wp.int32, device=device)
    pieces.excess = wp.zeros(1, dtype=wp.int32, device=device)
    pieces.side = wp.empty(slot_count, dtype=wp.vec2i, device=device)
    for field in ("half", "out", "key", "steps"):
        setattr(pieces, field, wp.empty(slot_count, dtype=wp.int32, device=device))
    return pieces
