"""A mesh on a grid: what is inside by crossings or by winding number, how far the surface is; and sparse volumes."""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..fields.field import Lattice, lattice_of, node_at
from ..offsets import launch
from ..patch import EXACT
from .distance import triangle_distance
from .winding import WindingTree, upload_winding, winding_at

wp.set_module_options(EXACT)

WIDER = wp.constant(1.001)  # than a distance, for boxes in float32
LOST = 1e-3  # of a triangle's longest edge: what float32 adds to its distance; 7e-4 was seen


class GridNodes(NamedTuple):
    """Nodes at equal steps along the axes, on the host."""

    origin: np.ndarray
    """The first node [m], shape [3]."""
    spacing: np.ndarray
    """[m], shape [3]."""
    shape: tuple[int, int, int]
    """Nodes along each axis."""


@wp.func
def passes_right(a: wp.vec3d, b: wp.vec3d, x: wp.float64, y: wp.float64):
    """Direction in which an edge crosses the ray from (x, y) to +x: 1 upwards, -1 downwards, 0 not at all.

    A vertex is above the ray or not, whichever edge asks; and given a and b in the same order, the answer for an edge
    is the same for both its triangles. So crossings cancel over a closed surface, however they round.
    """
    up = b[1] > y
    if (a[1] > y) == up:
        return 0
    right = bool(False)
    if x < wp.min(a[0], b[0]):
        right = True
    elif x < wp.max(a[0], b[0]):
        turn = (b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])
        right = (up and turn > wp.float64(0.0)) or (not up and turn < wp.float64(0.0))
    if not right:
        return 0
    if up:
        return 1
    return -1


@wp.func
def edge_step(vertices: wp.array[wp.vec3d], a: int, b: int, x: wp.float64, y: wp.float64):
    """The same for an edge from vertex a to vertex b."""
    if a < b:
        return passes_right(vertices[a], vertices[b], x, y)
    return -passes_right(vertices[b], vertices[a], x, y)


@wp.func
def node_from(x: wp.float64, last: int):
    """A whole number as the number of a node, from 0 to `last`."""
    return int(wp.clamp(x, wp.float64(0.0), wp.float64(last)))


@wp.kernel
def _cross_columns(
    grid: Lattice,  # In:
    vertices: wp.array[wp.vec3d],  # In: [m], shape [vertex]
    faces: wp.array[wp.vec3i],  # In:
    step: wp.array3d[wp.int32],  # Out: surfaces entered less those left, going up to a node from the one below it
):
    """Add a triangle's crossings with the columns of nodes below and above it."""
    f = faces[wp.tid()]
    a = vertices[f[0]]
    b = vertices[f[1]]
    c = vertices[f[2]]
    low = wp.cw_div(wp.min(wp.min(a, b), c) - grid.low, grid.step)
    high = wp.cw_div(wp.max(wp.max(a, b), c) - grid.low, grid.step)
    i_last = node_from(wp.floor(high[0]) + wp.float64(1.0), step.shape[0] - 1)
    j_last = node_from(wp.floor(high[1]) + wp.float64(1.0), step.shape[1] - 1)
    for i in range(node_from(wp.floor(low[0]), step.shape[0]), i_last + 1):
        for j in range(node_from(wp.floor(low[1]), step.shape[1]), j_last + 1):
            p = node_at(grid, i, j, 0)
            turns = edge_step(vertices, f[0], f[1], p[0], p[1])
            turns += edge_step(vertices, f[1], f[2], p[0], p[1])
            turns += edge_step(vertices, f[2], f[0], p[0], p[1])
            if turns != 0:  # above 0: the triangle faces up, and the solid is left
                n = wp.cross(b - a, c - a)
                z = a[2]  # height of the triangle at (x, y) of the column, never beyond its corners'
                if n[2] != wp.float64(0.0):
                    z = a[2] - (n[0] * (p[0] - a[0]) + n[1] * (p[1] - a[1])) / n[2]
                z = wp.clamp(z, wp.min(wp.min(a[2], b[2]), c[2]), wp.max(wp.max(a[2], b[2]), c[2]))
                h = (z - grid.low[2]) / grid.step[2]
                k = node_from(wp.floor(h) + wp.float64(1.0), step.shape[2])
                if turns > 0:
                    k = node_from(wp.ceil(h), step.shape[2])  # a node on the surface is outside
                if k < step.shape[2]:
                    wp.atomic_add(step, i, j, k, -turns)  # whole numbers: any order gives the same


@wp.kernel
def _sum_columns(
    step: wp.array3d[wp.int32],  # In:
    odd: int,  # In: 1: inside where the number of surfaces passed is odd; 0: where more were entered than left
    inside: wp.array3d[wp.uint8],  # Out:
):
    """Sum crossings up a column."""
    i, j = wp.tid()
    passed = int(0)
    for k in range(step.shape[2]):
        passed += step[i, j, k]
        is_in = passed > 0
        if odd == 1:
            is_in = passed % 2 != 0
        inside[i, j, k] = wp.uint8(wp.where(is_in, 1, 0))


