"""Walk contours from cell to cell over bits: which edges a section's polylines pass, in order.

A step is known by the node to its right, which is outside, and its direction; the node to its left is inside. Only bits
are read here, so this is the same for every field.

    left ahead   right ahead    goes
    outside      outside        left
    inside       outside        straight on
    inside       inside         right
    outside      inside         right if the cell's middle is inside, else left
"""

from typing import NamedTuple

import warp as wp

from ..offsets import launch
from ..patch import EXACT
from ..section.draw import HAND
from .grid import TILE_HEIGHT, TILE_WIDTH, Grid, Grids, is_inside, rim_count, rim_node
from .sample import ALONG_U, ALONG_V, AT_NODE, NO_POINT, Samples, parts_of

wp.set_module_options(EXACT)

# Directions, counter-clockwise: +u, +v, -u, -v.
DOWN = wp.constant(3)


class Trails(NamedTuple):
    """Points of polylines in order, without their places; a section's slots without a point come last."""

    code: wp.array  # see march_sample, int32, shape [slot]
    after: wp.array  # the next point; at a polyline's end its first one, as ~first if it is open; int32 [slot]
    section: wp.array  # of the chunk, int32 [slot]


@wp.struct
class Cells:
    """One section's bits."""

    bits: wp.array[wp.uint8]
    saddle: wp.array[wp.uint8]
    start: wp.array[wp.uint8]  # edges along u from outside to inside that were not passed yet
    start_word: wp.array[wp.uint32]  # the same memory, tile by tile
    base: int  # the section's first byte
    grid: Grid


@wp.struct
class Step:
    """A cut edge about to be crossed, inside to the left."""

    i: int  # node to its right
    j: int
    heading: int  # see `ahead`
    slot: int  # where its point goes


@wp.func
def ahead(heading: int):
    """A direction as a step between nodes; to its left lies (-y, x)."""
    x = int(0)
    y = int(0)
    if heading == 0:
        x = 1
    elif heading == 1:
        y = 1
    elif heading == 2:
        x = -1
    else:
        y = -1
    return wp.vec2i(x, y)


@wp.func
def code_of(cells: Cells, s: Step):
    """Code of a step's point, of the object's kind."""
    m = ahead(s.heading)
    node = wp.min(s.j, s.j + m[0]) * (cells.grid.nu + 1) + wp.min(s.i, s.i - m[1])
    if m[0] == 0:
        return 8 * node + ALONG_U
    return 8 * node + ALONG_V


@wp.func
def leaves(cells: Cells, s: Step):
    """Whether a step leads out of the grid."""
    m = ahead(s.heading)
    i = s.i + m[0]
    j = s.j + m[1]
    return i < 0 or j < 0 or i > cells.grid.nu or j > cells.grid.nv


@wp.func
def step_after(cells: Cells, s: Step):
    """The step out of the cell that a step leads into."""
    m = ahead(s.heading)
    left = wp.vec2i(s.i - m[1], s.j + m[0])
    right_in = is_inside(cells.bits, cells.base, cells.grid, s.i + m[0], s.j + m[1])
    left_in = is_inside(cells.bits, cells.base, cells.grid, left[0] + m[0], left[1] + m[1])
    goes_right = right_in and left_in
    if right_in and not left_in:
        i = wp.min(wp.min(s.i, s.i + m[0]), wp.min(left[0], left[0] + m[0]))
        j = wp.min(wp.min(s.j, s.j + m[1]), wp.min(left[1], left[1] + m[1]))
        goes_right = is_inside(cells.saddle, cells.base, cells.grid, i, j)
    n = Step()
    n.slot = s.slot + 1
    n.i = s.i
    n.j = s.j
    if goes_right:
        n.heading = (s.heading + 3) % 4
    elif left_in:
        n.heading = s.heading
        n.i = s.i + m[0]
        n.j = s.j + m[1]
    else:
        n.heading = (s.heading + 1) % 4
        n.i = left[0] + m[0]
        n.j = left[1] + m[1]
    return n


