"""Hand meshes as given: how a file's axes become the hand's, which faces feel, and what a hand mesh must be.

A hand mesh must be one skin that faces outwards, with a region that feels and has a rim.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...datasets.array_file import ONLY, read_arrays
from ...datasets.bounded_file import read_text
from ...datasets.errors import name_nothing
from ...datasets.known_names import likely_file
from ...kernels.section.half_edges import OPEN, twins_of
from ..errors import MeshError, PlacementError
from ..objects.mesh.bodies import signed_volumes
from ..objects.mesh.files import load_mesh
from ..objects.mesh.sheets import edges_of
from ..user_warnings import warn_user

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


SIZE_LARGEST = 1.0  # [m]; a hand is 0.2 m long


class HandSurface(NamedTuple):
    """A hand mesh that was judged."""

    vertices: np.ndarray
    """[m], hand frame, float32, shape [row, vertex, 3]."""
    faces: np.ndarray
    """Counter-clockwise from outside, int32, shape [face, 3]."""
    glabrous: np.ndarray
    """Which faces curves are drawn on, bool, shape [face]."""


def checked_hand(name: str, vertices: np.ndarray, faces: np.ndarray, glabrous: np.ndarray | None) -> HandSurface:
    """Check a hand mesh and mend what can be mended, with a warning.

    vertices: [m], shape [vertex, 3] or [pose, vertex, 3]; faces: int, shape [face, 3]; glabrous: bool, shape [face], or
    None for all. Vertices in the same place at every pose become one. Raises MeshError for what is no hand mesh.
    """
    vertices = checked_vertices(name, vertices)
    faces = checked_faces(name, faces, vertices.shape[1])
    glabrous = checked_region(name, glabrous, len(faces))
    welded_from, number = welded(vertices, faces)
    vertices, faces = vertices[:, welded_from], number[faces]
    alive = living_faces(name, vertices, faces)
    faces, glabrous = faces[alive], glabrous[alive]
    used, faces = np.unique(faces, return_inverse=True)
    vertices, welded_from, faces = vertices[:, used], welded_from[used], faces.reshape(-1, 3)
    if not glabrous.any():
        raise MeshError(f"{name}: the glabrous region has no triangle: curves are drawn on it alone")
    require_manifold(name, faces, welded_from)
    volume = signed_volumes(vertices[0].astype(np.float64), faces, np.zeros(len(faces), np.int64))[0]
    if volume < 0 and not (twins_of(faces) == OPEN).any():
        warn_user(f"{name}: faces inwards; all {len(faces)} triangles were turned over")
        faces = faces[:, ::-1]
    require_rim(name, faces[glabrous], len(faces))
    warn_of_size(name, vertices)
    return HandSurface(vertices, np.ascontiguousarray(faces, np.int32), glabrous)


def checked_vertices(name: str, vertices: np.ndarray) -> np.ndarray:
    """Vertices as float32, shape [row, vertex, 3]."""
    try:
        out = np.asarray(vertices, np.float32)
    except (TypeError, ValueError):
        raise MeshError(f"{name}: vertices must be numbers, shape [vertex, 3] or [pose, vertex, 3]") from None
    if out.ndim not in (2, 3) or out.shape[-1] != 3 or 0 in out.shape:
        raise MeshError(f"{name}: vertices must have shape [vertex, 3] or [pose, vertex, 3], not {list(out.shape)}")
    out = out.reshape(-1, *out.shape[-2:]) + np.float32(0)  # a copy; -0 is 0
    bad = np.argwhere(~np.isfinite(out).all(axis=2))
    if len(bad):
        where = f"vertex {bad[0, 1]}" + (f" at pose {bad[0, 0]}" if len(out) > 1 else "")
        raise MeshError(f"{name}: {where} is not finite ({len(bad)} such vertices in all)")
    return out


def checked_faces(name: str, faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Faces as int64, shape [face, 3]."""
    try:
        out = np.asarray(faces)
    except ValueError:  # rows of several lengths
        raise MeshError(f"{name}: faces must be integers of shape [face, 3]") from None
    if out.ndim != 2 or out.shape[1] != 3 or out.dtype.kind not in "iu" or not len(out):
        raise MeshError(f"{name}: faces must be integers of shape [face, 3], not {out.dtype} {list(out.shape)}")
    out = out.astype(np.int64)
    if out.min() < 0 or out.max() >= vertex_count:
        bad = int(np.argwhere((out < 0) | (out >= vertex_count))[0, 0])
        raise MeshError(f"{name}: face {bad} names vertices {out[bad].tolist()}, but there are {vertex_count}")
    return out


