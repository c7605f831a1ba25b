"""Typed access to palpate's HDF5 files: arrays, attributes, digests, and errors that name the file and the dataset.

| damage                                             | is found                                                     |
|----------------------------------------------------|--------------------------------------------------------------|
| a bit of the file's own structure                  | when that part is opened: libhdf5's checksums                |
| a bit of a chunk of rows                           | whenever the chunk is read: Fletcher-32                      |
| a file that is too short, rows that are not there  | when a dataset of it is opened                               |
| a chunk of zeros, 0x0000 for 0xFFFF, an attribute  | by `require_rows` and `require_attributes`: digests (XXH3)   |
"""

from __future__ import annotations

import math
import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import cached_property
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError, Hdf5Error, name_nothing
from ..known_names import likely_file
from .digests import ATTRIBUTE, Digests, RowDigest, attribute_digest
from .hdf5_opening import Attribute, open_hdf5
from .schema import FIELDS, Field, count_problems, shape_problem

# Exceptions that h5py raises for damaged or foreign content; any other exception is a bug of palpate.
FAILURES = (OSError, LookupError, ValueError, TypeError, RuntimeError, ArithmeticError, EOFError, MemoryError)

_BLOCK_BYTES = 1 << 22


class Hdf5Reader:
    """An HDF5 file opened for reading, of which only what is asked for is opened.

    Raises:
        ContourFileError: From every method, if the file is missing, foreign, truncated or damaged.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = Path(path)
        with _failures(self.path):
            try:
                self._opened = open_hdf5(self.path)
            except FileNotFoundError:
                raise name_nothing(ContourFileError(f"{self.path} does not exist{likely_file(self.path)}")) from None
            except IsADirectoryError:
                raise name_nothing(ContourFileError(f"{self.path} is a folder, not a contour file")) from None
            self._state = self._opened.state()
            self._kept: dict[str, tuple[int, NDArray[Any]]] = {}

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def require_unchanged(self) -> None:
        """Raise ContourFileError if the size or modification time of the opened file has changed since opening.

        Replacing the file by another one of the same name is no change: the opened one is still read.
        """
        with _failures(self.path):
            size, time_ns = self._opened.state()
        if (size, time_ns) != self._state:
            how = f"from {self._state[0]} to {size} bytes" if size != self._state[0] else "in place"
            raise ContourFileError(f"{self.path} was changed {how} while it was read")

    def __contains__(self, name: str) -> bool:
        with _failures(self.path):
            return name in self._opened

    def layout(self, name: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
        """Dtype and shape of a dataset; raises if it is a scalar, or if any of its chunks is not in the file."""
        with _failures(self.path, name):
            self._opened.dataset(name)
            own = self._opened.declared(name)
            if not own.shape:
                raise Hdf5Error(f"{name} is one value, expected rows")
            return own.dtype, own.shape

    def has_checksum(self, name: str) -> bool:
        """Whether a dataset's chunks have a Fletcher-32 checksum; True for a dataset without rows."""
        with _failures(self.path):
            own = self._opened.declared(name)
            return "fletcher32" in own.filters or not own.nbytes

    def read(self, name: str, first: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `first` to `stop` (default: all) of a dataset; raises unless a contour file's dataset fits its field."""
        try:
            with _failures(self.path, name):
                return self._read(name, first, stop)
        except ContourFileError:
            self.require_unchanged()  # raises a clearer error if the file was changed
            raise

    def _read(self, name: str, first: int, stop: int | None) -> NDArray[Any]:
        """Rows of a dataset; of those in one chunk, the whole chunk is kept, as poses are often read one by one."""
        own = self._opened.declared(name)
        if name not in self._kept and name in _SPECS and (problem := shape_problem(_SPECS[name], own.dtype, own.shape)):
            raise Hdf5Error(problem)
        rows = own.chunk[0] if own.chunk else 0
        begin, end, _ = slice(first, stop).indices(own.shape[0] if own.shape else 0)
        if not rows or begin >= end or begin // rows != (end - 1) // rows:
            return self._opened.read(name, first, stop)
        chunk = begin // rows * rows
        if self._kept.get(name, (-1,))[0] != chunk:
            self._kept[name] = chunk, self._opened.read(name, chunk, chunk + rows)
        return self._kept[name][1][begin - chunk : end - chunk].copy()

    @cached_property
    def digests(self) -> Digests | None:
        """Digests of datasets and attributes; None if the file has none, or those of blocks, of formats 1.2 to 1.4."""
        with _failures(self.path):
            text = self._opened.attribute("/", ATTRIBUTE)
            if text is None:
                return None
            try:
                return Digests.from_text(text if isinstance(text, str) else "")
            except ValueError as error:
                raise Hdf5Error(f"attribute {ATTRIBUTE} of / is damaged: {error}") from error

    def require_attributes(self) -> None:
        """Raise ContourFileError if the attributes do not match the file's digests, where it has any."""
        with _failures(self.path):
            for group, digests in self.digests.attributes.items() if self.digests else ():
                for key, digest in digests.items():
                    value = self._opened.attribute(group, key)
                    if value is None or attribute_digest(value) != digest:
                        raise Hdf5Error(f"attribute {key} of {group} is not what was written")

    def require_rows(self) -> None:
        """Read all datasets, in bounded memory; raises ContourFileError where one does not match its digest.

        Does nothing for a file without digests.
        """
        if self.digests is None:
            return
        for name in dict.fromkeys((*self.digests.datasets, *(path for path in _SPECS if path in self))):
            digest = RowDigest()
            for first, stop in self.row_blocks(name):
                digest.add(self.read(name, first, stop))
            self.require_digest(name, digest)

    def row_blocks(self, name: str) -> Iterator[tuple[int, int]]:
        """Divide the rows of a dataset into ranges (first, stop) of at most 4 MiB, or one chunk where it is longer.

        Raises ContourFileError as `layout`, and for text.
        """
        dtype, shape = self.layout(name)
        if dtype.kind == "O":
            raise ContourFileError(f"{self.path}: {name} is text, expected numbers")
        rows = (self._opened.declared(name).chunk or (1,))[
            0
        ]  # whole chunks: HDF5 decodes one whole whenever it is read
        step = max(1, _BLOCK_BYTES // max(1, dtype.itemsize * math.prod(shape[1:])) // rows) * rows
        yield from ((first, min(first + step, shape[0])) for first in range(0, shape[0], step))

    def require_digest(self, name: str, found: RowDigest) -> None:
        """Raise ContourFileError unless all rows of a dataset, which `found` got, are what was written."""
        if self.digests is None:
            return
        if name not in self.digests.datasets:
            raise ContourFileError(f"{self.path}: {name} has no digest, which every dataset of this format has")
        if self.digests.datasets[name] != found.finish():
            raise ContourFileError(
                f"{self.path}: {name} is damaged: its rows are not what was written, by their digest"
            )

    def attribute(self, name: str, key: str) -> Attribute | None:
        """An attribute of a group or dataset; None if it does not exist."""
        with _failures(self.path, f"attribute {key} of {name}"):
            return self._opened.attribute(name, key)

    def text(self, name: str, key: str) -> str:
        """A text attribute; raises ContourFileError if it is missing or not text."""
        value = self.attribute(name, key)
        if not isinstance(value, str):
            raise ContourFileError(f"{self.path}: attribute {key} of {name} is missing or not text")
        return value

    def number(self, name: str, key: str) -> float | None:
        """A finite number from an attribute; None if it does not exist, ContourFileError for any other value."""
        with _failures(self.path, f"attribute {key} of {name}"):
            return self._opened.number(name, key)

    def whole(self, name: str, key: str) -> int | None:
        """An integer from an attribute; None if it does not exist, ContourFileError for any other value."""
        with _failures(self.path, f"attribute {key} of {name}"):
            return self._opened.whole(name, key)


_SPECS = {spec.path: spec for spec in FIELDS}


def require_fitting(file: Hdf5Reader, fields: tuple[Field, ...], pose_count: int) -> None:
    """Raise ContourFileError if row counts of a group's fields contradict each other or the number of poses."""
    shapes = {spec.path: file.layout(spec.path)[1] for spec in fields if spec.path in file}
    counts, problems = count_problems(shapes, fields)
    if counts.get("pose", pose_count) != pose_count:
        problems.append(f"/{fields[0].group} has {counts['pose']} poses, expected {pose_count}")
    if problems:
        raise ContourFileError(f"{file.path}: {problems[0]}")


@contextmanager
def _failures(path: Path, inside: str = "") -> Generator[None, None, None]:
    """Convert `Hdf5Error` and h5py's exceptions to a ContourFileError that names the file and the place inside it."""
    try:
        yield
    except Hdf5Error as error:  # its message names the place inside the file already
        raise ContourFileError(f"{path}: {error}") from None
    except FAILURES as error:
        raise ContourFileError(f"{path}{inside and ': '}{inside} {reason_of(error, 'read')}") from error


def is_of_system(sentence: str) -> bool:
    """Whether a problem's text is an error of the operating system while reading, so the content may be intact."""
    return re.search(r"\[Errno [1-9]|errno = [1-9]|permission denied", sentence) is not None


def reason_of(error: BaseException, task: str) -> str:
    """h5py's error as text for a user; task: a participle for errors that are not known, as "read"."""
    text = str(error)
    known = {
        "file signature not found": "is not an HDF5 file",
        "truncated file": "is truncated",
        "fletcher32": "is damaged: the checksum of a chunk does not match",
        "filter returned failure": "is damaged: the checksum of a chunk does not match",
        "Permission denied": "may not be read: permission denied",
    }
    for sign, reason in known.items():
        if sign in text:
            return reason
    return f"cannot be {task}: {' '.join(text.split()) or type(error).__name__}"


def get_version(file: Hdf5Reader) -> tuple[int, int]:
    """Major and minor version of a file's format; raises ContourFileError if it is missing or impossible."""
    version = file.attribute("/", "version")
    if not isinstance(version, np.ndarray) or version.shape != (2,) or version.dtype.kind not in "iu":
        raise ContourFileError(f"{file.path}: attribute version of / is missing or not [major, minor]")
    major, minor = (int(number) for number in version)
    if major < 1 or minor < 0:
        raise ContourFileError(f"{file.path} has format version {major}.{minor}, the first was 1.0")
    return major, minor
