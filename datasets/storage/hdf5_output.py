"""HDF5 files written by libhdf5, which never meets a full disk: a stream between the two keeps what goes wrong.

libhdf5 crashes the process where a file cannot be flushed when it is closed. So the stream takes every write, and the
first one that the system refuses is raised once libhdf5 has closed the file.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from .digests import ATTRIBUTE, BlockDigester, Digests, digests_text
from .hdf5_opening import Attribute
from .hdf5_structure import h5py
from .schema import CHUNK_ROWS, DIGESTS, Field

FILL = {"f": np.nan, "i": -1, "u": 255}
"""A chunk that was never written must show: no field has one of these values by right."""

FORMAT = ("v108", "v108")
"""HDF5 1.8's format, which every reader of today reads: its object headers carry checksums, so that damage to them is
an error; with older headers libhdf5 can read for ever. Not newer: those mark a file as open for writing."""


def fixed_text(text: str) -> Any:
    """Text of fixed length: HDF5 keeps it in the checksummed header, not in a heap without checksum."""
    raw = text.encode()
    return np.array(raw, h5py.string_dtype("utf-8", max(1, len(raw))))


def create_dataset(file: Any, spec: Field, shape: tuple[int, ...], *, gzip: int = 0) -> Any:
    """Make a dataset of a final shape without content, in chunks with checksums; one without elements is contiguous."""
    chunked: dict[str, Any] = {}
    if 0 not in shape:
        chunked = {"chunks": (min(CHUNK_ROWS, shape[0]), *shape[1:]), "fletcher32": True}
        if gzip:
            chunked |= {"compression": "gzip", "compression_opts": gzip, "shuffle": True}
    dataset: Any = file.create_dataset(
        spec.path, shape=shape, dtype=spec.dtype, fillvalue=FILL[spec.dtype.kind], track_times=False, **chunked
    )
    dataset.attrs["units"] = fixed_text(spec.unit)
    dataset.attrs["frame"] = fixed_text(spec.frame)
    return dataset


class Hdf5Output:
    """A contour file to be filled from front to back: datasets of a final shape, whose rows come a few at a time."""

    def __init__(self, file: Any, gzip: int) -> None:
        self._file = file
        self._gzip = gzip
        self._datasets: dict[Field, Any] = {}
        self._written: dict[Field, int] = {}
        self._digesters: dict[Field, BlockDigester] = {}
        self._attributes: dict[str, dict[str, Attribute]] = {}

    def attributes(self, name: str, values: dict[str, Attribute]) -> None:
        """Give a group attributes."""
        self._attributes.setdefault(name, {}).update(values)

    def begin(self, spec: Field, shape: tuple[int, ...]) -> None:
        """Make a dataset of a final shape."""
        self._datasets[spec] = create_dataset(self._file, spec, shape, gzip=self._gzip)
        self._written[spec], self._digesters[spec] = 0, BlockDigester(CHUNK_ROWS)

    def append(self, spec: Field, rows: NDArray[Any]) -> None:
        """Write the next rows of a dataset."""
        if rows.size:
            first = self._written[spec]
            self._datasets[spec][first : first + len(rows)] = rows
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
        digests: dict[Field, Digests] = {spec: digester.finish() for spec, digester in self._digesters.items()}
        datasets = {spec.path: (self._datasets[spec].shape, own) for spec, own in digests.items()}
        text = digests_text(datasets, self._attributes, CHUNK_ROWS)
        self.add(DIGESTS, np.concatenate([np.zeros(0, np.uint64), *digests.values()]))
        self.attributes("/", {ATTRIBUTE: text})
        for name, values in self._attributes.items():
            target: Any = self._file.require_group(name)
            for key, value in values.items():
                target.attrs[key] = fixed_text(value) if isinstance(value, str) else value


@contextmanager
def hdf5_output(path: Path, *, gzip: int = 0) -> Generator[Hdf5Output, None, None]:
    """Write a new file, or anew; when this returns, it is on the disk. gzip: 0 does not compress, 9 most.

    Raises OSError where the disk is full or fails.
    """
    with new_hdf5(path) as file:
        output = Hdf5Output(file, gzip)
        yield output
        output.finish()


@contextmanager
def new_hdf5(path: Path) -> Generator[Any, None, None]:
    """A new `h5py.File` to fill, or one anew; when this returns, it is on the disk.

    Raises OSError where the disk is full or fails.
    """
    stream = _Stream(path)
    try:
        file: Any = h5py.File(stream, "w", libver=FORMAT)
        try:
            yield file
        finally:
            file.close()
        stream.sync()
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
        self._handle = os.open(path, flags, 0o666)
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
            count = os.preadv(self._handle, [buffer], self._at)
        self._at += count
        return count

    def write(self, content: memoryview) -> int:
        left = memoryview(content)
        with self._kept_failure():
            while left and self.failure is None:
                count = os.pwrite(self._handle, left, self._at + len(content) - len(left))
                if count == 0:
                    raise OSError(errno.EIO, "nothing was written")
                left = left[count:]
        self._at += len(content)
        self._size = max(self._size, self._at)
        return len(content)

    def truncate(self, size: int) -> int:
        with self._kept_failure():
            os.ftruncate(self._handle, size)
        self._size = size
        return size

    def flush(self) -> None:
        """libhdf5 asks for it; `sync` does it."""

    def sync(self) -> None:
        """Have all on the disk; raises OSError, also of what was written before."""
        if self.failure is not None:
            raise self.failure
        os.fsync(self._handle)

    def close(self) -> None:
        os.close(self._handle)

    @contextmanager
    def _kept_failure(self) -> Generator[None, None, None]:
        try:
            yield
        except OSError as error:
            self.failure = self.failure or error
