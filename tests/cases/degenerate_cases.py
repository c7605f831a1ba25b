"""Palms exactly through vertices, along edges and in faces of a mesh."""

import numpy as np
from scipy.spatial.transform import Rotation

HALF = np.array([0.0425, 0.0425])


def pose_of(position, u, n):
    """A palm at a position whose width runs along u and whose normal is n, as near as u allows."""
    n = np.asarray(n, float) / np.linalg.norm(n)
    u = np.asarray(u, float) - np.dot(u, n) * n
    u /= np.linalg.norm(u)
    turn = Rotation.from_matrix(np.stack([u, n, np.cross(u, n)], axis=1))
    return np.hstack([position, turn.as_quat()]).astype(np.float32)


def corner_at(point, pose, sides=(-1, 1)):
    """The pose moved so that a side or corner of its palm lies at a point."""
    turn = Rotation.from_quat(pose[3:].astype(float))
    local = np.array([sides[0] * HALF[0], 0.0, -sides[1] * HALF[1]])
    return np.hstack([point - turn.apply(local), pose[3:]]).astype(np.float32)


def degenerate_poses(mesh, count, seed):
    """Poses about a mesh's own vertices, edges and faces, by what is degenerate in them."""
    vertices, faces = mesh[0].astype(float), mesh[1]
    rng = np.random.default_rng(seed)
    poses = {}
    for k in range(count):
        a, b, c = vertices[faces[rng.integers(len(faces))]]
        normal = np.cross(b - a, c - a)
        any_way = rng.normal(size=3)
        across = np.cross(b - a, any_way)
        for sign in (1, -1):
            flush = pose_of((a + b + c) / 3, b - a, sign * normal)
            poses[f"flush with a face {k} {sign}"] = flush
            poses[f"flush, a corner on a vertex {k} {sign}"] = corner_at(a, flush)
            poses[f"flush, a side along an edge {k} {sign}"] = corner_at(0.5 * (a + b), flush, (0, sign))
        poses[f"through a vertex {k}"] = pose_of(a, any_way, rng.normal(size=3))
        poses[f"a corner on a vertex {k}"] = corner_at(a, pose_of(a, any_way, rng.normal(size=3)))
        poses[f"along an edge {k}"] = pose_of(0.5 * (a + b), any_way, across)
        poses[f"along an edge, a side too {k}"] = corner_at(0.5 * (a + b), pose_of(a, b - a, across), (0, 1))
        poses[f"a side through an edge {k}"] = corner_at(0.3 * a + 0.7 * b, pose_of(a, any_way, b - a), (1, 0))
        poses[f"a corner on an edge {k}"] = corner_at(0.3 * a + 0.7 * b, pose_of(a, any_way, b - a), (1, -1))
    return poses
