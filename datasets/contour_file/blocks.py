"""Blocks of a rendering that is not finished: whole HDF5 files of consecutive poses, in the work folder OUT.h5.partial.

A block is named `poses-FIRST-STOP.h5` and holds what the finished file holds of its poses: /contours, /metrics, /timing
and their digests. It gets its name when it is whole and on the disk, so what a killed writer leaves can be read.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
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
_OPEN_MOST = 64  # files: a day of rendering commits more blocks than a process may have files open


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


class BlockFile:
    """A file with the rows of consecutive poses: a block, or the finished file.

    recent: the blocks of the same folder that are open; the one that was opened first is closed when they are too many.
    recipe: of a block, the SHA-256 of its rendering's recipe.
    """

    def __init__(
        self, first: int, stop: int, rows: Hdf5Reader, recent: list[BlockFile] | None = None, recipe: str = ""
    ) -> None:
        self.first, self.stop, self.path, self.recipe = first, stop, rows.path, recipe
        self._recent: list[BlockFile] = [] if recent is None else recent
        self._rows: Hdf5Reader | None = None
        self._keep(rows)

    @property
    def rows(self) -> Hdf5Reader:
        """The opened file; ask for it anew once other blocks were read."""
        return self._rows or self._keep(Hdf5Reader(self.path))

    @cached_property
    def polylines(self) -> int:
        """Number of polylines."""
        return self.rows.layout("/contours/polyline_closed")[1][0]

    @cached_property
    def points(self) -> int:
        """Number of points, the repeated ones of closed polylines included."""
        return self.rows.layout("/contours/points")[1][0]

    @cached_property
    def optional(self) -> frozenset[Field]:
        """Optional fields that the file has."""
        return frozenset(spec for spec in (*CONTOURS, *METRICS) if spec.optional and spec.path in self.rows)

    def _keep(self, rows: Hdf5Reader) -> Hdf5Reader:
        self._rows = rows
        self._recent.append(self)
        if len(self._recent) > _OPEN_MOST:
            self._recent[0].close()
        return rows

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        if self._rows is not None:
            self._rows.close()
            self._rows = None
            self._recent.remove(self)


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


def open_blocks(folder: Path) -> tuple[list[BlockFile], list[str]]:
    """The blocks of a folder that can be opened, in pose order, without those that overlap one before.

    And a sentence for each that cannot. Raises as `block_files`, and ContourFileError where the system fails to read a
    block, which may be whole.
    """
    blocks: list[BlockFile] = []
    problems: list[str] = []
    recent: list[BlockFile] = []
    try:
        for first, stop, path in block_files(folder):
            try:
                blocks.append(block := _opened(path, first, stop, blocks[-1].stop if blocks else 0, recent))
                _ = block.polylines, block.points, block.optional  # kept, so that no file is opened again for them
            except ContourFileError as error:
                problems.append(problem_of(error))
    except BaseException:
        close_blocks(blocks)
        raise
    return blocks, problems


def problem_of(error: ContourFileError) -> str:
    """What is wrong with a block; raises the error if the system failed to read it, as the block may be whole."""
    if is_of_system(str(error)):
        raise error
    return str(error)


def close_blocks(blocks: Iterable[BlockFile]) -> None:
    """Close their files."""
    for block in blocks:
        block.close()


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


def _opened(path: Path, first: int, stop: int, reached: int, recent: list[BlockFile]) -> BlockFile:
    if stop <= first:
        raise ContourFileError(f"{path.name} names no pose")
    if first < reached:
        raise ContourFileError(f"{path.name} overlaps the poses before {reached}")
    rows = Hdf5Reader(path)
    try:
        for fields in (CONTOURS, METRICS, TIMING):
            for spec in fields:
                if not spec.optional:
                    rows.layout(spec.path)
            require_fitting(rows, fields, stop - first)
        return BlockFile(first, stop, rows, recent, rows.text("/", _RECIPE))
    except ContourFileError:
        rows.close()
        raise
