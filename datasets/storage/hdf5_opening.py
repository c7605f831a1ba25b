"""Strict opening of HDF5 for reading: a file's complete structure is validated before any data is read.

    with open_hdf5(path) as opened:            # or open_hdf5(path, content) for bytes that are in memory already
        opened.datasets["/rows"].shape         # from the structure; reads no data
        opened.read("/rows", first, stop)      # checked first: the rows are in the file and fit into memory
        opened.attribute("/", "format")        # a plain value of bounded size

Refused content raises `Hdf5Error`; its message names the path inside the file, the value and the bound, but not the
file, which the caller prepends. Exceptions of h5py for damaged files (`hdf5.FAILURES`) pass through.

HDF5 reads the file through a handle and not by name. It therefore takes no lock and does not notice that the same
process may have the file open in h5py, for reading or writing. Opening a FIFO does not wait for its writer.
"""

from __future__ import annotations

import errno
import math
import os
import stat
from collections.abc import Collection
from os import PathLike
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import Hdf5Error
from .hdf5_chunks import require_chunks, require_room
from .hdf5_heap import collection_size, refuse_endless_heap
from .hdf5_structure import ATTRIBUTE_BYTES_MOST, OF_SCALES, Declared, h5py, walk

MEMORY_MOST = 1 << 30
"""Most memory of one read [byte], plus 8 times the file's size, as compressed data grow when read."""

Attribute = str | int | float | NDArray[Any]
"""Value of an attribute."""

_PIECE_MOST = 2 * ATTRIBUTE_BYTES_MOST  # most bytes of one read during the walk of the structure
_WALK_MOST = 1 << 26  # most bytes of the walk, plus 4 times the file's size: ends the walk of a cyclic structure
_VLEN = np.dtype([("length", "<u4"), ("place", "<u4", 3)])  # reference to a text of variable length, VLEN_BYTES


def open_hdf5(path: str | PathLike[str], content: bytes | None = None, *, unread: Collection[str] = ()) -> StrictFile:
    """Open a file and validate its structure.

    content: the file's bytes, if they are in memory already; `path` is not opened then.
    unread: paths of datasets that will not be read; they may declare rows that were never written.

    Raises:
        OSError: From the system: FileNotFoundError, IsADirectoryError, PermissionError.
        Hdf5Error: Not a regular file, an empty file, or a structure that is refused.
        Exception: From h5py for a foreign or damaged file (`hdf5.FAILURES`).
    """
    source = _MemorySource(content) if content is not None else _FileSource(path)
    try:
        return StrictFile(source, unread)
    except BaseException:
        source.close()
        raise


