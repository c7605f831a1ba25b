"""Scans of a closed surface in float32: steps of the scan path that cross the plane, noted as bits of a few words.

A walk clears the bits of the crossings that it passes, and the next loop begins at the lowest bit that is still set.
On larger surfaces neighbouring steps share a bit. So a walk may clear the bit of a crossing that it does not pass. Then
the loops pass fewer crossings than the scan counted, or one of them passes a lower bit than that of its first crossing.
Such a section is left to float64.
"""

from typing import Any

import warp as wp

from ..offsets import BLOCK
from .edge_pairing import OPEN
from .half_edges import SCAN_WORDS, Surface
from .triangle_walk import load_vec4, vertex_of

ALL = wp.constant(wp.uint32(0xFFFFFFFF))
NONE_SET = wp.constant(wp.uint32(0))


@wp.struct
class Scans:
    """Scans of queries, and those whose planes cross the surface. Word k of query q has index q * stride + k * step."""

    word: wp.array[wp.uint32]
    stride: wp.int64
    step: wp.int64
    listed: wp.array[wp.vec2i]  # queries that have crossings, and how many, in any order, shape [query]
    count: wp.array[wp.int32]  # number of these queries, zero-initialised, shape [1]
    claimed: wp.array[wp.int32]  # how many of them lanes of a GPU have claimed, zero-initialised, shape [1]


@wp.struct
class Float32Scan:
    """Result of a scan."""

    count: int  # crossings
    least: float  # smallest distance of a vertex from the plane [m]


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return fmaf(a[0], b[0], fmaf(a[1], b[1], fmaf(a[2], b[2], c)));
#else
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + c;
#endif
""")
def float32_sum(a: wp.vec3, b: wp.vec3, c: float) -> float:
    """About the scalar product of a and b, plus c."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    asm volatile("" : "+f"(x));
#endif
    return x;
""")
def held(x: float) -> float:
    """The same number, which a GPU keeps, and does not convert from float64 again wherever it is used."""


@wp.func
def held_vec3(x: wp.vec3):
    """The same vector, as `held`."""
    return wp.vec3(held(x[0]), held(x[1]), held(x[2]))


@wp.func_native("""
    return (reinterpret_cast<const unsigned&>(a) ^ reinterpret_cast<const unsigned&>(b)) >> 31;
""")
def signs_differ(a: float, b: float) -> wp.uint32:
    """1 if one of two numbers is negative (-0 is), else 0."""


@wp.func_native("""
    const unsigned bit = reinterpret_cast<const unsigned&>(x.c[3]);
    const int apart = reinterpret_cast<const int&>(a) ^ reinterpret_cast<const int&>(b);
#ifdef __CUDA_ARCH__
    return apart < 0 ? bit : 0u;
#else
    return bit & static_cast<unsigned>(apart >> 31);  // no branch, which a CPU would often mispredict
#endif
""")
def bit_of_crossing(a: float, b: float, x: wp.vec4) -> wp.uint32:
    """The last number's bits if one of a and b is negative (-0 is) and the other is not, else 0."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __ffs(x) - 1;
#else
    return x ? __builtin_ctz(x) : -1;
#endif
""")
def lowest_bit(x: wp.uint32) -> int:
    """Number of the lowest bit that is set, -1 for none."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __funnelshift_l(0u, 1u, bit);  // masks the shift
#else
    return 1u << (bit & 31);
#endif
""")
def bit_in_word(bit: int) -> wp.uint32:
    """A number with one bit set, by its number from bit 0 of word 0 on."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    __shared__ unsigned int near[{SCAN_WORDS}][{BLOCK}];
    unsigned address = static_cast<unsigned>(__cvta_generic_to_shared(&near[0][threadIdx.x]));
    asm volatile("" : "+r"(address));  // computed once, not wherever it is used
    return address;
#else
    return reinterpret_cast<wp::uint64>(far.data + first);
#endif
""")
def address_of_words(far: wp.array[wp.uint32], first: wp.int64) -> wp.uint64:
    """Address of the words of the query that a lane walks.

    A GPU keeps such words near its lanes; a CPU changes those of `Scans`, where the query's first has index `first`.
    """


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    asm volatile("st.shared.u32 [%0], %1;" ::"r"(static_cast<unsigned>(address) + {4 * BLOCK} * k), "r"(x) : "memory");
#else
    reinterpret_cast<unsigned*>(address)[k] = x;
#endif
""")
def set_word(address: wp.uint64, k: int, x: wp.uint32):
    """Set word k of those of `address_of_words`."""


