"""The contour file's format: its datasets as tables, and validation of arrays against them.

docs/formats/file-format.md describes the format for users of other languages; a test compares it with this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError

FORMAT_NAME = "palpate contours"
FORMAT_VERSION = (1, 5)
"""(major, minor). Readers of an older major version refuse the file; a minor version adds what they may ignore."""

DIGESTS_SINCE = (1, 5)
"""First version with a digest of each dataset and attribute; 1.2 to 1.4 had digests of blocks, which are ignored."""

CHUNK_ROWS = 8192
"""Rows of an HDF5 chunk: 98 kB of points. Larger chunks slow down reading single poses, smaller ones writing."""

KIND_NAMES = ("object", "hand", "made")
"""Names of a segment's `kind`: on the object's surface, on the hand's boundary, made by a transform stage."""

PRUNED_NAMES = ("off_skin", "close_together", "small", "turned_away", "hidden", "joined", "other")
"""Prune stages in the names of metrics; "other" stands for all user-defined ones."""


def removed_name(stage: str) -> str:
    """Name of the metric for the length that a prune stage removed; a stage's second use, "name#2", shares the
    first one's."""
    own = stage.partition("#")[0].replace("-", "_")
    return f"removed_{own if own in PRUNED_NAMES else 'other'}"


Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Field:
    """One dataset of the file.

    `dims[0]` names a row's meaning; further dims are lengths, or "stage". `unit` and `frame` are stored as attributes.
    """

    group: str
    name: str
    dtype: np.dtype[Any]
    dims: tuple[str | int, ...]
    unit: str = "1"
    frame: str = "none"
    optional: bool = False
    absent: float = 0.0
    """Value of an optional field's rows in parts of a file that lack the field."""

    @property
    def path(self) -> str:
        """Path of the dataset in the file, as `/contours/points`."""
        return f"/{self.group}/{self.name}"

    @property
    def is_offset(self) -> bool:
        """Whether it holds offsets: one entry more than rows, from 0 to the row count of the dataset they index."""
        return str(self.dims[0]).endswith("+ 1")


_F4, _F8, _I4, _I8, _U1 = (np.dtype(code) for code in ("<f4", "<f8", "<i4", "<i8", "u1"))

CONTOURS = (
    Field("contours", "points", _F4, ("point", 3), "m", "array"),
    Field("contours", "kind", _U1, ("point",)),
    Field("contours", "intensity", _F4, ("point",), optional=True, absent=1.0),
    Field("contours", "dwell", _F4, ("point",), "s", optional=True),
    Field("contours", "polyline_start", _I8, ("polyline + 1",)),
    Field("contours", "polyline_patch", _I4, ("polyline",)),
    Field("contours", "polyline_closed", _U1, ("polyline",)),
    Field("contours", "pose_start", _I8, ("pose + 1",)),
)
METRICS = (
    Field("metrics", "length", _F4, ("pose",), "m"),
    *(Field("metrics", f"length_{kind}", _F4, ("pose",), "m") for kind in KIND_NAMES),
    Field("metrics", "polylines", _I4, ("pose",)),
    *(Field("metrics", f"removed_{stage}", _F4, ("pose",), "m", optional=True) for stage in PRUNED_NAMES),
)
MOTION = (
    Field("motion", "time", _F8, ("pose",), "s", optional=True),
    Field("motion", "pose", _F4, ("pose", 7), "m (x y z), 1 (qx qy qz qw)", "array"),
)
OBJECT = (
    Field("object", "vertices", _F4, ("vertex", 3), "m", "array"),
    Field("object", "faces", _I4, ("face", 3)),
    Field("object", "moved", _F4, ("pose", 7), "m (x y z), 1 (qx qy qz qw)", "array", optional=True),
)
HAND = (
    Field("hand", "patch_pose", _F4, ("patch pose", 7), "m (x y z), 1 (qx qy qz qw)", "hand", optional=True),
    Field("hand", "skin_vertices", _F4, ("skin vertex", 3), "m", "hand", optional=True),
    Field("hand", "skin_faces", _I4, ("skin face", 3), optional=True),
    Field("hand", "skin_glabrous", _U1, ("skin face",), optional=True),
)
LIVE = (
    Field("live", "stamp", _F8, ("pose",), "s", optional=True),
    Field("live", "emitted", _F8, ("pose",), "s", optional=True),
    Field("live", "position", _F4, ("focal point", 3), "m", "array", optional=True),
    Field("live", "intensity", _F4, ("focal point",), optional=True),
    Field("live", "gain", _F4, ("sample",), optional=True),
    Field("live", "mark", _U1, ("sample",), optional=True),
    Field("live", "events", _U1, ("byte",), optional=True),
)
LIVE_MARKS = ("emitted", "dropped", "held", "faded")
"""Names of a sample's `mark`: what the array emitted when the sample was due."""
HEADER = (*MOTION, *OBJECT, *HAND, *LIVE)
TIMING = (
    Field("timing", "first", _I8, ("chunk",)),
    Field("timing", "stop", _I8, ("chunk",)),
    Field("timing", "seconds", _F8, ("chunk", "stage"), "s"),
)
FIELDS = (*CONTOURS, *METRICS, *HEADER, *TIMING)