class StrictFile:
    """An open HDF5 file whose structure was validated; a context manager."""

    def __init__(self, source: _ByteSource, unread: Collection[str]) -> None:
        self._source, self._unread = source, frozenset(unread)
        if source.size == 0:
            raise Hdf5Error("the file is empty")
        source.left = _WALK_MOST + 4 * source.size
        self.file: Any = h5py.File(source, "r")
        """The `h5py.File`."""
        try:
            self.structure = walk(self.file.id, self._require_room)
            """All groups, datasets and attribute names of the file."""
        except BaseException:
            self.file.close()
            raise
        source.left = None
        self._opened: dict[str, Any] = {}

    def _require_room(self, dataset: Any, own: Declared) -> None:
        if own.path not in self._unread:
            require_room(dataset, own, self._source.size)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self._opened.clear()
        self.file.close()
        self._source.close()

    @property
    def datasets(self) -> dict[str, Declared]:
        """Declarations (dtype, shape, filters, ...) of the datasets, by path."""
        return self.structure.datasets

    def state(self) -> tuple[int, int]:
        """Size [byte] and modification time [ns] of the opened file."""
        return self._source.state()

    def declared(self, path: str) -> Declared:
        """Declaration of a dataset; raises Hdf5Error if there is no such dataset."""
        if path not in self.datasets or path in self._unread:
            raise Hdf5Error(f"{path} is missing or not a dataset")
        return self.datasets[path]

    def dataset(self, path: str) -> Any:
        """The `h5py.Dataset` of a path; raises Hdf5Error if it does not exist or is not completely in the file."""
        if path not in self._opened:  # cached: opening a dataset takes longer than reading one pose from it
            own = self.declared(path)
            dataset: Any = self.file[path]
            require_chunks(dataset.id, own, self._source.size)
            self._opened[path] = dataset
        return self._opened[path]

    def read(self, path: str, first: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `first` to `stop` (default: all) of a dataset, in native byte order; texts as an object array of str.

        Raises Hdf5Error as `dataset`, for a scalar, and if the rows would take too much memory.
        """
        dataset, own = self.dataset(path), self.datasets[path]
        if not own.shape:
            raise Hdf5Error(f"{path} is one value, expected rows")
        if own.is_text:
            self._refuse_long_texts(dataset, own)
            return np.asarray(dataset.asstr()[first:stop], object)
        rows = len(range(*slice(first, stop).indices(own.shape[0])))
        size, most = rows * own.nbytes // max(own.shape[0], 1), MEMORY_MOST + 8 * self._source.size
        if size > most:
            raise Hdf5Error(f"{path} takes {size} bytes for {rows} rows, expected at most {most}")
        values: NDArray[Any] = np.asarray(dataset[first:stop])
        return values.astype(values.dtype.newbyteorder("="), copy=False)

    def attribute(self, path: str, key: str) -> Attribute | None:
        """An attribute of a group or dataset; None if it does not exist. Raises Hdf5Error for text that is not UTF-8
        and for attributes with which HDF5 marks dimension scales."""
        if key not in self.structure.attributes.get(path, ()):
            return None
        if key in OF_SCALES:
            raise Hdf5Error(f"attribute {key} of {path} is HDF5's own")
        stored: Any = self.file[path].attrs[key]
        value: Any = stored.item() if hasattr(stored, "item") and stored.ndim == 0 else stored
        try:
            if isinstance(value, bytes):
                value = value.decode()
            elif isinstance(value, str):
                value.encode()  # h5py decodes bytes that are not UTF-8 to lone surrogates, which cannot be printed
        except (UnicodeDecodeError, UnicodeEncodeError) as error:
            raise Hdf5Error(f"attribute {key} of {path} is not UTF-8: {error.reason} at {error.start}") from None
        return value

    def number(self, path: str, key: str) -> float | None:
        """A finite number from an attribute; None if it does not exist. Raises Hdf5Error for any other value."""
        value = self.attribute(path, key)
        if value is not None and not (isinstance(value, int | float) and math.isfinite(value)):
            raise Hdf5Error(f"attribute {key} of {path} is {_brief(value)}, expected a finite number")
        return None if value is None else float(value)

    def whole(self, path: str, key: str) -> int | None:
        """An integer from an attribute; None if it does not exist. Raises Hdf5Error for any other value."""
        value = self.attribute(path, key)
        if value is not None and not isinstance(value, int):
            raise Hdf5Error(f"attribute {key} of {path} is {_brief(value)}, expected a whole number")
        return value

    def require_all_stored(self) -> None:
        """Check the chunks of every dataset; raises Hdf5Error as `dataset`."""
        for path in self.datasets.keys() - self._unread:
            self.dataset(path)

    def _refuse_long_texts(self, dataset: Any, own: Declared) -> None:
        """Refuse texts longer in total than the file: many references to the same bytes would fill the memory."""
        if own.layout != "contiguous" or own.nbytes == 0 or not dataset.id.get_type().is_variable_str():
            return
        places = np.zeros(own.nbytes // _VLEN.itemsize, _VLEN)
        self._source.seek(int(dataset.id.get_offset()))
        self._source.readinto(places.view(np.uint8))
        total = int(places["length"].sum(dtype=np.uint64))
        if total > self._source.size:
            raise Hdf5Error(f"{own.path} has texts of {total} bytes, more than the file's {self._source.size}")


def _brief(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= 80 else f"{shown[:80]}..."


class _ByteSource:
    """A file object that HDF5 reads from; each read fills its buffer completely or raises."""

    size: int
    """[byte]"""
    left: int | None = None
    """Bytes that may still be read, at most `_PIECE_MOST` at once; None: no bound."""
    _at = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the position of the next read; returns it [byte]."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        """Position of the next read [byte]."""
        return self._at

    def read(self, size: int) -> bytes:
        """Read bytes; h5py requires this method of a file object, but calls `readinto`."""
        content = bytearray(size)
        self.readinto(content)
        return bytes(content)

    def flush(self) -> None:
        """Do nothing; h5py requires this method."""

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer; raises OSError if the file is too short, Hdf5Error if the walk reads too much."""
        view = memoryview(buffer).cast("B")
        if self.left is not None:
            self.left -= len(view)
            if len(view) > _PIECE_MOST:
                bound = f"expected at most {_PIECE_MOST}"
                raise Hdf5Error(f"a piece of the file's structure has {len(view)} bytes at byte {self._at}, {bound}")
            if self.left < 0:
                raise Hdf5Error("the file's structure leads in a circle, or is far larger than the file")
        if self._at + len(view) > self.size:
            raise OSError(f"truncated file: bytes {self._at} to {self._at + len(view)} of {self.size} are asked for")
        self._fill(self._at, view)
        if 0 < (size := collection_size(view)) <= self.size - self._at:
            collection = memoryview(bytearray(size))  # checked now: libhdf5 may read the rest of it without its header
            self._fill(self._at, collection)
            refuse_endless_heap(collection)
        self._at += len(view)
        return len(view)

    def _fill(self, at: int, view: memoryview) -> None:
        """Fill `view` with the bytes from offset `at`; the caller has checked that they exist."""
        raise NotImplementedError

    def state(self) -> tuple[int, int]:
        """Size [byte] and modification time [ns]."""
        raise NotImplementedError

    def close(self) -> None:
        """Release the handle; a second call does nothing."""


class _MemorySource(_ByteSource):
    """Bytes in memory."""

    def __init__(self, content: bytes) -> None:
        self._content = memoryview(content)
        self.size = len(content)

    def _fill(self, at: int, view: memoryview) -> None:
        view[:] = self._content[at : at + len(view)]

    def state(self) -> tuple[int, int]:
        return self.size, 0


class _FileSource(_ByteSource):
    """A regular file; raises Hdf5Error for anything else."""

    def __init__(self, path: str | PathLike[str]) -> None:
        # O_NONBLOCK: opening a FIFO would wait for a writer; for regular files it has no effect
        self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        state = os.fstat(self._handle)
        if not stat.S_ISREG(state.st_mode):
            self.close()
            if stat.S_ISDIR(state.st_mode):
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
            raise Hdf5Error("the file is a pipe, a device or a socket, expected a regular file")
        self.size = state.st_size

    def _fill(self, at: int, view: memoryview) -> None:
        done = 0
        while done < len(view):
            count = os.preadv(self._handle, [view[done:]], at + done)
            if count == 0:
                raise OSError(f"truncated file: it ends at byte {at + done}, and had {self.size} when opened")
            done += count

    def state(self) -> tuple[int, int]:
        state = os.fstat(self._handle)
        return state.st_size, state.st_mtime_ns

    def close(self) -> None:
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1
