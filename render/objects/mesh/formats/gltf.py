"""glTF 2.0: the triangles of the default scene, as its nodes place them; what is not read is refused by its name.

| in a file                                 | here                                                                     |
|-------------------------------------------|--------------------------------------------------------------------------|
| triangles, strips, fans; points and lines | triangles; left out                                                      |
| morph targets                             | added with the weights of the node, else of the mesh                     |
| skins                                     | applied in the pose of the file's nodes; the node's own place is ignored |
| extensions that it requires               | refused, but for those of looks, and those named in NOT_OF_SHAPE         |
"""

import base64
import binascii
import math
import struct
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np

from .....datasets.bounded_file import require_bytes
from ....errors import MeshError
from .polygons import (
    FACE_BYTES,
    VERTEX_BYTES,
    FileMesh,
    fan_triangles,
    require_corners,
    strip_triangles,
    united,
)

KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def item(tree: dict[str, Any], name: str, index: Any) -> Any:
    """Entry `index` of the list `name` of a glTF; raises MeshError for one that is not there."""
    entries = tree.get(name, [])
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(entries):
        raise MeshError(f"names entry {index} of {name}, which has {len(entries)}, from 0 on")
    return entries[index]


def whole(value: Any) -> int:
    """A number of JSON that counts something; raises MeshError for another."""
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not 0 <= value < math.inf
        or value != int(value)
    ):
        raise MeshError(f"a count must be a whole number of 0 or more, not {str(value)[:40]}")
    return int(value)


def accessor_bytes(accessor: dict[str, Any]) -> int:
    """Bytes of an array."""
    return whole(accessor["count"]) * np.dtype(KINDS[accessor["componentType"]]).itemsize * COMPONENTS[accessor["type"]]


def glb_chunks(content: bytes) -> tuple[bytes, bytes | None]:
    """The JSON of a GLB file, and the bytes of its first buffer if it has them; raises MeshError if it has no JSON."""
    if len(content) < 20 or content[:4] != b"glTF":
        raise MeshError("is no GLB file: it must begin with glTF, a version and its length")
    version, length = struct.unpack_from("<2I", content, 4)
    if version != 2:
        raise MeshError(f"is glTF {version}, and only glTF 2 is read: gltf-pipeline, for one, converts it")
    if length > len(content):
        raise MeshError(f"gives its length as {length} bytes, but has {len(content)}: it may be cut off")
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", content, at)
        if at + 8 + size > length:
            raise MeshError(f"ends within its chunk {kind.decode('latin-1').strip()!r}: it may be cut off")
        chunks.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    if b"JSON" not in chunks:
        raise MeshError("is no GLB file of glTF 2: it has no chunk JSON")
    return chunks[b"JSON"], chunks.get(b"BIN\0")


