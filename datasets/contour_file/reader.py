"""Lazy reading of contour files by pose range; files may be sealed or still being written."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import chain
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..counted import counted
from ..errors import ContourFileError
from ..storage.durable import FolderLock
from ..storage.hdf5 import Hdf5Reader, require_fitting
from ..storage.schema import CONTOURS, HAND, LIVE, METRICS, MOTION, Arrays, Field
from .blocks import HEADER_NAME, Block, block_of, find_blocks, problem_of, work_folder
from .header import (
    FileHeader,
    get_header,
    get_json,
    get_live,
    get_provenance,
    get_representation,
    get_texts,
    get_version,
    recipe_hash,
    refuse_foreign,
)
from .header_live import RecordedRun, require_live
from .timing import Timing, get_timing, join_timing

_BLOCK_POSES = 1 << 16
_BLOCK_POINTS = 1 << 20


class ContourFile:
    """A contour file opened for reading; use it in a `with`, or `close()` it.

    Where `path` does not exist but the work folder beside it does, the poses committed so far are read: `sealed` is
    False, `done` lists them, and reading any other pose raises. What is committed later is not seen.

    Whenever rows are read, their checksums (Fletcher-32) are verified. `verify` first verifies everything by the file's
    digests (format 1.5 and newer), which also detect a chunk of zeros.

    Raises:
        ContourFileError: From every method: missing, empty, truncated, foreign or damaged files, a newer major
            version, poses out of range or not done yet. The message names the file and why.

    >>> from palpate.render import ContourFile, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> with ContourFile(path) as file:
    ...     file.contours()["points"].shape, file.metrics()["length"]
    ((5, 3), array([0.34], dtype=float32))
    """

    def __init__(self, path: str | PathLike[str], *, verify: bool = False) -> None:
        self.path = Path(path)
        self.sealed, self._header_file, blocks, self.problems = _open(self.path)
        """Sentences on damage in an unfinished file; resuming renders the damaged ranges again."""
        self._pose_blocks = blocks
        self._block_file: Hdf5Reader | None = None  # one at a time: a day of rendering commits thousands
        self._fitting: set[tuple[Field, ...]] = set()
        try:
            refuse_foreign(self._header_file)
            _, shape = self._header_file.layout("/motion/pose")
            self.pose_count = shape[0]
            """Number of poses of the motion, done or not."""
            if self.pose_count == 0:
                raise ContourFileError(f"{self._header_file.path}: /motion/pose has no rows")
            if self.sealed:
                self._pose_blocks = [block_of(self._header_file, 0, self.pose_count)]
            if verify:
                self.require_whole()
        except ContourFileError:
            self.close()
            raise

    def __repr__(self) -> str:
        """One line."""
        state = "sealed" if self.sealed else "unfinished"
        return f"ContourFile({str(self.path)!r}, {counted(self.pose_count, 'pose')}, {state})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self._header_file.close()
        if self._block_file is not None:
            self._block_file.close()

    def _rows(self, block: Block) -> Hdf5Reader:
        """The file of a block; it stays open until another one's is asked for."""
        if self.sealed:
            return self._header_file
        if self._block_file is None or self._block_file.path != block.path:
            if self._block_file is not None:
                self._block_file.close()
                self._block_file = None
            try:
                self._block_file = Hdf5Reader(block.path)
            except ContourFileError:
                if self.path.is_file():
                    raise ContourFileError(f"{self.path} was finished while it was read: open it again") from None
                raise
        return self._block_file

    def require_whole(self) -> None:
        """Read everything once, in bounded memory, and raise ContourFileError for content that fails its digest.

        Digests detect accidents: who changes a file can also change its digests. Raises ContourFileError also if the
        file has none, as those of formats 1.0 to 1.4.
        """
        if self._header_file.digests is None:
            raise ContourFileError(f"{self.path} has no digests that prove its content: format 1.5 brought them")
        for rows in chain([self._header_file], map(self._rows, self._pose_blocks)):  # each is opened in turn
            rows.require_attributes()
            rows.require_rows()

    def intact_blocks(self) -> tuple[list[tuple[int, int]], list[str]]:
        """Pose ranges of the blocks of an unfinished file whose rows are what was written, and why others are not.

        Raises ContourFileError if the header is not what was written, which sealing would refuse.
        """
        try:
            self._header_file.require_attributes()
            self._header_file.require_rows()
        except ContourFileError as error:
            raise ContourFileError(f'{problem_of(error)}; mode="overwrite" begins anew') from None
        intact: list[tuple[int, int]] = []
        damaged: list[str] = []
        for block in self._pose_blocks:
            try:
                rows = self._rows(block)
                rows.require_attributes()
                rows.require_rows()
                get_timing(rows)
                own = self.contours(block.first, block.stop)  # sealing must not fail for what resuming has accepted
                if (len(own["polyline_closed"]), len(own["points"])) != (block.polyline_count, block.point_count):
                    raise ContourFileError(f"{block.path}: polylines or points belong to no pose")
                intact.append((block.first, block.stop))
            except ContourFileError as error:
                damaged.append(problem_of(error))
        return intact, damaged

    def require_unchanged(self) -> None:
        """Raise ContourFileError if a sealed file was changed since it was opened."""
        self._header_file.require_unchanged()

    @property
    def folder(self) -> Path:
        """The folder that holds the blocks, or the sealed file."""
        return self._header_file.path.parent

    def parts(self) -> tuple[Hdf5Reader, Iterator[tuple[Hdf5Reader, int]]]:
        """The file's header, and for each rendered range of poses its rows and its number of poses, one by one."""
        return self._header_file, ((self._rows(block), block.stop - block.first) for block in self._pose_blocks)

    @property
    def done(self) -> list[tuple[int, int]]:
        """Pose ranges (first, stop) that can be read; adjacent ranges are merged."""
        ranges: list[tuple[int, int]] = []
        for block in self._pose_blocks:
            if ranges and ranges[-1][1] == block.first:
                ranges[-1] = (ranges[-1][0], block.stop)
            else:
                ranges.append((block.first, block.stop))
        return ranges

    @cached_property
    def polyline_count(self) -> int:
        """Number of polylines of the poses done."""
        return sum(block.polyline_count for block in self._pose_blocks)

    @cached_property
    def point_count(self) -> int:
        """Number of points of the poses done, the repeated ones of closed polylines included."""
        return sum(block.point_count for block in self._pose_blocks)

    @cached_property
    def optional(self) -> tuple[str, ...]:
        """Optional fields of /contours and /metrics that exist for any of the poses done."""
        found = frozenset[Field]().union(*(block.optional for block in self._pose_blocks))
        return tuple(spec.name for spec in (*CONTOURS, *METRICS) if spec in found)

    @cached_property
    def strategy(self) -> dict[str, Any]:
        """JSON of the intersection strategy."""
        return get_json(self._header_file, "/", "strategy")

    @cached_property
    def hand(self) -> dict[str, Any]:
        """JSON of the hand."""
        return get_json(self._header_file, "/hand", "description")

    @cached_property
    def recipe(self) -> dict[str, str]:
        """Everything that determines the data, as text by field (`FileHeader.recipe`)."""
        return get_texts(self._header_file, "/", "recipe")

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Format name and version, software versions, device, creation time; if any, seed, inserted poses, motion."""
        file = self._header_file
        attributes: dict[str, Any] = {
            "format": file.text("/", "format"),
            "version": list(get_version(file)),
            "versions": get_texts(file, "/", "versions"),
            "device": file.text("/", "device"),
            "created": file.text("/", "created"),
        }
        notes = {name: file.whole("/", name) for name in ("seed", "poses_inserted")}
        notes |= {"raw_error": file.number("/", "raw_error"), "motion": get_provenance(file)}
        return attributes | {name: value for name, value in notes.items() if value is not None}

    @cached_property
    def live_run(self) -> RecordedRun | None:
        """The live run that this is the recording of; None for any other file."""
        if (described := get_live(self._header_file)) is None:
            return None
        try:
            rows = {spec.name: self._header_file.layout(spec.path)[1][0] for spec in LIVE if self.has_live(spec.name)}
            require_live(described, rows, self.pose_count)
            return RecordedRun.from_json(described)
        except ContourFileError as error:
            raise ContourFileError(f"{self.path}: {error}") from None

    def has_live(self, name: str) -> bool:
        """Whether the file has an array of /live."""
        return f"/live/{name}" in self._header_file

    def live_rows(self, name: str, first: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `first` to `stop` (all) of an array of /live by its name (docs/formats/file-format.md)."""
        return self._header_file.read(f"/live/{name}", first, stop)

    def header(self) -> FileHeader:
        """The header: everything that the writer got before the first pose was rendered."""
        return get_header(self._header_file)

    def motion(self, first: int = 0, stop: int | None = None) -> Arrays:
        """Poses `first` to `stop` (all): `pose`, float32 [pose, 7], hand frame -> array frame; `time` [s], if any.

        `time` is float64 [pose]. Poses are there before their contours are done.
        """
        self._require_fitting(MOTION)
        names = ("pose", "time") if "/motion/time" in self._header_file else ("pose",)
        return {name: self._header_file.read(f"/motion/{name}", first, stop) for name in names}

    def object(self) -> dict[str, Any]:
        """The rendered object: `vertices` [m], float32 [vertex, 3], array frame, and `faces` of its mesh, or of a mesh
        of its outline if it is not a mesh. Also `name`, `hash`, JSON, and for a moving object `moved`, float32
        [pose, 7].
        """
        file = self._header_file
        return {
            "name": file.text("/object", "name"),
            "hash": file.text("/object", "hash"),
            "placement": get_json(file, "/object", "placement"),
            "attributes": get_json(file, "/object", "attributes"),
            "representation": get_representation(file),
            "vertices": file.read("/object/vertices"),
            "faces": file.read("/object/faces"),
            **({"moved": file.read("/object/moved")} if "/object/moved" in file else {}),
        }

    def hand_arrays(self) -> Arrays:
        """Arrays of the hand by name, which complete its description."""
        return {spec.name: self._header_file.read(spec.path) for spec in HAND if spec.path in self._header_file}

    def contours(self, first: int = 0, stop: int | None = None) -> Arrays:
        """Contours of poses `first` to `stop` (default: all), as one batch.

        Returns the arrays of `/contours` by name (docs/formats/file-format.md); offsets start at 0; optional ones only
        if the file has them. Raises ContourFileError if a pose of the range is not done.
        """
        parts = self._parts(first, stop, CONTOURS)
        batches = [self._contours_of(block, *poses) for block, *poses in parts]
        return join_contours(batches)

    def blocks(self, *, point_limit: int = _BLOCK_POINTS) -> Iterator[tuple[int, int]]:
        """Divide the poses done into ranges (first, stop) of at most `point_limit` points each, in order.

        A pose with more points is a range of its own. Use it to read a file of any size in bounded memory.
        """
        for block in self._pose_blocks:
            for first in range(0, block.stop - block.first, _BLOCK_POSES):
                stop = min(first + _BLOCK_POSES, block.stop - block.first)
                point_start = self._point_start(block, first, stop)
                row = 0
                while row < stop - first:
                    limit = int(point_start[row]) + point_limit
                    end = max(int(np.searchsorted(point_start, limit, side="right")) - 1, row + 1)
                    yield block.first + first + row, block.first + first + end
                    row = end

    def metrics(self, first: int = 0, stop: int | None = None) -> Arrays:
        """Metrics of poses `first` to `stop` (all) by name, each of shape [pose]: lengths [m], number of polylines.

        What prune stages removed [m] only where the file has it.
        """
        wanted = [spec for spec in METRICS if not spec.optional or spec.name in self.optional]
        parts = [[np.zeros(0, spec.dtype) for spec in wanted]]
        for block, low, high in self._parts(first, stop, METRICS):
            rows = self._rows(block)
            parts.append(
                [
                    rows.read(spec.path, low, high)
                    if not spec.optional or spec in block.optional
                    else np.full(high - low, spec.absent, spec.dtype)
                    for spec in wanted
                ]
            )
        return {spec.name: np.concatenate(own) for spec, own in zip(wanted, zip(*parts, strict=True), strict=True)}

    def timing(self) -> Timing:
        """Time that each chunk took, by stage; chunks in the order of their poses."""
        return join_timing([get_timing(rows) for rows in map(self._rows, self._pose_blocks)])

    def _parts(self, first: int, stop: int | None, fields: tuple[Field, ...]) -> list[tuple[Block, int, int]]:
        """Pieces that make up a pose range, each with the rows in it; the numbers of rows of the fields fit."""
        stop = self.pose_count if stop is None else stop
        if not 0 <= first <= stop <= self.pose_count:
            raise ContourFileError(
                f"{self.path}: poses {first} to {stop} are out of range, there are {self.pose_count} poses"
            )
        if self.sealed:  # blocks were looked at when they were found
            self._require_fitting(fields)
        parts: list[tuple[Block, int, int]] = []
        reached = first
        for block in self._pose_blocks:
            if block.first <= reached < min(stop, block.stop):
                end = min(stop, block.stop)
                parts.append((block, reached - block.first, end - block.first))
                reached = end
        if reached < stop:
            raise ContourFileError(f"{self.path}: pose {reached} of {first} to {stop} is not done yet")
        return parts

    def _require_fitting(self, fields: tuple[Field, ...]) -> None:
        """`require_fitting` of the file with the header, once for all reading."""
        if fields not in self._fitting:
            require_fitting(self._header_file, fields, self.pose_count)
            self._fitting.add(fields)

    def _contours_of(self, block: Block, first: int, stop: int) -> Arrays:
        file = self._rows(block)
        pose_start = _offsets(file, "/contours/pose_start", first, stop, "/contours/polyline_closed")
        low, high = int(pose_start[0]), int(pose_start[-1])
        polyline_start = _offsets(file, "/contours/polyline_start", low, high, "/contours/points")
        rows = {"pose": (first, stop), "polyline": (low, high)}
        rows["point"] = int(polyline_start[0]), int(polyline_start[-1])
        arrays: Arrays = {"pose_start": pose_start - low, "polyline_start": polyline_start - rows["point"][0]}
        for spec in CONTOURS:
            if not spec.is_offset and (not spec.optional or spec in block.optional):
                arrays[spec.name] = file.read(spec.path, *rows[str(spec.dims[0])])
        return arrays

    def _point_start(self, block: Block, first: int, stop: int) -> NDArray[np.int64]:
        """Offsets into a piece's points where its poses `first` to `stop` begin, and where the last of them ends."""
        file = self._rows(block)
        pose_start = _offsets(file, "/contours/pose_start", first, stop, "/contours/polyline_closed")
        low, high = int(pose_start[0]), int(pose_start[-1])
        polyline_start = _offsets(file, "/contours/polyline_start", low, high, "/contours/points")
        return np.asarray(polyline_start[pose_start - low], np.int64)


