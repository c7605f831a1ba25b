"""One strict way to open HDF5 for reading: a file's whole structure is looked at before any of its data is read.

    with open_hdf5(path) as opened:            # or open_hdf5(path, content) for bytes that are in memory already
        opened.datasets["/rows"].shape         # what the structure declares; no data is read for it
        opened.read("/rows", first, stop)        # all of the rows are known to be in the file, and to fit into memory
        opened.attribute("/", "format")        # plain values of bounded size

Every refusal is an `Hdf5Error`; its message names the path inside the file, the value and the bound, but not the file:
the caller puts the file's name before it. What h5py raises for damage (`hdf5.FAILURES`) passes through.

The file is read through a handle, not by name: HDF5 sees no lock and no other opening of the same file, so a file that
this process holds open in h5py, for reading or for writing, can be read too; and a FIFO keeps nobody waiting.
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
"""[byte] that one read may take, plus 8 times the file's size: what is compressed grows when it is read."""

Attribute = str | int | float | NDArray[Any]
"""Value of an attribute."""

_PIECE_MOST = 2 * ATTRIBUTE_BYTES_MOST  # [byte] that the walk reads at once
_WALK_MOST = 1 << 26  # [byte] that the walk reads, plus 4 times the file's size: structure that leads in a circle ends
_VLEN = np.dtype([("length", "<u4"), ("place", "<u4", 3)])  # of a text of any length, VLEN_BYTES


def open_hdf5(path: str | PathLike[str], content: bytes | None = None, *, unread: Collection[str] = ()) -> StrictFile:
    """Open a file and look at its structure.

    content: the file's bytes, if they are in memory already; `path` is only its name then.
    unread: paths of datasets that nobody will read, so that they may declare rows that were never written.

    Raises:
        OSError: As the system says: FileNotFoundError, IsADirectoryError, PermissionError.
        Hdf5Error: Something else than a regular file, an empty file, or a structure that is refused.
        Exception: What h5py raises for a foreign or damaged file (`hdf5.FAILURES`).
    """
    source = _Memory(content) if content is not None else _Handle(path)
    try:
        return StrictFile(source, unread)
    except BaseException:
        source.close()
        raise


class StrictFile:
    """An HDF5 file whose structure was looked at; use it in a `with`."""

    def __init__(self, source: _Source, unread: Collection[str]) -> None:
        self._source, self._unread = source, frozenset(unread)
        if source.size == 0:
            raise Hdf5Error("the file is empty")
        source.left = _WALK_MOST + 4 * source.size
        self.file: Any = h5py.File(source, "r")
        """The `h5py.File`."""
        try:
            self.structure = walk(self.file.id, self._require_room)
            """Everything that it declares."""
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
        """What its datasets declare, by path."""
        return self.structure.datasets

    def state(self) -> tuple[int, int]:
        """Size [bytes] and time of the last change [ns] of the file that was opened."""
        return self._source.state()

    def declared(self, path: str) -> Declared:
        """What a dataset's header declares; raises Hdf5Error where there is none."""
        if path not in self.datasets or path in self._unread:
            raise Hdf5Error(f"{path} is missing or not a dataset")
        return self.datasets[path]

    def dataset(self, path: str) -> Any:
        """The `h5py.Dataset` of a path; raises Hdf5Error where there is none, or its bytes are not all in the file."""
        if path not in self._opened:  # opening one takes longer than reading a pose of it
            own = self.declared(path)
            dataset: Any = self.file[path]
            require_chunks(dataset.id, own, self._source.size)
            self._opened[path] = dataset
        return self._opened[path]

    def read(self, path: str, first: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `first` to `stop` (all) of a dataset, in the machine's byte order; texts are an object array of str.

        Raises Hdf5Error as `dataset`, for a scalar, and where the rows would take too much memory.
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
        """An attribute of a group or dataset; None if it is not there. Raises Hdf5Error for text that is not UTF-8."""
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
                value.encode()  # h5py gives what is not UTF-8 as half characters, which nothing can show
        except (UnicodeDecodeError, UnicodeEncodeError) as error:
            raise Hdf5Error(f"attribute {key} of {path} is not UTF-8: {error.reason} at {error.start}") from None
        return value

    def number(self, path: str, key: str) -> float | None:
        """An attribute that is a finite number, None if it is not there; raises Hdf5Error for any other."""
        value = self.attribute(path, key)
        if value is not None and not (isinstance(value, int | float) and math.isfinite(value)):
            raise Hdf5Error(f"attribute {key} of {path} is {_brief(value)}, expected a finite number")
        return None if value is None else float(value)

    def whole(self, path: str, key: str) -> int | None:
        """An attribute that is a whole number, None if it is not there; raises Hdf5Error for any other."""
        value = self.attribute(path, key)
        if value is not None and not isinstance(value, int):
            raise Hdf5Error(f"attribute {key} of {path} is {_brief(value)}, expected a whole number")
        return value

    def require_all_stored(self) -> None:
        """Look at the chunks of every dataset; raises Hdf5Error as `dataset`."""
        for path in self.datasets.keys() - self._unread:
            self.dataset(path)

    def _refuse_long_texts(self, dataset: Any, own: Declared) -> None:
        """Refuse texts that are longer than the file: many that lie in the same place."""
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


class _Source:
    """What HDF5 reads bytes from; each read gives all that was asked for, or is an error."""

    size: int
    """[byte]"""
    left: int | None = None
    """[byte] that may still be read, no more than `_PIECE_MOST` at once; None for any."""
    _at = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a byte; where that is."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        """Where the next read begins."""
        return self._at

    def read(self, size: int) -> bytes:
        """h5py takes only what has this for a file; it uses `readinto`."""
        content = bytearray(size)
        self.readinto(content)
        return bytes(content)

    def flush(self) -> None:
        """h5py calls this; there is nothing to write."""

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer; raises OSError where the file ends before, Hdf5Error where the walk reads too much."""
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
            collection = memoryview(bytearray(size))  # of a long one libhdf5 reads the rest later, without its head
            self._fill(self._at, collection)
            refuse_endless_heap(collection)
        self._at += len(view)
        return len(view)

    def _fill(self, at: int, view: memoryview) -> None:
        """Fill with the bytes from `at` on, which there are."""
        raise NotImplementedError

    def state(self) -> tuple[int, int]:
        """Size [bytes] and time of the last change [ns]."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go; closing twice does nothing."""


class _Memory(_Source):
    """Bytes."""

    def __init__(self, content: bytes) -> None:
        self._content = memoryview(content)
        self.size = len(content)

    def _fill(self, at: int, view: memoryview) -> None:
        view[:] = self._content[at : at + len(view)]

    def state(self) -> tuple[int, int]:
        return self.size, 0


class _Handle(_Source):
    """A regular file; raises Hdf5Error for anything else."""

    def __init__(self, path: str | PathLike[str]) -> None:
        # O_NONBLOCK: opening a FIFO would wait for a writer; regular files know no such wait
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
