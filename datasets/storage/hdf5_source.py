"""Bytes of an HDF5 file as libhdf5 asks for them, with bounds.

libhdf5 (2.0 and older) walks through a collection of its global heap, where texts of any length lie, for ever if free
space declares 0 bytes (HDF5 File Format Specification 3.0, III.E). So each collection is tried before libhdf5 gets it.
Opening a FIFO does not wait for its writer.
"""

from __future__ import annotations

import errno
import os
import stat
import struct
from collections.abc import Generator
from contextlib import contextmanager
from os import PathLike
from typing import Any

from ..errors import Hdf5Error
from .hdf5_declared import ATTRIBUTE_BYTES_MOST

_PIECE_MOST = 2 * ATTRIBUTE_BYTES_MOST  # most bytes of one read of structure
_WALK_MOST = 1 << 26  # most bytes read to open one object, plus 4 times the file's size: ends a cyclic structure


class ByteSource:
    """A file object that HDF5 reads from; each read fills its buffer completely or raises.

    Opening raises OSError, and Hdf5Error for what is no regular file.
    """

    left: int | None = None
    """Bytes that may still be read, at most `_PIECE_MOST` at once; None: no bound."""
    _at = 0

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
        """[byte]"""

    @contextmanager
    def bounded(self) -> Generator[None, None, None]:
        """Bound what libhdf5 reads within the block, which opens an object or reads an attribute."""
        self.left = _WALK_MOST + 4 * self.size
        try:
            yield
        finally:
            self.left = None

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
        """Fill a buffer; raises OSError if the file is too short, Hdf5Error beyond a bound."""
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
        """Fill `view` with the bytes from offset `at`; the caller has checked that they are in the file."""
        done = 0
        while done < len(view):
            count = os.preadv(self._handle, [view[done:]], at + done)
            if count == 0:
                raise OSError(f"truncated file: it ends at byte {at + done}, and had {self.size} when opened")
            done += count

    def state(self) -> tuple[int, int]:
        """Size [byte] and modification time [ns]."""
        state = os.fstat(self._handle)
        return state.st_size, state.st_mtime_ns

    def close(self) -> None:
        """Release the handle; a second call does nothing."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


SIGNATURE = b"GCOL"
_HEAD = struct.Struct("<4sB3xQ")  # signature, version, size of the collection
_OBJECT = struct.Struct("<HHIQ")  # index, references, reserved, size of the content


def collection_size(content: memoryview) -> int:
    """Size that a heap collection declares [byte]; 0 if it is none. content: its first bytes."""
    if len(content) < _HEAD.size or content[: len(SIGNATURE)].tobytes() != SIGNATURE:
        return 0
    return int(_HEAD.unpack_from(content)[2])


def refuse_endless_heap(content: memoryview) -> None:
    """Raise OSError for a collection in which a walk from object to object does not reach the end."""
    at = _HEAD.size
    while at + _OBJECT.size <= len(content):
        index, _, _, length = _OBJECT.unpack_from(content, at)
        step = length if index == 0 else _OBJECT.size + -(-length // 8) * 8  # free space counts its own head
        if step < _OBJECT.size or at + step > len(content):
            raise OSError(
                f"its heap of texts is damaged: object {index} at byte {at} takes {step} of {len(content)} bytes"
            )
        at += step
