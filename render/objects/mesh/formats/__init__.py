"""Formats of mesh files: bytes of a file -> vertices and triangles, or an error that names what is not read."""
