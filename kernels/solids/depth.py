"""Depth of points inside a mesh."""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT

wp.set_module_options(EXACT)

FARTHEST = 1e3  # [m]; every mesh is nearer


@wp.kernel
def _measure_depth(
    # In:
    mesh: wp.uint64,
    points: wp.array[wp.vec3],  # [m]
    # Out:
    depth: wp.array[wp.float32],  # [m]; 0 outside
):
    """Distance to the surface from inside."""
    i = wp.tid()
    x = points[i]
    depth[i] = 0.0
    query = wp.mesh_query_point_sign_winding_number(mesh, x, FARTHEST)
    if query.result and query.sign < 0.0:
        depth[i] = wp.length(wp.mesh_eval_position(mesh, query.face, query.u, query.v) - x)


def mesh_for_depth(vertices: np.ndarray, faces: np.ndarray, device: str) -> wp.Mesh:
    """A mesh that `measure_depth` can ask, on a device; vertices: [m], [vertex, 3]; faces: int, [face, 3]."""
    return wp.Mesh(
        wp.array(np.ascontiguousarray(vertices, np.float32), dtype=wp.vec3, device=device),
        wp.array(np.ascontiguousarray(faces, np.int32).ravel(), dtype=wp.int32, device=device),
        support_winding_number=True,
    )


def measure_depth(mesh: wp.Mesh, points: np.ndarray) -> np.ndarray:
    """Depth of points inside a mesh [m], 0 outside, float32, shape [point]; points: [m], shape [point, 3].

    Inside is where the mesh winds around a point.
    """
    count, device = len(points), mesh.device
    depth = wp.empty(count, dtype=wp.float32, device=device)
    x = wp.array(np.ascontiguousarray(points, np.float32), dtype=wp.vec3, device=device)
    wp.launch(_measure_depth, count, inputs=[mesh.id, x], outputs=[depth], device=device, block_dim=BLOCK)
    return depth.numpy()
