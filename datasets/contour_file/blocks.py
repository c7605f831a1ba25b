"""Blocks of a rendering that is not finished: whole HDF5 files of consecutive poses, in the work folder OUT.h5.partial.

A block is named `poses-FIRST-STOP.h5` and holds what the finished file holds of its poses: /contours, /metrics, /timing
and their digests. It gets its name when it is whole and on the disk, so what a killed writer leaves can be read.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError, name_nothing
from ..storage.durable import NewFile, fitting_name
from ..storage.hdf5 import Hdf5Reader, is_of_system, require_fitting
from ..storage.hdf5_output import Hdf5Output, hdf5_output
from ..storage.schema import CONTOURS, METRICS, TIMING, Arrays, Field
from .timing import Timing, write_timing

HEADER_NAME = "header.h5"
"""File of the work folder with all that is known before the first pose is rendered."""
_BLOCK_NAME = re.compile(r"poses-(\d{12})-(\d{12})\.h5")
_OLDER_NAME = re.compile(r"poses-\d{12}(\.log|\.rows|-\d{12}-[0-9a-f]{8}\.h5)")  # before a block was a whole file
_RECIPE = "recipe"  # attribute of the root: SHA-256 of the rendering's recipe


class PoseRows(NamedTuple):
    """Contours and metrics of consecutive poses, as `ContourWriter.write` takes them."""

    first: int
    stop: int
    contours: Arrays
    metrics: Arrays

    @property
    def counts(self) -> dict[str, int]:
        """Number of poses, polylines and points."""
        contours = self.contours
        return {
            "pose": self.stop - self.first,
            "polyline": len(contours["polyline_closed"]),
            "point": len(contours["points"]),
        }


class Block(NamedTuple):
    """A file with the rows of consecutive poses, which was opened once: a block, or the finished file."""

    first: int
    stop: int
    path: Path
    polyline_count: int
    point_count: int
    """The repeated points of closed polylines included."""
    optional: frozenset[Field]
    """Optional fields that the file has."""


def block_of(rows: Hdf5Reader, first: int, stop: int) -> Block:
    """What an opened file says of its poses `first` to `stop`; raises ContourFileError where a field is missing."""
    polylines, points = rows.layout("/contours/polyline_closed")[1][0], rows.layout("/contours/points")[1][0]
    optional = frozenset(spec for spec in (*CONTOURS, *METRICS) if spec.optional and spec.path in rows)
    return Block(first, stop, rows.path, polylines, points, optional)


def work_folder(path: Path) -> Path:
    """Folder of a file's blocks until it is sealed; raises ContourFileError for a path without a name."""
    if not path.name:  # "/", "."
        raise name_nothing(ContourFileError(f"{path} is a folder, not a contour file"))
    return fitting_name(path, ".partial")


def block_files(folder: Path) -> list[tuple[int, int, Path]]:
    """First pose, the pose after the last, and path of each block of a folder, in pose order; nothing is opened.

    Raises ContourFileError for a folder that an older palpate wrote, OSError where it cannot be listed.
    """
    found: list[tuple[int, int, Path]] = []
    for path in folder.iterdir():
        if match := _BLOCK_NAME.fullmatch(path.name):
            found.append((int(match[1]), int(match[2]), path))
        elif _OLDER_NAME.fullmatch(path.name):
            raise ContourFileError(
                f"{folder} was begun by an older palpate, which wrote {path.name}: it cannot be read, nor resumed; "
                'mode="overwrite" begins anew'
            )
    return sorted(found)


def block_like_files(folder: Path) -> list[Path]:
    """Blocks of a folder, and what older palpates wrote in place of them."""
    named = [path for path in folder.iterdir() if _BLOCK_NAME.fullmatch(path.name) or _OLDER_NAME.fullmatch(path.name)]
    return sorted(named)


def find_blocks(folder: Path, recipe: str) -> tuple[list[Block], list[str]]:
    """The blocks of a folder that are of a rendering, in pose order; and a sentence for each file that is none of them.

    recipe: SHA-256 of the rendering's recipe. Left out are also blocks that overlap one before. Raises as
    `block_files`, and ContourFileError where the system fails to read a block, which may be whole.
    """
    blocks: list[Block] = []
    problems: list[str] = []
    for first, stop, path in block_files(folder):
        try:
            if stop <= first:
                raise ContourFileError(f"{path.name} names no pose")
            if blocks and first < blocks[-1].stop:
                raise ContourFileError(f"{path.name} overlaps the poses before {blocks[-1].stop}")
            with Hdf5Reader(path) as rows:
                for fields in (CONTOURS, METRICS, TIMING):
                    require_fitting(rows, fields, stop - first)
                if rows.text("/", _RECIPE) != recipe:
                    raise ContourFileError(f"{path.name} is of another rendering than the folder it lies in")
                blocks.append(block_of(rows, first, stop))
        except ContourFileError as error:
            problems.append(problem_of(error))
    return blocks, problems


def problem_of(error: ContourFileError) -> str:
    """What is wrong with a block; raises the error if the system failed to read it, as the block may be whole."""
    if is_of_system(str(error)):
        raise error
    return str(error)


def write_block(folder: Path, rows: list[PoseRows], timing: Timing, recipe: str) -> None:
    """Write a block of consecutive rows; when this returns, it is on the disk.

    Raises OSError; then nothing is there, except where only the sync of the folder failed.
    """
    first, stop = rows[0].first, rows[-1].stop
    counts = {dim: sum(part.counts[dim] for part in rows) for dim in rows[0].counts}
    with (
        NewFile(folder / f"poses-{first:012d}-{stop:012d}.h5") as new,
        hdf5_output(new.temporary) as output,
    ):
        output.attributes("/", {_RECIPE: recipe})
        write_rows(output, rows, counts, optional_fields(rows))
        write_timing(output, timing)


def write_rows(
    output: Hdf5Output, rows: Iterable[PoseRows], counts: Mapping[str, int], optional: Collection[str]
) -> None:
    """Write /contours and /metrics of consecutive rows to a file.

    counts: poses, polylines and points of all. optional: fields that the file has; where rows lack one, its `absent`
    value is written.
    """
    fields = [spec for spec in (*CONTOURS, *METRICS) if not spec.optional or spec.name in optional]
    for spec in fields:
        dim = str(spec.dims[0]).removesuffix(" + 1")
        output.begin(spec, (counts[dim] + int(spec.is_offset), *(int(size) for size in spec.dims[1:])))
    base = {"pose_start": 0, "polyline_start": 0}
    for number, part in enumerate(rows):
        for spec in fields:
            output.append(spec, _continued(spec, part, base, is_first=number == 0))
        base["pose_start"] += part.counts["polyline"]
        base["polyline_start"] += part.counts["point"]


def optional_fields(rows: Iterable[PoseRows]) -> tuple[str, ...]:
    """Names of the optional fields that any of the rows has, in the order of the tables."""
    names = {name for part in rows for name in (*part.contours, *part.metrics)}
    return tuple(spec.name for spec in (*CONTOURS, *METRICS) if spec.optional and spec.name in names)


def _continued(spec: Field, part: PoseRows, base: Mapping[str, int], *, is_first: bool) -> NDArray[Any]:
    """Rows of a field as they go on behind those before, whose offsets end at `base`."""
    arrays = part.contours if spec.group == "contours" else part.metrics
    if spec.name not in arrays:
        return np.full(part.counts[str(spec.dims[0])], spec.absent, spec.dtype)
    rows = arrays[spec.name]
    return rows[int(not is_first) :] + base[spec.name] if spec.is_offset else rows
