"""Hand meshes from files: how their axes become the hand's, where its origin goes, and which faces feel."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...datasets.array_file import ONLY, read_arrays
from ...datasets.bounded_file import read_text
from ...datasets.errors import name_nothing
from ...datasets.known_names import likely_file
from ..errors import MeshError, PlacementError
from ..objects.mesh.files import load_mesh

AXES = ("x", "y", "z", "-x", "-y", "-z")
WRIST = "wrist"  # a WebXR hand's root joint: its axes are the hand's
PALM_BETWEEN = ("middle-finger-metacarpal", "middle-finger-phalanx-proximal")
"""WebXR joints half way between which the palm is."""

Glabrous = np.ndarray | str | Path | Callable[[np.ndarray, np.ndarray], np.ndarray] | None


class ReadHand(NamedTuple):
    """A hand mesh as its file has it."""

    vertices: np.ndarray
    """float64, shape [vertex, 3], in the file's units and axes."""
    faces: np.ndarray
    """int64, shape [face, 3]."""
    joints: dict[str, np.ndarray]
    """Joint -> file, by name: matrices [4, 4]; empty without a skeleton."""


def read_hand(path: Path) -> ReadHand:
    """All triangles of a file, its scene flattened, and its named nodes.

    Raises MeshError for a missing file, one that cannot be read, and one without triangles.
    """
    if not path.exists():
        raise name_nothing(MeshError(f"{path}: no such file{likely_file(path)}"))
    mesh = load_mesh(path)
    return ReadHand(mesh.vertices, mesh.faces, mesh.nodes)


def axes_of(read: ReadHand, back: str | None, fingers: str | None) -> np.ndarray:
    """Rotation file -> hand: rows are the hand's X, Y and Z in the file's axes.

    back: the file's axis that points out of the back of the hand (Y); fingers: the one towards the finger tips (-Z).
    None: the wrist joint's axes where the file has one, else y and -z, which leaves coordinates as they are.
    Raises PlacementError for what are no two axes.
    """
    if back is None and fingers is None and WRIST in read.joints:
        turn = read.joints[WRIST][:3, :3]
        u, _, v = np.linalg.svd(turn)  # written with rounding
        return (u @ v).T
    back, fingers = back or "y", fingers or "-z"
    for field, axis in (("back", back), ("fingers", fingers)):
        if axis not in AXES:
            raise PlacementError(f"{field} must be one of {', '.join(AXES)}, not {axis!r}")
    if back[-1] == fingers[-1]:
        raise PlacementError(f"back and fingers must be axes across each other, not {back} and {fingers}")
    y, z = unit_axis(back), -unit_axis(fingers)
    return np.stack([np.cross(y, z), y, z])


def unit_axis(name: str) -> np.ndarray:
    """The unit vector of an axis by name."""
    out = np.zeros(3)
    out["xyz".index(name[-1])] = -1.0 if name[0] == "-" else 1.0
    return out


def palm_skin(read: ReadHand, turned: np.ndarray, turn: np.ndarray, scale: float) -> np.ndarray:
    """Middle of the palm's skin [m]: below the middle of the hand's metacarpals, where the skin faces down (-Y).

    turned: the vertices in the hand's axes [m]. Raises MeshError for a file without these joints.
    """
    missing = [name for name in PALM_BETWEEN if name not in read.joints]
    if missing:
        raise MeshError(f"the palm cannot be found without joints {', '.join(missing)}: give origin=(x, y, z)")
    middle = scale * turn @ np.mean([read.joints[name][:3, 3] for name in PALM_BETWEEN], axis=0)
    a, b, c = (turned[read.faces[:, k]] - middle for k in range(3))
    weights = [one[:, 0] * two[:, 2] - one[:, 2] * two[:, 0] for one, two in ((b, c), (c, a), (a, b))]
    total = np.sum(weights, axis=0)
    through = (np.sign(weights) == np.sign(total)).all(axis=0) & (total != 0)
    share = np.stack(weights)[:, through] / total[through]
    height = share[0] * a[through, 1] + share[1] * b[through, 1] + share[2] * c[through, 1]
    if not (height < 0).any():
        raise MeshError("there is no skin below the palm's joints: give origin=(x, y, z)")
    return middle + np.array([0.0, height[height < 0].max(), 0.0])


def placed_hand(
    read: ReadHand, *, scale: float, back: str | None, fingers: str | None, origin: str | Sequence[float] | None
) -> np.ndarray:
    """Vertices in the hand's frame [m], shape [vertex, 3]. See `MeshHand.load`."""
    if not isinstance(scale, int | float | np.integer | np.floating) or not 0 < scale < np.inf:
        raise PlacementError(f"scale must be positive and finite, not {scale!r}")
    turn = axes_of(read, back, fingers)
    turned = scale * read.vertices @ turn.T
    if origin is None and not all(name in read.joints for name in PALM_BETWEEN):
        return turned
    if origin is None or isinstance(origin, str):
        if origin not in (None, "palm"):
            raise PlacementError(f'origin must be "palm" or a point (x, y, z) in metres, not {origin!r}')
        return turned - palm_skin(read, turned, turn, scale)
    point = np.asarray(origin, np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise PlacementError(f"origin must be three finite numbers in metres, not {origin}")
    return turned - turn @ point


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals of faces, as long as twice their area [m^2], float64, shape [..., face, 3]."""
    corner = np.asarray(vertices, np.float64)[..., faces, :]
    return np.cross(corner[..., 1, :] - corner[..., 0, :], corner[..., 2, :] - corner[..., 0, :])


def facing_palm(vertices: np.ndarray, faces: np.ndarray, *, angle: float = 90.0) -> np.ndarray:
    """Faces that look out of the palm: whose normal makes less than `angle` [degree] with -Y; bool, shape [face].

    vertices: [m], hand frame, shape [vertex, 3] or [pose, vertex, 3], of which the first row counts.
    """
    vertices = np.asarray(vertices)
    normal = face_normals(vertices if vertices.ndim == 2 else vertices[0], np.asarray(faces))
    return -normal[:, 1] > np.cos(np.radians(angle)) * np.linalg.norm(normal, axis=1)


def region_of(vertices: np.ndarray, faces: np.ndarray, glabrous: Glabrous, angle: float) -> np.ndarray | None:
    """The mask of faces that feel: see `MeshHand.load`."""
    if glabrous is None or isinstance(glabrous, np.ndarray):
        return glabrous
    if isinstance(glabrous, str) and glabrous == "palm":
        return facing_palm(vertices, faces, angle=angle)
    if isinstance(glabrous, str) and glabrous == "all":
        return None
    if callable(glabrous):
        normal = face_normals(vertices, faces)
        length = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        return np.asarray(glabrous(vertices[faces].mean(axis=1), normal / length))
    path = Path(glabrous)
    if not path.exists():
        raise MeshError(f'{path}: no such file; glabrous is "palm", "all", a mask, a function or a file of 0 and 1')
    try:
        mask = read_arrays(path)[ONLY] if path.suffix == ".npy" else np.loadtxt(read_text(path).splitlines(), ndmin=1)
    except (ValueError, KeyError, OSError, MemoryError) as error:
        raise MeshError(f"{path}: cannot be read as a mask of faces ({error})") from error
    return mask if mask.dtype.kind == "b" else np.where(np.isin(mask, (0, 1)), mask, 2).astype(np.int64)
