"""The loops in which planes cut a closed surface of few vertices, for each set of vertices that lie above the plane.

Such a set is a pattern: bit v is set if vertex v is above. A pattern alone decides which edges the plane crosses and
how triangles join the crossings to loops. So all walks are done once, when the table is made.
"""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..patch import Frame, above, patch_coordinates
from ..section.half_edges import HalfEdges, pad_to_vec4
from ..section.triangle_walk import Crossing, load_vec4, vertex_of

VERTICES_MOST = 12  # 4096 patterns
FACES_MOST = 44  # of 12 vertices that are joined two by two; checked first, since numbering vertices takes time
CROSSINGS_MOST = 32  # of a pattern: a section's crossings are bits of one word
NEVER = np.iinfo(np.int32).max

# A crossing in 23 bits, from the lowest: numbers of the vertices above and below the plane; the next crossing of its
# loop; its key, the rank of its half-edge among the pattern's crossings; and, in the place of crossing k, the crossing
# whose key is k.
LOWER, NEXT, KEY, PLACE = (wp.constant(bit) for bit in (4, 8, 13, 18))
VERTEX_BITS, CROSSING_BITS = wp.constant(15), wp.constant(31)


@wp.struct
class LoopTable:
    """Crossings of all patterns on a device; those of a pattern are loop by loop, as contours are numbered."""

    vertex: wp.array[wp.vec4]  # [m], shape [vertex]
    start: wp.array[wp.int32]  # offsets of each pattern's crossings, shape [pattern + 1]
    crossing: wp.array[wp.int32]  # packed, see LOWER .. PLACE
    reach: wp.float32  # `Surface.reach` [m]


class PatternLoops(NamedTuple):
    """Crossings of all patterns on the host."""

    vertex: np.ndarray  # numbers of the vertices in the surface's, shape [vertex]
    start: np.ndarray  # int32, shape [pattern + 1]
    half: np.ndarray  # half-edges that run down through the plane, int64, shape [crossing]
    onward: np.ndarray  # the next crossing of the loop, counted in its pattern; int64, shape [crossing]


def loops_of(surface: HalfEdges) -> PatternLoops | None:
    """Loops of each pattern; None for an open surface, and for one with too many vertices, triangles or crossings.

    Each loop begins with its crossing of lowest rank (`HalfEdges.rank`) on a scanned edge, and loops are in the order
    of these ranks, as the search along the scan path gives them.
    """
    if len(surface.faces) > FACES_MOST or surface.open_count:
        return None
    vertex, tail = np.unique(surface.faces, return_inverse=True)
    if len(vertex) > VERTICES_MOST:
        return None
    above = (np.arange(2 ** len(vertex))[:, None] >> np.arange(len(vertex))) & 1 == 1
    faces = tail.reshape(-1, 3)
    down = above[:, faces.ravel()] & ~above[:, np.roll(faces, -1, axis=1).ravel()]
    count = down.sum(axis=1)
    if count.max() > CROSSINGS_MOST:
        return None
    half, onward = walk_patterns(surface, down, above[:, np.roll(faces, 1, axis=1).ravel()])
    present = np.arange(half.shape[1]) < count[:, None]
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return PatternLoops(vertex, start, half[present], onward[present])


