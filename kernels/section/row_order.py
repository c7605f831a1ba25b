"""Rows of a block in the order of their lengths: threads of a warp then take rows that are about as long.

A block of LANES threads takes `rounds` times as many rows. All its threads call, in this order: `begin_order`;
`note_length` for one row a round; `end_order`; and `row_in_order`, round by round. On a CPU a block is one thread that
takes one row.
"""

from typing import Any

import warp as wp

from ..lanes import LANES, lane_count

ROUNDS_MOST = 8  # of a block: its rows split into 16 groups of about equal lengths
BLOCKS_OF_PROCESSOR = 64  # that a multiprocessor of a GPU gets at least, if there are enough rows for several rounds
BINS = LANES  # of lengths; each lane adds up those before one bin
STEP = 2  # lengths of a bin
SPACE = 2 * BINS + 2 * LANES * ROUNDS_MOST  # words of 32 bits: bins, where they start, bin and place of rows, order


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    __shared__ int space[{SPACE}];
    space[threadIdx.x] = 0;
    __syncthreads();
    return reinterpret_cast<wp::uint64>(space);
#else
    return 0;
#endif
""")
def begin_order() -> wp.uint64:
    """Begin to order a block's rows; returns the address of the order."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    int* space = reinterpret_cast<int*>(order);
    const int bin = {BINS - 1} - min(max(length, 0) / {STEP}, {BINS - 1});  // the longest rows first
    space[{2 * BINS} + i] = bin << 16 | atomicAdd(space + bin, 1);
#endif
""")
def note_length(order: wp.uint64, i: int, length: int):
    """Note the length of row i of the block."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    int* space = reinterpret_cast<int*>(order);
    __syncthreads();
    int before = 0;
    for (int bin = 0; bin < {BINS}; ++bin)
        before += bin < static_cast<int>(threadIdx.x) ? space[bin] : 0;
    space[{BINS} + threadIdx.x] = before;
    __syncthreads();
    for (int k = 0; k < rounds; ++k) {{
        const int i = k * {LANES} + threadIdx.x, noted = space[{2 * BINS} + i];
        space[{2 * BINS + LANES * ROUNDS_MOST} + space[{BINS} + (noted >> 16)] + (noted & 0xffff)] = i;
    }}
    __syncthreads();
#endif
""")
def end_order(order: wp.uint64, rounds: int):
    """Order the block's rows."""


@wp.func_native(f"""
#ifdef __CUDA_ARCH__
    const int lane = threadIdx.x ^ (round & 1 ? {LANES // 2} : 0);  // each warp has the longer rows every other time
    return reinterpret_cast<const int*>(order)[{2 * BINS + LANES * ROUNDS_MOST} + round * {LANES} + lane];
#else
    return round;
#endif
""")
def row_in_order(order: wp.uint64, round: int) -> int:
    """Row of the block that the thread takes in a round."""


def rounds_for(row_count: int, device: Any) -> int:
    """How many rows a thread takes: several only if there are enough rows to fill the device all the same."""
    if device.is_cpu:
        return 1
    return max(1, min(ROUNDS_MOST, row_count // (LANES * BLOCKS_OF_PROCESSOR * device.sm_count)))


def thread_count(row_count: int, rounds: int, device: Any) -> int:
    """Threads that take so many rows, in whole blocks."""
    if device.is_cpu:
        return row_count
    return -(-row_count // (LANES * rounds)) * LANES


def ordered_threads(row_count: int, device: Any, inputs: list) -> dict[str, Any]:
    """Arguments of a launch whose blocks order their rows: number of threads, and inputs, to which lanes of a block and
    rounds are added."""
    rounds = rounds_for(row_count, device)
    return {"dim": thread_count(row_count, rounds, device), "inputs": [*inputs, lane_count(device), rounds]}
