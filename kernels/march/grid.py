"""Grids of nodes for marching: a grid over each patch, positions of its nodes, and one bit per node (1 is inside).

Bits are stored in tiles of 8 x 4 nodes: 32 bits per tile, one byte per row, so that whole tiles can be classified at
once. Node (i, j) lies i steps along u and j along v from the patch's corner 0.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..offsets import launch
from ..patch import EXACT, ON, Frame, Patch, section_frame

wp.set_module_options(EXACT)

TILE_WIDTH = 8  # nodes
TILE_HEIGHT = 4
CELLS_MOST = 4096  # along a side of a grid


@wp.struct
class Grid:
    """One patch's grid: the same for all poses."""

    nu: int  # cells along u; nodes are one more
    nv: int
    across: int  # tiles along u
    tile: int  # its first tile among those of a hand
    rim: int  # its first byte among those of a hand that hold a bit for each node of the boundary
    half: wp.vec2d  # half extents, less ON [m]


@wp.struct
class Lattice:
    """One section's grid in the array's frame."""

    origin: wp.vec3d  # node (0, 0), ON below the plane: what lies on the plane counts as on its +n side [m]
    u: wp.vec3d  # from node to node [m]
    v: wp.vec3d
    lift: wp.vec3d  # back to the plane [m]


@wp.struct
class MovedNodes:
    """Nodes that were moved off their grid positions, section by section."""

    start: wp.array[wp.int32]  # a section's first one, shape [section]; no sections where no node is moved
    stop: wp.array[wp.int32]
    node: wp.array[wp.int32]  # row by row
    place: wp.array[wp.vec2d]  # in grid steps from node (0, 0)
    bits: wp.array[wp.uint8]  # of all nodes, as they lie then


class Grids(NamedTuple):
    """All grids of a hand."""

    grid: wp.array  # Grid, shape [patch]
    patch_of: wp.array  # patch of each of a hand's tiles, int32, shape [tile]
    rim_bytes: int  # of a hand
    node_count: int


def lay_grids(half: np.ndarray, step: float, device: wp.Device) -> Grids:
    """Divide patches into ceil(side / step) cells each way.

    half: half extents of each patch [m], shape [patch, 2], less ON as in Patch; step [m].
    Raises ValueError for a step that is not positive, or needs more than CELLS_MOST cells along a side.
    """
    if not (np.isfinite(step) and step > 0.0):
        raise ValueError(f"step must be a positive length, not {step} m")
    cells = np.maximum(np.ceil(2.0 * (half + float(ON)) / step - 1e-6).astype(np.int64), 1)
    if cells.max(initial=1) > CELLS_MOST:
        finest = 2.0 * half.max() / CELLS_MOST
        raise ValueError(f"step of {step:g} m is too fine for a side of {2 * half.max():g} m: at least {finest:.3g} m")
    grids, patches, tile, rim = [], [], 0, 0
    for own, ((nu, nv), extent) in enumerate(zip(cells.tolist(), half.tolist(), strict=True)):
        grid = Grid()
        grid.nu, grid.nv, grid.half = nu, nv, wp.vec2d(*extent)
        grid.across, grid.tile, grid.rim = nu // TILE_WIDTH + 1, tile, rim
        tile += grid.across * (nv // TILE_HEIGHT + 1)
        rim += (nu + nv + 3) // 4
        patches += [own] * (tile - len(patches))
        grids.append(grid)
    return Grids(
        grid=wp.array(grids, dtype=Grid, device=device),
        patch_of=wp.array(np.array(patches, np.int32), dtype=wp.int32, device=device),
        rim_bytes=rim,
        node_count=int(((cells + 1).prod(axis=1)).sum()),
    )


@wp.func
def node_at(lattice: Lattice, i: wp.float64, j: wp.float64):
    """A node, or a place between nodes, where a field is asked [m]."""
    return lattice.origin + i * lattice.u + j * lattice.v


@wp.func
def place_of(moved: MovedNodes, section: int, nodes: int, i: int, j: int):
    """Position of node (i, j) in grid steps from node (0, 0); nodes: of a row."""
    out = wp.vec2d(wp.float64(i), wp.float64(j))
    if section < moved.start.shape[0]:
        for k in range(moved.start[section], moved.stop[section]):
            if moved.node[k] == j * nodes + i:
                out = moved.place[k]
    return out


@wp.func
def is_done(moved: MovedNodes, section: int):
    """Whether nodes were moved, but none of this section."""
    if section >= moved.start.shape[0]:
        return False
    return moved.start[section] == moved.stop[section]


@wp.func
def is_inside(bits: wp.array[wp.uint8], base: int, grid: Grid, i: int, j: int):
    """Bit of node (i, j), or of the cell that it is the lowest corner of; base: the section's first byte."""
    row = base + 4 * ((j >> 2) * grid.across + (i >> 3)) + (j & 3)
    return (int(bits[row]) >> (i & 7)) & 1 != 0


@wp.func
def rim_count(grid: Grid):
    """Nodes on a patch's boundary, and edges between them."""
    return 2 * (grid.nu + grid.nv)


@wp.func
def rim_node(grid: Grid, k: int):
    """Node k of a patch's boundary, counter-clockwise from corner 0."""
    if k < grid.nu:
        return wp.vec2i(k, 0)
    if k < grid.nu + grid.nv:
        return wp.vec2i(grid.nu, k - grid.nu)
    if k < 2 * grid.nu + grid.nv:
        return wp.vec2i(2 * grid.nu + grid.nv - k, grid.nv)
    return wp.vec2i(0, rim_count(grid) - k)


@wp.func
def lattice_of(f: Frame, grid: Grid, bounded: int, middle: wp.vec3d):
    """A grid in a patch's frame: on the patch, or in its plane around the point there that is nearest to `middle`."""
    a = -grid.half[0]
    b = -grid.half[1]
    if bounded == 0:
        a += wp.dot(f.u, middle - f.origin)
        b += wp.dot(f.v, middle - f.origin)
    lattice = Lattice()
    lattice.lift = f.flush * f.n
    lattice.origin = f.origin + a * f.u + b * f.v - lattice.lift
    lattice.u = (wp.float64(2.0) * grid.half[0] / wp.float64(grid.nu)) * f.u
    lattice.v = (wp.float64(2.0) * grid.half[1] / wp.float64(grid.nv)) * f.v
    return lattice


@wp.kernel
def _place_grids(
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    grid: wp.array[Grid],
    first: int,  # section
    bounded: int,  # 0: the whole plane
    middle: wp.vec3d,  # of what the grid must cover there [m]
    lattice: wp.array[Lattice],  # shape [section of the chunk]
):
    """Bring each section's grid into the array's frame."""
    row = wp.tid()
    f = section_frame(pose, patch, first + row)
    lattice[row] = lattice_of(f, grid[(first + row) % patch.shape[0]], bounded, middle)


def place_grids(
    pose: wp.array, patch: wp.array, grids: Grids, first: int, count: int, *, middle: np.ndarray | None
) -> wp.array:
    """Grids of `count` sections from `first` on, in the array's frame; middle: see `lattice_of`, None if bounded."""
    device = pose.device
    lattice = wp.empty(count, dtype=Lattice, device=device)
    around = wp.vec3d() if middle is None else wp.vec3d(*middle)
    inputs = [pose, patch, grids.grid, first, int(middle is None), around]
    launch(_place_grids, count, inputs, [lattice])
    return lattice
