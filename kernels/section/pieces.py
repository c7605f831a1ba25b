"""Contour pieces: a piece is a part of a contour inside one patch, from where it enters or starts to where it leaves
or ends."""

from typing import Any

import numpy as np
import warp as wp

from ..patch import Frame

SLOTS = 8  # slots of a section in the first search; sections with more pieces are searched again with enough slots
CLOSED = wp.constant(1 << 30)  # in a piece's key: a closed loop inside the patch


@wp.struct
class ContourPieces:
    """Pieces in slots: one row per section; slot s of row r has index start[r] + s * stride."""

    section: wp.array[wp.int32]  # section of each row; empty: section of row r = first + r
    first: int  # 0 unless `section` is empty
    start: wp.array[wp.int64]  # index of each row's slot 0, shape [row]; empty: start[r] = r
    room: wp.array[wp.int32]  # number of slots of each row; empty: SLOTS
    stride: wp.int64
    count: wp.array[wp.int32]  # pieces found, also those without a slot, shape [row]
    winding: wp.array[wp.int32]  # of the solid around the patch's corner 0, shape [row]
    excess: wp.array[wp.int32]  # number of rows with more pieces than slots, shape [1]
    half: wp.array[wp.int32]  # half-edge of the crossing before the piece enters, or of its first crossing inside
    key: wp.array[wp.int32]  # sort key of the pieces of a section: half, or CLOSED + rank
    out: wp.array[wp.int32]  # half-edge of the crossing before the piece leaves
    side: wp.array[wp.vec2i]  # patch sides by which the piece enters and leaves, NONE for none
    steps: wp.array[wp.int32]  # 2 * (steps of non-zero length between crossings inside) + 1 if both ends are clear.
    # An end is clear if in float32 it differs from the neighbouring crossings and corners, so steps there are not zero
    listed: wp.array[wp.int32]  # half-edges at which the steps of non-zero length begin, piece by piece; or empty
    row_start: wp.array[wp.int64]  # where a row's pieces begin in `listed`, shape [row]
    begin: wp.array[wp.int32]  # where a piece begins among those of its row
    frame: wp.array[Frame]  # of each row's section; with `listed`
    place: wp.array[wp.int64]  # where the first of a piece's listed crossings is drawn, among the points of all rows


@wp.func
def room_of(pieces: ContourPieces, row: int):
    """Number of slots of a row."""
    if pieces.room.shape[0] == 0:
        return SLOTS
    return pieces.room[row]


@wp.func
def start_of(pieces: ContourPieces, row: int):
    """Index of a row's slot 0."""
    if pieces.start.shape[0] == 0:
        return wp.int64(row)
    return pieces.start[row]


@wp.func
def section_at(section: wp.array[wp.int32], row: int):
    """Section of a row: see `ContourPieces.section`."""
    if section.shape[0] == 0:
        return row
    return section[row]


@wp.func
def section_of(pieces: ContourPieces, row: int):
    """Section of a row."""
    return pieces.first + section_at(pieces.section, row)


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
    """Store a piece if its row has the slot; clear: 1 if its ends are (`ContourPieces.steps`), 0 if that is unknown."""
    if slot < room_of(pieces, row):
        i = start_of(pieces, row) + wp.int64(slot) * pieces.stride
        pieces.half[i] = half
        pieces.out[i] = out
        pieces.key[i] = key
        pieces.side[i] = wp.vec2i(enter, leave)
        pieces.steps[i] = 2 * steps + clear


@wp.func
def count_row(pieces: ContourPieces, row: int, count: int, winding: int):
    """Write a row's number of pieces and winding number; count the row in `excess` if it has too few slots."""
    pieces.count[row] = count
    pieces.winding[row] = winding
    if count > room_of(pieces, row):
        wp.atomic_add(pieces.excess, 0, 1)


def room_for_sections(section_count: int, device: Any, section: wp.array | None = None) -> Any:
    """ContourPieces with one row per section and SLOTS slots per row; equal slots of neighbouring rows are adjacent.

    section: those of the rows if they are not all.
    """
    pieces = ContourPieces()
    pieces.section = wp.empty(0, dtype=wp.int32, device=device) if section is None else section
    pieces.start = wp.empty(0, dtype=wp.int64, device=device)
    pieces.room = wp.empty(0, dtype=wp.int32, device=device)
    pieces.stride = section_count
    return with_slots(pieces, section_count, section_count * SLOTS, device)


def room_for_excess(found: Any, device: Any) -> Any:
    """ContourPieces for the rows of `found` with too few slots; each row gets as many slots as it has pieces."""
    count = found.count.numpy()
    row = np.flatnonzero(count > SLOTS)
    section = row if found.section.shape[0] == 0 else found.section.numpy()[row]
    start = np.concatenate([[0], np.cumsum(count[row], dtype=np.int64)])
    pieces = ContourPieces()
    pieces.section = wp.array(section.astype(np.int32), device=device)
    pieces.start = wp.array(start[:-1], dtype=wp.int64, device=device)
    pieces.room = wp.array(count[row], dtype=wp.int32, device=device)
    pieces.stride = 1
    return with_slots(pieces, len(row), int(start[-1]), device)


def with_slots(pieces: Any, row_count: int, slot_count: int, device: Any) -> Any:
    """Allocate the arrays of `pieces`; returns it."""
    pieces.count = wp.empty(row_count, dtype=wp.int32, device=device)
    pieces.winding = wp.empty(row_count, dtype=wp.int32, device=device)
    pieces.excess = wp.zeros(1, dtype=wp.int32, device=device)
    pieces.side = wp.empty(slot_count, dtype=wp.vec2i, device=device)
    for field in ("half", "out", "key", "steps"):
        setattr(pieces, field, wp.empty(slot_count, dtype=wp.int32, device=device))
    return pieces
