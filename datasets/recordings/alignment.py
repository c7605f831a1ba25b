"""From a tracker's frame to the array's: one rigid transform, given outright or by a JSON file; it may mirror.

```json
{"position": [0.0, 0.12, 0.0], "orientation": [0.70710678, 0.0, 0.0, 0.70710678]}
{"matrix": [[1, 0, 0, 0], [0, 0, -1, 0.12], [0, 1, 0, 0], [0, 0, 0, 1]]}
```

`position` [m] is the tracker's origin in the array's frame, `orientation` xyzw turns the tracker's axes into the
array's; `matrix` is the same, row by row. A matrix of determinant -1 is of a tracker whose frame is left-handed, as
Unity's; it mirrors positions and orientations, and only `load_recording` takes it. A scale is no alignment and is
refused: units are the reader's.
"""

import json
import math
from os import PathLike
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from ..errors import RecordingError
from ..known_names import find_name
from ..rigid import POSITION_FARTHEST, Numbers, matrix_of, quaternion_of
from ..storage.durable import write_file
from .conventions import MIRRORED
from .json_fields import Json, items, number, read_json

Y_UP = (0.0, 0.0, 0.0, math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""A tracker at the array's centre whose y is up, x to the right and z towards the user (a Leap lying flat, OpenXR)."""

NAMES = ("y-up", "yup")
"""Words for it."""

UNITY = "unity"
"""The word for a tracker at the array's centre in Unity's left-handed frame: x right, y up, z away from the user."""

TOLERANCE = 1e-3  # of a quaternion's norm, and of a matrix's columns

Alignment = str | PathLike[str] | ArrayLike


class SplitAlignment(NamedTuple):
    """An alignment as a rigid transform, after a mirror where the tracker's frame is left-handed."""

    pose: Numbers
    """x y z [m] qx qy qz qw, shape [7]."""
    mirrors: bool = False
    """Whether the tracker's z is reversed before."""


def alignment_pose(alignment: Alignment) -> Numbers:
    """An alignment as a pose, tracker frame -> array frame, shape [7].

    alignment: x y z [m] qx qy qz qw; a 4 x 4 matrix (by rows); "y-up" for Y_UP; or the path of a JSON file. Raises
    RecordingError for anything that is not a rigid transform, naming the file.
    """
    found = split_alignment(alignment)
    if found.mirrors:
        raise RecordingError(
            f"alignment: {alignment!r:.60} mirrors (determinant -1), a rigid transform does not; load_recording takes"
            " it, for a tracker's frame that is left-handed"
        )
    return found.pose


def split_alignment(alignment: Alignment) -> SplitAlignment:
    """An alignment, "unity" and matrices that mirror included; raises RecordingError as `alignment_pose`."""
    if not isinstance(alignment, (str, PathLike)):
        return _pose(alignment, "alignment")
    if find_name(str(alignment), (*NAMES, UNITY)) is not None:
        return SplitAlignment(np.array(Y_UP), find_name(str(alignment), (UNITY,)) is not None)
    path = Path(alignment)
    content = _content(path)
    name = f"{path}: alignment"
    if set(content) == {"matrix"}:
        rows = items(content["matrix"], f"{name}, matrix")
        return _pose([_numbers(row, f"{name}, matrix") for row in rows], name, shapes=((4, 4),))
    if set(content) == {"position", "orientation"}:
        position, orientation = (_numbers(content[key], f"{name}, {key}") for key in ("position", "orientation"))
        if (len(position), len(orientation)) != (3, 4):
            raise RecordingError(f"{name}: position and orientation must be lists of 3 and 4 numbers")
        return _pose([*position, *orientation], name)
    raise RecordingError(f"{name}: has {sorted(content)}, must have position and orientation, or matrix")


def write_alignment(path: str | PathLike[str], alignment: Alignment, *, overwrite: bool = False) -> None:
    """Write an alignment as JSON.

    Raises RecordingError where it is none, where the file is there unless `overwrite`, or cannot be written.
    """
    found = split_alignment(alignment)
    pose = found.pose.tolist()
    if Path(path).exists() and not overwrite:
        raise RecordingError(f"{path}: exists already; overwrite=True replaces it")
    content: Json = {"position": pose[:3], "orientation": pose[3:]}
    if found.mirrors:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = matrix_of(found.pose[3:]) * MIRRORED, found.pose[:3]
        content = {"matrix": matrix.tolist()}
    text = json.dumps(content) + "\n"
    try:
        write_file(Path(path), text.encode())
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error}") from error


def _content(path: Path) -> dict[str, Json]:
    try:
        content = read_json(path)
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be read as an alignment: {error.strerror or error}; y-up is that of one lying flat, unity"
            " that of Unity"
        ) from None
    except RecordingError as error:
        raise RecordingError(f"{path}: not an alignment: {error}") from None
    if not isinstance(content, dict):
        raise RecordingError(f"{path}: an alignment is a JSON object with position and orientation, or matrix")
    return cast("dict[str, Json]", content)


def _numbers(node: Json, name: str) -> list[float]:
    return [number(value, name) for value in items(node, name)]


def _pose(value: ArrayLike, name: str, shapes: tuple[tuple[int, ...], ...] = ((7,), (4, 4))) -> SplitAlignment:
    try:
        given = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        given = np.array(None)
    if given.dtype.kind not in "iuf":
        raise RecordingError(f"{name}: must be numbers, got {value!r:.60}")
    numbers = given.astype(np.float64)
    if numbers.shape not in shapes:
        wanted = " or ".join(str(list(shape)) for shape in shapes)
        raise RecordingError(f"{name}: must have shape {wanted}, got {list(numbers.shape)}")
    if not np.isfinite(numbers).all():
        raise RecordingError(f"{name}: {numbers.tolist()} is not finite")
    place = numbers[:3] if numbers.shape == (7,) else numbers[:3, 3]
    if (np.abs(place) > POSITION_FARTHEST).any():
        raise RecordingError(f"{name}: position {place.tolist()} m must lie within {POSITION_FARTHEST:g} m")
    return _from_matrix(numbers, name) if numbers.shape == (4, 4) else _from_pose(numbers, name)


def _from_pose(pose: Numbers, name: str) -> SplitAlignment:
    norm = float(np.linalg.norm(pose[3:]))
    if abs(norm - 1.0) > TOLERANCE:
        raise RecordingError(f"{name}: quaternion norm {norm:.6g}; it must be 1 within {TOLERANCE:g}")
    return SplitAlignment(np.concatenate([pose[:3], pose[3:] / norm]))


def _from_matrix(matrix: Numbers, name: str) -> SplitAlignment:
    if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9:
        raise RecordingError(f"{name}: last row {matrix[3].tolist()} must be 0 0 0 1 (matrices are written by rows)")
    turn = matrix[:3, :3]
    with np.errstate(over="ignore"):  # infinite is no 1 either
        scale = np.linalg.norm(turn, axis=0)
    if np.abs(scale - 1.0).max() > TOLERANCE:
        raise RecordingError(f"{name}: scales by {scale.round(4).tolist()}; a rigid transform scales by 1")
    if np.abs(turn.T @ turn - np.eye(3)).max() > 2.0 * TOLERANCE:
        raise RecordingError(f"{name}: its axes are not at right angles")
    mirrors = bool(np.linalg.det(turn) < 0.0)
    turn = turn * MIRRORED if mirrors else turn
    return SplitAlignment(np.concatenate([matrix[:3, 3], quaternion_of(turn)]), mirrors)
