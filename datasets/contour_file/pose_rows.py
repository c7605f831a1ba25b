"""What a file's header has of one pose: where a moving object is, and the rows of an articulated hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..storage.hdf5 import Hdf5Reader
from ..storage.schema import HAND, Arrays
from .reader import ContourFile

_WHOLE = ("skin_faces", "skin_glabrous")


def object_pose_at(file: ContourFile, pose: int) -> NDArray[np.float32] | None:
    """Where the middle of a moving object is at a pose, and how it is turned, shape [7]; None: the object is at rest.

    Raises ContourFileError for a pose that the file does not have, and for damaged rows.
    """
    header = _header(file, pose)
    return header.read("/object/moved", pose, pose + 1)[0] if "/object/moved" in header else None


def hand_at(file: ContourFile, pose: int) -> tuple[dict[str, Any], Arrays]:
    """Description and arrays of the hand at a pose, as a hand of one pose would have them.

    Only this pose's rows are read. The description has no SHA-256, which is of the rows of all poses. Raises
    ContourFileError for a pose that the file does not have, and for damaged rows.
    """
    header = _header(file, pose)
    described = {name: value for name, value in file.hand.items() if name != "sha256"}
    articulated = "poses" in described
    arrays: Arrays = {}
    for spec in HAND:
        if spec.path not in header:
            continue
        if articulated and spec.name not in _WHOLE:
            _, shape = header.layout(spec.path)
            count = shape[0] // file.pose_count
            arrays[spec.name] = header.read(spec.path, pose * count, (pose + 1) * count)
        else:
            arrays[spec.name] = header.read(spec.path)
    return (described | {"poses": 1} if articulated else described), arrays


def _header(file: ContourFile, pose: int) -> Hdf5Reader:
    if not 0 <= pose < file.pose_count:
        raise ContourFileError(f"{file.path}: pose must lie in 0..{file.pose_count - 1}, not {pose}")
    return file.parts()[0]
