"""Mesh files within the budget of one file: what would unpack or multiply beyond it is refused.

| in a file                                         | may be                                                       |
|---------------------------------------------------|--------------------------------------------------------------|
| its bytes                                         | as many as the budget                                        |
| words of text (OBJ, OFF, STL or PLY in ASCII)     | as many as it takes memory to parse                          |
| arrays that a glTF's JSON declares; their uses    | the same, whatever lies in its buffers                       |
| copies of a mesh in a scene                       | the same, before they are made                               |
| another file that a .gltf names                   | in its folder or below                                       |

The formats have readers of their own because trimesh 5.2 gives other shapes without an error: it counts relative
indices of an OBJ from the last vertex of the file, and reads rows of unequal width of a binary PLY as if they were
alike. It takes text that is cut off, and polygons with inward corners as fans.
"""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from ....datasets.bounded_file import (
    ANY_SIZE,
    FileBoundError,
    file_beside,
    read_content,
    require_bytes,
)
from ....datasets.json_text import parse_json
from ...errors import MeshError
from ...file_kinds import MESH_SUFFIXES, NOT_READ
from ...validation import value_text
from .formats.gltf import glb_chunks, read_gltf
from .formats.obj import read_obj
from .formats.off import read_off
from .formats.ply import read_ply
from .formats.polygons import FileMesh
from .formats.stl import is_binary_stl, read_stl

if TYPE_CHECKING:
    import pyvista
    import trimesh

WORD_BYTES = 64  # that parsing takes for a word of text: 30 to 75, measured


class NamedFiles:
    """The files that a mesh file names; all together within the budget."""

    def __init__(self, path: Path) -> None:
        self._path, self._taken = path, 0

    def get(self, name: str) -> bytes:
        """Bytes of a file by its URI; raises FileBoundError."""
        content = read_content(file_beside(self._path, unquote(name)))
        self._taken += len(content)
        require_bytes(self._taken, "what it names")
        return content


def load_mesh(path: Path) -> FileMesh:
    """All triangles of a mesh file, a scene flattened with its transforms.

    Raises MeshError, which names the file, for one that is missing or cannot be read, for a format that is none of
    MESH_SUFFIXES, and for one without triangles.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        what = (
            f"is {NOT_READ[suffix]}"
            if suffix in NOT_READ
            else f"its name must end in one of {', '.join(MESH_SUFFIXES)}"
        )
        raise MeshError(f"{path}: cannot be read as a mesh: {what}")
    try:
        content = read_content(path)
        with np.errstate(all="ignore"):  # what is not finite is refused once it is placed
            mesh = parsed(content, suffix, NamedFiles(path))
    except FileBoundError as error:
        raise MeshError(f"{path}: {error}") from error
    except Exception as error:  # ValueErrors, MeshErrors too, say what is wrong
        what = str(error)[:400] if isinstance(error, ValueError) else f"{type(error).__name__}: {str(error)[:300]}"
        raise MeshError(f"{path}: cannot be read as a mesh: {what}") from error
    if len(mesh.faces) == 0:
        raise MeshError(f"{path}: has no triangles ({len(content)} bytes)")
    return without_stray(mesh)


def parsed(content: bytes, suffix: str, files: NamedFiles) -> FileMesh:
    """The triangles that bytes of a format hold; raises MeshError."""
    if suffix in (".glb", ".gltf"):
        text, binary = glb_chunks(content) if suffix == ".glb" else (content, None)
        try:
            tree = parse_json(text.decode("utf-8-sig"), text_most=ANY_SIZE)
        except ValueError as error:
            raise MeshError(f"has JSON that cannot be read ({str(error)[:200]})") from error
        return read_gltf(tree, files.get, binary)
    if is_text(content, suffix):
        require_bytes(WORD_BYTES * sum(content.count(mark) for mark in b" \t\r\n\v\f"), "what its text holds")
    read = {".stl": read_stl, ".obj": read_obj, ".ply": read_ply, ".off": read_off}
    return read[suffix](content)


def is_text(content: bytes, suffix: str) -> bool:
    """Whether a file is in text."""
    if suffix == ".stl":
        return not is_binary_stl(content)
    return suffix != ".ply" or b"format ascii" in content[: content.find(b"end_header")]


def without_stray(mesh: FileMesh) -> FileMesh:
    """The mesh without vertices that no triangle uses, if some of those are not finite."""
    is_stray = np.ones(len(mesh.vertices), bool)
    is_stray[mesh.faces] = False
    if np.isfinite(mesh.vertices[is_stray]).all():
        return mesh
    number = np.cumsum(~is_stray) - 1
    return FileMesh(mesh.vertices[~is_stray], number[mesh.faces], mesh.nodes)


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
