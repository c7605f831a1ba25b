"""What a mesh file should give, by exact arithmetic: polygons as triangles, and what they enclose."""

import numpy as np

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
QUADS = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
"""The faces of CUBE, counter-clockwise from outside."""
TRIANGLES = [[a, b, c] for w, x, y, z in QUADS for a, b, c in ((w, x, y), (w, y, z))]


def enclosed(mesh):
    """Number of triangles, size of what they use, and volume by the divergence theorem."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    volume = sum(np.dot(a, np.cross(b, c)) for a, b, c in corners) / 6
    used = corners.reshape(-1, 3)
    return len(corners), np.ptp(used, axis=0).round(6).tolist(), round(float(volume), 9)


def triangles_of(vertices, polygons):
    """Corners of fans around the first corner of each polygon, one by one; shape [triangle, 3, 3]."""
    rows = [(own[0], own[k], own[k + 1]) for own in polygons for k in range(1, len(own) - 1)]
    return np.array([[vertices[corner] for corner in row] for row in rows]).reshape(-1, 3, 3)


def corners_of(mesh):
    """The corners of the triangles of a mesh, shape [triangle, 3, 3]."""
    return np.asarray(mesh.vertices)[mesh.faces]


def moved(vertices, by):
    """Vertices moved along x."""
    return np.asarray(vertices) + np.array([by, 0.0, 0.0])
