"""The surface of what a hand and an object share, both fields, as points: one a cut cell of a lattice.

The lattice's nodes are the multiples of its step in the object's frame, so that points do not swim while a hand moves.
A cell is named by its lowest node. Nodes of a pose are numbered with z fastest.
"""

from typing import Any

import numpy as np
import warp as wp

from ..fields.field import MODULE, Field, inside_function, made_once
from ..offsets import launch, scan_counts
from ..patch import EXACT, rotate, to_float32, to_float64

wp.set_module_options(EXACT)

HALVINGS = wp.constant(24)  # of half a cell's diagonal: 2 mm end at 0.1 nm


@wp.struct
class Blocks:
    """The nodes that are looked at: a block for each pose."""

    step: wp.float64  # [m]
    pose: wp.array[wp.transform]  # hand frame -> object's frame
    first: wp.array2d[int]  # lowest node, in steps, shape [pose, 3]
    count: wp.array2d[int]  # nodes along x, y and z, shape [pose, 3]; 0 0 0 for none
    start: wp.array[int]  # offsets into nodes, shape [pose + 1]


@wp.func
def pose_of_node(start: wp.array[int], node: int):
    """The last pose that starts at or before a node; those before it at the same place have none."""
    low = int(0)
    high = int(start.shape[0] - 1)
    while high - low > 1:
        middle = (low + high) // 2
        if start[middle] <= node:
            low = middle
        else:
            high = middle
    return low


@wp.func
def node_place(blocks: Blocks, pose: int, index: int, corner: int):
    """Position of a node of a pose's block, or of the one at a corner (bits x, y, z) of its cell [m]."""
    across = blocks.count[pose, 2]
    row = index // across
    i = blocks.first[pose, 0] + row // blocks.count[pose, 1] + (corner & 1)
    j = blocks.first[pose, 1] + row % blocks.count[pose, 1] + ((corner >> 1) & 1)
    k = blocks.first[pose, 2] + index % across + ((corner >> 2) & 1)
    return blocks.step * wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k))


@wp.func
def corner_node(blocks: Blocks, pose: int, node: int, corner: int):
    """Number of the node at a corner of a cell."""
    row = (corner & 1) * blocks.count[pose, 1] + ((corner >> 1) & 1)
    return node + row * blocks.count[pose, 2] + ((corner >> 2) & 1)


@wp.kernel
def _count_cut_cells(
    blocks: Blocks,
    inside: wp.array[wp.uint8],
    count: wp.array[int],  # [node + 1]
):
    """1 for a cell with corners inside and outside."""
    node = wp.tid()
    pose = pose_of_node(blocks.start, node)
    found = int(0)
    index = node - blocks.start[pose]
    across = blocks.count[pose, 2]
    deep = blocks.count[pose, 1]
    row = index // across
    # The last nodes of a block along each of its edges have no cell.
    last = row // deep == blocks.count[pose, 0] - 1
    if not last and row % deep < deep - 1 and index % across < across - 1:
        total = int(0)
        for corner in range(8):
            total += int(inside[corner_node(blocks, pose, node, corner)])
        if total > 0 and total < 8:
            found = int(1)
    count[node] = found


@wp.kernel
def _start_poses(
    start: wp.array[int],  # [pose + 1], into nodes
    before: wp.array[int],  # [node + 1], points before
    point_start: wp.array[wp.int64],  # [pose + 1]
):
    """Points before each pose."""
    pose = wp.tid()
    point_start[pose] = wp.int64(before[start[pose]])


