"""Faces of a mesh that lie on each other: where two bodies touch, or one touches itself."""

from weakref import WeakKeyDictionary

import numpy as np

from .solid_mesh import MeshObject

FLAT = 1e-4  # planes whose normals, or whose places in units of the mesh's size, differ by less may be one plane
ROUNDINGS = 8.0  # of float32: what two faces on each other may be apart by, seen along a plane that cuts both askew
GAP_LARGEST = 1e-6  # [m]; a tenth of what contours are right to
_GAPS: WeakKeyDictionary[MeshObject, float] = WeakKeyDictionary()


def gap_of(mesh: MeshObject) -> float:
    """How far from each other faces of a mesh may count as one place [m]; 0 if none lie on each other for sure.

    Vertices are rounded to float32, so between faces that touched there are gaps and walls of that width. Faces that
    merely look opposite ways in one plane count, too: telling them apart would take longer than it saves. Worked out
    once for each object.
    """
    if mesh not in _GAPS:
        vertices = mesh.vertices.astype(np.float64)
        touches = mesh.solid != "winding" or _has_opposite_planes(vertices, mesh.faces)
        spacing = float(np.spacing(np.abs(mesh.vertices).max()))
        _GAPS[mesh] = min(ROUNDINGS * spacing, GAP_LARGEST) if touches else 0.0
    return _GAPS[mesh]


def _has_opposite_planes(vertices: np.ndarray, faces: np.ndarray) -> bool:
    from scipy.spatial import KDTree  # a tenth of a second that simple meshes do without

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corner = ((vertices - 0.5 * (low + high)) / np.ptp([low, high], axis=0).max())[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal, corner = normal[length > 0] / length[length > 0, None], corner[length > 0]
    place = np.einsum("ij,ij->i", normal, corner[:, 0])
    plane = np.unique(np.rint(np.column_stack([normal, place]) / FLAT), axis=0)  # many faces of a voxel mesh share one
    distance = np.asarray(KDTree(plane).query(-plane, distance_upper_bound=4.0)[0])  # rounding: 2 units a coordinate
    return bool(np.isfinite(distance).any())
