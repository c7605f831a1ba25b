"""Distances from a mesh: of triangles' points, exact ones of single triangles, and how deep a point is inside."""

import numpy as np
import warp as wp

from ..fields.mesh_inside import Triangle, height_sign, touches, turns_around
from ..offsets import launch
from ..patch import EXACT, to_float64

wp.set_module_options(EXACT)

FAR = wp.constant(1.0e6)  # [m]


@wp.func
def segment_distance(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d):
    """Distance of a point from a segment."""
    along = b - a
    square = wp.dot(along, along)
    share = wp.float64(0.0)
    if square > wp.float64(0.0):
        share = wp.clamp(wp.dot(p - a, along) / square, wp.float64(0.0), wp.float64(1.0))
    return wp.length(p - a - share * along)


@wp.func
def triangle_distance(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Distance of a point from a triangle; float32 would lose a tenth of a millimetre on long, thin ones."""
    n = wp.cross(b - a, c - a)
    square = wp.dot(n, n)
    if square > wp.float64(0.0):
        one = wp.dot(wp.cross(b - a, p - a), n) >= wp.float64(0.0)
        two = wp.dot(wp.cross(c - b, p - b), n) >= wp.float64(0.0)
        three = wp.dot(wp.cross(a - c, p - c), n) >= wp.float64(0.0)
        if one and two and three:
            return wp.abs(wp.dot(p - a, n)) / wp.sqrt(square)
    return wp.min(segment_distance(p, a, b), wp.min(segment_distance(p, b, c), segment_distance(p, c, a)))


@wp.kernel
def _bound_distances(
    mesh: wp.uint64,
    corner: wp.array2d[wp.vec3],  # [m], shape [triangle, 3]
    known: wp.array[float],  # [m]
    bound: wp.array[float],  # [m]
):
    """Distance of a triangle's middle, and one that no point of it exceeds.

    The distance from the face nearest to the middle is convex, so no point is farther from it than the farthest corner;
    and no point is farther from the mesh than the middle is, and the corners are from that.
    """
    i = wp.tid()
    middle = (corner[i, 0] + corner[i, 1] + corner[i, 2]) / 3.0
    found = wp.mesh_query_point_no_sign(mesh, middle, FAR)
    known[i] = FAR
    bound[i] = FAR
    if found.result:
        distance = wp.length(middle - wp.mesh_eval_position(mesh, found.face, found.u, found.v))
        points = wp.mesh_get(mesh).points
        index = wp.mesh_get(mesh).indices
        a = wp.vec3d(points[index[3 * found.face]])
        b = wp.vec3d(points[index[3 * found.face + 1]])
        c = wp.vec3d(points[index[3 * found.face + 2]])
        reach = float(0.0)
        most = float(0.0)
        for k in range(3):
            reach = wp.max(reach, wp.length(corner[i, k] - middle))
            most = wp.max(most, wp.float32(triangle_distance(wp.vec3d(corner[i, k]), a, b, c)))
        known[i] = distance
        bound[i] = wp.max(distance, wp.min(distance + reach, most))


class MeshDistance:
    """A mesh on a device that distances are measured from."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, device: str) -> None:
        """Vertices: [m], shape [vertex, 3]; faces: int, shape [face, 3]. Worked out about their middle, in float32."""
        self._device = device
        self._middle = (vertices.min(axis=0) + vertices.max(axis=0)).astype(np.float64) / 2
        near = wp.array((vertices - self._middle).astype(np.float32), dtype=wp.vec3, device=device)
        self._mesh = wp.Mesh(near, wp.array(faces.astype(np.int32).ravel(), dtype=int, device=device))

    def bound_distances(self, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each triangle the distance of its middle from the mesh, and a bound of that of its points [m], float64.

        triangles: [m], shape [triangle, 3, 3].
        """
        near = (triangles - self._middle).astype(np.float32)
        corner = wp.array(near, dtype=wp.vec3, device=self._device)
        known, bound = (wp.empty(len(near), dtype=float, device=self._device) for _ in range(2))
        launch(_bound_distances, len(near), [self._mesh.id, corner], [known, bound])
        return known.numpy().astype(np.float64), bound.numpy().astype(np.float64)


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