@wp.func
def write_step(cells: Cells, s: Step, code: wp.array[wp.int32], after: wp.array[wp.int32]):
    """Write a step's point; no loop needs to start there any more."""
    code[s.slot] = code_of(cells, s)
    after[s.slot] = s.slot + 1
    if s.heading == DOWN:
        byte = cells.base + 4 * ((s.j >> 2) * cells.grid.across + (s.i >> 3)) + (s.j & 3)
        cells.start[byte] = wp.uint8(int(cells.start[byte]) & ~(1 << (s.i & 7)))


@wp.func
def walk_piece(cells: Cells, first: Step, code: wp.array[wp.int32], after: wp.array[wp.int32]):
    """Walk from a step to where it leaves the grid, which is the step returned, or around to where it began."""
    s = first
    write_step(cells, s, code, after)
    while not leaves(cells, s):
        n = step_after(cells, s)
        if n.i == first.i and n.j == first.j and n.heading == first.heading:
            break
        s = n
        write_step(cells, s, code, after)
    return s


@wp.func
def rim_inside(cells: Cells, k: int):
    """Whether node k of the boundary is inside."""
    node = rim_node(cells.grid, k)
    return is_inside(cells.bits, cells.base, cells.grid, node[0], node[1])


@wp.func
def step_inward(cells: Cells, k: int, slot: int):
    """The step inward across edge k of the boundary, from inside at node k to outside at the next."""
    node = rim_node(cells.grid, (k + 1) % rim_count(cells.grid))
    s = Step()
    s.i = node[0]
    s.j = node[1]
    s.slot = slot
    s.heading = 1
    if k >= cells.grid.nu:
        s.heading = 2
    if k >= cells.grid.nu + cells.grid.nv:
        s.heading = 3
    if k >= 2 * cells.grid.nu + cells.grid.nv:
        s.heading = 0
    return s


@wp.func
def rim_edge(cells: Cells, s: Step):
    """Edge of the boundary that a step out of the grid crosses."""
    g = cells.grid
    if s.heading == DOWN:
        return s.i
    if s.heading == 0:
        return g.nu + s.j
    if s.heading == 1:
        return 2 * g.nu + g.nv - s.i
    return rim_count(g) - s.j


@wp.func
def is_corner(grid: Grid, k: int):
    """Whether node k of the boundary is a corner of the patch."""
    return k == 0 or k == grid.nu or k == grid.nu + grid.nv or k == 2 * grid.nu + grid.nv


@wp.func
def write_corner(grid: Grid, k: int, slot: int, code: wp.array[wp.int32], after: wp.array[wp.int32]):
    """Write a corner's point; the boundary goes on from it."""
    node = rim_node(grid, k)
    code[slot] = 8 * (node[1] * (grid.nu + 1) + node[0]) + AT_NODE + HAND
    after[slot] = slot + 1


@wp.func
def walk_rim(cells: Cells, out: Step, code: wp.array[wp.int32], after: wp.array[wp.int32]):
    """Along the boundary from where a piece leaves to where the next one enters: (that edge, next free slot)."""
    code[out.slot] = code[out.slot] + HAND
    count = rim_count(cells.grid)
    slot = out.slot + 1
    k = (rim_edge(cells, out) + 1) % count
    while rim_inside(cells, k):
        if is_corner(cells.grid, k):
            write_corner(cells.grid, k, slot, code, after)
            slot += 1
        k = (k + 1) % count
    return wp.vec2i((k + count - 1) % count, slot)


@wp.func
def walk_from_rim(
    cells: Cells,
    edge: int,
    first: int,
    closes: int,
    rim: wp.array[wp.uint8],
    rim_base: int,
    code: wp.array[wp.int32],
    after: wp.array[wp.int32],
):
    """A polyline that enters across an edge of the boundary, from slot `first` on; returns the next free slot."""
    k = edge
    slot = first
    while True:
        out = walk_piece(cells, step_inward(cells, k, slot), code, after)
        slot = out.slot + 1
        if closes == 0:
            after[out.slot] = ~first
            break
        reached = walk_rim(cells, out, code, after)
        k = reached[0]
        slot = reached[1]
        if k == edge:
            after[slot - 1] = first
            break
        rim[rim_base + (k >> 3)] = wp.uint8(int(rim[rim_base + (k >> 3)]) | (1 << (k & 7)))
    return slot


