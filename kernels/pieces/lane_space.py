"""Memory of a group of lanes for the boxes or the crossings of one section.

Crossings lie near the lanes (a GPU's shared memory) if a section has few of them, else in the device's memory. For each
there are five words of 32 bits: its half-edge, a link, a state of 64 bits, and a beginning. While crossings are looked
for, each warp has its share of the memory; three of the words are those of lists of boxes.
"""

from typing import Any

import warp as wp

from ..lanes import Warp
from ..warps import int_at, long_at, set_int, set_long

WORDS = wp.constant(5)  # of a crossing
NEAR_FEW = 512  # crossings near the lanes: more groups of few lanes, and more cache, find room beside little memory
NEAR_MANY = 1536  # or fewer groups of many lanes
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
