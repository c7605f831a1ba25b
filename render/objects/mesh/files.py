"""Mesh files, read by trimesh, within the budget of one file: what would unpack or multiply beyond it is refused.

| in a file                                         | may be                                                       |
|---------------------------------------------------|--------------------------------------------------------------|
| its bytes; those of the members of a .zip         | as many as the budget, all together                          |
| words of text (OBJ, OFF, STL or PLY in ASCII)     | as many as it takes memory to parse                          |
| arrays that a glTF's JSON declares; their uses    | the same, whatever lies in its buffers                       |
| copies of a mesh in a scene                       | the same, before they are made                               |
| another file that a .gltf names                   | in its folder or below; in a .zip, one of its members        |
"""

import io
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ....datasets.bounded_file import (
    FileBoundError,
    file_beside,
    parse_json,
    read_content,
    require_bytes,
    unzip,
)
from ...errors import MeshError

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".zip")
WORD_BYTES = 64  # that trimesh takes to parse a word of text: 24 to 115, measured
COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # of glTF's number types
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
VERTEX_BYTES = FACE_BYTES = 24  # float64 and int64, which all becomes
Read = Callable[[str], bytes]


class NamedFiles:
    """The files that a mesh may name, as trimesh asks for them; all together within the budget."""

    def __init__(self, read: Read, file_name: str) -> None:
        self.file_name = file_name
        self._read, self._taken = read, 0

    def get(self, name: str) -> bytes:
        """Bytes of a file by its URI; raises FileBoundError."""
        content = self._read(unquote(name))
        self._taken += len(content)
        require_bytes(self._taken, "what it names")
        return content

    __getitem__ = get


def load_scene(path: Path) -> Any:
    """The scene of a mesh file.

    Raises MeshError, which names the file, for one that is missing or cannot be read, and for a format that is none of
    SUFFIXES.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise MeshError(f"{path}: cannot be read as a mesh: its name must end in one of {', '.join(SUFFIXES)}")
    try:
        content = read_content(path)
        scene = archived(content) if suffix == ".zip" else parsed(content, suffix, named_beside(path))
        placed = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
        size = sum(VERTEX_BYTES * len(one.vertices) + FACE_BYTES * len(getattr(one, "faces", ())) for one in placed)
        require_bytes(size, "its scene, with all copies of its meshes,")
    except FileBoundError as error:
        raise MeshError(f"{path}: {error}") from error
    except Exception as error:  # readers of many formats, each with errors of its own
        raise MeshError(f"{path}: cannot be read as a mesh ({type(error).__name__}: {str(error)[:300]})") from error
    return scene


def named_beside(path: Path) -> NamedFiles:
    """Files in the folder of a mesh."""
    return NamedFiles(lambda name: read_content(file_beside(path, name)), path.name)


def archived(content: bytes) -> Any:
    """The scene of all meshes in a zip file."""
    from trimesh.scene.scene import append_scenes

    members = unzip(content)

    def member(name: str) -> bytes:
        if name not in members:
            raise FileBoundError(f"names the file {name[:200]!r}, which is not in the archive")
        return members[name]

    suffixes = {name: Path(name).suffix.lower() for name in members}
    meshes = [name for name, suffix in suffixes.items() if suffix in SUFFIXES and suffix != ".zip"]
    return append_scenes([parsed(members[name], suffixes[name], NamedFiles(member, name)) for name in meshes])


def parsed(content: bytes, suffix: str, files: NamedFiles) -> Any:
    """The scene that bytes of a format hold."""
    import trimesh  # half a second that built-in objects need not wait for

    if suffix in (".glb", ".gltf"):
        require_gltf(parse_json(gltf_text(content) if suffix == ".glb" else content.decode("utf-8-sig")))
    elif is_text(content, suffix):
        require_bytes(WORD_BYTES * (content.count(b" ") + content.count(b"\n")), "what its text holds")
        content = content if suffix == ".ply" else utf8_of(content, suffix)
    return trimesh.load_scene(
        io.BytesIO(content), file_type=suffix[1:], resolver=files, process=False, skip_materials=True
    )


def is_text(content: bytes, suffix: str) -> bool:
    """Whether trimesh reads a file as text."""
    if suffix == ".stl":
        return len(content) < 84 or len(content) != 84 + 50 * struct.unpack_from("<I", content, 80)[0]
    return suffix != ".ply" or b"format ascii" in content[: content.find(b"end_header")]


def utf8_of(content: bytes, suffix: str) -> bytes:
    """The text of an OBJ, OFF or ASCII STL file in UTF-8, as trimesh reads others with charset_normalizer alone.

    Another encoding is read as Latin-1: only comments and names have letters beyond ASCII. Raises ValueError for what
    is no text.
    """
    try:
        content.decode()
    except UnicodeDecodeError:
        if suffix == ".stl" and len(content) >= 84:
            count = struct.unpack_from("<I", content, 80)[0]
            told = f"is neither text nor the {84 + 50 * count} bytes of the {count} triangles that its header tells"
            raise ValueError(f"{told}, but {len(content)} bytes") from None
        if b"\0" in content:
            raise ValueError("is no text: it holds NUL bytes") from None
        return content.decode("latin-1").encode()
    return content


def gltf_text(content: bytes) -> str:
    """The JSON of a GLB file, its first chunk; raises ValueError where there is none."""
    if len(content) < 20 or content[:4] != b"glTF" or content[16:20] != b"JSON":
        raise ValueError("no GLB file of glTF 2")
    return content[20 : 20 + struct.unpack_from("<I", content, 12)[0]].decode("utf-8")


def require_gltf(tree: Any) -> None:
    """Refuse a glTF whose JSON declares more than the budget: buffers cut into views, arrays, and uses of them.

    Views may overlap, arrays need no bytes at all, and any number of primitives may use one array. Raises
    FileBoundError; ValueError, KeyError or TypeError for JSON that is no glTF.
    """
    sizes, counts = [], []
    for accessor in tree.get("accessors", []):
        counts.append(whole(accessor["count"]))
        sizes.append(counts[-1] * COMPONENT_BYTES[accessor["componentType"]] * COMPONENTS[accessor["type"]])
    views = sum(whole(view["byteLength"]) for view in tree.get("bufferViews", []))
    uses = 0
    for mesh in tree.get("meshes", []):
        for primitive in mesh["primitives"]:
            uses += VERTEX_BYTES * counts[primitive["attributes"]["POSITION"]]
            uses += FACE_BYTES * counts[primitive["indices"]] if "indices" in primitive else 0
    require_bytes(views + sum(sizes) + uses, "what its arrays hold")


def whole(value: Any) -> int:
    """A number of JSON that counts something; raises ValueError for another."""
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not 0 <= value < math.inf
        or value != int(value)
    ):
        raise ValueError(f"a count must be a whole number of 0 or more, not {str(value)[:40]}")
    return int(value)


def mesh_arrays(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices, float64 [vertex, 3], and faces, int64 [face, 3]; raises ValueError for what cannot be them."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError(f"vertices and faces must be rows of three, not {list(vertices.shape)}, {list(faces.shape)}")
    if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise ValueError(f"faces name vertices {faces.min()} to {faces.max()} of {len(vertices)}")
    return vertices, faces
