"""HDF5 files put together past libhdf5's writing: it makes the metadata, in memory; chunks go to the disk as they are.

| where       | what                                                                                   |
|-------------|----------------------------------------------------------------------------------------|
| 0 to room   | superblock, groups, attributes, headers of datasets, roots of their indices            |
| room to end | chunks that are there already (`Rows`), none in a new file                             |
| behind      | other chunks, the last of a dataset filled up; nodes of indices                        |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..storage.chunk_index import ChunkTable, index_nodes, with_end
from ..storage.digests import ATTRIBUTE, Digests, block_digests, digests_text
from ..storage.durable import Buffer, append_at
from ..storage.hdf5_image import FILL, Hdf5Image
from ..storage.hdf5_opening import Attribute
from ..storage.schema import CHUNK_ROWS, DIGESTS, Field
from .rows import CHECKSUM_BYTES, Rows, encode_chunks

_SUPERBLOCK_BYTES = 48


class Assembly:
    """An HDF5 file to be written: attributes by group, datasets by field."""

    def __init__(self, end: int) -> None:
        self._end = end
        self._behind: list[Buffer] = []
        self._shapes: dict[Field, tuple[int, ...]] = {}
        self._addresses: dict[Field, list[int]] = {}
        self._digests: dict[Field, Digests] = {}
        self._attributes: dict[str, dict[str, Attribute]] = {}

    def attributes(self, name: str, values: dict[str, Attribute]) -> None:
        """Give a group attributes."""
        self._attributes.setdefault(name, {}).update(values)

    def add(self, spec: Field, array: NDArray[Any]) -> None:
        """Give the file a dataset with content."""
        self._add(spec, array.shape, [], array, np.zeros(0, np.uint64))

    def add_written(self, spec: Field, array: NDArray[Any], address: int) -> int:
        """Give the file a dataset whose chunks are in it already, from an address on; where they end."""
        chunk_rows = min(CHUNK_ROWS, array.shape[0])
        count = -(-array.shape[0] // chunk_rows) if array.size else 0
        size = chunk_rows * math.prod(array.shape[1:]) * spec.dtype.itemsize + CHECKSUM_BYTES
        self._shapes[spec] = array.shape
        self._addresses[spec] = list(range(address, address + count * size, size))
        self._digests[spec] = block_digests(array, CHUNK_ROWS)
        return address + count * size

    def add_rows(self, rows: Rows, digests: Sequence[Digests]) -> None:
        """Give the file the datasets of rows, whose whole chunks are in it already and have these content digests."""
        for index, spec in enumerate(rows.fields):
            tail = rows.tail(index)
            shape = (rows.counts[index], *tail.shape[1:])
            self._add(spec, shape, list(rows.addresses[index]), tail, digests[index])

    def front(self, room: int) -> tuple[bytearray, list[Buffer]] | None:
        """Bytes before the rows, padded to `room`, and bytes after the rows; None if `room` is too small.

        Once only: it completes the assembly by the digests.
        """
        content = self._metadata()
        if len(content) > room:
            return None
        content[:_SUPERBLOCK_BYTES] = with_end(bytes(content[:_SUPERBLOCK_BYTES]), self._end)
        content.extend(bytes(room - len(content)))
        return content, self._behind

    def metadata_size(self) -> int:
        """Bytes of room that `front` needs. Once only, instead of it."""
        return len(self._metadata())

    def _metadata(self) -> bytearray:
        self._add_digests()
        roots: dict[Field, bytes] = {}
        for spec, addresses in self._addresses.items():
            if addresses:
                roots[spec], below = index_nodes(self._table(spec), self._end)
                self._put_behind(below)
        with Hdf5Image() as image:
            for spec, shape in self._shapes.items():
                (image.reserve_index if spec in roots else image.reserve)(spec, shape)
            for name, values in self._attributes.items():
                image.attributes(name, values)
            content = bytearray(image.image())
            for spec, root in roots.items():
                at = image.index_root(spec, content)
                content[at : at + len(root)] = root
        return content

    def _add_digests(self) -> None:
        datasets = {spec.path: (shape, self._digests[spec]) for spec, shape in self._shapes.items()}
        text = digests_text(datasets, self._attributes, CHUNK_ROWS)
        self.add(DIGESTS, np.concatenate([np.zeros(0, np.uint64), *self._digests.values()]))
        self.attributes("/", {ATTRIBUTE: text})

    def _add(
        self, spec: Field, shape: tuple[int, ...], addresses: list[int], rest: NDArray[Any], digests: Digests
    ) -> None:
        """rest: rows behind those whose chunks have addresses and digests."""
        self._shapes[spec], self._addresses[spec] = shape, addresses
        self._digests[spec] = np.concatenate([digests, block_digests(rest, CHUNK_ROWS)])
        chunk_rows = min(CHUNK_ROWS, shape[0])
        whole = len(rest) // chunk_rows * chunk_rows if rest.size else 0
        for rows in (rest[:whole], _pad_chunk(rest[whole:], chunk_rows)):
            for part in encode_chunks(spec, rows, chunk_rows):
                addresses.append(self._end)
                self._put_behind(part)

    def _put_behind(self, buffers: Sequence[Buffer]) -> None:
        self._behind += buffers
        self._end += sum(map(len, buffers))

    def _table(self, spec: Field) -> ChunkTable:
        shape, addresses = self._shapes[spec], self._addresses[spec]
        chunk_shape = (min(CHUNK_ROWS, shape[0]), *shape[1:])
        size = math.prod(chunk_shape) * spec.dtype.itemsize + CHECKSUM_BYTES
        return ChunkTable(addresses, [size] * len(addresses), chunk_shape, spec.dtype.itemsize)


def write_assembly(path: Path, assembly: Assembly, end: int, room: int, *, fresh: bool = False) -> bool:
    """Write what an assembly adds to the first `end` bytes of a file; when this returns, it is on the disk.

    fresh: see `append_at`. Returns False, and writes nothing, where the metadata do not fit the room.

    Raises OSError where the disk is full or fails: what lies between the room and `end` is as it was.
    """
    made = assembly.front(room)
    if made is None:
        return False
    front, behind = made
    append_at(path, end, behind, front=front, fresh=fresh)
    return True


def _pad_chunk(rows: NDArray[Any], chunk_rows: int) -> NDArray[Any]:
    """The rows of a last chunk, with as many others as it lacks."""
    if len(rows) in (0, chunk_rows):
        return rows
    filled = np.full((chunk_rows, *rows.shape[1:]), FILL[rows.dtype.kind], rows.dtype)
    filled[: len(rows)] = rows
    return filled
