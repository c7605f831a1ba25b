"""Geomview's OFF: polygons of any number of corners; normals, colours and texture coordinates are left out."""

import re

import numpy as np

from ....errors import MeshError
from .plain_text import numbers_of, plain_text, wrong_line
from .polygons import FileMesh, fan_triangles, require_corners

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
        raise MeshError(
            f"names {vertex_count} vertices and {face_count} faces, but {len(lines) - 1} lines follow, "
            "not one for each: it may be cut off"
        )
    rows = [line.split() for line in lines[1:]]
    points, faces = rows[:vertex_count], rows[vertex_count:]
    for row in points:
        if len(row) < 3:
            raise wrong_line(b" ".join(row), "three numbers")
    vertices = numbers_of([b" ".join(row[:3]) for row in points]).reshape(-1, 3)
    sides = numbers_of([row[0] for row in faces], np.int64)
    for row, count in zip(faces, sides, strict=True):
        if not 0 <= count < len(row):
            raise wrong_line(b" ".join(row), "a count and as many vertices")
    corners = numbers_of([b" ".join(row[1 : count + 1]) for row, count in zip(faces, sides, strict=True)], np.int64)
    require_corners(corners, vertex_count)
    return FileMesh(vertices, fan_triangles(corners, sides))