def checked_region(name: str, glabrous: np.ndarray | None, face_count: int) -> np.ndarray:
    """The mask of the glabrous region."""
    if glabrous is None:
        return np.ones(face_count, bool)
    try:
        out = np.asarray(glabrous)
    except ValueError:
        raise MeshError(f"{name}: glabrous must be a mask of the {face_count} faces") from None
    if out.shape != (face_count,) or out.dtype.kind not in "biu" or not np.isin(out, (0, 1)).all():
        raise MeshError(
            f"{name}: glabrous must be a mask of the {face_count} faces, bool of shape [{face_count}], "
            f"not {out.dtype} {list(out.shape)}"
        )
    return out.astype(bool)


def welded(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the vertices that stay, and which of these each vertex has become; unused ones disappear."""
    used = np.unique(faces)
    rows = np.ascontiguousarray(vertices[:, used].transpose(1, 0, 2)).reshape(len(used), -1)
    _, first, same = np.unique(rows.view(f"V{rows.shape[1] * 4}").ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    number = np.full(vertices.shape[1], -1)
    number[used] = rank[same.ravel()]
    return used[first[order]], number


def living_faces(name: str, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces that are triangles, bool, shape [face]: no corner twice, no repeat, some area or two neighbours."""
    a, b, c = faces.T
    alive = (a != b) & (b != c) & (c != a)
    order = np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    first = np.zeros(len(faces), bool)
    first[np.unique(order, axis=0, return_index=True)[1]] = True
    alive &= first
    flat = np.ones(len(faces), bool)
    for row in vertices:
        corner = row[faces[flat]].astype(np.float64)
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        flat[flat] = area == 0
    while (flat & alive).any():  # one that falls can leave another at the rim
        index = np.flatnonzero(alive)
        inner = (twins_of(faces[index]) != OPEN).reshape(-1, 3).sum(axis=1)
        falls = flat[index] & (inner < 2)  # with more neighbours the surface closes through it
        if not falls.any():
            break
        alive[index[falls]] = False
    if not alive.all():
        count = len(faces) - int(alive.sum())
        warn_user(
            f"{name}: {count} of {len(faces)} triangles were dropped: a corner twice, no area, or a repeat of another"
        )
    return alive


def require_manifold(name: str, faces: np.ndarray, original: np.ndarray) -> None:
    """Raise MeshError, naming the vertices, for an edge of three triangles and for neighbours that disagree."""
    edges = edges_of(faces)
    ends = original[np.sort(np.stack([faces.ravel(), np.roll(faces, -1, axis=1).ravel()], axis=1), axis=1)]
    many, wrong = edges.face_count > 2, (edges.face_count == 2) & (edges.balance != 0)
    if many.any():
        one, two = ends[many[edges.of_half]][0]
        raise MeshError(
            f"{name}: the edge between vertices {one} and {two} is shared by {edges.face_count[many][0]} triangles "
            f"({many.sum()} such edges in all): a skin has one side there and one behind, no more"
        )
    if wrong.any():
        one, two = ends[wrong[edges.of_half]][0]
        raise MeshError(
            f"{name}: the two triangles at the edge between vertices {one} and {two} are wound against each other "
            f"({wrong.sum()} such edges in all): turn one over (trimesh.repair.fix_winding)"
        )


def require_rim(name: str, region: np.ndarray, face_count: int) -> None:
    """Raise MeshError for a region without boundary."""
    if (twins_of(region) == OPEN).any():
        return
    what = "all of a closed mesh" if len(region) == face_count else "a closed surface of its own"
    raise MeshError(
        f"{name}: the glabrous region is {what} ({len(region)} triangles) and has no boundary to close contours along: "
        "name the skin that feels, as glabrous=facing_palm(vertices, faces)"
    )


def warn_of_size(name: str, vertices: np.ndarray) -> None:
    """Warn of a hand that is in millimetres by its looks."""
    size = np.ptp(vertices.reshape(-1, 3), axis=0)
    if size.max() > SIZE_LARGEST:
        warn_user(
            f"{name}: is {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} m; a size like this suggests millimetres: "
            "use scale=0.001"
        )
