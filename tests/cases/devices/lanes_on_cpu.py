"""Kernels' branches for GPUs on a CPU: each lane is a fiber, which runs until it waits for others.

Intrinsics and PTX of native functions become C++ of the same meaning (CUDA C++ Programming Guide; PTX ISA). A GPU may
run its lanes in any order between two waits. Here the order is rising or falling: a lane that does not wait for what
another one writes reads it too early in one of the two.
"""

import importlib
import mmap
import pkgutil
import re
import sys
from ctypes import CDLL, c_int, c_size_t, c_void_p
from types import SimpleNamespace

import warp as wp
from warp._src import codegen  # its template gives lanes their order

import palpate.kernels.section
from palpate.kernels.section import lanes

GPU = SimpleNamespace(is_cpu=False, is_cuda=True, sm_count=1)
ASKED = ("lane_count", "group_count", "threads_for", "claiming_lanes", "lists_steps")
"""Functions of the house that ask a device how many lanes it has."""

INDEX = "payload->block_first + (size_t)lane;"
ORDERS = {
    "rising": ("wp_cpu_get_thread_idx()", INDEX),
    "falling": (
        "WP_TILE_BLOCK_DIM - 1 - wp_cpu_get_thread_idx()",
        "payload->block_first - 1 - lane"
        "+ wp::min((wp::uint64)WP_TILE_BLOCK_DIM, (wp::uint64)(dim->size - payload->block_first));",
    ),
}
"""By the order in which lanes run: a lane's number in its block, and its number in all, in C++."""

NEAR = 0x20000000
"""Address of 64 KiB that stand for a block's shared memory, which PTX addresses with 32 bits."""

INTRINSICS = """
    struct Lanes {
        static int own() { return OWN_LANE; }
        static void wait(int group, int size) {
            static int arrived[33], turn[33];
            const int now = turn[group];
            if (++arrived[group] == size) {
                arrived[group] = 0;
                ++turn[group];
            }
            for (long k = 0; turn[group] == now; ++k) {
                if (k > 1000000) __builtin_trap();  // a lane waits for one that never comes
                wp_cpu_tile_sync();
            }
        }
        static void warp() { wait(own() / 32, 32); }
        static void block() { wait(32, wp_cpu_get_active_count()); }
        static int* told() {
            static int x[1024];
            return x;
        }
        static int from(int x, int lane) {
            told()[own()] = x;
            warp();
            const int y = told()[own() / 32 * 32 + lane];
            warp();
            return y;
        }
        static int below(int x, unsigned k) {
            const unsigned lane = own() % 32;
            return from(x, lane < k ? lane : lane - k);
        }
        static unsigned ballot(int vote) {
            told()[own()] = vote != 0;
            warp();
            unsigned votes = 0;
            for (int k = 0; k < 32; ++k)
                votes |= static_cast<unsigned>(told()[own() / 32 * 32 + k]) << k;
            warp();
            return votes;
        }
        static int any(int vote) {
            static int votes;
            block();
            votes = 0;
            block();
            votes |= vote != 0;
            block();
            return votes;
        }
        static int add(int* at, int x) {
            const int before = *at;
            *at += x;
            return before;
        }
        static unsigned left(unsigned low, unsigned high, unsigned k) {
            return ((static_cast<wp::uint64>(high) << 32 | low) << (k & 31)) >> 32;
        }
        static unsigned right(unsigned low, unsigned high, unsigned k) {
            return (static_cast<wp::uint64>(high) << 32 | low) >> (k & 31);
        }
        static unsigned bytes(unsigned low, unsigned high, unsigned which) {
            unsigned x = 0;
            for (int k = 0; k < 4; ++k)
                x |= ((static_cast<wp::uint64>(high) << 32 | low) >> (8 * (which >> (4 * k) & 7)) & 255) << (8 * k);
            return x;
        }
        static float as_float(unsigned x) { return reinterpret_cast<float&>(x); }
        static unsigned as_bits(float x) { return reinterpret_cast<unsigned&>(x); }
    };
    struct int4 { int x, y, z, w; };
    struct float4 { float x, y, z, w; };
    struct { unsigned x; } threadIdx{static_cast<unsigned>(Lanes::own())};
    (void)threadIdx;
#define __shared__ static
#define __align__(k) __attribute__((aligned(k)))
#define __syncwarp() Lanes::warp()
#define __syncthreads() Lanes::block()
#define __syncthreads_or(vote) Lanes::any(vote)
#define __ballot_sync(mask, vote) Lanes::ballot(vote)
#define __shfl_sync(mask, x, lane) Lanes::from(x, lane)
#define __shfl_up_sync(mask, x, k) Lanes::below(x, k)
#define __ldg(at) (*(at))
#define __popc(x) __builtin_popcount(x)
#define __ffs(x) __builtin_ffs(x)
#define __funnelshift_l(low, high, k) Lanes::left(low, high, k)
#define __funnelshift_r(low, high, k) Lanes::right(low, high, k)
#define __byte_perm(low, high, which) Lanes::bytes(low, high, which)
#define __int_as_float(x) Lanes::as_float(x)
#define __float_as_uint(x) Lanes::as_bits(x)
#define atomicAdd(at, x) Lanes::add(at, x)
#define atomicOr(at, x) (*(at) |= (x))
#define fmaf(a, b, c) static_cast<float>(static_cast<double>(a) * (b) + (c))
#define __cvta_generic_to_shared(at) (NEAR_MEMORY + reinterpret_cast<size_t>(at) - reinterpret_cast<size_t>(near))
""".replace("NEAR_MEMORY", f"{NEAR}")

