"""A table longer than memory, written block by block: chunks go to the disk as they are, HDF5 makes the metadata alone.

Bytes from 0 to `room` are kept for the metadata; chunks follow in the order in which they became whole; behind them the
last ones, filled up, and nodes of indices. HDF5 makes the metadata in memory, so it never meets a full disk.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..contour_file.rows import encode_chunks
from ..errors import SweepStoreError
from ..storage.chunk_index import ChunkTable, index_nodes, leaf_of_one, with_end
from ..storage.content_digest import file_trailer
from ..storage.durable import Buffer, append_at, discard, publish
from ..storage.hdf5_columns import BOOL, CHUNK_ROWS, Columns, Values, column_arrays, image_of, new_image, temporary_name
from ..storage.hdf5_image import FILL
from ..storage.schema import Field
from .table import FORMAT_VERSION, KIND, ROW, Attributes, described, proven

_SUPERBLOCK_BYTES = 48
_ROOM_STEP = 4096
_NO_COORDINATE = "This is a netCDF dimension but not a netCDF variable. {:10d}"
"""Marks a dimension that has a length and no values, for readers of netCDF-4."""


@dataclass
class _Growing:
    """A column while it grows."""

    dtype: np.dtype[Any]
    is_bool: bool
    unit: str
    tail: list[NDArray[Any]] = field(default_factory=list[NDArray[Any]])
    """Rows in no whole chunk."""
    tail_count: int = 0
    addresses: list[int] = field(default_factory=list[int])
    sizes: list[int] = field(default_factory=list[int])


class TableWriter:
    """Writes a table as HDF5 block by block; it has its name once it is whole, and replaces an earlier one then.

    Use as a context: an exception within leaves nothing behind. Columns are bool and numbers; `load_table` reads it, as
    do xarray and others; its dimension `row` has no values of its own.

    Raises:
        SweepStoreError: From every method; blocks differ in their columns, or the file cannot be written.
    """

    def __init__(self, path: str | Path, attributes: Attributes, *, units: Mapping[str, str] | None = None) -> None:
        self.path = Path(path)
        self.row_count = 0
        self._attributes = proven(described(attributes))
        self._units = dict(units or {})
        self._temporary = temporary_name(self.path)
        self._columns: dict[str, _Growing] | None = None
        self._room = 0
        self._end = 0
        self._written = 0
        self._write([], fresh=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self.close()
        finally:
            discard(self._temporary)  # if it has not got its name

    def append(self, block: Mapping[str, Values]) -> None:
        """Write rows behind those that there are; every block has the columns of the first, of the same dtypes."""
        arrays = column_arrays(block)
        if self._columns is None:
            self._columns = self._begun(arrays)
        self._refuse_other(arrays)
        buffers: list[Buffer] = []
        for name, column in self._columns.items():
            buffers += self._grown(column, name, arrays[name])
        self._write(buffers)
        self.row_count += len(next(iter(arrays.values()), ()))

    def close(self) -> None:
        """Make what was written an HDF5 file, have it on the disk, and give it its name."""
        columns = self._columns if self._columns is not None else self._begun({})
        buffers: list[Buffer] = []
        for name, column in columns.items():
            if column.tail_count:
                filled = np.full(min(self.row_count, CHUNK_ROWS), FILL[column.dtype.kind], column.dtype)
                filled[: column.tail_count] = np.concatenate(column.tail)
                buffers += self._placed(column, name, filled, len(filled))
        front, nodes = self._front(columns, self.row_count)
        if len(front) > self._room:
            raise SweepStoreError(
                f"{self.path}: metadata take {len(front)} bytes, more than {self._room} kept for them"
            )
        self._write([*buffers, *nodes], front=front, is_last=True)

    def _begun(self, arrays: Columns) -> dict[str, _Growing]:
        refused = [name for name, array in arrays.items() if array.dtype.kind == "O" or name == ROW]
        if refused:
            raise SweepStoreError(f"{self.path}: column {refused[0]} is text or has the dimension's name: numbers only")
        columns = {
            name: _Growing(
                np.dtype(np.int8) if array.dtype.kind == "b" else array.dtype.newbyteorder("<"),
                array.dtype.kind == "b",
                self._units.get(name, ""),
            )
            for name, array in arrays.items()
        }
        size = len(self._image(columns, CHUNK_ROWS + 1, with_index=True)[0])
        self._room = self._end = self._written = -(-size // _ROOM_STEP) * _ROOM_STEP + _ROOM_STEP
        self._write([], fresh=True)
        return columns

    def _refuse_other(self, arrays: Columns) -> None:
        columns = self._columns or {}
        kinds = {name: np.dtype(np.int8) if array.dtype.kind == "b" else array.dtype for name, array in arrays.items()}
        if kinds != {name: column.dtype for name, column in columns.items()}:
            raise SweepStoreError(
                f"{self.path}: rows from {self.row_count} on have columns {_shown(kinds)}; "
                f"the first have {_shown({name: column.dtype for name, column in columns.items()})}"
            )

    def _grown(self, column: _Growing, name: str, array: NDArray[Any]) -> list[Buffer]:
        """Chunks of a column that become whole."""
        rows = array.astype(column.dtype, copy=False)
        column.tail.append(rows)
        column.tail_count += len(rows)
        if column.tail_count < CHUNK_ROWS:
            column.tail[-1] = rows.copy()  # of its own: the caller may use the block again
            return []
        rows = np.concatenate(column.tail)
        whole = len(rows) // CHUNK_ROWS * CHUNK_ROWS
        column.tail, column.tail_count = [rows[whole:].copy()], len(rows) - whole
        return self._placed(column, name, rows[:whole], CHUNK_ROWS)

    def _placed(self, column: _Growing, name: str, rows: NDArray[Any], chunk_rows: int) -> list[Buffer]:
        """Whole chunks as they go behind all others."""
        buffers: list[Buffer] = []
        for part in encode_chunks(Field("", name, column.dtype, (ROW,)), rows, chunk_rows):
            column.addresses.append(self._end)
            column.sizes.append(sum(map(len, part)))
            self._end += column.sizes[-1]
            buffers += part
        return buffers

    def _front(self, columns: Mapping[str, _Growing], count: int) -> tuple[bytes, list[Buffer]]:
        """The metadata, indices' roots among them, and nodes below the roots, which go behind all chunks."""
        image, stubs = self._image(columns, count, with_index=count > 0)
        content = bytearray(image)
        nodes: list[Buffer] = []
        for name, address in stubs.items():
            column = columns[name]
            table = ChunkTable(column.addresses, column.sizes, (min(count, CHUNK_ROWS),), column.dtype.itemsize)
            root, below = index_nodes(table, self._end)
            at = content.index(leaf_of_one(1, address, 1))
            content[at : at + len(root)] = root
            nodes += below
            self._end += sum(map(len, below))
        content[:_SUPERBLOCK_BYTES] = with_end(bytes(content[:_SUPERBLOCK_BYTES]), max(self._end, self._room))
        return bytes(content), nodes

    def _image(
        self, columns: Mapping[str, _Growing], count: int, *, with_index: bool
    ) -> tuple[memoryview, dict[str, int]]:
        """HDF5's metadata of a table of so many rows; where the stub lies that stands for each column's first chunk."""
        stubs: dict[str, int] = {}
        with new_image() as file:
            for key, value in self._attributes.items():
                file.attrs[key] = value
            scale: Any = file.create_dataset(ROW, shape=(count,), dtype=">f4", track_times=False)
            scale.make_scale(_NO_COORDINATE.format(count))
            chunked: dict[str, Any] = {"chunks": (min(count, CHUNK_ROWS),), "fletcher32": True} if with_index else {}
            for name, column in columns.items():
                dataset: Any = file.create_dataset(
                    name,
                    shape=(count,),
                    dtype=column.dtype,
                    fillvalue=FILL[column.dtype.kind],
                    track_times=False,
                    **chunked,
                )
                if column.is_bool:
                    dataset.attrs["dtype"] = BOOL
                if column.unit:
                    dataset.attrs["units"] = column.unit
                dataset.dims[0].attach_scale(scale)
                if with_index:
                    dataset.id.write_direct_chunk((0,), b"\0")
                    stubs[name] = int(dataset.id.get_chunk_info(0).byte_offset)
            return image_of(file), stubs

    def _write(self, buffers: list[Buffer], *, front: bytes = b"", is_last: bool = False, fresh: bool = False) -> None:
        try:
            append_at(self._temporary, self._written, buffers, front=front, durable=False, fresh=fresh)
            self._written += sum(map(len, buffers))
            if is_last:
                trailer = file_trailer(KIND, FORMAT_VERSION, self._temporary)
                append_at(self._temporary, self._written, [trailer])
                publish(self._temporary, self.path)
        except OSError as error:
            raise SweepStoreError(f"{self.path} cannot be written: {error.strerror or error}") from error


def write_blocks(
    path: str | Path,
    blocks: Iterable[Mapping[str, Values]],
    attributes: Attributes,
    *,
    units: Mapping[str, str] | None = None,
) -> int:
    """Write a table as HDF5 from blocks of rows, one in memory at a time; the number of rows. See `TableWriter`."""
    with TableWriter(path, attributes, units=units) as writer:
        for block in blocks:
            writer.append(block)
    return writer.row_count


def _shown(dtypes: Mapping[str, np.dtype[Any]]) -> str:
    return ", ".join(f"{name} {dtype}" for name, dtype in dtypes.items()) or "none"
