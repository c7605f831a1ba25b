"""The work folder of an unfinished contour file: a header, and parts that grow by consecutive poses.

A part is two files. `poses-FIRST.rows` becomes OUT.h5: room for HDF5's metadata, motion and mesh as they lie in the
header (in the first part; the others leave room), then chunks (`rows.py`), never touched again. `poses-FIRST.log` says
what of it is done: a record for the part, then one for each range of poses written, with the rows that are in no chunk
yet (`part_log.py`). The binary data of a range's record are the field of each chunk (uint8), the digest of each
(uint64) and the tails (`Growth`).

| end of a log                        | what it means                                                     |
|-------------------------------------|-------------------------------------------------------------------|
| a whole record                      | all is well                                                       |
| a record cut short                  | the writer was killed: that range was never reported done         |
| a whole record with another CRC     | damage: that range and those after it are done again, and reported |
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bounded_file import ANY_SIZE, open_regular
from ..errors import ContourFileError, name_nothing
from ..storage.durable import append_at, fitting_name, write_file
from ..storage.schema import CHUNK_ROWS
from .part_log import counts_of, number, record, records, timing_of
from .rows import Growth, Rows, chunk_bytes, decode_chunk, row_fields, row_shape

HEADER_NAME = "header.h5"
LOG_SUFFIX, ROWS_SUFFIX = ".log", ".rows"
_PATTERN = re.compile(r"poses-(\d{12})\.log")
_DIGESTS = "xxh3-64"


@dataclass(frozen=True)
class Commit:
    """One range of poses that is done."""

    stop: int
    """The pose after its last."""
    rows_end: int
    """Where the chunks that it is in end [byte]."""
    log_end: int
    """Where its record ends [byte]."""
    timing: dict[str, float]
    """Seconds by stage."""


@dataclass
class FilePart:
    """Poses first to stop, as far as they are done."""

    log: Path
    first: int
    recipe: str
    """SHA-256 of the recipe."""
    rows: Rows
    begun_end: int
    """Where its first record ends [byte]."""
    log_end: int
    digested: bool = True
    """Whether its log has digests of chunks; those of format 1.1 and older have not."""
    commits: list[Commit] = field(default_factory=list[Commit])
    problem: str | None = None
    """What is wrong with the part beyond its last commit."""

    @property
    def path(self) -> Path:
        """The file of rows."""
        return self.log.with_suffix(ROWS_SUFFIX)

    @property
    def stop(self) -> int:
        """The pose after the last one done."""
        return self.commits[-1].stop if self.commits else self.first

    @property
    def optional(self) -> tuple[str, ...]:
        """The optional fields that it has."""
        return tuple(spec.name for spec in self.rows.fields if spec.optional)

    def append(
        self,
        stop: int,
        contours: Mapping[str, NDArray[Any]],
        metrics: Mapping[str, NDArray[Any]],
        timing: Mapping[str, float],
    ) -> None:
        """Add poses up to `stop`; when this returns, they are done: on the disk, chunks first, then their record.

        Raises OSError where the disk is full or fails; nothing has changed then.
        """
        growth, chunks = self.rows.grown(contours, metrics)
        head = {"stop": stop, "counts": growth.counts, "chunks": len(growth.order), "timing": dict(timing)}
        digests = growth.digests.astype("<u8").tobytes()
        done = record(head, growth.order.tobytes(), digests, *(tail.tobytes() for tail in growth.tails))
        if chunks:
            append_at(self.path, self.rows.end, chunks)
        append_at(self.log, self.log_end, [done])
        self._accept(stop, growth, dict(timing), self.log_end + len(done))

    def accept(self, head: Mapping[str, Any], content: memoryview, log_end: int) -> None:
        """Take over a commit that was read back; raises ValueError or KeyError where it means nothing."""
        order = np.frombuffer(content, np.uint8, number(head["chunks"]))
        counts = counts_of(head["counts"], order, self.rows.counts)
        digests = np.frombuffer(content, "<u8", len(order) if self.digested else 0, len(order))
        tails: list[NDArray[Any]] = []
        begin = len(order) + digests.nbytes
        for spec, count in zip(self.rows.fields, self.rows.tail_counts(counts), strict=True):
            width = int(np.prod(row_shape(spec), dtype=np.int64))
            tail = np.frombuffer(content, spec.dtype, count * width, begin).reshape(count, *row_shape(spec))
            tails.append(tail)
            begin += tail.nbytes
        stop, timing = number(head["stop"], self.stop + 1), timing_of(head["timing"])
        self._accept(stop, Growth(counts, order, digests, tails), timing, log_end)

    def _accept(self, stop: int, growth: Growth, timing: dict[str, float], log_end: int) -> None:
        self.rows.accept(growth)
        self.log_end = log_end
        self.commits.append(Commit(stop, self.rows.end, log_end, timing))


def work_folder(path: Path) -> Path:
    """Folder of a file's parts until it is sealed; raises ContourFileError for a path without a name."""
    if not path.name:  # "/", "."
        raise name_nothing(ContourFileError(f"{path} is a folder, not a contour file"))
    return fitting_name(path, ".partial")


