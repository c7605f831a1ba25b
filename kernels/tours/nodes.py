"""Points of skin inside an object, pose by pose: nodes of grids over patches, marked by bits, or vertices of a mesh."""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..contours import Contours
from ..fields.field import Field
from ..march.grid import TILE_HEIGHT, TILE_WIDTH, Grid, Grids, Lattice, lay_grids, node_at, place_grids
from ..march.sample import bits_below, sample_nodes
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float32, to_float64
from ..skin.edges import Skin
from ..skin.sign import WORD, Posed, sign_vertices, turn_of, vertex_at

wp.set_module_options(EXACT)

OFF = wp.constant(wp.float64(1.0e-3))  # [step]; contours are rounded by less
NEARLY = 1.0 - 1e-6  # of the separation: nodes that lie it apart by their steps are chosen, whatever rounds


class Nodes(NamedTuple):
    """Marked nodes of grids at some poses."""

    grids: Grids
    lattice: wp.array  # of each section
    bits: wp.array  # uint32, shape [tile of all poses]


@wp.func
def grid_place(lat: Lattice, x: wp.vec3):
    """A point of the patch in steps from node (0, 0)."""
    d = to_float64(x) - lat.origin
    return wp.vec2d(wp.dot(d, lat.u) / wp.dot(lat.u, lat.u), wp.dot(d, lat.v) / wp.dot(lat.v, lat.v))


@wp.func
def row_height(g: Grid, j: int):
    """Height of a row of nodes, the first and the last one moved off the patch's boundary [step]."""
    return wp.clamp(wp.float64(j), OFF, wp.float64(g.nv) - OFF)


@wp.func
def row_above(g: Grid, y: wp.float64):
    """The first row of nodes that is not below a height; one past the last if there is none."""
    j = wp.clamp(int(wp.ceil(y)), 0, g.nv + 1)
    if j > 0 and row_height(g, wp.max(j - 1, 0)) >= y:
        j -= 1
    elif j <= g.nv and row_height(g, wp.min(j, g.nv)) < y:
        j += 1
    return j


@wp.func
def column_after(g: Grid, x: wp.float64):
    """The first column of nodes that is right of a place; the first and the last one lie off the boundary."""
    if x < OFF:
        return 0
    if x >= wp.float64(g.nu) - OFF:
        return g.nu + 1
    return wp.min(int(wp.floor(x)) + 1, g.nu)


@wp.kernel
def _fill_outlines(
    lattice: wp.array[Lattice], grid: wp.array[Grid], tile_count: int, c: Contours, bits: wp.array[wp.uint32]
):
    """Invert the nodes right of each edge of a pose's closed outlines: those that end inverted are inside.

    tile_count: of a hand; bits: zero-initialised.
    """
    pose = wp.tid()
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        patch = c.polyline_patch[line]
        g = grid[patch]
        lat = lattice[pose * grid.shape[0] + patch]
        first = c.polyline_start[line]
        count = int(c.polyline_start[line + 1] - first)
        a = grid_place(lat, c.points[first + wp.int64(count - 1)])
        low = row_above(g, a[1])
        for k in range(count):
            b = grid_place(lat, c.points[first + wp.int64(k)])
            high = row_above(g, b[1])
            for j in range(wp.min(low, high), wp.max(low, high)):
                t = (row_height(g, j) - a[1]) / (b[1] - a[1])
                i = column_after(g, a[0] + t * (b[0] - a[0]))
                mask = (wp.uint32(0xFF) << wp.uint32(i & 7)) & wp.uint32(0xFF)
                for across in range(i >> 3, g.across):
                    place = pose * tile_count + g.tile + (j >> 2) * g.across + across
                    bits[place] = bits[place] ^ (mask << wp.uint32(8 * (j & 3)))
                    mask = wp.uint32(0xFF)
            a = b
            low = high


@wp.struct
class Disc:
    """What a node that is chosen excludes around it: rows of nodes, by how many rows they lie off."""

    reach: wp.array[wp.int32]  # columns to either side
    du: wp.float64  # from column to column [m]
    dv: wp.float64


@wp.func
def lowest_bit(word: wp.uint32):
    """Number of the lowest bit that is set."""
    return int(wp.bit_count((word & (~word + wp.uint32(1))) - wp.uint32(1)))


@wp.func
def exclude_around(bits: wp.array[wp.uint32], base: int, g: Grid, disc: Disc, i: int, j: int, chosen: int):
    """Clear the nodes around a chosen one; if it is the first, returns the farthest, 32 x tile + bit; else -1."""
    far = wp.float64(0.0)
    farthest = int(-1)
    most = disc.reach.shape[0] - 1
    for row in range(wp.max(j - most, 0), wp.min(j + most, g.nv) + 1):
        first = wp.max(i - disc.reach[wp.abs(row - j)], 0)
        last = wp.min(i + disc.reach[wp.abs(row - j)], g.nu)
        for across in range(first >> 3, (last >> 3) + 1):
            low = wp.max(first - 8 * across, 0)
            wide = wp.min(last - 8 * across, 7) - low + 1
            mask = wp.uint32(((1 << wide) - 1) << low) << wp.uint32(8 * (row & 3))
            tile = (row >> 2) * g.across + across
            word = bits[base + tile]
            bits[base + tile] = word & (~mask)
            gone = wp.where(chosen == 0, word & mask, wp.uint32(0))
            while gone != wp.uint32(0):
                bit = lowest_bit(gone)
                gone = gone & (gone - wp.uint32(1))
                x = disc.du * wp.float64(8 * across + (bit & 7) - i)
                y = disc.dv * wp.float64(row - j)
                if x * x + y * y > far:
                    far = x * x + y * y
                    farthest = 32 * tile + bit
    return farthest


