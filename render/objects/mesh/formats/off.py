"""Geomview's OFF: polygons of any number of corners; normals, colours and texture coordinates are left out."""

import re

import numpy as np

from ....errors import MeshError
from .polygons import FileMesh, numbers_of, plain_text, polygon_triangles, require_corners, wrong_line

_HEADER = re.compile(rb"\s*(ST)?C?N?(4?n?)OFF\b[ \t]*(BINARY\b)?")


def read_off(content: bytes) -> FileMesh:
    """The triangles of an OFF file in text; raises MeshError for its binary form and for points of more dimensions."""
    header = _HEADER.match(re.sub(rb"#[^\r\n]*", b"", content[:4096]))
    if header is None:
        raise MeshError("is no OFF file: it must begin with OFF, COFF, NOFF or STOFF")
    if header[3]:
        raise MeshError("is a binary OFF file, which is not read: write it in text")
    if header[2]:
        raise MeshError(f"begins with {header[2].decode()}OFF, whose points have other dimensions than three")
    text = re.sub(rb"#[^\n]*", b"", plain_text(content))
    lines = [line for line in text[_HEADER.match(text).end() :].split(b"\n") if line.strip()]  # pyright: ignore
    counts = numbers_of(lines[:1], np.int64)
    if len(counts) < 2 or (counts < 0).any():
        raise wrong_line(lines[0] if lines else b"", "the counts of vertices, faces and edges")
    vertex_count, face_count = (int(count) for count in counts[:2])
    if len(lines) != 1 + vertex_count + face_count:
        cause = "it may be cut off" if len(lines) <= vertex_count + face_count else "the counts may be wrong"
        raise MeshError(
            f"names {vertex_count} vertices and {face_count} faces, but {len(lines) - 1} lines follow, "
            f"not one for each: {cause}"
        )
    points, faces = lines[1 : 1 + vertex_count], lines[1 + vertex_count :]
    vertices = numbers_of([b" ".join(line.split(None, 3)[:3]) for line in points])
    if len(vertices) != 3 * vertex_count:
        raise wrong_line(next(line for line in points if len(line.split()) < 3), "three numbers")
    counts = numbers_of([line.split(None, 1)[0] for line in faces], np.int64)
    rows = [_corners_of(line, count) for line, count in zip(faces, counts.tolist(), strict=True)]
    corners, vertices = numbers_of(rows, np.int64), vertices.reshape(-1, 3)
    require_corners(corners, vertex_count)
    return FileMesh(vertices, polygon_triangles(corners, counts, vertices))


def _corners_of(line: bytes, count: int) -> bytes:
    """The vertices of a face, which begins with their count; a colour behind them is left out."""
    words = line.split(None, count + 1)[1 : count + 1] if 0 <= count < len(line) else []
    if len(words) != count:
        raise wrong_line(line, "a count and as many vertices")
    return b" ".join(words)