@wp.func_native(f"""
    unsigned x;
#ifdef __CUDA_ARCH__
    const unsigned at = static_cast<unsigned>(address) + {4 * BLOCK} * k;
    asm volatile("ld.shared.u32 %0, [%1];" : "=r"(x) : "r"(at) : "memory");
#else
    x = reinterpret_cast<unsigned*>(address)[k];
#endif
    return x;
""")
def get_word(address: wp.uint64, k: int) -> wp.uint32:
    """Word k of those of `address_of_words`."""


@wp.func
def fetch_words(surface: Surface, scans: Scans, query: int):
    """Fetch the words of a query to walk it; returns their address."""
    first = wp.int64(query) * scans.stride
    address = address_of_words(scans.word, first)
    for k in range(surface.scan_words):
        set_word(address, k, scans.word[first + wp.int64(k) * scans.step])
    return address


@wp.func
def clear_bit(address: wp.uint64, bit: int, passes: wp.bool):
    """Note in the words of a query that its walk passes a crossing, if it does."""
    k = bit >> 5
    set_word(address, k, get_word(address, k) & (ALL ^ wp.where(passes, bit_in_word(bit), NONE_SET)))


@wp.func
def lowest_left(surface: Surface, address: wp.uint64):
    """The lowest bit that is set in the words of a query; OPEN for none."""
    out = int(OPEN)
    k = int(0)
    while out == OPEN and k < surface.scan_words:
        low = lowest_bit(get_word(address, k))
        if low >= 0:
            out = 32 * k + low
        k += 1
    return out


@wp.func
def scan_height(n: wp.vec3, distance: float, x: wp.vec4):
    """Height of a vertex above the plane [m]."""
    return float32_sum(n, vertex_of(x), -distance)


@wp.func
def scan_in_float32(surface: Surface, n: wp.vec3, distance: float, scans: Scans, query: int):
    """Note and count the crossings of the scan path with a plane."""
    height = scan_height(n, distance, load_vec4(surface.scan_path, 0))
    least = wp.abs(height)
    count = int(0)
    size = 32 * surface.scan_group
    for k in range(surface.scan_words):
        word = wp.uint32(0)
        for i in range(k * size + 1, wp.min((k + 1) * size + 1, surface.scan_path.shape[0])):
            x = load_vec4(surface.scan_path, i)
            now = scan_height(n, distance, x)
            least = wp.min(least, wp.abs(now))
            bit = bit_of_crossing(now, height, x)
            word |= bit
            count += wp.where(bit != NONE_SET, 1, 0)
            height = now
        scans.word[wp.int64(query) * scans.stride + wp.int64(k) * scans.step] = word
    found = Float32Scan()
    found.count = count
    found.least = least
    return found


@wp.func
def half_at(surface: Surface, n: wp.vec3, distance: float, bit: int):
    """Half-edge of the first crossing among the steps of a bit, if `scan_in_float32` was sure; OPEN for none."""
    half = int(OPEN)
    i = bit * surface.scan_group
    stop = wp.min(i + surface.scan_group + 1, surface.scan_path.shape[0])
    height = scan_height(n, distance, load_vec4(surface.scan_path, i))
    i += 1
    while half == OPEN and i < stop:
        x = load_vec4(surface.scan_path, i)
        now = scan_height(n, distance, x)
        if signs_differ(now, height) != NONE_SET:
            half = surface.scan_path_half[i][wp.where(height > 0.0, 0, 1)]
        height = now
        i += 1
    return half


@wp.func_native("""
    const unsigned k = static_cast<unsigned>(rank);
    return (mask.data[k >> 5] >> (k & 31u)) & 1u;
""")
def is_marked(mask: wp.array[wp.uint32], rank: int) -> wp.bool:
    """Whether the scanned edge of that rank is marked as passed."""


@wp.func_native("""
    const unsigned k = static_cast<unsigned>(rank);
    mask.data[k >> 5] |= 1u << (k & 31u);
""")
def mark(mask: wp.array[wp.uint32], rank: int):
    """Mark the scanned edge of that rank as passed."""


def room_for_scans(surface: Any, query_count: int, counters: Any, device: Any) -> Any:
    """Memory for scans of queries; counters: two of int32, zero-initialised, shape [2]."""
    scans = Scans()
    words = surface.scan_words
    scans.stride, scans.step = (words, 1) if device.is_cpu else (1, query_count)
    scans.word = wp.empty(query_count * words, dtype=wp.uint32, device=device)
    scans.listed = wp.empty(query_count, dtype=wp.vec2i, device=device)
    scans.count, scans.claimed = counters[:1], counters[1:2]
    return scans
