"""Where voxels lie: spacing, origin and orientation as one affine map, and the box around the surface."""

from collections.abc import Sequence

import numpy as np

from .errors import VoxelError
from .objects import Placement

SKEW = 1e-3  # how far from 1 the length of a direction, and from 0 the volume of a cell of unit sides, must be


def affine_of(
    spacing: float | Sequence[float] | None,
    origin: Sequence[float] | None,
    direction: np.ndarray | None,
    affine: np.ndarray | None,
) -> np.ndarray:
    """Indices to coordinates [m], shape [4, 4]; raises VoxelError for what is not one."""
    if affine is not None:
        if not (spacing is None and origin is None and direction is None):
            raise VoxelError("give affine, or spacing, origin and direction, not both")
        out = np.array(affine, np.float64)
        if out.shape != (4, 4) or not np.isfinite(out).all() or (out[3] != [0, 0, 0, 1]).any():
            raise VoxelError(f"affine must be finite, [4, 4] and end in 0 0 0 1, not {np.asarray(affine).tolist()}")
    else:
        step = np.ravel(np.asarray(1.0 if spacing is None else spacing, np.float64))
        step = np.repeat(step, 3) if len(step) == 1 else step
        if len(step) != 3 or not (np.isfinite(step) & (step > 0)).all():
            raise VoxelError(f"spacing must be one or three positive lengths in metres, not {spacing}")
        start = np.zeros(3) if origin is None else np.asarray(origin, np.float64)
        if start.shape != (3,) or not np.isfinite(start).all():
            raise VoxelError(f"origin must be three finite coordinates in metres, not {origin}")
        turn = np.eye(3) if direction is None else np.asarray(direction, np.float64)
        if turn.shape != (3, 3) or not (abs(np.linalg.norm(turn, axis=0) - 1.0) <= SKEW).all():
            raise VoxelError(f"direction must be [3, 3] with columns of length 1, not {np.asarray(direction).tolist()}")
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = turn * step, start
    length = np.linalg.norm(out[:3, :3], axis=0)
    if not (length > 0).all() or abs(np.linalg.det(out[:3, :3] / length)) < SKEW:
        raise VoxelError(f"the axes of the volume must not lie in a plane: {out[:3, :3].T.tolist()} [m/voxel]")
    return out


def crossing_points(padded: np.ndarray) -> np.ndarray:
    """Where the surface crosses the lines between neighbouring voxel centres, in indices, float64, shape [point, 3].

    padded: see `pad_outside`; indices are those of what was padded.
    """
    out = []
    for axis in range(3):
        low, high = np.moveaxis(padded, axis, 0)[:-1], np.moveaxis(padded, axis, 0)[1:]
        change = (low < 0) != (high < 0)
        a, b = low[change].astype(np.float64), high[change].astype(np.float64)
        at = np.argwhere(change).astype(np.float64) - 1.0
        at[:, 0] += a / (a - b)
        out.append(np.insert(at[:, 1:], axis, at[:, 0], axis=1))
    return np.concatenate(out)


def box_of(points: np.ndarray) -> np.ndarray:
    """Lowest and highest coordinates, shape [2, 3]."""
    return np.stack([points.min(axis=0), points.max(axis=0)])


def applied(affine: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points through an affine map."""
    return points @ affine[:3, :3].T + affine[:3, 3]


def corners_of(box: np.ndarray) -> np.ndarray:
    """The eight corners of a box, shape [8, 3]; corner 0 the lowest, then one step along each axis."""
    steps = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]])
    return np.where(steps == 0, box[0], box[1])


def placed_affine(affine: np.ndarray, placement: Placement, points: np.ndarray) -> np.ndarray:
    """The affine map moved as a mesh's vertices are, by the box around the surface; voxels are never resampled.

    points: of the surface, in indices.
    """
    if placement == Placement():
        return affine
    corners = corners_of(box_of(applied(affine, points)))
    after = placement.applied_to(corners)
    move = np.eye(4)
    move[:3, :3] = ((after[1:4] - after[0]) / np.diag(corners[1:4] - corners[0])[:, None]).T
    move[:3, 3] = after[0] - move[:3, :3] @ corners[0]
    return move @ affine


def box_around(affine: np.ndarray, points: np.ndarray) -> np.ndarray:
    """A box that holds the surface [m], shape [2, 3]; the smallest one if the volume's axes are the array's.

    points: where the surface crosses the lines between voxel centres, in indices. It lies within their box there, since
    the trilinear value on a slice of a cell is lowest at a corner; and each of its points within a voxel of one.
    """
    whole = box_of(applied(affine, corners_of(box_of(points))))
    near = box_of(applied(affine, points)) + np.array([[-1.0], [1.0]]) * np.abs(affine[:3, :3]).sum(axis=1)
    return np.stack([np.maximum(whole[0], near[0]), np.minimum(whole[1], near[1])])
