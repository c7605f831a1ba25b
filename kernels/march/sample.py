"""Ask a field about the nodes of grids: which are inside, where cells are ambiguous, where an edge is cut.

Kernels are made for a field's functions and shared by all fields that have them. Each tile is asked about as a whole
first, if the field can answer (`Field.ball`); its nodes only if that does not classify the tile.
"""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..fields.field import MODULE, Field, ball_unknown, inside_function, made_once, root_function
from ..offsets import launch, offsets_of, scan_counts
from ..patch import EXACT, to_float32
from .grid import TILE_HEIGHT, TILE_WIDTH, Grid, Grids, Lattice, MovedNodes, is_done, node_at, place_of

wp.set_module_options(EXACT)

# Codes of points: 8 x node + what is there + kind of the segment that starts there.
ALONG_U = wp.constant(0)  # on the edge from the node to the next one along u
ALONG_V = wp.constant(2)
AT_NODE = wp.constant(4)  # a corner of the patch
NO_POINT = wp.constant(-1)

FULL = wp.constant(wp.uint32(0xFFFFFFFF))
FIRST_COLUMN = wp.constant(wp.uint32(0x01010101))
OTHER_COLUMNS = wp.constant(wp.uint32(0x7F7F7F7F))
NEAR_ALL = wp.constant(wp.float64(1.0 + 1e-6))  # of the distance of a tile's corners from its middle


class Samples(NamedTuple):
    """Signs of the nodes of a chunk of sections; bits of a tile are stored by the tile's number."""

    bits: wp.array  # uint32, shape [tile]: which nodes are inside
    saddle: wp.array  # uint32, shape [tile]: cells with inside at their middle, of those that are ambiguous
    start: wp.array  # uint32, shape [tile]: edges along u from outside to inside
    cut_start: wp.array  # offsets of the sections' cut edges, and `spare` each, int32, shape [section + 1]


