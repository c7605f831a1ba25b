"""Lists of steps: walks list the half-edges at which a row's steps of non-zero length inside the patch begin.

Contours are then drawn point by point from these lists (`listed_drawing`), without walking again.
"""

import math
from typing import Any

import warp as wp

FOUR = 4  # half-edges of 16 bits in a word: a surface with a scan path has fewer than 2^16
PLACE = wp.constant(2)  # bits of a half-edge's place in its word
BOUNDED = (4.0, 16)  # words of a row: by the square root of the number of triangles, and most
UNBOUNDED = (9.0, 36)  # the same if patches cut nothing off, so whole loops are listed; see `pieces.UNLISTED`


@wp.struct
class StepLists:
    """Lists of the steps of all rows: those of a row's loops one after the other, each loop's from a whole word on."""

    words: wp.int32  # of a row; 0: nothing is listed
    word: wp.array[wp.uint64]  # words of a row are adjacent


@wp.func
def write_word(lists: StepLists, row: int, k: int, word: wp.uint64):
    """Write word k of a row if there is room."""
    if k < lists.words:
        lists.word[wp.int64(row) * wp.int64(lists.words) + wp.int64(k)] = word


@wp.func
def list_half(lists: StepLists, row: int, k: int, word: wp.uint64, half: int):
    """List a half-edge as number k of a row; returns the word that is filled so far, which is written once full."""
    filled = (word >> wp.uint64(16)) | (wp.uint64(half) << wp.uint64(48))
    if k & 3 == 3:
        write_word(lists, row, k >> PLACE, filled)
    return filled


@wp.func
def end_list(lists: StepLists, row: int, count: int, word: wp.uint64):
    """Write a loop's last word if it is not full; returns the number with which the next loop's list begins."""
    free = -count & 3
    if free == 0:
        return count
    write_word(lists, row, count >> PLACE, word >> wp.uint64(16 * free))
    return count + free


@wp.func_native("""
    return reinterpret_cast<const unsigned short*>(word.data + static_cast<long long>(row) * words)[k];
""")
def listed_half(word: wp.array[wp.uint64], words: int, row: int, k: int) -> int:
    """Number k of a row's list, which consists of so many words."""


def room_for_steps(row_count: int, face_count: int, *, bounded: bool, device: Any) -> Any:
    """StepLists for a surface's rows: enough for nearly all of them, others are drawn by walking."""
    factor, most = BOUNDED if bounded else UNBOUNDED
    lists = StepLists()
    lists.words = min(most, math.ceil(factor * math.sqrt(face_count) / FOUR))
    lists.word = wp.empty(row_count * lists.words, dtype=wp.uint64, device=device)
    return lists


def no_steps(device: Any) -> Any:
    """StepLists without room."""
    lists = StepLists()
    lists.word = wp.empty(0, dtype=wp.uint64, device=device)
    return lists