def part_logs(folder: Path) -> list[Path]:
    """Logs of a folder in pose order; nothing is opened. Raises OSError where it cannot be listed."""
    return sorted(path for path in folder.iterdir() if _PATTERN.fullmatch(path.name))


def begin_part(folder: Path, first: int, recipe: str, begin: int, *, optional: tuple[str, ...]) -> FilePart:
    """A part without poses, on the disk, whose rows begin at `begin` bytes; raises OSError."""
    log = folder / f"{_stem(first)}{LOG_SUFFIX}"
    head = {
        "recipe": recipe,
        "first": first,
        "begin": begin,
        "optional": list(optional),
        "chunk_rows": CHUNK_ROWS,
        "digests": _DIGESTS,
    }
    begun = record(head)
    part = FilePart(log, first, recipe, Rows(row_fields(optional), begin), len(begun), len(begun))
    append_at(part.path, begin, [], fresh=True)
    write_file(log, memoryview(begun))  # its folder's fsync keeps both names
    return part


def read_part(log: Path, *, limit: int | None = None) -> FilePart:
    """A part as described by its log, up to its last whole record (or the one that ends at `limit`).

    Raises ContourFileError where not even its first record can be read, or its rows are gone.
    """
    part: FilePart | None = None
    problem: str | None = None
    try:
        with open_regular(log, ANY_SIZE) as stream:
            for head, rest, end in records(stream, limit):
                if part is None:
                    part = _new_part(log, head, end)
                else:
                    part.accept(head, rest, end)
    except OSError as error:
        raise ContourFileError(f"{log} cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError):  # what a record of something else raises
        problem = "is truncated or damaged"
    if part is None:
        raise ContourFileError(f"{log} is truncated or damaged")
    if not part.path.is_file():
        raise ContourFileError(f"{log} has lost its rows")
    part.problem = problem
    return part


def readable_parts(folder: Path) -> tuple[list[FilePart], list[str]]:
    """Parts of a folder that can be read and hold poses, in pose order and without those that overlap one before.

    And a sentence for each that is damaged, as far as logs show.
    """
    parts: list[FilePart] = []
    problems: list[str] = []
    for log in part_logs(folder):
        try:
            part = read_part(log)
        except ContourFileError as error:
            problems.append(str(error))
            continue
        if part.problem:
            problems.append(f"{log} {part.problem} after pose {part.stop}")
        if part.stop > part.first >= (parts[-1].stop if parts else 0):
            parts.append(part)
    return parts, problems


def verify_part(part: FilePart) -> FilePart:
    """The part up to the range of poses before the first damaged chunk; `problem` describes the damage, if any."""
    damaged = _first_damaged(part)
    if damaged is None:
        return part
    kept = [commit.log_end for commit in part.commits if commit.rows_end <= damaged]
    cut = read_part(part.log, limit=kept[-1] if kept else part.begun_end)
    cut.problem = "is truncated or damaged"
    return cut


def _first_damaged(part: FilePart) -> int | None:
    """Address of the first chunk that is not what was written; None if all are."""
    chunks = sorted(
        (address, index, number)
        for index, addresses in enumerate(part.rows.addresses)
        for number, address in enumerate(addresses)
    )
    if not chunks:
        return None
    try:
        with open_regular(part.path, ANY_SIZE) as stream:
            for address, index, number in chunks:
                spec = part.rows.fields[index]
                stream.seek(address)
                if decode_chunk(spec, stream.read(chunk_bytes(spec)), part.rows.digest(index, number)) is None:
                    return address
    except OSError:
        return chunks[0][0]
    return None


def _new_part(log: Path, head: Mapping[str, Any], end: int) -> FilePart:
    if head["chunk_rows"] != CHUNK_ROWS:
        raise ValueError(f"chunks of {head['chunk_rows']} rows")
    rows = Rows(row_fields([str(name) for name in head["optional"]]), number(head["begin"]))
    if head.get("digests", _DIGESTS) != _DIGESTS:
        raise ValueError(f"digests by {head['digests']}")
    first = number(head["first"])
    if log.stem != _stem(first):
        raise ValueError(f"first pose {first}")
    return FilePart(log, first, str(head["recipe"]), rows, end, end, digested="digests" in head)


def _stem(first: int) -> str:
    return f"poses-{first:012d}"
