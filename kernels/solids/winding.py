"""The generalised winding number of a triangle surface that need not be closed (Jacobson et al. 2013).

It is 1 inside and 0 outside of what is closed, and between them near holes: above 0.5 counts as inside. Triangles far
away act as one, by a series (Barill et al. 2018), along a heap of boxes in Morton order.
"""

import numpy as np
import warp as wp

from ..section.half_edges import spatial_order

LEAF = wp.constant(8)  # triangles of a leaf
FAR = wp.constant(wp.float64(1.5))  # a node acts as one from this many of its radii on: wrong by 0.07 (measured)
FARTHER = wp.constant(wp.float64(4.0))  # the same where the first answer may be wrong: by 3e-3
UNSURE = wp.constant(wp.float64(0.2))  # how near to HALF that is
HALF = wp.constant(wp.float64(0.5))  # inside above it
TURN = wp.constant(wp.float64(4.0 * np.pi))  # the whole sphere seen from its middle


@wp.struct
class WindingTree:
    """Triangles and the heap over them, on a device; the root is node 1."""

    corner: wp.array[wp.vec3d]  # [m], shape [3 face]
    centre: wp.array[wp.vec3d]  # of a node's area [m], shape [node]
    area: wp.array[wp.vec3d]  # its triangles' areas along their normals, summed [m^2]
    moment: wp.array[wp.mat33d]  # the same, each times where it is from the centre (column) [m^3]
    square: wp.array[wp.float64]  # of its radius [m^2]
    leaf_first: wp.int32
    face_count: wp.int32


@wp.func
def solid_angle(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Of a triangle seen from the origin, in turns of the sphere, above 0 from behind (Van Oosterom, Strackee 1983);
    0 from within its plane, so that a closed surface has 0.5 on it."""
    top = wp.dot(a, wp.cross(b, c))
    if top == wp.float64(0.0):
        return wp.float64(0.0)
    la = wp.length(a)
    lb = wp.length(b)
    lc = wp.length(c)
    bottom = la * lb * lc + wp.dot(a, b) * lc + wp.dot(b, c) * la + wp.dot(c, a) * lb
    return wp.float64(2.0) * wp.atan2(top, bottom) / TURN


@wp.func
def winding_within(tree: WindingTree, x: wp.vec3d, far: wp.float64):
    """Winding number at a point, nodes farther than `far` radii as one; always summed in the same order."""
    w = wp.float64(0.0)
    node = int(1)
    while node != 0:
        d = tree.centre[node] - x
        square = wp.dot(d, d)
        below = bool(False)
        if square > far * far * tree.square[node]:
            moment = tree.moment[node]  # of all triangles of the node: two terms of the series
            bent = wp.trace(moment) - wp.float64(3.0) * wp.dot(d, moment * d) / square
            w += (wp.dot(tree.area[node], d) + bent) / (TURN * square * wp.sqrt(square))
        elif node >= tree.leaf_first:  # of a leaf's triangles, each exactly
            leaf = node - tree.leaf_first
            turns = wp.float64(0.0)
            for face in range(leaf * LEAF, wp.min((leaf + 1) * LEAF, tree.face_count)):
                h = 3 * face
                turns += solid_angle(tree.corner[h] - x, tree.corner[h + 1] - x, tree.corner[h + 2] - x)
            w += turns
        else:
            below = True
        if below:
            node = 2 * node
        else:
            node += 1
            while node % 2 == 0:
                node = node // 2
            if node == 1:
                node = 0
    return w


@wp.func
def winding_at(tree: WindingTree, x: wp.vec3d):
    """Winding number at a point: roughly where that decides what is inside, else well."""
    w = winding_within(tree, x, FAR)
    if wp.abs(w - HALF) < UNSURE:
        w = winding_within(tree, x, FARTHER)
    return w


def upload_winding(vertices: np.ndarray, faces: np.ndarray, device: str) -> WindingTree:
    """Triangles in Morton order on a Warp device, and their areas and moments summed upwards.

    vertices: [m], float64, shape [vertex, 3]; faces: int, shape [face, 3].
    """
    faces = faces[spatial_order(vertices.astype(np.float32), faces)]
    corner = vertices[faces].astype(np.float64)
    leaf_count = 1 << int(np.ceil(np.log2(max(1, -(-len(faces) // int(LEAF))))))
    a, b, c = (corner[:, k] for k in range(3))
    vector = np.zeros((leaf_count * int(LEAF), 3))
    vector[: len(faces)] = 0.5 * np.cross(b - a, c - a)
    weight = np.linalg.norm(vector, axis=1) + 1e-300
    weight[len(faces) :] = 0.0
    middle = np.zeros_like(vector)
    middle[: len(faces)] = corner.mean(axis=1)
    spread = vector[:, :, None] * middle[:, None, :]
    area, total, place, moment = (np.zeros((2 * leaf_count, *shape)) for shape in ((3,), (), (3,), (3, 3)))
    for out, given in ((area, vector), (total, weight), (place, weight[:, None] * middle), (moment, spread)):
        out[leaf_count:] = given.reshape(leaf_count, int(LEAF), *given.shape[1:]).sum(axis=1)
    low, high = np.full_like(area, np.inf), np.full_like(area, -np.inf)
    of_leaf = leaf_count + np.arange(len(faces)) // int(LEAF)
    np.minimum.at(low, of_leaf, corner.min(axis=1))
    np.maximum.at(high, of_leaf, corner.max(axis=1))
    size = leaf_count
    while size > 1:
        up, one, two = slice(size // 2, size), slice(size, 2 * size, 2), slice(size + 1, 2 * size, 2)
        for array in (area, total, place, moment):
            array[up] = array[one] + array[two]
        low[up], high[up] = np.minimum(low[one], low[two]), np.maximum(high[one], high[two])
        size //= 2
    centre = place / np.maximum(total, 1e-300)[:, None]
    moment -= area[:, :, None] * centre[:, None, :]
    empty = ~np.isfinite(low[:, 0])
    radius = np.linalg.norm(np.maximum(high - centre, centre - low), axis=1)
    radius[empty], centre[empty] = 0.0, 1e9
    tree = WindingTree()
    tree.corner, tree.centre, tree.area = (
        wp.array(x, dtype=wp.vec3d, device=device) for x in (corner.reshape(-1, 3), centre, area)
    )
    tree.moment = wp.array(moment, dtype=wp.mat33d, device=device)
    tree.square = wp.array(radius**2, dtype=wp.float64, device=device)
    tree.leaf_first, tree.face_count = leaf_count, len(faces)
    return tree