def join_contours(batches: list[Arrays]) -> Arrays:
    """Concatenate batches; a batch without an optional field gets the field's `absent` value."""
    joined: Arrays = {}
    for spec in CONTOURS:
        if spec.is_offset:
            joined[spec.name] = _join_offsets([block[spec.name] for block in batches])
        elif not spec.optional or any(spec.name in block for block in batches):
            empty = np.zeros((0, *(size for size in spec.dims[1:] if isinstance(size, int))), spec.dtype)
            columns = (
                block[spec.name] if spec.name in block else np.full(len(block["points"]), spec.absent, spec.dtype)
                for block in batches
            )
            joined[spec.name] = np.concatenate([empty, *columns])
    return joined


def _open(path: Path) -> tuple[bool, Hdf5Reader, list[Block], list[str]]:
    """Whether the file is sealed, the file with its header, its blocks if it is not sealed, and their problems."""
    folder = path if (path / HEADER_NAME).is_file() else work_folder(path)
    if folder != path and (path.exists() or not folder.is_dir()):
        return True, Hdf5Reader(path), [], []
    if not any(folder.glob("*.h5")) and not path.is_file():
        state = "is being written, nothing of it is saved yet" if FolderLock.is_held(folder) else "was never saved"
        raise ContourFileError(f"{path} {state}")
    try:
        header = Hdf5Reader(folder / HEADER_NAME)
        try:
            blocks, problems = find_blocks(folder, recipe_hash(get_texts(header, "/", "recipe")))
        except BaseException:
            header.close()
            raise
    except (OSError, ContourFileError) as error:
        if not path.is_file():
            raise ContourFileError(f"{path} is not written yet, and {folder} cannot be read ({error})") from error
    else:
        if not path.is_file():
            return False, header, blocks, problems
        header.close()
    return True, Hdf5Reader(path), [], []  # it was sealed while its blocks were opened


def _offsets(file: Hdf5Reader, name: str, first: int, stop: int, target: str) -> NDArray[np.int64]:
    """Offsets of rows `first` to `stop`; raises ContourFileError unless they increase and stay inside `target`."""
    offsets = file.read(name, first, stop + 1)
    _, shape = file.layout(target)
    whole = len(offsets) == stop - first + 1 and offsets[0] >= 0 and offsets[-1] <= shape[0]
    if not whole or (np.diff(offsets) < 0).any():
        raise ContourFileError(f"{file.path}: {name} is damaged: its offsets do not lead forward inside {target}")
    return offsets


def _join_offsets(batches: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    joined = [np.zeros(1, np.int64)]
    base = np.int64(0)
    for block in batches:
        joined.append(block[1:] + base)
        base += block[-1]
    return np.concatenate(joined)