class GltfArrays:
    """The arrays that a glTF's accessors name, read where they are asked for.

    tree: the JSON. named: bytes of a file by its URI. binary: bytes of the first buffer of a GLB file.
    """

    def __init__(self, tree: dict[str, Any], named: Callable[[str], bytes], binary: bytes | None) -> None:
        self.tree = tree
        self._named, self._binary = named, binary
        self._buffers: dict[int, bytes] = {}

    def accessor(self, index: int, kind: str) -> np.ndarray:
        """An array, shape [row, component]; float64 if it is normalised, else of its own type.

        kind: the type that it must have, such as "VEC3". Raises MeshError for another, and for one without data.
        """
        accessor = item(self.tree, "accessors", index)
        if accessor["type"] != kind:
            raise MeshError(f"accessor {index} must be of type {kind}, not {accessor['type']}")
        dtype, columns = np.dtype(KINDS[accessor["componentType"]]), COMPONENTS[kind]
        count, sparse = whole(accessor["count"]), accessor.get("sparse")
        if "bufferView" in accessor:
            begin = whole(accessor.get("byteOffset", 0))
            values = self._viewed(accessor["bufferView"], begin, dtype, count, columns)
        elif sparse is None:
            raise MeshError(f"accessor {index} has no data: an extension may hold them, which is not read")
        else:
            values = np.zeros((count, columns), dtype)
        if sparse is not None:
            values = values.copy()
            changed, new = sparse["indices"], sparse["values"]
            changes, place = whole(sparse["count"]), np.dtype(KINDS[changed["componentType"]])
            begin = whole(changed.get("byteOffset", 0))
            rows = self._viewed(changed["bufferView"], begin, place, changes, 1)[:, 0]
            if len(rows) and rows.max() >= count:
                raise MeshError(f"accessor {index} of {count} rows has a sparse change of row {rows.max()}")
            begin = whole(new.get("byteOffset", 0))
            values[rows] = self._viewed(new["bufferView"], begin, dtype, changes, columns)
        if accessor.get("normalized") and dtype.kind != "f":
            return np.maximum(values.astype(np.float64) / np.iinfo(dtype).max, -1.0)
        return values

    def _viewed(self, view_index: Any, begin: int, dtype: np.dtype, count: int, columns: int) -> np.ndarray:
        """Rows of a buffer view from its byte `begin` on, shape [count, columns]."""
        view = item(self.tree, "bufferViews", view_index)
        start, size = whole(view.get("byteOffset", 0)), whole(view["byteLength"])
        row = dtype.itemsize * columns
        stride = whole(view.get("byteStride", row))
        if stride < row:
            raise MeshError(f"bufferView {view_index} has a byteStride of {stride}, less than the {row} bytes of a row")
        content = self._buffer(view["buffer"])
        needed = begin + (stride * (count - 1) + row if count else 0)
        if needed > size or start + size > len(content):
            raise MeshError(
                f"needs bytes {start} to {start + needed} of buffer {view['buffer']}, of which bufferView {view_index} "
                f"has {size} and the buffer {len(content)}: it may be cut off"
            )
        if not count:
            return np.empty((0, columns), dtype)
        return np.ndarray((count, columns), dtype, content, start + begin, (stride, dtype.itemsize))

    def _buffer(self, index: Any) -> bytes:
        """Bytes of a buffer."""
        buffer = item(self.tree, "buffers", index)
        if index not in self._buffers:
            uri = buffer.get("uri")
            if uri is None and index == 0 and self._binary is not None:
                self._buffers[index] = self._binary
            elif uri is None:
                names = ", ".join(buffer.get("extensions", {})) or "no extension"
                raise MeshError(f"buffer {index} has no data (but {names}): export it without compression")
            else:
                self._buffers[index] = embedded(uri) if uri.startswith("data:") else self._named(uri)
        return self._buffers[index]


def embedded(uri: str) -> bytes:
    """Bytes of a data URI; raises MeshError for one that is damaged."""
    head, comma, text = uri.partition(",")
    if not comma:
        raise MeshError(f"has a data URI without a comma: {uri[:40]!r}")
    if not head.endswith(";base64"):
        return unquote_to_bytes(text)
    try:
        return base64.b64decode(unquote_to_bytes(text), validate=True)
    except (binascii.Error, ValueError) as error:
        raise MeshError(f"has a data URI that is no base64 ({error})") from error


OF_LOOKS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp", "EXT_texture_", "EXT_lights_", "MSFT_texture_")
NOT_OF_SHAPE = ("KHR_mesh_quantization", "KHR_node_visibility", "KHR_animation_pointer", "EXT_mesh_manifold")
"""Extensions that a file may require: they change no shape, or what they say is applied."""
STRIP, FAN, TRIANGLES = 5, 6, 4
NODE_NUMBERS = {"translation": 3, "rotation": 4, "scale": 3, "matrix": 16}
SKIN_BYTES = 384  # of a vertex: its matrix of float64, and two that are added to it
AFFINE_ROUNDING = 1e-5  # of matrices in float32, in whose inverses are rounded: those that differ less are equal


