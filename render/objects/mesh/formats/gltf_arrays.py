"""Arrays of a glTF file: accessors as the specification of glTF 2.0 says, normalised and sparse ones too."""

import base64
import binascii
import math
import struct
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np

from ....errors import MeshError

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

    def count(self, index: int) -> int:
        """Rows of an accessor."""
        return whole(item(self.tree, "accessors", index)["count"])

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
