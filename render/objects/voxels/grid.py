"""Where voxels lie: spacing, origin and orientation as one affine map, and the box around the surface."""

from collections.abc import Sequence

import numpy as np

from ...errors import VoxelError
from ...validation import value_text
from ..mesh.placement import Placement

LENGTHS = "one or three positive lengths in metres"
COORDINATES = "three finite coordinates in metres"
DIRECTIONS = "[3, 3] with columns of length 1"
FINEST, COARSEST = 1e-9, 1e6  # [m]; between voxel centres, before a placement
SKEW = 1e-3  # how far from 1 the length of a direction, and from 0 the volume of a cell of unit sides, must be


def numbers_of(name: str, value: object, wanted: str) -> np.ndarray:
    """Numbers as float64, of any shape; raises VoxelError for what is none."""
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise VoxelError(f"{name} must be {wanted}, not {value_text(value)}") from error


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
        out = numbers_of("affine", affine, "finite, [4, 4] and end in 0 0 0 1")
        if out.shape != (4, 4) or not np.isfinite(out).all() or (out[3] != [0, 0, 0, 1]).any():
            raise VoxelError(f"affine must be finite, [4, 4] and end in 0 0 0 1, not {value_text(out.tolist())}")
    else:
        step = np.ravel(numbers_of("spacing", 1.0 if spacing is None else spacing, LENGTHS))
        step = np.repeat(step, 3) if len(step) == 1 else step
        if len(step) != 3 or not (np.isfinite(step) & (step > 0)).all():
            raise VoxelError(f"spacing must be {LENGTHS}, not {value_text(spacing)}")
        start = np.zeros(3) if origin is None else numbers_of("origin", origin, COORDINATES)
        if start.shape != (3,) or not np.isfinite(start).all():
            raise VoxelError(f"origin must be {COORDINATES}, not {value_text(origin)}")
        turn = np.eye(3) if direction is None else numbers_of("direction", direction, DIRECTIONS)
        if turn.shape != (3, 3) or not (abs(np.linalg.norm(turn, axis=0) - 1.0) <= SKEW).all():
            raise VoxelError(f"direction must be {DIRECTIONS}, not {value_text(turn.tolist())}")
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = turn * step, start
    axes = out[:3, :3]
    reach = np.abs(axes).max(axis=0)
    if reach.all() and not ((reach >= FINEST) & (reach <= COARSEST)).all():
        raise VoxelError(f"voxels must be {FINEST:g}..{COARSEST:g} m apart, not {value_text(reach.tolist())}")
    if not reach.all() or abs(np.linalg.det(axes / np.linalg.norm(axes, axis=0))) < SKEW:
        raise VoxelError(f"the axes of the volume must not lie in a plane: {value_text(axes.T.tolist())} [m/voxel]")
    return out


def crossing_points(padded: np.ndarray) -> np.ndarray:
    """Where the surface crosses the lines through voxel centres first and last, in indices, float64, shape [point, 3].

    padded: see `pad_outside`; indices are those of what was padded. All other crossings lie between these, so a box
    around them in any direction is the box around all. Works layer by layer: six points a line, whatever the volume.
    """
    out = []
    for axis in range(3):
        other = 0 if axis else 1
        for number, layer in enumerate(np.moveaxis(padded, (other, axis), (0, 1))):
            inside = layer < 0
            change = inside[1:] != inside[:-1]
            column = np.flatnonzero(change.any(axis=0))
            if not len(column):
                continue
            first, last = change.argmax(axis=0)[column], len(change) - 1 - change[::-1].argmax(axis=0)[column]
            for row in (first, last):
                a, b = layer[row, column].astype(np.float64), layer[row + 1, column].astype(np.float64)
                at = np.empty((len(column), 3))
                at[:, other], at[:, 3 - other - axis] = number - 1, column - 1
                at[:, axis] = row - 1 + a / (a - b)
                out.append(at)
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