@wp.kernel
def _wind_nodes(
    grid: Lattice,  # In:
    tree: WindingTree,  # In:
    winding: wp.array3d[wp.float32],  # Out:
):
    """Winding number at each node."""
    i, j, k = wp.tid()
    winding[i, j, k] = wp.float32(winding_at(tree, node_at(grid, i, j, k)))


@wp.kernel
def _measure_distances(
    grid: Lattice,  # In: relative to the mesh's middle
    mesh: wp.uint64,  # In: vertices in float32
    corner: wp.array[wp.vec3d],  # In: its vertices, shape [3 face]
    band: float,  # In: no distance beyond it [m]
    lost: float,  # In: what Warp's float32 search may add to the distance of a long, thin triangle [m]
    distance: wp.array3d[wp.float32],  # Out: to the nearest point of the surface [m]
):
    """Distance of each node. Warp's search is asked for a near triangle only, never for a sign."""
    i, j, k = wp.tid()
    x = node_at(grid, i, j, k)
    p = wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))
    found = wp.mesh_query_point_no_sign(mesh, p, band + lost)
    out = band
    if found.result:
        h = 3 * found.face
        near = triangle_distance(x, corner[h], corner[h + 1], corner[h + 2])
        if near <= wp.length(grid.step) + wp.float64(lost):  # the surface may pass the cells around the node
            reach = wp.vec3(wp.float32(near) * WIDER)
            for face in wp.mesh_query_aabb(mesh, p - reach, p + reach):
                h = 3 * face
                near = wp.min(near, triangle_distance(x, corner[h], corner[h + 1], corner[h + 2]))
        out = wp.min(wp.float32(near), band)
    distance[i, j, k] = out


@wp.kernel
def _look_up_voxels(
    volume: wp.uint64,  # In:
    low: wp.vec3i,  # In: coordinates of the first voxel
    values: wp.array3d[wp.float32],  # Out: also of voxels that are not stored
):
    """Values of a sparse volume of float."""
    i, j, k = wp.tid()
    values[i, j, k] = wp.volume_lookup(volume, low[0] + i, low[1] + j, low[2] + k, dtype=wp.float32)


def cross_columns(vertices: np.ndarray, faces: np.ndarray, nodes: GridNodes, *, odd: bool, device: str) -> np.ndarray:
    """Whether nodes are inside a closed surface, uint8, shape `nodes.shape`, by the crossings in each column.

    vertices: [m], float64, shape [vertex, 3]; faces: int, shape [face, 3]. odd: inside where the number of crossings
    is odd, whichever way triangles face; else where more were entered than left. A node on the surface is
    outside where the column is left there, and on one side or the other where the surface runs along the column.
    """
    step = wp.zeros(nodes.shape, dtype=wp.int32, device=device)
    inputs = [
        lattice_of(nodes.origin, nodes.spacing),
        wp.array(vertices, dtype=wp.vec3d, device=device),
        wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=device),
    ]
    launch(_cross_columns, len(faces), inputs, [step])
    inside = wp.empty(nodes.shape, dtype=wp.uint8, device=device)
    launch(_sum_columns, nodes.shape[:2], [step, int(odd)], [inside])
    return inside.numpy()


def wind_nodes(vertices: np.ndarray, faces: np.ndarray, nodes: GridNodes, device: str) -> np.ndarray:
    """Generalised winding number at each node, float32, shape `nodes.shape`; within 0.1 of the sum
    over triangles, and within 5e-3 near 0.5."""
    winding = wp.empty(nodes.shape, dtype=wp.float32, device=device)
    tree = upload_winding(vertices, faces, device)
    launch(_wind_nodes, nodes.shape, [lattice_of(nodes.origin, nodes.spacing), tree], [winding])
    return winding.numpy()


def measure_distances(
    vertices: np.ndarray, faces: np.ndarray, nodes: GridNodes, *, band: float, device: str
) -> np.ndarray:
    """Distance from each node to the surface [m], at most `band`, float32, shape `nodes.shape`.

    Nodes of cells that the surface passes are measured in float64; from others, a triangle may be 1e-3 of its longest
    edge too far, as Warp's search measures in float32.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    corner = (vertices - middle)[faces.ravel()]
    sides = corner.reshape(-1, 3, 3)
    edge = float(np.linalg.norm(sides - np.roll(sides, 1, axis=1), axis=2).max())
    mesh = wp.Mesh(
        wp.array(corner.astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(np.arange(len(corner), dtype=np.int32), dtype=wp.int32, device=device),
    )
    distance = wp.empty(nodes.shape, dtype=wp.float32, device=device)
    inputs = [
        lattice_of(nodes.origin - middle, nodes.spacing),
        mesh.id,
        wp.array(corner, dtype=wp.vec3d, device=device),
        float(band),
        LOST * edge,
    ]
    launch(_measure_distances, nodes.shape, inputs, [distance])
    return distance.numpy()


def gather_volume(volume: wp.Volume, low: np.ndarray, shape: tuple[int, int, int]) -> np.ndarray:
    """Values of a sparse float volume in a box from voxel `low` on, float32, its background where nothing is stored."""
    values = wp.empty(shape, dtype=wp.float32, device=volume.device)
    launch(_look_up_voxels, shape, [volume.id, wp.vec3i(*(int(x) for x in low))], [values])
    return values.numpy()
