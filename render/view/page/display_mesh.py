"""Meshes for the screen: no more triangles than a person sees the use of."""

import numpy as np

FACES_MOST = 20_000
"""Triangles of an object on a page; of those that have more, manifold3d moves corners together."""
_SHARES = (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)  # of the object's size: tolerances, until few triangles are left


def simplified_for_display(
    vertices: np.ndarray, faces: np.ndarray, faces_most: int = FACES_MOST
) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices [m] and faces of a mesh with few triangles, and the tolerance [m] that it took; 0: the mesh itself.

    A surface that is not closed stays as it is, whatever its size: manifold3d does not take it.
    """
    if len(faces) <= faces_most:
        return vertices, faces, 0.0
    import manifold3d  # 50 ms that only simplifying costs

    middle = (vertices.min(axis=0).astype(np.float64) + vertices.max(axis=0)) / 2
    near = (vertices - middle).astype(np.float32)
    mesh = manifold3d.Mesh(near, np.ascontiguousarray(faces, np.uint32))
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError or solid.num_tri() == 0:
        return vertices, faces, 0.0
    tolerance = 0.0
    for share in _SHARES:
        tolerance = share * float(np.ptp(near, axis=0).max())
        solid = solid.simplify(tolerance)
        if solid.num_tri() <= faces_most:
            break
    out = solid.to_mesh()
    found = np.asarray(out.vert_properties)[:, :3].astype(np.float64) + middle
    return found.astype(np.float32), np.asarray(out.tri_verts, np.int32), tolerance
