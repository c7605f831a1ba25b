"""Wavefront OBJ: vertices and polygons of all groups and materials; relative indices count from where the face stands.

Indices begin at 1, and -1 is the last vertex above (Wavefront's Advanced Visualizer, appendix B1).
"""

import re

import numpy as np

from ....errors import MeshError
from .polygons import FileMesh, numbers_of, plain_text, polygon_triangles, shown, wrong_line

_CONTINUED = re.compile(rb"\\[ \t]*\n")
_CONTINUED_LINES = re.compile(rb"^[ \t]*(?:v|fo?)[ \t](?:[^\n]*\\[ \t]*\n)+", re.MULTILINE)  # no name that ends in \
_COMMENT = re.compile(rb"#[^\n]*")
_VERTEX = re.compile(rb"^[ \t]*v[ \t]+([^ \t\n]+[ \t]+[^ \t\n]+[ \t]+[^ \t\n]+)", re.MULTILINE)
_VERTEX_LINE = re.compile(rb"^[ \t]*v(?:[ \t][^\n]*)?$", re.MULTILINE)
_FACE_LINE = re.compile(rb"^[ \t]*fo?[ \t]+([^\n]*)$", re.MULTILINE)  # `fo` is the face of older versions
_NOT_READ = re.compile(rb"^[ \t]*(surf|call|scmp)\b[^\n]*", re.MULTILINE)
_OTHER_INDICES = re.compile(rb"/[^ \t\n]*")  # of texture coordinates and normals
_REASONS = {b"surf": "a free-form surface", b"call": "another file", b"scmp": "another file"}


def read_obj(content: bytes) -> FileMesh:
    """The triangles of an OBJ file; raises MeshError for what it holds beside polygons, and for a wrong index."""
    text = _COMMENT.sub(b"", plain_text(content))
    text = _CONTINUED_LINES.sub(lambda found: _CONTINUED.sub(b" ", found[0]), text)
    if found := _NOT_READ.search(text):
        raise MeshError(
            f"the line {shown(found[0])} names {_REASONS[found[1]]}, which is not read: export polygons into one file"
        )
    rows = _VERTEX.findall(text)  # a weight or a colour behind a position is left out
    if len(rows) != sum(1 for _ in _VERTEX_LINE.finditer(text)):
        given = (found[0] for found in _VERTEX_LINE.finditer(text))
        raise wrong_line(next(line for line in given if not _VERTEX.match(line)), "three numbers after v")
    vertices = numbers_of(rows).reshape(-1, 3)
    lines = [_OTHER_INDICES.sub(b"", found[1]) for found in _FACE_LINE.finditer(text)]
    counts = np.fromiter((len(line.split()) for line in lines), np.int64, len(lines))
    corners = numbers_of(lines, np.int64)
    if (corners < 0).any():
        begins = [found.start() for found in _VERTEX_LINE.finditer(text)]
        before = np.searchsorted(begins, [found.start() for found in _FACE_LINE.finditer(text)])
        corners = np.where(corners < 0, corners + np.repeat(before, counts) + 1, corners)
    is_wrong = (corners < 1) | (corners > len(vertices))
    if is_wrong.any():
        face = int(np.repeat(np.arange(len(lines)), counts)[np.argmax(is_wrong)])
        found = list(_FACE_LINE.finditer(text))[face]
        raise MeshError(
            f"the face {shown(found[0])} (number {face + 1}) must name vertices from 1 to {len(vertices)}, "
            "or from -1 back to the first vertex above it"
        )
    return FileMesh(vertices, polygon_triangles(corners - 1, counts, vertices))
