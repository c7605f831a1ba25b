"""Lanes: the threads of a GPU that share out work; on a CPU each works alone.

*Warps* are 32 threads that run in step and share out what one of them has much of. Each lane counts what it has, all
together number it through (`sums_of_warp`), and then lane k takes number k, k + 32 and so on, whichever lane that
belongs to. What others need for it lies in memory of the warp. Functions that a whole warp calls are called by all its
lanes.

*Groups* are the blocks of threads that share one section in a flat search; on a CPU a group has one lane. All lanes of
a group take the same branches where they vote, synchronise or claim a query. A kernel is launched with `lane_count`
threads for each group, and with that many threads a block; a kernel that does not vote may have groups of another size
(`flat_ranks`).
"""

from typing import Any

import warp as wp

from ..offsets import BLOCK

WARP = 32  # lanes of a warp on a GPU


def memory_of_warp(words: int, begin: int = 0) -> str:
    """Source of a native function that gives the address of so many words of 64 bits for each lane of a warp.

    On a GPU this is shared memory. On a CPU it is the array `own`, one launch's alone, from a word on.
    """
    return f"""
#ifdef __CUDA_ARCH__
    __shared__ wp::int64 words[{BLOCK // WARP}][{WARP * words}];
    return reinterpret_cast<wp::uint64>(words[threadIdx.x / {WARP}u]);
#else
    return reinterpret_cast<wp::uint64>(own.data + {begin});
#endif
"""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    return threadIdx.x % {WARP}u;
#else
    return 0;
#endif
""")
def lane_of_warp() -> int:
    """Number of this lane in its warp."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    return {WARP};
#else
    return 1;
#endif
""")
def warp_size() -> int:
    """Number of lanes of a warp."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    __syncwarp();
#endif
""")
def sync_warp():
    """Wait for all lanes of the warp; what they wrote before can be read after."""


LOWER = """
    unsigned int lower;  // bits of the lanes below this one
    asm("mov.u32 %0, %%lanemask_lt;" : "=r"(lower));
"""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    {LOWER}
    const unsigned int votes = __ballot_sync(0xffffffffu, vote);
    return wp::vec_t<2, int>(__popc(votes & lower), __popc(votes));
#else
    return wp::vec_t<2, int>(0, vote ? 1 : 0);
#endif
""")
def warp_votes_of(vote: wp.bool) -> wp.vec2i:
    """How many lanes of this warp below this one voted, and how many in all; waits for its lanes."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    {LOWER}
    int before = 0, all = 0;
    for (int bit = 0; bit < 3; ++bit) {{
        const unsigned int votes = __ballot_sync(0xffffffffu, (number >> bit) & 1);
        before += __popc(votes & lower) << bit;
        all += __popc(votes) << bit;
    }}
    return wp::vec_t<2, int>(before, all);
#else
    return wp::vec_t<2, int>(0, number);
#endif
""")
def warp_numbers_of(number: int) -> wp.vec2i:
    """Sum of the numbers, 0 to 7, of the lanes of this warp below this one, and of all."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    const unsigned int lane = threadIdx.x % {WARP}u;
    int sum = number;
    for (unsigned int k = 1; k < {WARP}u; k *= 2u) {{
        const int other = __shfl_up_sync(0xffffffffu, sum, k);
        sum += lane >= k ? other : 0;
    }}
    return wp::vec_t<2, int>(sum - number, __shfl_sync(0xffffffffu, sum, {WARP - 1}));
#else
    return wp::vec_t<2, int>(0, number);
#endif
""")
def sums_of_warp(number: int) -> wp.vec2i:
    """Sum of the numbers of the lanes below this one, and of all."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return true;
#else
    return false;
#endif
""")
def in_step() -> wp.bool:
    """Whether a lane has others beside it that run in step, as on a GPU."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    const unsigned int all = 0xffffffffu, votes = __ballot_sync(all, wants), lane = threadIdx.x % 32u;
    const int number = __popc(votes), rank = __popc(votes & ((1u << lane) - 1u)), left = ours[1] - ours[0];
    int place = ours[0] + rank;
    ours[0] += number;
    if (left < number && ours[1] < count) {{
        int first = 0;
        if (lane == 0)
            first = atomicAdd(claimed.data, {WARP});
        first = __shfl_sync(all, first, 0);
        if (rank >= left)
            place = first + rank - left;
        ours = wp::vec_t<2, int>(first + number - left, first + {WARP});
    }}
#else
    const int place = ours[0];
    if (wants)
        ours[0] = count;
#endif
    return wp::vec_t<3, int>(wants && place < count ? place : -1, ours[0], ours[1]);
""")
def claim_place(wants: wp.bool, ours: wp.vec2i, claimed: wp.array[wp.int32], count: int) -> wp.vec3i:
    """The next place of a list of `count` for each lane of a warp that wants one, -1 for none; waits for its lanes.

    ours: places that the warp has claimed and given to no lane, from the first one to before the second one; they
    follow in the answer, and the first one is at least `count` when the list is at its end. If there are too few, a GPU
    claims more through `claimed`; a CPU has one lane a place.
    """


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return wp::vec_t<2, int>(0, 0);
#else
    return wp::vec_t<2, int>(lane, lane + 1);