def validate_fields(arrays: Mapping[str, NDArray[Any]], fields: tuple[Field, ...]) -> dict[str, int]:
    """Check names, dtypes and shapes of arrays against fields. Returns the number of rows by dim, as {"point": 25}.

    Raises:
        ContourFileError: An array is missing or unknown, has another dtype or shape, or arrays with the same dim have
            different numbers of rows.
    """
    group = fields[0].group
    if unknown := sorted(set(arrays) - {spec.name for spec in fields}):
        raise ContourFileError(f"/{group} has no field {unknown[0]!r}")
    rows: dict[str, int] = {}
    for spec in fields:
        if spec.name not in arrays:
            if spec.optional:
                continue
            raise ContourFileError(f"{spec.path} is missing")
        array = arrays[spec.name]
        if problem := shape_problem(spec, array.dtype, array.shape):
            raise ContourFileError(problem)
        if problem := _count_rows(rows, spec, array.shape[0]):
            raise ContourFileError(problem)
    return rows


def shape_problem(spec: Field, dtype: np.dtype[Any], shape: tuple[int, ...]) -> str | None:
    """A sentence on what is wrong with a dtype or shape for a field; None if both fit."""
    if dtype != spec.dtype:
        return f"{spec.path} is {dtype}, expected {spec.dtype}"
    fixed = tuple(size if isinstance(size, int) else None for size in spec.dims)
    if len(shape) != len(fixed) or any(wanted not in (None, got) for wanted, got in zip(fixed, shape, strict=True)):
        return f"{spec.path} has shape {list(shape)}, expected [{', '.join(map(str, spec.dims))}]"
    if spec.is_offset and shape[0] == 0:
        return f"{spec.path} has no entries, expected at least the first offset 0"
    return None


def count_problems(
    shapes: Mapping[str, tuple[int, ...]], fields: tuple[Field, ...]
) -> tuple[dict[str, int], list[str]]:
    """Rows by dim from the shapes of the fields that exist, and a sentence for each field that contradicts another."""
    rows: dict[str, int] = {}
    problems = [_count_rows(rows, spec, shapes[spec.path][0]) for spec in fields if spec.path in shapes]
    return rows, [problem for problem in problems if problem]


def _count_rows(rows: dict[str, int], spec: Field, count: int) -> str | None:
    dim = str(spec.dims[0]).removesuffix(" + 1")
    count -= int(spec.is_offset)
    if rows.setdefault(dim, count) != count:
        return f"{spec.path} has {count} {dim} rows, other fields have {rows[dim]}"
    return None