PTX = {
    "": "",  # only says where a number is kept
    "mov.u32 %0, %%lanemask_lt;": "%0 = (1u << threadIdx.x % 32u) - 1u;",
    "lop3.b32 %0, %1, %2, 0, 0x03;": "%0 = ~(%1 | %2);",
    "st.shared.u32 [%0], %1;": "*reinterpret_cast<unsigned*>(static_cast<size_t>(%0)) = %1;",
    "ld.shared.u32 %0, [%1];": "%0 = *reinterpret_cast<unsigned*>(static_cast<size_t>(%1));",
    "st.global.v2.s32 [%0], {%1, %2};": "*(%0) = wp::vec_t<2, int>(%1, %2);",
    "{.reg .pred p; setp.ne.s32 p, %2, 0; @p st.global.b64 [%0], %1;}": "if (%2) *(%0) = %1;",
}
"""PTX of native functions, and C++ of the same meaning."""

ASM = re.compile(r'asm(?: volatile)?\("([^"]*)"([^;]*)\);')
OPERAND = re.compile(r'"[=+]?[a-z]"\(((?:[^()]|\([^()]*\))*)\)')


def as_cpp(asm):
    """C++ of one asm statement; KeyError if no meaning of its PTX is known."""
    operands = OPERAND.findall(asm[2])
    return re.sub(r"%(\d)", lambda number: operands[int(number[1])], PTX[asm[1]])


def source_for_cpu(source, own):
    """A native function's branch for GPUs, for lanes on a CPU; own: this lane's number in its block."""
    return INTRINSICS.replace("OWN_LANE", own) + ASM.sub(as_cpp, source).replace("#ifdef __CUDA_ARCH__", "#if 1")


def modules():
    """The modules whose kernels have lanes."""
    section = palpate.kernels.section
    for found in pkgutil.iter_modules(section.__path__, f"{section.__name__}."):
        importlib.import_module(found.name)
    return [module for name, module in sys.modules.items() if name.startswith(section.__name__)]


def map_near_memory():
    """Take the addresses from NEAR on."""
    libc = CDLL(None)
    libc.mmap.restype, libc.mmap.argtypes = c_void_p, [c_void_p, c_size_t, c_int, c_int, c_int, c_size_t]
    fixed = 0x100000  # MAP_FIXED_NOREPLACE, for which mmap has no name
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | fixed
    taken = libc.mmap(NEAR, 2**16, mmap.PROT_READ | mmap.PROT_WRITE, flags, -1, 0)
    if taken != NEAR:
        raise OSError(f"the memory from {NEAR:#x} on is taken")


def emulate_lanes(order):
    """Let kernels of this process run their branches for GPUs on the CPU, in blocks of fibers; order: see ORDERS."""
    own, index = ORDERS[order]
    template = codegen.cpu_block_module_template_forward
    if INDEX not in template:
        raise ValueError(f"this version of Warp does not give lanes their index by {INDEX}")
    codegen.cpu_block_module_template_forward = template.replace(INDEX, index)
    wp.config.enable_cpu_blocks = True
    map_near_memory()
    for module in modules():
        for name, x in list(vars(module).items()):
            if name in ASKED and module is not lanes:  # tests call its functions as they are
                setattr(module, name, lambda device, *rest, ask=x: ask(GPU, *rest))
            source = getattr(x, "native_snippet", None)
            if source and "__CUDA_ARCH__" in source:
                x.native_snippet = source_for_cpu(source, own)
