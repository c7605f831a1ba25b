"""Rows of a contour file while it grows: HDF5 chunks back to back, each written once, in an order that poses decide.

A chunk is whole once `CHUNK_ROWS` rows of its dataset are there. Chunks lie in the order of the poses that made them
whole, then of the fields; so the bytes do not depend on how many poses came at a time. Rows beyond the last whole chunk
are the tail.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..storage.checksum import fletcher32
from ..storage.digests import content_digest, growing_digests
from ..storage.durable import Buffer
from ..storage.schema import CHUNK_ROWS, CONTOURS, METRICS, Field

CHECKSUM_BYTES = 4


def row_fields(optional: Collection[str] = ()) -> tuple[Field, ...]:
    """The fields that grow with the poses, of the optional ones those named."""
    return tuple(spec for spec in (*CONTOURS, *METRICS) if not spec.optional or spec.name in optional)


def optional_fields(names: Iterable[str]) -> tuple[str, ...]:
    """The names that are optional fields, in the order of the tables."""
    names = set(names)
    return tuple(spec.name for spec in (*CONTOURS, *METRICS) if spec.optional and spec.name in names)


@dataclass(frozen=True)
class Growth:
    """Rows that further poses add."""

    counts: list[int]
    """Rows of each field that there are with them."""
    order: NDArray[np.uint8]
    """The field of each chunk that became whole."""
    digests: NDArray[np.uint64]
    """XXH3-64 of it as it lies in the file, checksum included; empty where an older palpate wrote it."""
    tails: list[NDArray[Any]]
    """Rows of each field that came with them and are in no whole chunk."""


@dataclass
class Rows:
    """Location of the rows of consecutive poses: full chunks in a file, later rows (tails) in memory."""

    fields: tuple[Field, ...]
    end: int
    """Where the next chunk goes [byte]."""
    counts: list[int] = field(default_factory=list[int])
    """Rows of each field."""
    addresses: list[array[int]] = field(default_factory=list["array[int]"])
    """Of each whole chunk of each field [byte]."""
    digests: list[array[int]] = field(default_factory=list["array[int]"])
    """The same of their digests; empty where an older palpate wrote them."""
    tails: list[list[NDArray[Any]]] = field(default_factory=list[list[NDArray[Any]]])
    """Of each field, in pieces."""

    def __post_init__(self) -> None:
        for _ in self.fields:
            self.counts.append(0)
            self.addresses.append(array("q"))
            self.digests.append(array("Q"))
            self.tails.append([])

    def count(self, dim: str) -> int:
        """Number of poses, polylines or points."""
        names = [str(spec.dims[0]) for spec in self.fields]
        return self.counts[names.index(dim)]

    def grown(
        self, contours: Mapping[str, NDArray[Any]], metrics: Mapping[str, NDArray[Any]]
    ) -> tuple[Growth, list[Buffer]]:
        """Rows that poses add after the existing ones, and the bytes of the chunks that they fill, in order.

        Nothing changes before `accept`. Chunks are views of the arrays where they can be.
        """
        columns = [self._column(spec, contours, metrics) for spec in self.fields]
        counts = [count + len(rows) for count, rows in zip(self.counts, columns, strict=True)]
        whole = self._made_whole(counts, contours)
        content = [self._chunks(index, counts, rows) for index, rows in enumerate(columns)]
        taken = [self.counts[index] // CHUNK_ROWS for index in range(len(columns))]
        parts = [content[index][chunk - taken[index]] for index, chunk in whole]
        digests = np.array([content_digest(*part) for part in parts], np.uint64)
        buffers: list[Buffer] = [buffer for part in parts for buffer in part]
        order = np.array([index for index, _ in whole], np.uint8)
        tails = [rows[begin:] for rows, begin in zip(columns, self._tail_begins(counts), strict=True)]
        return Growth(counts, order, digests, tails), buffers

    def accept(self, growth: Growth) -> None:
        """Take over what was added: its chunks lie behind the others by now."""
        sizes = np.array([chunk_bytes(spec) for spec in self.fields], np.int64)[growth.order]
        addresses = self.end + np.cumsum(sizes) - sizes
        self.end += int(sizes.sum())
        for index, tail in enumerate(growth.tails):
            own = growth.order == index
            if own.any():
                self.addresses[index].frombytes(addresses[own].tobytes())
                if len(growth.digests):
                    self.digests[index].frombytes(growth.digests[own].tobytes())
                self.tails[index].clear()
            if len(tail):
                self.tails[index].append(np.array(tail))  # of its own: a view would keep all rows alive
        self.counts = list(growth.counts)

    def digest(self, index: int, chunk: int) -> int | None:
        """XXH3-64 of a whole chunk of a field; None where an older palpate wrote it."""
        return self.digests[index][chunk] if self.digests[index] else None

    def tail(self, index: int) -> NDArray[Any]:
        """Rows of a field beyond its last whole chunk."""
        pieces = self.tails[index]
        if len(pieces) != 1:
            spec = self.fields[index]
            self.tails[index] = [np.concatenate([np.zeros((0, *row_shape(spec)), spec.dtype), *pieces])]
        return self.tails[index][0]

    def tail_counts(self, counts: Sequence[int]) -> list[int]:
        """Number of rows outside full chunks after growing to `counts`, by field."""
        begins = self._tail_begins(counts)
        return [count - old - begin for count, old, begin in zip(counts, self.counts, begins, strict=True)]

    def _tail_begins(self, counts: Sequence[int]) -> list[int]:
        """Index of the first new row in the tail, by field."""
        return [max(count // CHUNK_ROWS * CHUNK_ROWS - old, 0) for count, old in zip(counts, self.counts, strict=True)]

    def _column(
        self, spec: Field, contours: Mapping[str, NDArray[Any]], metrics: Mapping[str, NDArray[Any]]
    ) -> NDArray[Any]:
        """New rows of a field; offsets go on where those that there are end."""
        arrays = contours if spec.group == "contours" else metrics
        if spec.name not in arrays:
            count = len(contours["points"]) if spec.group == "contours" else len(contours["pose_start"]) - 1
            return np.full(count, spec.absent, spec.dtype)
        rows = arrays[spec.name]
        if spec.is_offset:
            started = self.count(str(spec.dims[0])) > 0
            rows = rows[int(started) :] + self.count("polyline" if spec.name == "pose_start" else "point")
        return np.ascontiguousarray(rows, spec.dtype)

    def _made_whole(self, counts: Sequence[int], contours: Mapping[str, NDArray[Any]]) -> list[tuple[int, int]]:
        """Field and number of each chunk that becomes whole, in the order of the file."""
        fields: list[NDArray[np.int64]] = []
        chunks: list[NDArray[np.int64]] = []
        poses: list[NDArray[np.int64]] = []
        for index, (spec, old, count) in enumerate(zip(self.fields, self.counts, counts, strict=True)):
            new = np.arange(old // CHUNK_ROWS, count // CHUNK_ROWS, dtype=np.int64)
            last = (new + 1) * CHUNK_ROWS - 1 - old
            fields.append(np.full(len(new), index))
            chunks.append(new)
            poses.append(_pose_of(spec, last, contours, started=old > 0))
        field_of, chunk_of = np.concatenate(fields), np.concatenate(chunks)
        order = np.lexsort((chunk_of, field_of, np.concatenate(poses)))
        return [(int(field_of[k]), int(chunk_of[k])) for k in order]

    def _chunks(self, index: int, counts: Sequence[int], new: NDArray[Any]) -> list[tuple[memoryview, bytes]]:
        """Contents and checksums of the chunks of a field that become whole."""
        spec, old, count = self.fields[index], self.counts[index], counts[index] // CHUNK_ROWS * CHUNK_ROWS
        if count <= old // CHUNK_ROWS * CHUNK_ROWS:
            return []
        begun = old % CHUNK_ROWS
        first = [] if begun == 0 else [np.concatenate([self.tail(index), new[: CHUNK_ROWS - begun]])]
        rest = new[CHUNK_ROWS - begun if begun else 0 : count - old]
        return [part for rows in (*first, rest) for part in encode_chunks(spec, rows, CHUNK_ROWS)]


def _pose_of(
    spec: Field, rows: NDArray[np.int64], contours: Mapping[str, NDArray[Any]], *, started: bool
) -> NDArray[np.int64]:
    """The new pose that each new row belongs to. An offset counts with the row that ends there."""
    dim = str(spec.dims[0]).removesuffix(" + 1")
    if spec.is_offset and not started:
        rows = np.maximum(rows - 1, 0)
    if dim == "point":
        rows = np.searchsorted(contours["polyline_start"], rows, side="right") - 1
    if dim in ("point", "polyline"):
        rows = np.searchsorted(contours["pose_start"], rows, side="right") - 1
    return rows.astype(np.int64)


def row_shape(spec: Field) -> tuple[int, ...]:
    """Shape of one row."""
    return tuple(size for size in spec.dims[1:] if isinstance(size, int))


def encode_chunks(spec: Field, rows: NDArray[Any], chunk_rows: int) -> list[tuple[memoryview, bytes]]:
    """Chunks as HDF5's filter leaves them: rows, which stay where they are, and checksum. rows: of whole chunks."""
    if rows.size == 0:
        return []
    contents = np.ascontiguousarray(rows, spec.dtype).reshape(len(rows) // chunk_rows, -1).view(np.uint8)
    return list(zip((content.data for content in contents), _checksums(contents), strict=True))


def _checksums(contents: NDArray[np.uint8]) -> list[bytes]:
    return [checksum.tobytes() for checksum in fletcher32(contents).astype("<u4")]


def decode_chunk(spec: Field, content: bytes, digest: int | None) -> NDArray[Any] | None:
    """Rows of a chunk of `CHUNK_ROWS`; None if it is not what was written.

    digest: XXH3-64 of the chunk; None where an older palpate wrote it, then its checksum decides.
    """
    chunk = np.frombuffer(content, np.uint8)
    if len(chunk) != chunk_bytes(spec):
        return None
    if digest is None:
        whole = _checksums(chunk[None, :-CHECKSUM_BYTES])[0] == content[-CHECKSUM_BYTES:]
    else:
        whole = content_digest(content) == digest
    return chunk[:-CHECKSUM_BYTES].view(spec.dtype).reshape(-1, *row_shape(spec)) if whole else None


def proven_digest(content: memoryview, spec: Field, digest: int | None) -> int | None:
    """XXH3-64 of the rows of a chunk of `CHUNK_ROWS`; None if it is not what was written (`decode_chunk`)."""
    if digest is None:
        rows = decode_chunk(spec, bytes(content), None)
        return None if rows is None else content_digest(rows.data)
    if len(content) != chunk_bytes(spec):
        return None
    of_rows, of_all = growing_digests(content[:-CHECKSUM_BYTES], content[-CHECKSUM_BYTES:])
    return of_rows if of_all == digest else None


def chunk_bytes(spec: Field) -> int:
    """Size of a whole chunk, checksum included [byte]."""
    return CHUNK_ROWS * spec.dtype.itemsize * int(np.prod(row_shape(spec), dtype=np.int64)) + CHECKSUM_BYTES
