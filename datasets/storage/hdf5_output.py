"""HDF5 files written by libhdf5, which never meets a full disk: a stream between the two keeps what goes wrong.

libhdf5 crashes the process where a file cannot be flushed when it is closed. So the stream takes every write, and the
first one that the system refuses is raised once libhdf5 has closed the file.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from .digests import ATTRIBUTE, Digests, RowDigest, attribute_digests
from .hdf5_declared import h5py
from .hdf5_opening import Attribute
from .schema import CHUNK_ROWS, Field

FILL = {"f": np.nan, "i": -1, "u": 255}
"""A chunk that was never written must show: no field has one of these values by right."""

_CHUNK_BYTES = 1 << 18  # of long rows, such as an array's wire bytes, fewer make a chunk

FORMAT = ("v108", "v108")
"""HDF5 1.8's format, which every reader of today reads: its object headers carry checksums, so that damage to them is
an error; with older headers libhdf5 can read for ever. Not newer: those mark a file as open for writing."""


def fixed_text(text: str) -> Any:
    """Text of fixed length: HDF5 keeps it in the checksummed header, not in a heap without checksum."""
    raw = text.encode()
    return np.array(raw, h5py.string_dtype("utf-8", max(1, len(raw))))


def create_dataset(file: Any, spec: Field, shape: tuple[int, ...], *, gzip: int = 0) -> Any:
    """Make a dataset of a final shape without content, in chunks with checksums; one without elements is contiguous.

    file: `h5py.File`. By h5py's low-level functions: a file has some 25 datasets, and they take a third of the time.
    """
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_fill_value(np.array(FILL[spec.dtype.kind], spec.dtype))
    plist.set_obj_track_times(False)
    if 0 not in shape:
        row_bytes = spec.dtype.itemsize * math.prod(shape[1:])
        plist.set_chunk((max(1, min(CHUNK_ROWS, _CHUNK_BYTES // row_bytes, shape[0])), *shape[1:]))
        if gzip:
            plist.set_shuffle()
            plist.set_deflate(gzip)
        plist.set_fletcher32()
    links = h5py.h5p.create(h5py.h5p.LINK_CREATE)
    links.set_create_intermediate_group(True)
    kind, space = h5py.h5t.py_create(spec.dtype), h5py.h5s.create_simple(shape)
    dataset: Any = h5py.h5d.create(file.id, spec.path.encode(), kind, space, plist, links)
    put_attribute(dataset, "units", spec.unit)
    put_attribute(dataset, "frame", spec.frame)
    return dataset


def put_attribute(owner: Any, name: str, value: Attribute) -> None:
    """Give a group or dataset an attribute. owner: its `h5py.h5g.GroupID` or `h5py.h5d.DatasetID`."""
    stored = fixed_text(value) if isinstance(value, str) else np.asarray(value)
    kind = h5py.h5t.py_create(stored.dtype, logical=True)
    attribute = h5py.h5a.create(
        owner,
        name.encode(),
        kind,
        h5py.h5s.create_simple(stored.shape) if stored.shape else h5py.h5s.create(h5py.h5s.SCALAR),
    )
    attribute.write(stored)


class Hdf5Output:
    """A file to be filled from front to back: datasets of a final shape, whose rows come a few at a time."""

    def __init__(self, file: Any, gzip: int) -> None:
        self._file = file
        self._gzip = gzip
        self._datasets: dict[Field, Any] = {}
        self._written: dict[Field, int] = {}
        self._digesters: dict[Field, RowDigest] = {}
        self._attributes: dict[str, dict[str, Attribute]] = {}

    def attributes(self, name: str, values: Mapping[str, Attribute]) -> None:
        """Give a group attributes."""
        self._attributes.setdefault(name, {}).update(values)

    def begin(self, spec: Field, shape: tuple[int, ...]) -> None:
        """Make a dataset of a final shape."""
        self._datasets[spec] = create_dataset(self._file, spec, shape, gzip=self._gzip)
        self._written[spec], self._digesters[spec] = 0, RowDigest()

    def append(self, spec: Field, rows: NDArray[Any]) -> None:
        """Write the next rows of a dataset."""
        if rows.size:
            space = self._datasets[spec].get_space()
            space.select_hyperslab((self._written[spec], *(0 for _ in rows.shape[1:])), rows.shape)
            memory = h5py.h5s.create_simple(rows.shape)
            self._datasets[spec].write(memory, space, np.ascontiguousarray(rows))
            self._written[spec] += len(rows)
            self._digesters[spec].add(rows)

    def add(self, spec: Field, array: NDArray[Any]) -> None:
        """Write a whole dataset."""
        self.begin(spec, array.shape)
        self.append(spec, array)

    def finish(self) -> None:
        """Write digests and attributes; raises ContourFileError if a dataset did not get all of its rows."""
        for spec, count in self._written.items():
            if count != (size := self._datasets[spec].shape)[0] and 0 not in size:
                raise ContourFileError(f"{spec.path} got {count} rows, expected {size[0]}")
        datasets = {spec.path: digest.finish() for spec, digest in self._digesters.items()}
        self.attributes("/", {ATTRIBUTE: Digests(datasets, attribute_digests(self._attributes)).text()})
        for name, values in self._attributes.items():
            group: Any = self._file.require_group(name).id
            for key, value in values.items():
                put_attribute(group, key, value)


@contextmanager
def hdf5_output(path: Path, *, gzip: int = 0, reserved_bytes: int = 0) -> Generator[Hdf5Output, None, None]:
    """Write a new file, or anew, which the caller then has on the disk (`NewFile.publish`).

    gzip: 0 does not compress, 9 most. reserved_bytes: room that the disk must have, or nothing is begun.
    Raises OSError where the disk is full or fails.
    """
    with new_hdf5(path, reserved_bytes=reserved_bytes) as file:
        output = Hdf5Output(file, gzip)
        yield output
        output.finish()


@contextmanager
def new_hdf5(path: Path, *, reserved_bytes: int = 0) -> Generator[Any, None, None]:
    """A new `h5py.File` to fill, or one anew; arguments and errors as `hdf5_output`."""
    stream = _Stream(path)
    try:
        if reserved_bytes:
            os.posix_fallocate(stream.handle, 0, reserved_bytes)
        file: Any = h5py.File(stream, "w", libver=FORMAT)
        try:
            yield file
        finally:
            file.close()
        if stream.failure is not None:
            raise stream.failure
    except Exception as error:
        if stream.failure is not None and stream.failure is not error:
            raise stream.failure from error  # libhdf5's own error has less information
        raise
    finally:
        stream.close()


class _Stream:
    """File object that libhdf5 writes to. After the first failure it writes nothing and hides that from libhdf5."""

    def __init__(self, path: Path) -> None:
        self.failure: OSError | None = None
        flags = os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW
        self.handle = os.open(path, flags, 0o666)
        self._at = 0
        self._size = 0  # as libhdf5 believes: where it is told another, it cannot close the file, and crashes at exit

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence] + offset
        return self._at

    def tell(self) -> int:
        return self._at

    def read(self, size: int = -1) -> bytes:
        """Read bytes; h5py recognises a file object by this method, but calls `readinto`."""
        raise NotImplementedError(size)

    def readinto(self, buffer: memoryview) -> int:
        count = 0
        with self._kept_failure():
            count = os.preadv(self.handle, [buffer], self._at)
        self._at += count
        return count

    def write(self, content: memoryview) -> int:
        left = memoryview(content)
        with self._kept_failure():
            while left and self.failure is None:
                count = os.pwrite(self.handle, left, self._at + len(content) - len(left))
                if count == 0:
                    raise OSError(errno.EIO, "nothing was written")
                left = left[count:]
        self._at += len(content)
        self._size = max(self._size, self._at)
        return len(content)

    def truncate(self, size: int) -> int:
        with self._kept_failure():
            os.ftruncate(self.handle, size)
        self._size = size
        return size

    def flush(self) -> None:
        """Do nothing; libhdf5 asks for it."""

    def close(self) -> None:
        os.close(self.handle)

    @contextmanager
    def _kept_failure(self) -> Generator[None, None, None]:
        try:
            yield
        except OSError as error:
            self.failure = self.failure or error