def walk_patterns(surface: HalfEdges, down: np.ndarray, third_above: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half-edges of each pattern's crossings in order, and the place of the next one; shape [pattern, crossing].

    down: whether a half-edge runs down through the plane; third_above: whether its triangle's other vertex is above;
    shape [pattern, half].
    """
    half = np.arange(len(surface.twin))
    after, before = half - half % 3 + (half + 1) % 3, half - half % 3 + (half + 2) % 3
    leads_to = surface.twin[np.where(third_above, after, before)]
    rank = np.where(down & surface.scanned, surface.rank, NEVER)
    pattern, most = np.arange(len(down)), int(down.sum(axis=1).max())
    out, onward = np.zeros((len(down), most), np.int64), np.zeros((len(down), most), np.int64)
    first = at = rank.argmin(axis=1)
    begin = np.zeros(len(down), np.int64)
    for place in range(most):
        out[:, place] = at
        rank[pattern, at] = NEVER
        at = leads_to[pattern, at]
        ends = at == first
        onward[:, place] = np.where(ends, begin, place + 1)
        first = np.where(ends, rank.argmin(axis=1), first)
        at = np.where(ends, first, at)
        begin = np.where(ends, place + 1, begin)
    return out, onward


def packed_crossings(surface: HalfEdges, loops: PatternLoops) -> np.ndarray:
    """Crossings as `LoopTable.crossing` has them, int32."""
    number = np.searchsorted(loops.vertex, surface.ends[loops.half])
    pattern = np.repeat(np.arange(len(loops.start) - 1), np.diff(loops.start))
    begin = loops.start[pattern]
    order = np.lexsort((loops.half, pattern))
    key = np.empty_like(order)
    key[order] = np.arange(len(order))
    fields = (number[:, 0], number[:, 1] << LOWER, loops.onward << NEXT, key - begin << KEY, order - begin << PLACE)
    return np.sum(fields, axis=0).astype(np.int32)


def upload_loop_table(surface: HalfEdges, device: str) -> Any:
    """The LoopTable of a surface on a device; None if it has none (`loops_of`)."""
    loops = loops_of(surface)
    if loops is None:
        return None
    out = LoopTable()
    out.vertex = wp.array(pad_to_vec4(surface.vertices[loops.vertex]), dtype=wp.vec4, device=device)
    out.start = wp.array(loops.start, dtype=wp.int32, device=device)
    out.crossing = wp.array(packed_crossings(surface, loops), dtype=wp.int32, device=device)
    out.reach = float(np.abs(surface.vertices).sum(axis=1).max())
    return out


@wp.func_native("""
#ifdef __CUDA_ARCH__
    __shared__ double shared[3 * 12 * 64];  // VERTICES_MOST, BLOCK; a thread reads what it wrote itself
    double* at = shared + 3 * 64 * v + threadIdx.x;
    const int step = 64;
#else
    double* at = memory.data + 3 * v;
    const int step = 1;
#endif
    if (writes) {
        at[0] = x[0];
        at[step] = x[1];
        at[2 * step] = x[2];
    }
    return wp::vec_t<3, wp::float64>(at[0], at[step], at[2 * step]);
""")
def remember(memory: wp.array[wp.float64], v: int, x: wp.vec3d, writes: bool) -> wp.vec3d:
    """Write a vertex into a thread's memory if `writes`; returns the one that is there. A GPU's is shared memory."""


def room_to_remember(device: Any) -> wp.array | None:
    """A launch's memory for `remember`: a CPU computes one section after another, and a GPU has shared memory."""
    return wp.empty(3 * VERTICES_MOST, dtype=wp.float64, device=device) if device.is_cpu else None


@wp.func
def place_vertices(table: LoopTable, f: Frame, memory: wp.array[wp.float64]):
    """Remember all vertices in the patch's frame [m]; returns the pattern of those above the plane."""
    pattern = int(0)
    for v in range(table.vertex.shape[0]):
        x = remember(memory, v, patch_coordinates(f, vertex_of(load_vec4(table.vertex, v))), True)
        pattern = pattern | (wp.where(above(x[2]), 1, 0) << v)
    return pattern


@wp.func
def next_of(packed: int):
    """The crossing after a packed one in its loop."""
    return (packed >> NEXT) & CROSSING_BITS


@wp.func
def crossing_of(memory: wp.array[wp.float64], packed: int):
    """A packed crossing of remembered vertices."""
    c = Crossing()
    c.upper = remember(memory, packed & VERTEX_BITS, wp.vec3d(), False)
    c.lower = remember(memory, (packed >> LOWER) & VERTEX_BITS, wp.vec3d(), False)
    return c
