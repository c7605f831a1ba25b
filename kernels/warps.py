"""Warps: 32 threads of a GPU that run in step and share out what one of them has much of; on a CPU one thread alone.

Each lane counts what it has, all together number it through (`sums_of_warp`), and then lane k takes number k, k + 32
and so on, whichever lane that belongs to. What others need for it lies in memory of the warp. Functions that a whole
warp calls are called by each lane that has not ended.
"""

from typing import Any

import warp as wp

from .offsets import BLOCK

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
def lanes_of_warp() -> int:
    """Number of lanes of a warp."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    __syncwarp();
#endif
""")
def sync_warp():
    """Wait for all lanes of the warp; what they wrote before can be read after."""


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
    return reinterpret_cast<const int*>(address)[i];
""")
def half_word_at(address: wp.uint64, i: int) -> int:
    """32 bits number i from an address on."""


@wp.func_native("""
    reinterpret_cast<int*>(address)[i] = x;
""")
def set_half_word(address: wp.uint64, i: int, x: int):
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


def threads_for(device: Any, rows: int) -> int:
    """Threads for so many rows, whole warps on a GPU."""
    return rows if device.is_cpu else -(-rows // BLOCK) * BLOCK
