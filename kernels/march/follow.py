"""Nodes moved onto tips that reach between them, so that the cells there see the tip, and where the grid ends.

A tip that is far from the step it was climbed from may have nodes of its own, around which a loop of its own was found,
or leave the patch. So along its path each node near it that is not in the region is moved onto the path, where the
field was asked, and its bit follows; neighbours in the chain of nodes share an edge, so the region holds together. The
nodes of the patch's boundary move along it, its corners not at all. Then the sections are walked again.
"""

from typing import Any

import warp as wp

from ..fields.field import MODULE, Field, inside_function, made_once
from ..offsets import launch
from ..patch import EXACT
from .grid import TILE_HEIGHT, Grid, Grids, Lattice, MovedNodes, is_done, is_inside, node_at, place_of
from .sample import parts_of
from .tip import FAR_TIP, FoundTips, Tips

wp.set_module_options(EXACT)

MOVED_MOST = 64  # nodes of a tip
SAMPLES = wp.constant(wp.float64(8.0))  # places along the path a grid step that are asked
BEFORE_END = wp.constant(wp.float64(0.9))  # of the last part of the path: its end is on the surface


@wp.struct
class Chain:
    """A section's nodes while they are moved."""

    base: int  # the section's first byte
    grid: Grid
    wanted: bool
    node: wp.vec2i  # the nearest one to the last place
    place: wp.vec2d
    next: int  # where the next moved node is noted
    stop: int


@wp.func
def has_bit(moved: MovedNodes, c: Chain, n: wp.vec2i):
    """Whether a node is in the region."""
    return is_inside(moved.bits, c.base, c.grid, n[0], n[1]) == c.wanted


@wp.func
def set_node(chain: Chain, moved: MovedNodes, n: wp.vec2i, at: wp.vec2d):
    """Move a node that is not in the region yet to a place that is."""
    c = chain
    if not has_bit(moved, c, n) and c.next < c.stop:
        moved.node[c.next] = n[1] * (c.grid.nu + 1) + n[0]
        moved.place[c.next] = at
        byte = c.base + 4 * ((n[1] >> 2) * c.grid.across + (n[0] >> 3)) + (n[1] & 3)
        moved.bits[byte] = wp.uint8(int(moved.bits[byte]) ^ (1 << (n[0] & 7)))
        c.next = c.next + 1
    return c


@wp.func
def share_between(one: int, other: int, a: wp.float64, b: wp.float64):
    """The share of the line from a to b at which the nearest node turns from one to the other, along one axis."""
    border = wp.float64(0.5) * (wp.float64(one) + wp.float64(other))
    return wp.clamp((border - a) / (b - a), wp.float64(0.0), wp.float64(1.0))


@wp.func
def nearest_node(p: wp.vec2d):
    """The node nearest to a place."""
    return wp.vec2i(int(wp.floor(p[0] + wp.float64(0.5))), int(wp.floor(p[1] + wp.float64(0.5))))


@wp.func
def exit_share(g: Grid, a: wp.vec2d, b: wp.vec2d):
    """The share of a line from a place in the grid at which it leaves the grid, above 1 if it is not."""
    out = wp.float64(2.0)
    for k in range(2):
        end = wp.float64(wp.where(k == 0, g.nu, g.nv))
        if b[k] < wp.float64(0.0):
            out = wp.min(out, a[k] / (a[k] - b[k]))
        elif b[k] > end:
            out = wp.min(out, (end - a[k]) / (b[k] - a[k]))
    return out


@wp.func
def snap_to_boundary(g: Grid, p: wp.vec2d):
    """A place near the boundary, exactly on it."""
    out = p
    for k in range(2):
        end = wp.float64(wp.where(k == 0, g.nu, g.nv))
        if wp.abs(p[k]) < wp.float64(1e-9):
            out[k] = wp.float64(0.0)
        if wp.abs(p[k] - end) < wp.float64(1e-9):
            out[k] = end
    return out


