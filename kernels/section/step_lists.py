"""Lists of steps: walks list the half-edges at which a query's steps of non-zero length inside the patch begin.

Contours are then drawn point by point from these lists (`listed_drawing`), without walking again.
"""

import math
from typing import Any

import warp as wp

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