def read_gltf(tree: Any, named: Callable[[str], bytes], binary: bytes | None = None) -> FileMesh:
    """The triangles of the default scene, and all named nodes of it.

    tree: the JSON; named: bytes of a file by its URI; binary: those of the first buffer of a GLB file. Raises
    MeshError for what cannot be read, FileBoundError for more than the budget.
    """
    try:
        require_version(tree)
        require_extensions(tree)
        require_size(tree)
        return GltfScene(tree, GltfArrays(tree, named, binary)).mesh()
    except (KeyError, TypeError, AttributeError, IndexError, ValueError) as error:
        if isinstance(error, MeshError):
            raise
        what = f"has no {error}" if isinstance(error, KeyError) else str(error)[:200]
        raise MeshError(f"is no valid glTF: an entry of its JSON {what}") from error


def require_version(tree: Any) -> None:
    """Raise MeshError for a version that is not read."""
    if not isinstance(tree, dict):
        raise MeshError("is no glTF: its JSON must be an object")
    asset = tree.get("asset", {})
    version, least = str(asset.get("version", "2.0")), str(asset.get("minVersion", "2.0"))
    if isinstance(tree.get("meshes"), dict) or version.split(".")[0] == "1":
        raise MeshError("is glTF 1.0, and only glTF 2 is read: gltf-pipeline, for one, converts it")
    if version.split(".")[0] != "2" or least != "2.0":
        raise MeshError(f"is glTF {version} (at least {least}), and only glTF 2.0 is read")


def require_extensions(tree: dict[str, Any]) -> None:
    """Raise MeshError, with its name, for an extension that changes shapes and is not applied."""
    required = [str(name) for name in tree.get("extensionsRequired", [])]
    unread = [name for name in required if not name.startswith(OF_LOOKS) and name not in NOT_OF_SHAPE]
    if any("EXT_mesh_gpu_instancing" in node.get("extensions", {}) for node in tree.get("nodes", [])):
        unread.append("EXT_mesh_gpu_instancing")
    if unread:
        raise MeshError(
            f"needs the glTF extension {', '.join(dict.fromkeys(unread))}, which is not read: export it without"
        )


def require_size(tree: dict[str, Any]) -> None:
    """Refuse a glTF whose JSON declares more than the budget: buffers cut into views, arrays, and uses of them.

    Views may overlap, arrays need no bytes at all, and any number of primitives may use one array. Raises
    FileBoundError.
    """
    arrays = sum(accessor_bytes(accessor) for accessor in tree.get("accessors", []))
    views = sum(whole(view["byteLength"]) for view in tree.get("bufferViews", []))
    uses = sum(mesh_bytes(tree, mesh) for mesh in tree.get("meshes", []))
    require_bytes(views + arrays + uses, "what its arrays hold")


def mesh_bytes(tree: dict[str, Any], mesh: dict[str, Any]) -> int:
    """Most bytes that the triangles of a mesh become."""
    size = 0
    for primitive in mesh["primitives"]:
        for name, each in (("POSITION", VERTEX_BYTES), ("indices", FACE_BYTES)):
            index = primitive.get("indices") if name == "indices" else primitive["attributes"].get(name)
            size += 0 if index is None else each * whole(item(tree, "accessors", index)["count"])
        targets = [target["POSITION"] for target in primitive.get("targets", []) if "POSITION" in target]
        size += sum(VERTEX_BYTES * whole(item(tree, "accessors", index)["count"]) for index in targets)
    return size


