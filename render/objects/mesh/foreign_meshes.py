"""Meshes of other libraries, taken and given back: trimesh's and PyVista's."""

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import MeshError
from ...validation import value_text

if TYPE_CHECKING:
    import pyvista
    import trimesh


IMAGE_HINT = "VoxelObject(image.active_scalars.reshape(image.dimensions, order='F'), spacing=image.spacing) takes it"


def foreign_arrays(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices, shape [vertex, 3], and triangles, shape [face, 3], of a mesh or scene of trimesh, or of PyVista.

    Faces with more corners are divided into triangles. Raises MeshError for what is no such mesh.
    """
    if hasattr(mesh, "to_mesh") and hasattr(mesh, "geometry"):  # a scene of trimesh, whose transforms are applied
        mesh = mesh.to_mesh()
    if hasattr(mesh, "combine") and hasattr(mesh, "n_blocks"):  # PyVista's several meshes
        if not mesh.n_blocks:
            raise MeshError("the MultiBlock has no mesh")
        mesh = mesh.combine()
    if hasattr(mesh, "spacing") and mesh.active_scalars is not None:  # PyVista's image: its surface is only its box
        raise MeshError(f"an image is a volume, not a mesh: {IMAGE_HINT}")
    if np.ndim(mesh) == 3:
        raise MeshError("an array [i, j, k] is a volume, not a mesh: VoxelObject(values, spacing=METRES) takes it")
    if hasattr(mesh, "extract_surface"):  # PyVista's: PolyData, or a volume with a surface
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of PyVista, on an option that older versions do not have
            surface = mesh if hasattr(mesh, "is_all_triangles") else mesh.extract_surface()
        if not surface.n_cells or not surface.is_all_triangles:
            surface = surface.triangulate()
        if not len(surface.faces):
            raise MeshError("the mesh has no triangles")
        return np.asarray(surface.points), np.asarray(surface.regular_faces)
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    raise MeshError(
        f"{value_text(mesh)} is no mesh: give vertices and faces, a mesh of trimesh or PyVista, or load a file by "
        "MeshObject.load(path)"
    )


def trimesh_mesh(vertices: np.ndarray, faces: np.ndarray) -> "trimesh.Trimesh":
    """A mesh of trimesh with exactly these arrays."""
    import trimesh

    return trimesh.Trimesh(vertices, faces, process=False)


def pyvista_mesh(vertices: np.ndarray, faces: np.ndarray) -> "pyvista.PolyData":
    """A mesh of PyVista with exactly these arrays; raises MeshError if it is not installed."""
    try:
        import pyvista
    except ImportError as error:
        raise MeshError("a mesh of PyVista needs PyVista: pip install pyvista") from error
    return pyvista.PolyData.from_regular_faces(vertices.copy(), faces.copy())