@wp.func
def walk_loops(cells: Cells, tiles: int, first: int, code: wp.array[wp.int32], after: wp.array[wp.int32]):
    """Polylines that do not meet the boundary, tile by tile; returns the next free slot."""
    slot = first
    for t in range(tiles):
        tile = cells.base // TILE_HEIGHT + t
        while cells.start_word[tile] != wp.uint32(0):
            k = int(0)
            while ((cells.start_word[tile] >> wp.uint32(k)) & wp.uint32(1)) == wp.uint32(0):
                k += 1
            s = Step()
            s.i = TILE_WIDTH * (t % cells.grid.across) + k % TILE_WIDTH
            s.j = TILE_HEIGHT * (t // cells.grid.across) + k // TILE_WIDTH
            s.heading = DOWN
            s.slot = slot
            last = walk_piece(cells, s, code, after)
            after[last.slot] = slot
            slot = last.slot + 1
    return slot


@wp.kernel
def _walk_sections(
    # In:
    bits: wp.array[wp.uint8],
    saddle: wp.array[wp.uint8],
    grid: wp.array[Grid],
    tiles_of_hand: int,
    rim_bytes: int,
    cut_start: wp.array[wp.int32],
    closes: int,  # 1: CC, 0: OC
    # In and out:
    start: wp.array[wp.uint32],  # where loops are yet to start; cleared
    start_bytes: wp.array[wp.uint8],  # the same memory
    rim: wp.array[wp.uint8],  # zero-initialised: edges of the boundary across which a polyline has entered
    # Out:
    code: wp.array[wp.int32],
    after: wp.array[wp.int32],
    section: wp.array[wp.int32],
):
    """Write a section's polylines: those that meet the boundary, loops, at last the boundary itself."""
    row = wp.tid()
    pose = row // grid.shape[0]
    cells = Cells()
    cells.bits = bits
    cells.saddle = saddle
    cells.start = start_bytes
    cells.start_word = start
    cells.grid = grid[row % grid.shape[0]]
    cells.base = TILE_HEIGHT * (pose * tiles_of_hand + cells.grid.tile)
    rim_base = pose * rim_bytes + cells.grid.rim
    slot = cut_start[row]
    first = int(slot)
    stop = cut_start[row + 1]
    if stop - slot > 4 * closes:
        inside = rim_inside(cells, 0)
        for k in range(rim_count(cells.grid)):
            next_inside = rim_inside(cells, (k + 1) % rim_count(cells.grid))
            if inside and not next_inside and (int(rim[rim_base + (k >> 3)]) >> (k & 7)) & 1 == 0:
                slot = walk_from_rim(cells, k, slot, closes, rim, rim_base, code, after)
            inside = next_inside
        tiles = cells.grid.across * (cells.grid.nv // TILE_HEIGHT + 1)
        met = slot > first
        slot = walk_loops(cells, tiles, slot, code, after)
        if met:
            first = NO_POINT
    if closes == 1 and first != NO_POINT and rim_inside(cells, 0):
        begin = int(slot)
        for k in range(rim_count(cells.grid)):
            if is_corner(cells.grid, k):
                write_corner(cells.grid, k, slot, code, after)
                slot += 1
        after[slot - 1] = begin
    for k in range(cut_start[row], stop):
        section[k] = row
        if k >= slot:
            code[k] = NO_POINT


def walk_sections(samples: Samples, grids: Grids, slot_count: int, *, closes: bool) -> Trails:
    """Walk the polylines of a chunk of sections; `samples.start` is used up. slot_count: what cut_start ends with."""
    device = samples.bits.device
    section_count = samples.cut_start.shape[0] - 1
    rim_size = section_count // grids.grid.shape[0] * grids.rim_bytes
    trails = Trails(*(wp.empty(slot_count, dtype=wp.int32, device=device) for _ in Trails._fields))
    launch(
        _walk_sections,
        section_count,
        [
            parts_of(samples.bits),
            parts_of(samples.saddle),
            grids.grid,
            grids.patch_of.shape[0],
            grids.rim_bytes,
            samples.cut_start,
            int(closes),
            samples.start,
            parts_of(samples.start),
            wp.zeros(rim_size, dtype=wp.uint8, device=device),
        ],
        [*trails],
    )
    return trails
