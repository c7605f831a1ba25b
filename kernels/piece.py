"""A piece: what of a contour lies in a patch, from where it enters (or starts) to where it leaves (or ends)."""

from typing import Any

import numpy as np
import warp as wp

from .clip import NONE, side_point, side_position
from .patch import Frame, lifted

SLOTS = 4  # pieces a section has room for at first; one with more is searched again, with as much room as it needs
CLOSED = wp.constant(1 << 30)  # in a piece's key: a loop that never leaves the patch


@wp.struct
class Pieces:
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
    side: wp.array[wp.vec2i]  # patch sides by which it enters and leaves, NONE for none
    position: wp.array[wp.vec2d]  # how far along them [m]
    steps: wp.array[wp.int32]  # points that differ from the one after, the last one apart
    first: wp.array[wp.vec3]  # first and last point [m], array frame
    last: wp.array[wp.vec3]


@wp.struct
class Piece:
    """A piece while it is walked."""

    half: int
    enter: int
    leave: int
    enter_position: wp.float64
    leave_position: wp.float64
    steps: int
    first: wp.vec3
    last: wp.vec3


@wp.func
def room_of(pieces: Pieces, row: int):
    """Slots of a row."""
    if pieces.room.shape[0] == 0:
        return SLOTS
    return pieces.room[row]


@wp.func
def start_of(pieces: Pieces, row: int):
    """Place of a row's slot 0."""
    if pieces.start.shape[0] == 0:
        return wp.int64(row)
    return pieces.start[row]


@wp.func
def section_of(pieces: Pieces, row: int):
    """Section of a row."""
    if pieces.section.shape[0] == 0:
        return row
    return pieces.section[row]


@wp.func
def store_piece(pieces: Pieces, row: int, slot: int, piece: Piece, key: int):
    """Put a piece where there is room for it; it is counted in any case."""
    if slot < room_of(pieces, row):
        i = start_of(pieces, row) + wp.int64(slot) * pieces.stride
        pieces.half[i] = piece.half
        pieces.key[i] = key
        pieces.side[i] = wp.vec2i(piece.enter, piece.leave)
        pieces.position[i] = wp.vec2d(piece.enter_position, piece.leave_position)
        pieces.steps[i] = piece.steps
        pieces.first[i] = piece.first
        pieces.last[i] = piece.last


@wp.func
def begun_inside(f: Frame, half: int, p: wp.vec2d):
    """A piece that begins at a crossing inside the patch."""
    piece = Piece()
    piece.half = half
    piece.enter = NONE
    piece.leave = NONE
    piece.first = lifted(f, p)
    piece.last = piece.first
    return piece


@wp.func
def begun_at_side(f: Frame, half: int, p: wp.vec2d, q: wp.vec2d, enter: int, side: wp.vec2d):
    """A piece that begins where p -> q enters the patch; half: of the crossing p."""
    s = side_point(enter, p, q, side)
    piece = begun_inside(f, half, s)
    piece.enter = enter
    piece.enter_position = side_position(enter, s)
    return piece


@wp.func
def led_to(f: Frame, piece: Piece, p: wp.vec2d):
    """The piece, a point longer."""
    x = lifted(f, p)
    if not (x == piece.last):
        piece.steps += 1
    piece.last = x
    return piece


@wp.func
def led_out(f: Frame, piece: Piece, p: wp.vec2d, q: wp.vec2d, leave: int, side: wp.vec2d):
    """The piece up to where p -> q leaves the patch."""
    s = side_point(leave, p, q, side)
    out = led_to(f, piece, s)
    out.leave = leave
    out.leave_position = side_position(leave, s)
    return out


@wp.func
def count_row(pieces: Pieces, row: int, count: int, winding: int):
    """Write how many pieces a row has, and whether it has room for them."""
    pieces.count[row] = count
    pieces.winding[row] = winding
    if count > room_of(pieces, row):
        wp.atomic_add(pieces.excess, 0, 1)


def room_for_sections(section_count: int, device: str) -> Any:
    """Pieces with a row a section and SLOTS slots a row, slot by slot, so that neighbouring rows are neighbours."""
    pieces = Pieces()
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
    pieces = Pieces()
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
    for field, dtype in (
        *(("half", wp.int32), ("key", wp.int32), ("side", wp.vec2i), ("position", wp.vec2d)),
        *(("steps", wp.int32), ("first", wp.vec3), ("last", wp.vec3)),
    ):
        setattr(pieces, field, wp.empty(slot_count, dtype=dtype, device=device))
    return pieces
