"""A field's surface as triangles: Warp's marching cubes for what joins what, the field's own roots for where.

Marching cubes see only -1 and +1, so that each of their vertices is the middle of the lattice edge that it lies on, to
the bit, and the edge can be told from it.
"""

from typing import Any

import warp as wp
import warp.geometry

from ..fields.field import MODULE, Field, Lattice, inside_function, made_once, node_at, root_function
from ..offsets import launch
from ..patch import EXACT

wp.set_module_options(EXACT)


@made_once
def isosurface_kernels(inside: Any, root: Any, data_type: Any) -> tuple[Any, Any]:
    """The kernels that mesh one kind of field: sides of nodes, and places of vertices."""

    @wp.kernel(**MODULE)
    def _mark_nodes(data: data_type, lattice: Lattice, side: wp.array3d[wp.float32]):
        """-1 inside, +1 outside; nodes of the border are outside."""
        i, j, k = wp.tid()
        last_i, last_j, last_k = side.shape[0] - 1, side.shape[1] - 1, side.shape[2] - 1
        mark = float(1.0)
        if i > 0 and j > 0 and k > 0 and i < last_i and j < last_j and k < last_k:
            if inside(data, node_at(lattice, i, j, k)):
                mark = float(-1.0)
        side[i, j, k] = mark

    @wp.kernel(**MODULE)
    def _place_vertices(
        data: data_type,
        lattice: Lattice,
        middle: wp.array[wp.vec3],  # of an edge, in steps
        margin: wp.float64,  # least share of an edge between a vertex and its ends
        vertex: wp.array[wp.vec3],  # [m]
    ):
        """Place vertices where the field's surface crosses edges of the lattice."""
        k = wp.tid()
        m = middle[k]
        a = node_at(lattice, int(wp.floor(m[0])), int(wp.floor(m[1])), int(wp.floor(m[2])))
        b = node_at(lattice, int(wp.ceil(m[0])), int(wp.ceil(m[1])), int(wp.ceil(m[2])))
        share = wp.float64(0.5)  # on the border both ends may be inside
        if inside(data, a) != inside(data, b):
            share = wp.dot(root(data, a, b) - a, b - a) / wp.dot(b - a, b - a)
        x = a + wp.clamp(share, margin, wp.float64(1.0) - margin) * (b - a)
        vertex[k] = wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))

    return _mark_nodes, _place_vertices


def mesh_isosurface(
    field: Field, lattice: Lattice, shape: tuple[int, int, int], *, margin: float, device: str
) -> tuple[wp.array, wp.array]:
    """Vertices [m], wp.vec3, and corners of triangles, int32, shape [3 triangle]; closed, counter-clockwise outside.

    shape: nodes of the lattice; those of its border count as outside.
    margin: share of an edge that a vertex keeps from its ends, so that no two vertices coincide.
    """
    mark, place = isosurface_kernels(inside_function(field), root_function(field), field.data_type)
    side = wp.empty(shape, dtype=wp.float32, device=device)
    launch(mark, shape, [field.data, lattice], [side])
    middle, corner = warp.geometry.IsoSurfaceMarchingCubes.extract(side, 0.0)
    vertex = wp.empty(middle.shape[0], dtype=wp.vec3, device=device)
    launch(place, middle.shape[0], [field.data, lattice, middle, margin], [vertex])
    return vertex, corner