#endif
""")
def first_places(lane: int) -> wp.vec2i:
    """Places of a list with which `claim_place` begins."""


@wp.func_native("""
    return reinterpret_cast<const int*>(address)[i];
""")
def int_at(address: wp.uint64, i: int) -> int:
    """32 bits number i from an address on; unlike an array's entry, they cost no look at the sign of i."""


@wp.func_native("""
    reinterpret_cast<int*>(address)[i] = x;
""")
def set_int(address: wp.uint64, i: int, x: int):
    """Write 32 bits number i from an address on."""


@wp.func_native("""
    int lane = 0;
#ifdef __CUDA_ARCH__
    for (int step = 16; step > 0; step /= 2)
        lane += reinterpret_cast<const int*>(firsts)[lane + step] <= k ? step : 0;
#endif
    return lane;
""")
def owner_of(firsts: wp.uint64, k: int) -> int:
    """The lane to which number k of the warp belongs; firsts: address of the first number of each lane, 32 bits."""


@wp.func_native("""
    unsigned int* word = reinterpret_cast<unsigned int*>(address) + k / 32u;
#ifdef __CUDA_ARCH__
    atomicOr(word, 1u << (k % 32u));
#else
    *word |= 1u << (k % 32u);
#endif
""")
def mark_bit(address: wp.uint64, k: wp.uint32):
    """Set bit k from an address on."""


@wp.func_native("""
    return (reinterpret_cast<const unsigned int*>(address)[k / 32u] >> (k % 32u)) & 1u;
""")
def is_bit(address: wp.uint64, k: wp.uint32) -> wp.bool:
    """Whether bit k from an address on is set."""


@wp.func_native("""
    const unsigned int word = reinterpret_cast<const unsigned int*>(address)[k / 32u];
    const unsigned int bits = word & (0xffffffffu >> (31u - k % 32u));
#ifdef __CUDA_ARCH__
    return __popc(bits);
#else
    return __builtin_popcount(bits);
#endif
""")
def bits_to(address: wp.uint64, k: wp.uint32) -> int:
    """How many bits are set from an address on, of the 32 to which bit k belongs, up to it."""


@wp.func_native("""
    return reinterpret_cast<const wp::int64*>(address)[i];
""")
def long_at(address: wp.uint64, i: int) -> wp.int64:
    """64 bits number i from an address on, as an integer."""


@wp.func_native("""
    reinterpret_cast<wp::int64*>(address)[i] = x;
""")
def set_long(address: wp.uint64, i: int, x: wp.int64):
    """Write 64 bits number i from an address on, as an integer."""


@wp.func_native("""
    const double* x = reinterpret_cast<const double*>(address) + i;
    return wp::vec_t<3, double>(x[0], x[1], x[2]);
""")
def vec3d_at(address: wp.uint64, i: int) -> wp.vec3d:
    """A vector of the 64 bits number i and those that follow."""


@wp.func_native("""
    double* y = reinterpret_cast<double*>(address) + i;
    y[0] = x[0], y[1] = x[1], y[2] = x[2];
""")
def set_vec3d(address: wp.uint64, i: int, x: wp.vec3d):
    """Write a vector as the 64 bits number i and those that follow."""


def threads_for(device: Any, count: int) -> int:
    """Threads for so many items, whole warps on a GPU."""
    return count if device.is_cpu else -(-count // BLOCK) * BLOCK


def claiming_lanes(device: Any, places: int, blocks: int) -> int:
    """Lanes to launch to take the places of a list: of as many blocks as the device holds, or one lane a place.

    blocks: that a processor of a GPU holds.
    """
    if device.is_cpu:
        return places
    return BLOCK * min(blocks * device.sm_count, -(-places // BLOCK))


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
