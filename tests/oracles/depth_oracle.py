"""Depth of points in closed meshes, and intensity by depth, in NumPy: every triangle and every grid point is asked."""

import numpy as np
import trimesh

from palpate.render.objects.moving_object import back_to
from palpate.render.stages.curves import divide_batch

BLOCK = 500  # points at a time


def windings(vertices, faces, points):
    """Winding number of a mesh around each point: its faces' solid angles (Van Oosterom, Strackee 1983), [point]."""
    corner = np.asarray(vertices, np.float64)[faces][None] - np.asarray(points, np.float64)[:, None, None]
    a, b, c = corner[:, :, 0], corner[:, :, 1], corner[:, :, 2]
    la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    top = np.einsum("pfk,pfk->pf", a, np.cross(b, c))
    dots = [np.einsum("pfk,pfk->pf", x, y) for x, y in ((a, b), (b, c), (c, a))]
    bottom = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    return 2.0 * np.arctan2(top, bottom).sum(axis=1) / (4.0 * np.pi)


def depths(mesh, points):
    """Distance to the surface from inside [m], 0 outside, shape [point]; mesh: vertices [m] and faces."""
    surface = trimesh.Trimesh(*mesh, process=False)
    out = np.zeros(len(points))
    for k in range(0, len(points), BLOCK):
        own = np.asarray(points[k : k + BLOCK], np.float64)
        distance = trimesh.proximity.closest_point_naive(surface, own)[1]
        out[k : k + BLOCK] = np.where(windings(*mesh, own) > 0.5, distance, 0.0)
    return out


def depth_at(setting, points, row):
    """Depth of points in the object, wherever it is at their poses [m], shape [point]."""
    if setting.object_pose is not None and len(row):
        solid, centre = setting.solid, setting.object_centre
        centre = solid.bounds.mean(axis=0) if centre is None else centre
        points = back_to(setting.object_pose[row], centre, points)
    return depths(setting.solid.outline_mesh(), points)


def grid_points(frames, grid):
    """The grid over each patch [m], shape [pose, patch, point, 3]."""
    along = np.linspace(-1.0, 1.0, grid)
    a, b = (part.ravel() for part in np.meshgrid(along, along))
    half = frames.half[None, :, None, :]
    u, v = (half[..., 0] * a)[..., None] * frames.u[:, :, None], (half[..., 1] * b)[..., None] * frames.v[:, :, None]
    return frames.origin[:, :, None] + u + v


def weighed(batch, setting, *, at, shallow, deep, lowest, grid, spacing):
    """The batch that the stage "depth" makes."""
    deep = shallow + 1e-9 if deep <= shallow else deep
    line_pose = np.repeat(np.arange(batch.pose_count), np.diff(batch.pose_start))
    if at == "point":
        batch = divide_batch(batch, spacing)
        depth = depth_at(setting, batch.points, np.repeat(line_pose, np.diff(batch.polyline_start)))
    else:
        points = grid_points(setting.frames, grid)
        shape = points.shape[:3]
        row = np.broadcast_to(np.arange(shape[0])[:, None, None], shape).ravel()
        deepest = depth_at(setting, points.reshape(-1, 3), row).reshape(shape).max(axis=2)
        if at == "pose":
            deepest = np.repeat(deepest.max(axis=1, keepdims=True), deepest.shape[1], axis=1)
        depth = np.repeat(deepest[line_pose, batch.polyline_patch], np.diff(batch.polyline_start))
    value = lowest + (1.0 - lowest) * np.clip((depth - shallow) / (deep - shallow), 0.0, 1.0)
    before = 1.0 if batch.intensity is None else batch.intensity
    return type(batch)(**{**batch.by_name(), "intensity": np.clip(value * before, 0.0, 1.0).astype(np.float32)})
