"""Rows of a contour file while it grows: HDF5 chunks back to back, each written once, in an order that poses decide.

A chunk is whole once `CHUNK_ROWS` rows of its dataset are there. Chunks lie in the order of the poses that made them
whole, then of the fields; so the bytes do not depend on how many poses came at a time. Rows beyond the last whole chunk
are the tail.
"""

from __future__ import annotations

import zlib
from array import array
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .checksum import fletcher32
from .durable import Buffer
from .schema import CHUNK_ROWS, CONTOURS, METRICS, Field

CHECKSUM_BYTES = 4


def row_fields(optional: Collection[str] = ()) -> tuple[Field, ...]:
    """The fields that grow with the poses, of the optional ones those named."""
    return tuple(spec for spec in (*CONTOURS, *METRICS) if not spec.optional or spec.name in optional)


def optional_fields(names: Iterable[str]) -> tuple[str, ...]:
    """Which of the names are optional fields, in the order of the tables."""
    names = set(names)
    return tuple(spec.name for spec in (*CONTOURS, *METRICS) if spec.optional and spec.name in names)


@dataclass(frozen=True)
class Growth:
    """What some more poses add."""

    counts: list[int]
    """Rows of each field that there are with them."""
    order: NDArray[np.uint8]
    """The field of each chunk that became whole."""
    sizes: NDArray[np.int64]
    """Its size, checksum included [byte]."""
    tails: list[NDArray[Any]]
    """Rows of each field that came with them and are in no whole chunk."""


