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
from ..storage.durable import TEMPORARY_SUFFIX, discard, fitting_name, publish
from ..storage.hdf5 import Hdf5Reader
from ..storage.hdf5_output import Hdf5Output, hdf5_output
from ..storage.schema import CONTOURS, METRICS, TIMING, Arrays, Field
from .timing import Timing, write_timing

HEADER_NAME = "header.h5"
"""File of the work folder with all that is known before the first pose is rendered."""
_BLOCK_NAME = re.compile(r"poses-(\d{12})-(\d{12})\.h5")
_OLDER_NAME = re.compile(r"poses-\d{12}\.(log|rows|h5)")  # as palpate wrote them before a block was a whole file
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


class PoseBlock(NamedTuple):
    """An opened file with the rows of consecutive poses: a block, or the finished file."""

    first: int
    stop: int
    rows: Hdf5Reader
    recipe: str = ""
    """Of a block, the SHA-256 of its rendering's recipe."""


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


def open_blocks(folder: Path) -> tuple[list[PoseBlock], list[str]]:
    """The blocks of a folder that can be opened, in pose order, without those that overlap one before.

    And a sentence for each that cannot. Raises as `block_files`.
    """
    blocks: list[PoseBlock] = []
    problems: list[str] = []
    try:
        for first, stop, path in block_files(folder):
            try:
                blocks.append(_opened(path, first, stop, blocks[-1].stop if blocks else 0))
            except ContourFileError as error:
                problems.append(str(error))
    except BaseException:
        close_blocks(blocks)
        raise
    return blocks, problems


def close_blocks(blocks: Iterable[PoseBlock]) -> None:
    """Close their files."""
    for block in blocks:
        block.rows.close()


def write_block(folder: Path, rows: list[PoseRows], timing: Timing, recipe: str) -> None:
    """Write a block of consecutive rows; when this returns, it is on the disk.

    Raises OSError; then nothing is there.
    """
    first, stop = rows[0].first, rows[-1].stop
    path = folder / f"poses-{first:012d}-{stop:012d}.h5"
    temporary = path.with_name(path.name + TEMPORARY_SUFFIX)
    counts = {dim: sum(part.counts[dim] for part in rows) for dim in rows[0].counts}
    try:
        with hdf5_output(temporary) as output:
            output.attributes("/", {_RECIPE: recipe})
            write_rows(output, rows, counts, optional_fields(rows))
            write_timing(output, timing)
        publish(temporary, path)
    except OSError:
        discard(temporary)
        raise


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


def _opened(path: Path, first: int, stop: int, reached: int) -> PoseBlock:
    if not reached <= first < stop:
        raise ContourFileError(f"{path.name} overlaps the poses before {reached}")
    rows = Hdf5Reader(path)
    try:
        _, shape = rows.layout("/metrics/length")
        if shape[0] != stop - first:
            raise ContourFileError(f"{path.name} has {shape[0]} poses, expected {stop - first}")
        for spec in TIMING:
            rows.layout(spec.path)
        return PoseBlock(first, stop, rows, rows.text("/", _RECIPE))
    except ContourFileError:
        rows.close()
        raise