class GltfScene:
    """The default scene of a glTF: nodes in their places, and the triangles of their meshes."""

    def __init__(self, tree: dict[str, Any], arrays: GltfArrays) -> None:
        self.tree, self.arrays = tree, arrays
        self.places: dict[int, np.ndarray] = {}
        """Node -> scene, matrices [4, 4]; of nodes that the scene shows or hides."""
        self.shown: list[int] = []
        self._place_nodes()

    def mesh(self) -> FileMesh:
        """All that the scene shows."""
        drawn = [index for index in self.shown if "mesh" in self.tree["nodes"][index]]
        copies = [item(self.tree, "meshes", self.tree["nodes"][index]["mesh"]) for index in drawn]
        size = sum(mesh_bytes(self.tree, mesh) for mesh in copies)
        require_bytes(size, "its scene, with all copies of its meshes,")
        found = united([primitive for index in drawn for primitive in self._drawn(index)])
        names = {index: self.tree["nodes"][index].get("name") for index in reversed(self.places)}
        return found._replace(nodes={name: self.places[index] for index, name in names.items() if name})

    def _place_nodes(self) -> None:
        """Follow the nodes from the scene's roots, each once."""
        if "scenes" not in self.tree:
            raise MeshError("has no scene, so that nothing of it is shown: export it with one")
        roots = item(self.tree, "scenes", self.tree.get("scene", 0)).get("nodes", [])
        waiting = [(index, np.eye(4), True) for index in reversed(roots)]
        while waiting:
            index, parent, is_shown = waiting.pop()
            node = item(self.tree, "nodes", index)
            if index in self.places:
                raise MeshError(f"node {index} has two parents, or is its own, which glTF does not allow")
            place = self.places[index] = parent @ local_place(node, index)
            is_shown &= node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True) is not False
            if is_shown:
                self.shown.append(index)
            waiting.extend((child, place, is_shown) for child in reversed(node.get("children", [])))

    def _drawn(self, index: int) -> Iterator[FileMesh]:
        """The triangles of a node's mesh, in their place."""
        node = self.tree["nodes"][index]
        mesh = item(self.tree, "meshes", node["mesh"])
        for primitive in mesh["primitives"]:
            weights = node.get("weights", mesh.get("weights", []))
            found = self._triangles(primitive, weights)
            if found is None:
                continue
            vertices, faces = found.vertices, found.faces
            if "skin" in node:
                place = self._skin_places(item(self.tree, "skins", node["skin"]), primitive, len(vertices))
            else:
                place = self.places[index]
            vertices = np.einsum("...ij,...j->...i", place[..., :3, :3], vertices) + place[..., :3, 3]
            if np.linalg.det(place[..., :3, :3]).mean() < 0:
                faces = faces[:, ::-1]
            yield FileMesh(vertices, faces)

    def _triangles(self, primitive: dict[str, Any], weights: list[float]) -> FileMesh | None:
        """The triangles of a primitive as its mesh has them, morph targets added; None for points and lines."""
        attributes, mode = primitive["attributes"], primitive.get("mode", TRIANGLES)
        if mode in (0, 1, 2, 3):
            return None
        if mode not in (STRIP, FAN, TRIANGLES):
            raise MeshError(f"the mode of a primitive must be 0 to 6, not {mode}")
        if "POSITION" not in attributes:
            if names := ", ".join(primitive.get("extensions", {})):
                raise MeshError(f"a primitive has no POSITION, but the extension {names}, which is not read")
            return None  # as the specification advises
        try:
            vertices = self.arrays.accessor(attributes["POSITION"], "VEC3").astype(np.float64)
            corners = np.arange(len(vertices))
            if "indices" in primitive:
                corners = self.arrays.accessor(primitive["indices"], "SCALAR")[:, 0]
                if corners.dtype.kind != "u":
                    raise MeshError(f"the indices of a primitive must be unsigned integers, not {corners.dtype}")
                corners = corners.astype(np.int64)
        except MeshError as error:
            names = ", ".join(primitive.get("extensions", {}))
            raise MeshError(f"{error} (the primitive has the extension {names})" if names else str(error)) from error
        require_corners(corners, len(vertices), "the indices of a primitive")
        for weight, target in zip(weights, primitive.get("targets", []), strict=False):
            if weight and "POSITION" in target:
                moved = self.arrays.accessor(target["POSITION"], "VEC3")
                vertices += float(weight) * of_each_vertex(moved, len(vertices), "a morph target")
        if mode == STRIP:
            return FileMesh(vertices, strip_triangles(corners))
        if mode == FAN:
            return FileMesh(vertices, fan_triangles(corners, np.array([len(corners)])))
        if len(corners) % 3:
            raise MeshError(f"a primitive of triangles has {len(corners)} corners, not three for each")
        return FileMesh(vertices, corners.reshape(-1, 3))

    def _skin_places(self, skin: dict[str, Any], primitive: dict[str, Any], vertex_count: int) -> np.ndarray:
        """Vertex -> scene in the pose of the file's nodes: matrices [4, 4] if all are alike, else [vertex, 4, 4]."""
        if missing := [index for index in skin["joints"] if index not in self.places]:
            raise MeshError(f"a skin has the joint {missing[0]}, which is no node of the scene")
        joints = np.stack([self.places[index] for index in skin["joints"]])
        if "inverseBindMatrices" in skin:
            inverse = self.arrays.accessor(skin["inverseBindMatrices"], "MAT4").astype(np.float64)
            if len(inverse) < len(joints):
                raise MeshError(f"a skin of {len(joints)} joints has {len(inverse)} inverse bind matrices")
            joints = joints @ inverse[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        if np.abs(joints - joints[0]).max() <= AFFINE_ROUNDING * np.abs(joints).max():
            is_identity = np.abs(joints[0] - np.eye(4)).max() <= AFFINE_ROUNDING
            return np.eye(4) if is_identity else joints[0]
        require_bytes(SKIN_BYTES * vertex_count, "what its skin needs")
        place = np.zeros((vertex_count, 4, 4))
        sets = [name.removeprefix("JOINTS_") for name in primitive["attributes"] if name.startswith("JOINTS_")]
        for number in sets:
            named = self.arrays.accessor(primitive["attributes"][f"JOINTS_{number}"], "VEC4")
            weights = self.arrays.accessor(primitive["attributes"][f"WEIGHTS_{number}"], "VEC4")
            named, weights = (of_each_vertex(own, vertex_count, "a skin") for own in (named, weights))
            require_corners(named, len(joints), "joints")
            for column in range(4):
                place += weights[:, column, None, None] * joints[named[:, column]]
        if not sets:
            raise MeshError("a node has a skin, but its mesh has no JOINTS_0")
        return place


def of_each_vertex(rows: np.ndarray, vertex_count: int, what: str) -> np.ndarray:
    """An array with a row for each vertex; raises MeshError for another, which NumPy might repeat."""
    if len(rows) != vertex_count:
        raise MeshError(f"{what} of a primitive has {len(rows)} rows, but the primitive {vertex_count} vertices")
    return rows


def local_place(node: dict[str, Any], index: int) -> np.ndarray:
    """Node -> its parent, a matrix [4, 4]."""
    for name, count in NODE_NUMBERS.items():
        if name in node and np.shape(node[name]) != (count,):
            raise MeshError(f"the {name} of node {index} must be {count} numbers, not {str(node[name])[:80]}")
    moves = [name for name in ("translation", "rotation", "scale") if name in node]
    out = np.eye(4)
    if "matrix" in node:
        if moves:
            raise MeshError(f"node {index} has both a matrix and {moves[0]}, which glTF does not allow")
        out = np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    else:
        x, y, z, w = unit_quaternion(node.get("rotation", [0, 0, 0, 1]), index)
        turn = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        out[:3, :3] = np.array(turn) * np.asarray(node.get("scale", [1, 1, 1]), np.float64)
        out[:3, 3] = node.get("translation", [0, 0, 0])
    if not np.isfinite(out).all() or np.abs(out[3] - (0, 0, 0, 1)).max() > AFFINE_ROUNDING:
        raise MeshError(f"the place of node {index} must be finite numbers, the last row of a matrix 0 0 0 1")
    return out


def unit_quaternion(values: list[float], index: int) -> np.ndarray:
    """x, y, z, w, made exactly of length 1."""
    out = np.asarray(values, np.float64)
    length = np.sqrt((out * out).sum())
    if not 0.5 < length < 2:
        raise MeshError(f"the rotation of node {index} must be four numbers of length 1, not {str(values)[:80]}")
    return out / length