@made_once
def overlap_kernels(in_solid: Any, solid_type: Any, in_hand: Any, hand_type: Any) -> tuple[Any, Any]:
    """The kernels for two kinds of fields: which nodes are in both, and a point in each cut cell."""

    @wp.func
    def in_both(solid: solid_type, hand: hand_type, pose: wp.transform, x: wp.vec3d):
        if in_solid(solid, x):
            q = wp.transform_get_rotation(pose)
            back = -to_float64(wp.vec3(q[0], q[1], q[2]))
            own = rotate(back, wp.float64(q[3]), x - to_float64(wp.transform_get_translation(pose)))
            return in_hand(hand, own)
        return False

    @wp.kernel(**MODULE)
    def _mark_shared(solid: solid_type, hand: hand_type, blocks: Blocks, inside: wp.array[wp.uint8]):
        """Mark nodes that are in both solids."""
        node = wp.tid()
        pose = pose_of_node(blocks.start, node)
        x = node_place(blocks, pose, node - blocks.start[pose], 0)
        inside[node] = wp.uint8(wp.where(in_both(solid, hand, blocks.pose[pose], x), 1, 0))

    @wp.kernel(**MODULE)
    def _place_points(
        # In:
        solid: solid_type,
        hand: hand_type,
        blocks: Blocks,
        inside: wp.array[wp.uint8],
        before: wp.array[int],  # [node + 1], points before
        # Out:
        point: wp.array[wp.vec3],  # [m]
    ):
        """A point on the surface in each cut cell: from the middle of its cut edges to a corner on the other side."""
        node = wp.tid()
        if before[node + 1] == before[node]:
            return
        pose = pose_of_node(blocks.start, node)
        index = node - blocks.start[pose]
        middle = wp.vec3d()
        cut = wp.float64(0.0)
        for corner in range(8):
            for axis in range(3):
                other = corner | (1 << axis)
                if other != corner:
                    one = inside[corner_node(blocks, pose, node, corner)]
                    if one != inside[corner_node(blocks, pose, node, other)]:
                        ends = node_place(blocks, pose, index, corner) + node_place(blocks, pose, index, other)
                        middle += wp.float64(0.5) * ends
                        cut += wp.float64(1.0)
        middle = middle / cut
        own = in_both(solid, hand, blocks.pose[pose], middle)
        least = wp.float64(1.0e30)
        end = middle
        for corner in range(8):
            if (inside[corner_node(blocks, pose, node, corner)] != wp.uint8(0)) != own:
                x = node_place(blocks, pose, index, corner)
                if wp.length_sq(x - middle) < least:
                    least = wp.length_sq(x - middle)
                    end = x
        for _halving in range(HALVINGS):
            x = wp.float64(0.5) * (middle + end)
            if in_both(solid, hand, blocks.pose[pose], x) == own:
                middle = x
            else:
                end = x
        point[before[node]] = to_float32(wp.float64(0.5) * (middle + end))

    return _mark_shared, _place_points


def find_shared_surface(
    solid: Field, hand: Field, pose: np.ndarray, first: np.ndarray, count: np.ndarray, *, step: float, device: str
) -> tuple[wp.array, wp.array]:
    """Points on the surface of what two fields share, a block of nodes for each pose.

    pose: hand frame -> object's frame, float32, shape [pose, 7]; first, count: lowest node in steps and nodes along
    each axis, int32, shape [pose, 3]; step: [m].
    Returns points [m], vec3, in order of pose and cell, and where each pose's start, int64, shape [pose + 1].
    """
    mark, place = overlap_kernels(inside_function(solid), solid.data_type, inside_function(hand), hand.data_type)
    start = np.concatenate([[0], np.cumsum(count.prod(axis=1, dtype=np.int64))])
    blocks = Blocks()
    blocks.step = step
    blocks.pose = wp.array(pose, dtype=wp.transform, device=device)
    blocks.first, blocks.count = (wp.array(x, dtype=int, device=device) for x in (first, count))
    blocks.start = wp.array(start.astype(np.int32), dtype=int, device=device)
    nodes = int(start[-1])
    inside = wp.empty(nodes, dtype=wp.uint8, device=device)
    launch(mark, nodes, [solid.data, hand.data, blocks], [inside])
    found = wp.zeros(nodes + 1, dtype=int, device=device)
    launch(_count_cut_cells, nodes, [blocks, inside], [found])
    (before,), (total,) = scan_counts(found)
    point = wp.empty(total, dtype=wp.vec3, device=device)
    launch(place, nodes, [solid.data, hand.data, blocks, inside, before], [point])
    point_start = wp.empty(len(start), dtype=wp.int64, device=device)
    launch(_start_poses, len(start), [blocks.start, before], [point_start])
    return point, point_start
