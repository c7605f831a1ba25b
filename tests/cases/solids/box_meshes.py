"""Meshes of boxes, as vertices and faces, for tests of repairs."""

import numpy as np
import trimesh


def box(size=0.1, at=(0.0, 0.0, 0.2)):
    """A cube around a point [m]."""
    mesh = trimesh.creation.box([size] * 3)
    return np.asarray(mesh.vertices) + at, np.asarray(mesh.faces)


def joined(*parts):
    """Several meshes as one."""
    offsets = np.cumsum([0, *(len(v) for v, _ in parts)])
    return np.vstack([v for v, _ in parts]), np.vstack([f + o for (_, f), o in zip(parts, offsets, strict=False)])


def inverted(body):
    """A mesh that faces inwards."""
    return body[0], body[1][:, ::-1]