@dataclass
class Rows:
    """Where the rows of consecutive poses lie: whole chunks in a file, tails here; offsets as if they were all."""

    fields: tuple[Field, ...]
    end: int
    """Where the next chunk goes [byte]."""
    gzip: int = 0
    counts: list[int] = field(default_factory=list[int])
    """Rows of each field."""
    addresses: list[array[int]] = field(default_factory=list["array[int]"])
    """Of each whole chunk of each field [byte]."""
    sizes: list[array[int]] = field(default_factory=list["array[int]"])
    """The same of their sizes, checksums included [byte]."""
    tails: list[list[NDArray[Any]]] = field(default_factory=list[list[NDArray[Any]]])
    """Of each field, in pieces."""

    def __post_init__(self) -> None:
        for _ in self.fields:
            self.counts.append(0)
            self.addresses.append(array("q"))
            self.sizes.append(array("q"))
            self.tails.append([])

    def count(self, dim: str) -> int:
        """Number of poses, polylines or points."""
        names = [str(spec.dims[0]) for spec in self.fields]
        return self.counts[names.index(dim)]

    def grown(
        self, contours: Mapping[str, NDArray[Any]], metrics: Mapping[str, NDArray[Any]]
    ) -> tuple[Growth, list[Buffer]]:
        """What poses add behind those that there are, and the bytes of the chunks that they make whole, in order.

        Nothing changes before `accept`. Chunks are views of the arrays where they can be.
        """
        columns = [self._column(spec, contours, metrics) for spec in self.fields]
        counts = [count + len(rows) for count, rows in zip(self.counts, columns, strict=True)]
        whole = self._made_whole(counts, contours)
        content = [self._chunks(index, counts, rows) for index, rows in enumerate(columns)]
        taken = [self.counts[index] // CHUNK_ROWS for index in range(len(columns))]
        parts = [content[index][chunk - taken[index]] for index, chunk in whole]
        sizes = [len(rows) + len(checksum) for rows, checksum in parts]
        buffers: list[Buffer] = [buffer for part in parts for buffer in part]
        order = np.array([index for index, _ in whole], np.uint8)
        tails = [rows[begin:] for rows, begin in zip(columns, self._tail_begins(counts), strict=True)]
        return Growth(counts, order, np.array(sizes, np.int64), tails), buffers

    def accept(self, growth: Growth) -> None:
        """Take over what was added: its chunks lie behind the others by now."""
        addresses = self.end + np.cumsum(growth.sizes) - growth.sizes
        self.end += int(growth.sizes.sum())
        for index, tail in enumerate(growth.tails):
            own = growth.order == index
            if own.any():
                self.addresses[index].frombytes(addresses[own].tobytes())
                self.sizes[index].frombytes(growth.sizes[own].tobytes())
                self.tails[index].clear()
            if len(tail):
                self.tails[index].append(np.array(tail))  # of its own: a view would keep all rows alive
        self.counts = list(growth.counts)

    def tail(self, index: int) -> NDArray[Any]:
        """Rows of a field beyond its last whole chunk."""
        pieces = self.tails[index]
        if len(pieces) != 1:
            spec = self.fields[index]
            self.tails[index] = [np.concatenate([np.zeros((0, *row_shape(spec)), spec.dtype), *pieces])]
        return self.tails[index][0]

    def tail_counts(self, counts: Sequence[int]) -> list[int]:
        """How many rows of a growth to `counts` are in no whole chunk, by field."""
        begins = self._tail_begins(counts)
        return [count - old - begin for count, old, begin in zip(counts, self.counts, begins, strict=True)]

    def _tail_begins(self, counts: Sequence[int]) -> list[int]:
        """Which of the rows that are new begin the tail, by field."""
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

    def _chunks(self, index: int, counts: Sequence[int], new: NDArray[Any]) -> list[tuple[Buffer, Buffer]]:
        """Contents and checksums of the chunks of a field that become whole."""
        spec, old, count = self.fields[index], self.counts[index], counts[index] // CHUNK_ROWS * CHUNK_ROWS
        if count <= old // CHUNK_ROWS * CHUNK_ROWS:
            return []
        begun = old % CHUNK_ROWS
        first = [] if begun == 0 else [np.concatenate([self.tail(index), new[: CHUNK_ROWS - begun]])]
        rest = new[CHUNK_ROWS - begun if begun else 0 : count - old]
        return [part for rows in (*first, rest) for part in encoded(spec, rows, CHUNK_ROWS, self.gzip)]


def _pose_of(
    spec: Field, rows: NDArray[np.int64], contours: Mapping[str, NDArray[Any]], *, started: bool
) -> NDArray[np.int64]:
    """Which of the new poses brings a new row. An offset is known with the row that ends there."""
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


def encoded(spec: Field, rows: NDArray[Any], chunk_rows: int, gzip: int) -> list[tuple[Buffer, Buffer]]:
    """Chunks as HDF5's filters leave them, rows and checksum: shuffled and deflated if asked for, then summed.

    rows: of whole chunks; what is not deflated stays where it is.
    """
    if rows.size == 0:
        return []
    contents = np.ascontiguousarray(rows, spec.dtype).reshape(len(rows) // chunk_rows, -1).view(np.uint8)
    if not gzip:
        return list(zip((content.data for content in contents), _checksums(contents), strict=True))
    shuffled = [np.ascontiguousarray(content.reshape(-1, spec.dtype.itemsize).T) for content in contents]
    deflated = [zlib.compress(content.data, gzip) for content in shuffled]
    return [(content, _checksums(np.frombuffer(content, np.uint8)[None])[0]) for content in deflated]


def _checksums(contents: NDArray[np.uint8]) -> list[bytes]:
    return [checksum.tobytes() for checksum in fletcher32(contents).astype("<u4")]


def decoded(spec: Field, content: bytes) -> NDArray[Any] | None:
    """Rows of an uncompressed chunk of `CHUNK_ROWS`; None if its checksum does not match."""
    rows = np.frombuffer(content, np.uint8)
    size = chunk_bytes(spec)
    if len(rows) != size or _checksums(rows[None, :-CHECKSUM_BYTES])[0] != content[-CHECKSUM_BYTES:]:
        return None
    return rows[:-CHECKSUM_BYTES].view(spec.dtype).reshape(-1, *row_shape(spec))


def chunk_bytes(spec: Field) -> int:
    """Size of a whole chunk that is not compressed, checksum included."""
    return CHUNK_ROWS * spec.dtype.itemsize * int(np.prod(row_shape(spec), dtype=np.int64)) + CHECKSUM_BYTES
