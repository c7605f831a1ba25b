"""HDF5 files put together past libhdf5's writing: it makes the metadata, in memory; chunks go to the disk as they are.

| where       | what                                                                                   |
|-------------|----------------------------------------------------------------------------------------|
| 0 to room   | superblock, groups, attributes, headers of datasets, roots of their indices            |
| room to end | chunks that are there already (`Rows`), none in a new file                             |
| behind      | other chunks, the last of a dataset filled up; nodes of indices                        |
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .durable import Buffer, append_at
from .errors import ContourFileError
from .hdf5 import FILL, Attribute, Hdf5Image
from .index import ChunkTable, index_nodes, with_end
from .rows import CHECKSUM_BYTES, Rows, encoded
from .schema import CHUNK_ROWS, Field

ROOM = 1 << 17
"""Bytes kept free before chunks; the metadata of a contour file take up to 90 kB and its JSON."""
_SUPERBLOCK_BYTES = 48


class Assembly:
    """An HDF5 file to be written: attributes by group, datasets by field."""

    def __init__(self, end: int) -> None:
        self._end = end
        self._behind: list[Buffer] = []
        self._shapes: dict[Field, tuple[int, ...]] = {}
        self._gzip: dict[Field, int] = {}
        self._addresses: dict[Field, list[int]] = {}
        self._sizes: dict[Field, list[int]] = {}
        self._attributes: dict[str, dict[str, Attribute]] = {}

    def attributes(self, name: str, values: dict[str, Attribute]) -> None:
        """Give a group attributes."""
        self._attributes.setdefault(name, {}).update(values)

    def add(self, spec: Field, array: NDArray[Any]) -> None:
        """Give the file a dataset with content."""
        self._add(spec, array.shape, [], [], array, gzip=0)

    def add_written(self, spec: Field, shape: tuple[int, ...], address: int) -> int:
        """Give the file a dataset whose chunks are in it already, from an address on; where they end."""
        chunk_rows = min(CHUNK_ROWS, shape[0])
        count = -(-shape[0] // chunk_rows) if 0 not in shape else 0
        size = chunk_rows * math.prod(shape[1:]) * spec.dtype.itemsize + CHECKSUM_BYTES
        self._shapes[spec], self._gzip[spec] = shape, 0
        self._addresses[spec] = list(range(address, address + count * size, size))
        self._sizes[spec] = [size] * count
        return address + count * size

    def add_rows(self, rows: Rows) -> None:
        """Give the file the datasets of rows, whose whole chunks are in it already."""
        for index, spec in enumerate(rows.fields):
            tail = rows.tail(index)
            shape = (rows.counts[index], *tail.shape[1:])
            self._add(spec, shape, list(rows.addresses[index]), list(rows.sizes[index]), tail, gzip=rows.gzip)

    def front(self, room: int) -> tuple[bytearray, list[Buffer]]:
        """What goes before the rows, filled up to `room` bytes, and what goes behind them."""
        roots: dict[Field, bytes] = {}
        for spec, addresses in self._addresses.items():
            if addresses:
                roots[spec], below = index_nodes(self._table(spec), self._end)
                self._put_behind(below)
        with Hdf5Image() as image:
            for spec, shape in self._shapes.items():
                (image.reserve_index if spec in roots else image.reserve)(spec, shape, gzip=self._gzip[spec])
            for name, values in self._attributes.items():
                image.attributes(name, values)
            content = bytearray(image.image())
            for spec, root in roots.items():
                at = image.index_root(spec, content)
                content[at : at + len(root)] = root
        if len(content) > room:
            raise ContourFileError(f"the file's metadata take {len(content)} bytes, more than the {room} kept for them")
        content[:_SUPERBLOCK_BYTES] = with_end(bytes(content[:_SUPERBLOCK_BYTES]), self._end)
        content.extend(bytes(room - len(content)))
        return content, self._behind

    def _add(
        self,
        spec: Field,
        shape: tuple[int, ...],
        addresses: list[int],
        sizes: list[int],
        rest: NDArray[Any],
        *,
        gzip: int,
    ) -> None:
        self._shapes[spec], self._gzip[spec] = shape, gzip
        self._addresses[spec], self._sizes[spec] = addresses, sizes
        chunk_rows = min(CHUNK_ROWS, shape[0])
        whole = len(rest) // chunk_rows * chunk_rows if rest.size else 0
        for rows in (rest[:whole], _filled(rest[whole:], chunk_rows)):
            for part in encoded(spec, rows, chunk_rows, gzip):
                addresses.append(self._end)
                sizes.append(sum(map(len, part)))
                self._put_behind(part)

    def _put_behind(self, buffers: list[bytes] | tuple[Buffer, ...]) -> None:
        self._behind += buffers
        self._end += sum(map(len, buffers))

    def _table(self, spec: Field) -> ChunkTable:
        shape = self._shapes[spec]
        chunk_shape = (min(CHUNK_ROWS, shape[0]), *shape[1:])
        return ChunkTable(self._addresses[spec], self._sizes[spec], chunk_shape, spec.dtype.itemsize)


def write_assembly(path: Path, assembly: Assembly, end: int, room: int, *, fresh: bool = False) -> None:
    """Write what an assembly adds to the first `end` bytes of a file; when this returns, it is on the disk.

    fresh: see `append_at`.

    Raises OSError where the disk is full or fails: what lies between the room and `end` is as it was.
    """
    front, behind = assembly.front(room)
    append_at(path, end, behind, front=front, fresh=fresh)


def _filled(rows: NDArray[Any], chunk_rows: int) -> NDArray[Any]:
    """The rows of a last chunk, with as many others as it lacks."""
    if len(rows) in (0, chunk_rows):
        return rows
    filled = np.full((chunk_rows, *rows.shape[1:]), FILL[rows.dtype.kind], rows.dtype)
    filled[: len(rows)] = rows
    return filled