@made_once
def follow_kernel(inside: Any, data_type: Any) -> Any:
    """The kernel that moves nodes, for a field's `inside`."""

    @wp.func
    def has_sign(data: data_type, lat: Lattice, p: wp.vec2d, wanted: bool):
        return inside(data, node_at(lat, p[0], p[1])) == wanted

    @wp.func
    def link_node(data: data_type, lat: Lattice, chain: Chain, moved: MovedNodes, n: wp.vec2i, at: wp.vec2d):
        """The chain at another node: the one before is moved, and one between them if they share no edge."""
        c = chain
        c = set_node(c, moved, c.node, c.place)
        if n[0] != c.node[0] and n[1] != c.node[1]:
            u = share_between(c.node[0], n[0], c.place[0], at[0])
            v = share_between(c.node[1], n[1], c.place[1], at[1])
            between = wp.vec2i(n[0], c.node[1])
            if v < u:
                between = wp.vec2i(c.node[0], n[1])
            place = wp.lerp(c.place, at, wp.float64(0.5) * (u + v))
            on_u = between[0] == 0 or between[0] == c.grid.nu
            on_v = between[1] == 0 or between[1] == c.grid.nv
            if not (on_u or on_v) and has_sign(data, lat, place, c.wanted):
                c = set_node(c, moved, between, place)
        c.node = n
        c.place = at
        return c

    @wp.func
    def left(data: data_type, lat: Lattice, chain: Chain, moved: MovedNodes, at: wp.vec2d):
        """The chain with a node of the boundary moved along it to where the path leaves the grid."""
        c = chain
        place = snap_to_boundary(c.grid, at)
        node = nearest_node(place)
        on_u = node[0] == 0 or node[0] == c.grid.nu
        on_v = node[1] == 0 or node[1] == c.grid.nv
        if not (on_u and on_v) and has_sign(data, lat, place, c.wanted):  # a corner of the patch stays
            c = link_node(data, lat, c, moved, node, place)
        return set_node(c, moved, c.node, c.place)

    @wp.func
    def along(data: data_type, lat: Lattice, chain: Chain, moved: MovedNodes, a: wp.vec2d, b: wp.vec2d):
        """The chain at b, nodes near the line from a moved onto it; `stop` is below 0 where that ends."""
        c = chain
        leaves = exit_share(c.grid, a, b)
        count = int(SAMPLES * wp.length(b - a)) + 1
        for k in range(count):
            if c.stop >= 0:
                share = wp.float64(k + 1) / wp.float64(count)
                at = wp.lerp(a, b, wp.min(share, leaves))
                if leaves < share:
                    c = left(data, lat, c, moved, at)
                    c.stop = -1
                elif has_sign(data, lat, at, c.wanted):
                    n = nearest_node(at)  # nodes of the boundary belong to `left`
                    node = wp.vec2i(wp.clamp(n[0], 1, c.grid.nu - 1), wp.clamp(n[1], 1, c.grid.nv - 1))
                    if node == c.node:
                        c.place = at
                    else:
                        c = link_node(data, lat, c, moved, node, at)
                else:
                    c = set_node(c, moved, c.node, c.place)
                    c.stop = -1
        return c

    @wp.func
    def first_node(moved: MovedNodes, c: Chain, m: wp.vec2d):
        """The corner of a cell that is in the region and nearest to m; (-1, -1) if there is none."""
        i = wp.clamp(int(wp.floor(m[0])), 0, c.grid.nu - 1)
        j = wp.clamp(int(wp.floor(m[1])), 0, c.grid.nv - 1)
        out = wp.vec2i(-1, -1)
        nearest = wp.float64(1e9)
        for k in range(4):
            n = wp.vec2i(i + (k & 1), j + (k >> 1))
            apart = wp.length(wp.vec2d(wp.float64(n[0]), wp.float64(n[1])) - m)
            if has_bit(moved, c, n) and apart < nearest:
                out = n
                nearest = apart
        return out

    @wp.kernel(**MODULE)
    def _follow_tips(
        # In:
        data: data_type,
        lattice: wp.array[Lattice],
        grid: wp.array[Grid],
        tiles_of_hand: int,
        tips: Tips,
        turn_start: wp.array[wp.int32],  # turns before each slot
        cut_start: wp.array[wp.int32],  # a section's first slot
        room: wp.array[wp.int32],  # far tips before each turn
        # Out:
        moved: MovedNodes,  # its bits are initialised as without tips
    ):
        """Move a section's nodes onto its far tips, one tip after the other."""
        row = wp.tid()
        c = Chain()
        c.grid = grid[row % grid.shape[0]]
        c.base = TILE_HEIGHT * (row // grid.shape[0] * tiles_of_hand + c.grid.tile)
        first = turn_start[cut_start[row]]
        end = turn_start[cut_start[row + 1]]
        c.next = MOVED_MOST * room[first]
        moved.start[row] = c.next
        moved.stop[row] = c.next
        room_stop = MOVED_MOST * room[end]
        for turn in range(first, end):
            if tips.what[turn] == FAR_TIP and c.grid.nu > 1 and c.grid.nv > 1:
                m = tips.path[turn, 0]
                c.wanted = inside(data, node_at(lattice[row], m[0], m[1]))
                c.node = first_node(moved, c, m)
                if c.node[0] >= 0:
                    c.stop = room_stop
                    a = place_of(moved, row, c.grid.nu + 1, c.node[0], c.node[1])
                    c.place = a
                    for k in range(tips.path_count[turn]):
                        b = tips.path[turn, k]
                        if k + 1 == tips.path_count[turn]:
                            b = wp.lerp(a, b, BEFORE_END)
                        if c.stop >= 0:
                            c = along(data, lattice[row], c, moved, a, b)
                        a = b
                    if c.stop >= 0:
                        c = set_node(c, moved, c.node, c.place)
                    moved.stop[row] = c.next

    return _follow_tips


def follow_tips(
    field: Field, lattice: wp.array, grids: Grids, bits: wp.array, cut_start: wp.array, found: FoundTips
) -> MovedNodes:
    """Move nodes onto the far tips; `bits` are changed with them. cut_start: see Samples."""
    device = lattice.device
    size = MOVED_MOST * found.far_count
    moved = MovedNodes()
    moved.start, moved.stop = (wp.empty(lattice.shape[0], dtype=wp.int32, device=device) for _ in range(2))
    moved.node = wp.empty(size, dtype=wp.int32, device=device)
    moved.place = wp.empty(size, dtype=wp.vec2d, device=device)
    moved.bits = parts_of(bits)
    inputs = [
        field.data,
        lattice,
        grids.grid,
        grids.patch_of.shape[0],
        found.tips,
        found.turn_start,
        cut_start,
        found.room,
    ]
    launch(follow_kernel(inside_function(field), field.data_type), lattice.shape[0], inputs, [moved])
    return moved


@wp.kernel
def _keep_slots(
    # In:
    section: wp.array[wp.int32],
    moved: MovedNodes,
    old_start: wp.array[wp.int32],  # slots of the sections before nodes were moved
    start: wp.array[wp.int32],
    value: wp.array[wp.vec3],  # of each slot before
    # Out:
    result: wp.array[wp.vec3],
):
    """Copy what belongs to a slot of a section without moved nodes."""
    slot = wp.tid()
    row = section[slot]
    if is_done(moved, row):
        result[slot] = value[slot - start[row] + old_start[row]]


def keep_slots(
    section: wp.array, moved: MovedNodes, old_start: wp.array, start: wp.array, value: wp.array, result: wp.array
) -> None:
    """Copy points, or what else there is of each slot, of sections without moved nodes: they are walked as before."""
    inputs = [section, moved, old_start, start, value]
    launch(_keep_slots, result.shape[0], inputs, [result])
