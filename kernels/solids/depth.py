"""How deep a point is inside a closed mesh: its distance from the surface, and its side of it."""

import numpy as np
import warp as wp

from ..fields.mesh_inside import Triangle, height_sign, touches, turns_around
from ..patch import to_float64

FARTHEST = wp.constant(wp.float32(1e3))  # [m]; every mesh is nearer
ROUNDING = wp.constant(wp.float32(1e-6))  # [m]; boxes of faces are looked for this much wider


@wp.func
def distance_within(mesh: wp.uint64, x: wp.vec3, most: float):
    """Distance from the surface [m], or `most` if it is farther."""
    query = wp.mesh_query_point_no_sign(mesh, x, most)
    if not query.result:
        return most
    return wp.length(wp.mesh_eval_position(mesh, query.face, query.u, query.v) - x)


@wp.func
def is_within(mesh: wp.uint64, x: wp.vec3):
    """Whether a closed mesh winds around a point, by the faces above it as in `fields.mesh_inside`; not on a face."""
    shape = wp.mesh_get(mesh)
    winding = int(0)
    low = wp.vec3(x[0] - ROUNDING, x[1] - ROUNDING, x[2] - ROUNDING)
    query = wp.mesh_query_aabb(mesh, low, wp.vec3(x[0] + ROUNDING, x[1] + ROUNDING, FARTHEST))
    face = int(0)
    at = to_float64(x)
    while wp.mesh_query_aabb_next(query, face):
        t = Triangle()
        t.a = to_float64(shape.points[shape.indices[3 * face]]) - at
        t.b = to_float64(shape.points[shape.indices[3 * face + 1]]) - at
        t.c = to_float64(shape.points[shape.indices[3 * face + 2]]) - at
        turns = turns_around(t)
        if turns != 0:
            side = height_sign(t, turns)
            if side == 0:
                return False
            if side > 0:
                winding += turns
        elif touches(t):
            return False
    return winding > 0


def mesh_for_depth(vertices: np.ndarray, faces: np.ndarray, device: str) -> wp.Mesh:
    """A closed mesh that these functions can ask, on a device; vertices: [m], [vertex, 3]; faces: int, [face, 3]."""
    return wp.Mesh(
        wp.array(np.ascontiguousarray(vertices, np.float32), dtype=wp.vec3, device=device),
        wp.array(np.ascontiguousarray(faces, np.int32).ravel(), dtype=wp.int32, device=device),
    )