@wp.kernel
def _thin_nodes(
    grid: wp.array[Grid],  # one
    tile_count: int,
    disc: Disc,
    # In and out:
    bits: wp.array[wp.uint32],
    count: wp.array[wp.int32],  # of each pose's nodes that are chosen
):
    """Keep nodes that are not too near to one chosen before; where but one is left, the farthest from it too."""
    pose = wp.tid()
    base = pose * tile_count
    g = grid[0]
    chosen = int(0)
    farthest = int(-1)
    for tile in range(tile_count):
        i = TILE_WIDTH * (tile % g.across)
        j = TILE_HEIGHT * (tile // g.across)
        done = ~bits_below(g.nu + 1 - i, g.nv + 1 - j)
        own = wp.uint32(0)
        word = bits[base + tile] & (~done)
        while word != wp.uint32(0):
            bit = lowest_bit(word)
            own = own | (wp.uint32(1) << wp.uint32(bit))
            found = exclude_around(bits, base, g, disc, i + (bit & 7), j + (bit >> 3), chosen)
            if chosen == 0:
                farthest = found
            chosen += 1
            word = bits[base + tile] & (~done)
        bits[base + tile] = own
    if chosen == 1 and farthest >= 0:
        place = base + (farthest >> 5)
        bits[place] = bits[place] | (wp.uint32(1) << wp.uint32(farthest & 31))
        chosen = 2
    count[pose] = chosen


@on_one_device
def lay_nodes(pose: wp.array, patch: wp.array, step: float) -> tuple[Grids, wp.array]:
    """Grids of a hand's patches, and where they lie at each pose, see `place_grids`."""
    half = patch.numpy()["half"].astype(np.float64).reshape(-1, 2)
    grids = lay_grids(half, step, pose.device)
    return grids, place_grids(pose, patch, grids, 0, pose.shape[0] * patch.shape[0], middle=None)


@on_one_device
def inside_nodes(field: Field, pose: wp.array, patch: wp.array, *, step: float, bounds: np.ndarray) -> Nodes:
    """Nodes of the patches' grids that are inside a field; arguments as `march_patches`.

    Memory is allocated for all nodes at once. Raises ValueError for a step that is not positive or too fine.
    """
    grids, lattice = lay_nodes(pose, patch, step)
    return Nodes(grids, lattice, sample_nodes(field, lattice, grids, bounds))


@on_one_device
def outlined_nodes(outlines: Contours, pose: wp.array, patch: wp.array, *, step: float) -> Nodes:
    """Nodes of the patches' grids that lie within closed contours of these poses; raises as `inside_nodes`.

    Nodes on a patch's boundary are taken to lie OFF steps farther in.
    """
    grids, lattice = lay_nodes(pose, patch, step)
    tile_count = grids.patch_of.shape[0]
    bits = wp.zeros(pose.shape[0] * tile_count, dtype=wp.uint32, device=pose.device)
    inputs = [lattice, grids.grid, tile_count, outlines]
    launch(_fill_outlines, pose.shape[0], inputs, [bits])
    return Nodes(grids, lattice, bits)


def nodes_of_pose(nodes: Nodes, pose: int) -> Nodes:
    """Those of one pose, by its row."""
    sections, tiles = nodes.grids.grid.shape[0], nodes.grids.patch_of.shape[0]
    lattice = nodes.lattice[pose * sections : (pose + 1) * sections]
    return Nodes(nodes.grids, lattice, nodes.bits[pose * tiles : (pose + 1) * tiles])


def thin_nodes(nodes: Nodes, *, separation: float) -> tuple[Nodes, wp.array]:
    """Thin the nodes of a hand of one patch as `thin_points` thins points, by their steps in the grid.

    Returns the nodes that are chosen, and how many they are at each pose, int32. separation: [m].
    """
    device = nodes.bits.device
    g = nodes.grids.grid.numpy()[0]
    du, dv = 2.0 * g["half"].astype(np.float64) / (g["nu"], g["nv"])
    off = dv * np.arange(g["nv"] + 1)
    apart = NEARLY * min(separation, 4.0 * float(g["half"].sum()))  # nothing is farther away on the patch
    reach = np.sqrt(apart**2 - off[off < apart] ** 2) / du
    disc = Disc()
    disc.reach = wp.array(np.minimum(reach, g["nu"]).astype(np.int32), dtype=wp.int32, device=device)
    disc.du, disc.dv = du, dv
    bits = wp.clone(nodes.bits)
    tile_count = nodes.grids.patch_of.shape[0]
    count = wp.empty(nodes.lattice.shape[0], dtype=wp.int32, device=device)
    inputs = [nodes.grids.grid, tile_count, disc, bits]
    launch(_thin_nodes, count.shape[0], inputs, [count])
    return nodes._replace(bits=bits), count


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
