"""Points of skin that are inside an object, pose by pose: marked nodes of patches (`nodes`), or vertices of a mesh."""

import numpy as np
import warp as wp

from ..fields.field import Field
from ..march.grid import TILE_HEIGHT, TILE_WIDTH, Grid, Lattice, node_at
from ..march.sample import bits_below
from ..offsets import count_then_fill, launch
from ..patch import EXACT, to_float32
from ..skin.edges import Skin
from ..skin.sign import WORD, Posed, sign_vertices, turn_of, vertex_at
from .nodes import Nodes, lowest_bit

wp.set_module_options(EXACT)


@wp.kernel
def _count_nodes(
    # In:
    grid: wp.array[Grid],
    patch_of: wp.array[wp.int32],
    # In and out:
    bits: wp.array[wp.uint32],  # those of no node are cleared
    # Out:
    count: wp.array[wp.int64],  # shape [tile + 1], the last one stays 0
):
    """Count a tile's nodes that are inside."""
    row, own = wp.tid()
    tile = row * patch_of.shape[0] + own
    g = grid[patch_of[own]]
    i = TILE_WIDTH * ((own - g.tile) % g.across)
    j = TILE_HEIGHT * ((own - g.tile) // g.across)
    bits[tile] = bits[tile] & bits_below(g.nu + 1 - i, g.nv + 1 - j)
    count[tile] = wp.int64(wp.bit_count(bits[tile]))


@wp.kernel
def _list_nodes(
    # In:
    grid: wp.array[Grid],
    patch_of: wp.array[wp.int32],
    bits: wp.array[wp.uint32],
    start: wp.array[wp.int64],
    lattice: wp.array[Lattice],
    # Out:
    point: wp.array[wp.vec3],
):
    """Write a tile's nodes that are inside."""
    row, own = wp.tid()
    tile = row * patch_of.shape[0] + own
    word = bits[tile]
    if word != wp.uint32(0):
        patch = patch_of[own]
        g = grid[patch]
        lat = lattice[row * grid.shape[0] + patch]
        i = TILE_WIDTH * ((own - g.tile) % g.across)
        j = TILE_HEIGHT * ((own - g.tile) // g.across)
        place = start[tile]
        while word != wp.uint32(0):
            k = lowest_bit(word)
            word = word & (word - wp.uint32(1))
            x = node_at(lat, wp.float64(i + k % TILE_WIDTH), wp.float64(j + k // TILE_WIDTH))
            point[place] = to_float32(x + lat.lift)
            place += wp.int64(1)


@wp.kernel
def _count_vertices(
    # In:
    vertex_count: int,
    # In and out:
    inside: wp.array2d[wp.uint32],  # bits of no vertex are cleared
    # Out:
    count: wp.array[wp.int64],  # shape [word of all poses + 1], the last one stays 0
):
    """Count a word's vertices that are inside."""
    row, word = wp.tid()
    left = vertex_count - WORD * word
    if left < WORD:
        inside[row, word] = inside[row, word] & ((wp.uint32(1) << wp.uint32(left)) - wp.uint32(1))
    count[row * inside.shape[1] + word] = wp.int64(wp.bit_count(inside[row, word]))


@wp.kernel
def _list_vertices(
    # In:
    vertex_count: int,
    inside: wp.array2d[wp.uint32],
    start: wp.array[wp.int64],
    pose: wp.array2d[wp.transform],
    skin: Skin,
    vertex: wp.array2d[wp.vec3],
    # Out:
    point: wp.array[wp.vec3],
):
    """Write a word's vertices that are inside."""
    row, word = wp.tid()
    bits = inside[row, word]
    if bits != wp.uint32(0):
        t = turn_of(pose[row, 0])
        own = wp.min(row, vertex.shape[0] - 1)
        place = start[row * inside.shape[1] + word]
        for k in range(wp.min(WORD, vertex_count - WORD * word)):
            if ((bits >> wp.uint32(k)) & wp.uint32(1)) != wp.uint32(0):
                point[place] = to_float32(vertex_at(skin, vertex, own, t, WORD * word + k))
                place += wp.int64(1)


@wp.kernel
def _start_poses(start: wp.array[wp.int64], words: int, pose_start: wp.array[wp.int64]):
    """Pick where each pose's points start from where those of words do, so many a pose."""
    pose_start[wp.tid()] = start[wp.tid() * words]


def pose_starts(start: wp.array, words: int, pose_count: int) -> wp.array:
    """Offsets by pose of offsets by word."""
    out = wp.empty(pose_count + 1, dtype=wp.int64, device=start.device)
    launch(_start_poses, pose_count + 1, [start, words], [out])
    return out


def list_nodes(nodes: Nodes) -> tuple[wp.array, wp.array]:
    """Nodes that are marked, in order of patch and tile.

    Returns points [m], vec3, array frame, and where each pose's start, int64, shape [pose + 1].
    """
    grids, lattice, bits = nodes
    dim = (lattice.shape[0] // grids.grid.shape[0], grids.patch_of.shape[0])
    (point,), (start,) = count_then_fill(
        _count_nodes,
        _list_nodes,
        dim,
        [grids.grid, grids.patch_of, bits],
        lambda total: [wp.empty(total, dtype=wp.vec3, device=bits.device)],
        rows=bits.shape[0],
        more=[lattice],
    )
    return point, pose_starts(start, dim[1], dim[0])


def inside_vertices(field: Field, posed: Posed, bounds: np.ndarray) -> tuple[wp.array, wp.array]:
    """Vertices of posed skin that are inside a field, in their order; returns as `list_nodes`."""
    inside = sign_vertices(field, posed, bounds)
    (point,), (start,) = count_then_fill(
        _count_vertices,
        _list_vertices,
        inside.shape,
        [posed.skin.vertex_count, inside],
        lambda total: [wp.empty(total, dtype=wp.vec3, device=inside.device)],
        rows=inside.size,
        more=[*posed],
    )
    return point, pose_starts(start, inside.shape[1], inside.shape[0])