@made_once
def classify_kernel(ball: Any, data_type: Any) -> Any:
    """Make the kernel that classifies whole tiles with a field's `ball`."""

    @wp.kernel(**MODULE)
    def _classify_tiles(
        # In:
        data: data_type,
        low: wp.vec3d,  # bounds of the solid [m]
        high: wp.vec3d,
        lattice: wp.array[Lattice],
        grid: wp.array[Grid],
        patch_of: wp.array[wp.int32],
        # Out:
        bits: wp.array[wp.uint32],
        unclassified: wp.array[wp.int32],  # 1 for the others, shape [tile + 1], the last one stays 0
    ):
        """Fill tiles that are inside or outside as a whole."""
        row, own = wp.tid()
        patch = patch_of[own]
        g = grid[patch]
        lat = lattice[row * grid.shape[0] + patch]
        i = TILE_WIDTH * ((own - g.tile) % g.across)
        j = TILE_HEIGHT * ((own - g.tile) // g.across)
        x = wp.float64(0.5) * wp.float64(wp.min(TILE_WIDTH - 1, g.nu - i))
        y = wp.float64(0.5) * wp.float64(wp.min(TILE_HEIGHT - 1, g.nv - j))
        middle = node_at(lat, wp.float64(i) + x, wp.float64(j) + y)
        radius = NEAR_ALL * wp.length(x * lat.u + y * lat.v)
        tile = row * patch_of.shape[0] + own
        side = int(1)
        out = wp.vec3d()  # from the box to the tile's middle
        for k in range(3):
            out[k] = wp.max(wp.max(low[k] - middle[k], middle[k] - high[k]), wp.float64(0.0))
        if wp.length(out) <= radius:
            side = ball(data, middle, radius)
        unclassified[tile] = wp.where(side == 0, 1, 0)
        bits[tile] = wp.where(side < 0, FULL, wp.uint32(0))

    return _classify_tiles


@made_once
def sample_kernel(inside: Any, ball: Any, data_type: Any) -> Any:
    """The kernel that asks about nodes, for a field's `inside` and `ball`."""

    @wp.func
    def eight_nodes(data: data_type, lat: Lattice, g: Grid, i: int, j: int):
        """Bits of 4 x 2 nodes from (i, j) on, the second row's 8 bits up; first all at once."""
        wide = wp.min(4, g.nu + 1 - i)
        high = wp.min(2, g.nv + 1 - j)
        bits = int(0)
        if wide > 0 and high > 0:
            x = wp.float64(0.5) * wp.float64(wide - 1)
            y = wp.float64(0.5) * wp.float64(high - 1)
            middle = node_at(lat, wp.float64(i) + x, wp.float64(j) + y)
            side = ball(data, middle, NEAR_ALL * wp.length(x * lat.u + y * lat.v))
            if side < 0:
                bits = 0x0F0F
            count = wp.where(side == 0, wide * high, 0)
            for k in range(count):
                a = k % wide
                b = k // wide
                if inside(data, node_at(lat, wp.float64(i + a), wp.float64(j + b))):
                    bits = bits | (1 << (a + 8 * b))
        return bits

    @wp.kernel(**MODULE)
    def _sample_nodes(
        # In:
        data: data_type,
        lattice: wp.array[Lattice],
        grid: wp.array[Grid],
        patch_of: wp.array[wp.int32],
        listed: wp.array[wp.int32],
        # Out:
        bits: wp.array[wp.uint16],  # two a tile
    ):
        """Write which nodes of one half of a listed tile are inside."""
        tile = listed[wp.tid() // 2]
        half = wp.tid() % 2
        row = tile // patch_of.shape[0]
        own = tile % patch_of.shape[0]
        patch = patch_of[own]
        g = grid[patch]
        lat = lattice[row * grid.shape[0] + patch]
        i = TILE_WIDTH * ((own - g.tile) % g.across)
        j = TILE_HEIGHT * ((own - g.tile) // g.across) + 2 * half
        word = int(0)
        for part in range(wp.min(2, g.nu + 1 - i)):  # of a length that is not known before: one copy of the function
            word = word | (eight_nodes(data, lat, g, i + 4 * part, j) << (4 * part))
        bits[2 * tile + half] = wp.uint16(word)

    return _sample_nodes


@wp.kernel
def _list_tiles(
    unclassified: wp.array[wp.int32],
    place: wp.array[wp.int32],  # its offsets
    listed: wp.array[wp.int32],
):
    """List the unclassified tiles, in order."""
    tile = wp.tid()
    if unclassified[tile] == 1:
        listed[place[tile]] = tile


@wp.func
def bits_below(columns: int, rows: int):
    """Bits of a tile's first columns and rows."""
    c = wp.min(columns, TILE_WIDTH)
    r = wp.min(rows, TILE_HEIGHT)
    if c <= 0 or r <= 0:
        return wp.uint32(0)
    mask = FIRST_COLUMN * wp.uint32((1 << c) - 1)
    return mask & (FULL >> wp.uint32(TILE_WIDTH * (TILE_HEIGHT - r)))


@wp.func
def next_column(tile: wp.uint32, right: wp.uint32):
    """Each node's neighbour along u, in the node's place."""
    return ((tile >> wp.uint32(1)) & OTHER_COLUMNS) | ((right & FIRST_COLUMN) << wp.uint32(7))


@wp.func
def next_row(tile: wp.uint32, upper: wp.uint32):
    """Each node's neighbour along v, in the node's place."""
    return (tile >> wp.uint32(8)) | (upper << wp.uint32(24))


@made_once
def resolve_kernel(inside: Any, data_type: Any) -> Any:
    """The kernel that compares neighbours, for a field's `inside`."""

    @wp.kernel(**MODULE)
    def _resolve_cells(
        # In:
        data: data_type,
        lattice: wp.array[Lattice],
        grid: wp.array[Grid],
        patch_of: wp.array[wp.int32],
        bits: wp.array[wp.uint32],
        # Out:
        saddle: wp.array[wp.uint32],
        start: wp.array[wp.uint32],
        cut_count: wp.array[wp.int32],  # added to, shape [section + 1]
    ):
        """Count cut edges and mark those where loops may start; ask about the middle of ambiguous cells."""
        row, own = wp.tid()
        tile = row * patch_of.shape[0] + own
        patch = patch_of[own]
        g = grid[patch]
        i = TILE_WIDTH * ((own - g.tile) % g.across)
        j = TILE_HEIGHT * ((own - g.tile) // g.across)
        right = bits[tile]  # at the grid's end any will do: those cells are masked out
        upper = bits[tile]
        diagonal = bits[tile]
        if i + TILE_WIDTH <= g.nu:
            right = bits[tile + 1]
        if j + TILE_HEIGHT <= g.nv:
            upper = bits[tile + g.across]
            diagonal = upper
            if i + TILE_WIDTH <= g.nu:
                diagonal = bits[tile + g.across + 1]
        a = bits[tile]
        if a == right and a == upper and a == diagonal and (a == wp.uint32(0) or a == FULL):
            saddle[tile] = wp.uint32(0)
            start[tile] = wp.uint32(0)
            return
        b = next_column(a, right)
        c = next_row(a, upper)
        d = next_row(b, next_column(upper, diagonal))
        along_u = (a ^ b) & bits_below(g.nu - i, g.nv + 1 - j)
        along_v = (a ^ c) & bits_below(g.nu + 1 - i, g.nv - j)
        resolved = wp.uint32(0)
        start[tile] = b & along_u
        if (along_u | along_v) != wp.uint32(0):
            section = row * grid.shape[0] + patch
            wp.atomic_add(cut_count, section, int(wp.bit_count(along_u) + wp.bit_count(along_v)))
            doubtful = (a ^ b) & (a ^ c) & (b ^ d) & bits_below(g.nu - i, g.nv - j)
            if doubtful != wp.uint32(0):
                lat = lattice[section]
                for k in range(TILE_WIDTH * TILE_HEIGHT):
                    bit = wp.uint32(1) << wp.uint32(k)
                    if (doubtful & bit) != wp.uint32(0):
                        x = wp.float64(i + k % TILE_WIDTH) + wp.float64(0.5)
                        y = wp.float64(j + k // TILE_WIDTH) + wp.float64(0.5)
                        if inside(data, node_at(lat, x, y)):
                            resolved = resolved | bit
        saddle[tile] = resolved

    return _resolve_cells


@made_once
def root_kernel(root: Any, data_type: Any) -> Any:
    """The kernel that finds where edges are cut, for a field's `root`."""

    @wp.kernel(**MODULE)
    def _find_roots(
        # In:
        data: data_type,
        lattice: wp.array[Lattice],
        grid: wp.array[Grid],
        code: wp.array[wp.int32],
        section: wp.array[wp.int32],
        moved: MovedNodes,
        # Out:
        point: wp.array[wp.vec3],  # those of sections that are done come written
    ):
        """Place a point where the surface cuts its edge, or at its node."""
        slot = wp.tid()
        if code[slot] == NO_POINT or is_done(moved, section[slot]):
            return
        lat = lattice[section[slot]]
        node = code[slot] >> 3
        what = code[slot] & 6
        nodes = grid[section[slot] % grid.shape[0]].nu + 1
        i = node % nodes
        j = node // nodes
        p = place_of(moved, section[slot], nodes, i, j)
        x = node_at(lat, p[0], p[1])
        if what != AT_NODE:
            p = place_of(
                moved, section[slot], nodes, i + wp.where(what == ALONG_U, 1, 0), j + wp.where(what == ALONG_V, 1, 0)
            )
            x = root(data, x, node_at(lat, p[0], p[1]))
        point[slot] = to_float32(x + lat.lift)

    return _find_roots


def sample_nodes(field: Field, lattice: wp.array, grids: Grids, bounds: np.ndarray) -> wp.array:
    """Whether nodes of sections are inside a field, uint32, shape [tile of all poses]; waits for the device once.

    bounds: lowest and highest coordinates of the solid [m], shape [2, 3]; nothing beyond is looked at.
    """
    device = lattice.device
    pose_count = lattice.shape[0] // grids.grid.shape[0]
    tile_count = pose_count * grids.patch_of.shape[0]
    bits = wp.empty(tile_count, dtype=wp.uint32, device=device)
    unclassified = wp.zeros(tile_count + 1, dtype=wp.int32, device=device)
    low, high = (wp.vec3d(*side) for side in np.asarray(bounds, np.float64))
    layout = [lattice, grids.grid, grids.patch_of]
    ball = field.ball or ball_unknown
    classify, dim = classify_kernel(ball, field.data_type), (pose_count, grids.patch_of.shape[0])
    launch(classify, dim, [field.data, low, high, *layout], [bits, unclassified])
    (place,), (total,) = scan_counts(unclassified)
    listed = wp.empty(total, dtype=wp.int32, device=device)
    launch(_list_tiles, tile_count, [unclassified, place], [listed])
    sample = sample_kernel(inside_function(field), ball, field.data_type)
    launch(sample, 2 * total, [field.data, *layout, listed], [parts_of(bits, wp.uint16)])
    return bits


def resolve_cells(field: Field, lattice: wp.array, grids: Grids, bits: wp.array, *, spare: int) -> Samples:
    """Compare nodes with their neighbours; spare: places for other points in each section's range."""
    saddle, start = wp.empty_like(bits), wp.empty_like(bits)
    cut_count = wp.full(lattice.shape[0] + 1, spare, dtype=wp.int32, device=lattice.device)
    resolve = resolve_kernel(inside_function(field), field.data_type)
    dim = (lattice.shape[0] // grids.grid.shape[0], grids.patch_of.shape[0])
    launch(resolve, dim, [field.data, lattice, grids.grid, grids.patch_of, bits], [saddle, start, cut_count])
    return Samples(bits, saddle, start, offsets_of(cut_count))


def find_roots(
    field: Field, lattice: wp.array, grids: Grids, code: wp.array, section: wp.array, moved: MovedNodes, point: wp.array
) -> None:
    """Write where the points with these codes lie [m], float32, shape [slot]; those of sections that are done stay."""
    kernel = root_kernel(root_function(field), field.data_type)
    launch(kernel, code.shape[0], [field.data, lattice, grids.grid, code, section, moved], [point])


def parts_of(words: wp.array, dtype: Any = wp.uint8) -> wp.array:
    """The same memory in bytes or halves of words, lowest first."""
    size = 4 * words.shape[0]
    count = size // wp.types.type_size_in_bytes(dtype)
    return wp.array(ptr=words.ptr, dtype=dtype, shape=count, device=words.device, capacity=size)
