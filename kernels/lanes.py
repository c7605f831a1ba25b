"""Lanes: the threads that share one section. On a GPU they are a warp, which runs in step; on a CPU there is one.

A kernel is launched with `lane_count` threads for each group of lanes. All lanes of a group take the same way through
it where they vote, synchronise or take a row.
"""

from typing import Any

import warp as wp

WARP = 32  # lanes of a group on a GPU
GROUPS_OF_PROCESSOR = 32  # groups that a multiprocessor of a GPU holds if threads need 64 registers


@wp.func_native("""
#ifdef __CUDA_ARCH__
    __syncwarp();
#endif
""")
def sync_lanes():
    """Wait for all lanes of the group; what they wrote before can be read after."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return static_cast<int>(__ballot_sync(0xffffffffu, vote));
#else
    return vote ? 1 : 0;
#endif
""")
def votes_of(vote: wp.bool) -> int:
    """Bit k is set if lane k votes for it."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __shfl_sync(0xffffffffu, x, 0);
#else
    return x;
#endif
""")
def from_first_lane(x: int) -> int:
    """The number of lane 0."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __popc(static_cast<unsigned int>(votes));
#else
    return votes != 0 ? 1 : 0;
#endif
""")
def vote_count(votes: int) -> int:
    """How many lanes voted."""


@wp.func
def votes_before(votes: int, lane: int):
    """How many lanes below this one voted."""
    return vote_count(votes & ((1 << lane) - 1))


@wp.func
def take_row(taken: wp.array[wp.int32], lane: int):
    """The next row that no group has taken."""
    row = int(0)
    if lane == 0:
        row = wp.atomic_add(taken, 0, 1)
    return from_first_lane(row)


def lane_count(device: Any) -> int:
    """Lanes of a group on a device."""
    return 1 if device.is_cpu else WARP


def group_count(device: Any, rows: int) -> int:
    """Groups that work at once: as many as the device holds, and not more than rows."""
    held = 1 if device.is_cpu else GROUPS_OF_PROCESSOR * device.sm_count
    return max(1, min(held, rows))
