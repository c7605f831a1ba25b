"""Lanes: the threads that share one section. On a GPU they are a block; on a CPU there is one.

All lanes of a group take the same branches where they vote, synchronise or claim a query. A kernel is launched
with `lane_count` threads for each group, and with that many threads a block; a kernel that does not vote may have
groups of another size (`pieces.flat_ranks`).
"""

from typing import Any

import warp as wp

from .offsets import BLOCK

LANES = BLOCK  # of a group on a GPU
WARPS = LANES // 32  # their lanes run in step
GROUPS_OF_PROCESSOR = 16  # groups that a multiprocessor of a GPU holds if lanes need 64 registers


@wp.func_native("""
#ifdef __CUDA_ARCH__
    __syncthreads();
#endif
""")
def sync_lanes():
    """Wait for all lanes of the group; what they wrote before can be read after."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __syncthreads_or(vote) != 0;
#else
    return vote;
#endif
""")
def any_lane(vote: wp.bool) -> wp.bool:
    """Whether any lane votes for it; waits for all lanes."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    __shared__ int counts[2][{WARPS}];
    const unsigned int votes = __ballot_sync(0xffffffffu, vote);
    const unsigned int lane = threadIdx.x % 32u, warp = threadIdx.x / 32u;
    int* count = counts[turn & 1];  // of each warp; a lane may still read those of the turn before
    if (lane == 0)
        count[warp] = __popc(votes);
    __syncthreads();
    int before = __popc(votes & ((1u << lane) - 1u)), all = 0;
    for (unsigned int k = 0; k < {WARPS}; ++k) {{
        before += k < warp ? count[k] : 0;
        all += count[k];
    }}
    return wp::vec_t<2, int>(before, all);
#else
    return wp::vec_t<2, int>(0, vote ? 1 : 0);
#endif
""")
def votes_of(vote: wp.bool, turn: int) -> wp.vec2i:
    """How many lanes below this one voted, and how many in all; waits for all lanes.

    turn: increases by one from call to call between two calls of `sync_lanes`.
    """


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    __shared__ int numbers[{WARPS}];
    const unsigned int warp = threadIdx.x / 32u;
    if (threadIdx.x % 32u == 0)
        numbers[warp] = number;
    __syncthreads();
    int before = 0, all = 0;
    for (unsigned int k = 0; k < {WARPS}; ++k) {{
        before += k < warp ? numbers[k] : 0;
        all += numbers[k];
    }}
    return wp::vec_t<2, int>(before, all);
#else
    return wp::vec_t<2, int>(0, number);
#endif
""")
def numbers_of_warps(number: int) -> wp.vec2i:
    """Sum of the numbers, one for each warp, of the warps below this one, and of all; waits for all lanes.

    Between two calls is a call of `sync_lanes`.
    """


@wp.struct
class Warp:
    """A lane's place in its group."""

    own: int  # number of its warp
    bits: int  # the group has 2^bits warps
    lane: int  # in its warp
    lanes: int  # of a warp


@wp.func
def warp_of(lane: int, lanes: int):
    """The place of a lane of a group."""
    warp = Warp()
    while (lanes >> warp.bits) > 32:
        warp.bits += 1
    warp.lanes = lanes >> warp.bits
    warp.own = lane // warp.lanes
    warp.lane = lane % warp.lanes
    return warp


@wp.func_native("""
#ifdef __CUDA_ARCH__
    __shared__ int first;
    if (threadIdx.x == 0)
        first = x;
    __syncthreads();
    x = first;
    __syncthreads();
#endif
    return x;
""")
def from_first_lane(x: int) -> int:
    """The number of lane 0; waits for all lanes."""


@wp.func
def claim_query(claimed: wp.array[wp.int64], kernel: int, lane: int):
    """Claim the next query that no group has claimed in a kernel; returns its number."""
    query = int(0)
    if lane == 0:
        query = int(wp.atomic_add(claimed, kernel, wp.int64(1)))
    return from_first_lane(query)


def lane_count(device: Any, lanes: int = LANES) -> int:
    """Lanes of a group on a device; lanes: those on a GPU."""
    return 1 if device.is_cpu else lanes


def group_count(device: Any, queries: int) -> int:
    """Groups that work at once: as many as the device holds, and not more than queries."""
    held = 1 if device.is_cpu else GROUPS_OF_PROCESSOR * device.sm_count
    return max(1, min(held, queries))
