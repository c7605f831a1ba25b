"""STL, binary or text: all solids of a file; normals are left out, as triangles are counter-clockwise from outside."""

import re
import struct

import numpy as np

from ....errors import MeshError
from .polygons import FileMesh, numbers_of, plain_text

_BEGIN = 84  # bytes before the first triangle of the binary form: a header, and the count of triangles
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NAME = re.compile(rb"solid\b[^\n]*?(?=facet\s+normal\b|$)", re.MULTILINE)
_VERTEX = re.compile(rb"vertex\s+(\S+\s+\S+\s+\S+)")


def is_binary_stl(content: bytes) -> bool:
    """Whether a file is as long as a binary STL file of the count of triangles that it gives."""
    return len(content) >= _BEGIN and len(content) == binary_size(content)


def binary_size(content: bytes) -> int:
    """Bytes of a binary STL file by the count of triangles that it gives."""
    return _BEGIN + _TRIANGLE.itemsize * struct.unpack_from("<I", content, 80)[0]


def read_stl(content: bytes) -> FileMesh:
    """The triangles of an STL file; raises MeshError for one that is cut off."""
    if is_binary_stl(content):
        vertices = np.frombuffer(content, _TRIANGLE, offset=_BEGIN)["corners"].reshape(-1, 3).astype(np.float64)
    else:
        vertices = _text_vertices(content)
    return FileMesh(vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3))


def _text_vertices(content: bytes) -> np.ndarray:
    """Corners of the triangles of an STL file in text, float64 [3 * triangle, 3]."""
    if len(content) >= _BEGIN and (b"\0" in content or not content.isascii()) and b"facet" not in content.lower():
        size = binary_size(content)
        cause = "it may be cut off" if len(content) < size else "the count may be wrong, or other data follow"
        raise MeshError(
            f"is neither text nor the {size} bytes of the {(size - _BEGIN) // 50} triangles that its header gives, "
            f"but {len(content)} bytes: {cause}"
        )
    text = plain_text(content).lower()
    body = _NAME.sub(b"", text)
    ends, corners = body.count(b"endfacet"), body.count(b"vertex")
    count = body.count(b"facet") - ends
    if count != ends or corners != 3 * count:
        raise MeshError(
            f"has {count} facets, of which {ends} end, and {corners} vertices, not three for each: it may be cut off"
        )
    if count and b"endsolid" not in text:
        raise MeshError("ends without endsolid: it may be cut off")
    return numbers_of(_VERTEX.findall(body)).reshape(-1, 3)
