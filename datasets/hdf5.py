"""Where h5py is touched for contour files: what comes out is typed, what goes wrong is an error naming the dataset.

h5py has no type information. It is imported by name, so all of it is `Any`, and stays inside this module.
"""

from __future__ import annotations

import importlib
import math
import os
import re
import secrets
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from .digests import ATTRIBUTE, Digests, DigestTable, attribute_digest, block_digests
from .errors import ContourFileError
from .index import leaf_of_one
from .schema import CHUNK_ROWS, DIGESTS, Field

h5py: Any = importlib.import_module("h5py")

# What h5py raises for damaged or foreign content; nothing else is taken for a bad file.
FAILURES = (OSError, KeyError, ValueError, TypeError, RuntimeError, OverflowError, EOFError, UnicodeError)

FILL = {"f": np.nan, "i": -1, "u": 255}
"""A chunk that was never written must show: no field has one of these values by right."""

_CHECKSUM_BYTES = 4
_BLOCK_ROWS = 1 << 17

Attribute = str | int | float | NDArray[Any]


class Hdf5Reader:
    """An HDF5 file opened for reading. Rows that the file has digests of are proven by them whenever they are read.

    Raises:
        ContourFileError: From every method, where the file is missing, foreign, truncated or damaged.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = Path(path)
        self._datasets: dict[str, Any] = {}
        self._block_digests: dict[str, Digests | None] = {}
        self._kept: dict[str, tuple[int, NDArray[Any]]] = {}  # of each dataset, the block that was read last
        with _failures(str(self.path)):
            try:
                with self.path.open("rb") as stream:
                    empty = not stream.read(1)
            except FileNotFoundError:
                raise ContourFileError(f"{self.path} does not exist") from None
            except IsADirectoryError:
                raise ContourFileError(f"{self.path} is a folder, not a contour file") from None
            if empty:
                raise ContourFileError(f"{self.path} is empty")
            # Files are replaced, never changed, so a lock would only keep others out.
            self._file: Any = h5py.File(fspath(self.path), "r", locking=False)
            self._opened = self._state()

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self._datasets.clear()
        self._kept.clear()
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def require_unchanged(self) -> None:
        """Refuse to go on with a file whose size or time of change is another than when it was opened.

        What was cut off reads as zeros, which pass a Fletcher-32 checksum. A file of that name which replaced this one
        is no change: the opened one is still read.
        """
        with _failures(str(self.path)):
            size, time_ns = self._state()
        if (size, time_ns) != self._opened:
            how = f"from {self._opened[0]} to {size} bytes" if size != self._opened[0] else "in place"
            raise ContourFileError(f"{self.path} was changed {how} while it was read")

    def _state(self) -> tuple[int, int]:
        """Size [bytes] and time of change [ns] of the opened file."""
        state = os.fstat(self._file.id.get_vfd_handle())
        return state.st_size, state.st_mtime_ns

    def __contains__(self, name: str) -> bool:
        with _failures(f"{self.path}: {name}"):
            return name in self._file

    def names(self, group: str) -> list[str]:
        """Names of what a group holds, sorted; empty if it is not there."""
        with _failures(f"{self.path}: {group}"):
            return sorted(map(str, self._file[group])) if group in self._file else []

    def layout(self, name: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
        """Dtype and shape of a dataset."""
        with _failures(f"{self.path}: {name}"):
            dataset: Any = self._dataset(name)
            return np.dtype(dataset.dtype), tuple(int(size) for size in dataset.shape)

    def has_checksum(self, name: str) -> bool:
        """Whether a dataset's chunks carry a Fletcher-32 checksum; a dataset without rows has nothing to check."""
        with _failures(f"{self.path}: {name}"):
            dataset: Any = self._dataset(name)
            return bool(dataset.fletcher32) or dataset.size == 0

    def read(self, name: str, first: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `first` to `stop` (all) of a dataset."""
        with _failures(f"{self.path}: {name}"):
            dataset: Any = self._dataset(name)
            digests = self._digests_of(name)
            if digests is None or not len(digests):
                rows = np.asarray(dataset[first:stop])
                return rows.astype(rows.dtype.newbyteorder("="), copy=False)
            begin, end, _ = slice(first, stop).indices(len(dataset))
            return self._proven(name, dataset, digests, begin, max(begin, end))

    @cached_property
    def digest_table(self) -> DigestTable | None:
        """Digests that the file has of its datasets and attributes; None where it has none."""
        if self.attribute("/", ATTRIBUTE) is None:
            return None
        try:
            return DigestTable(self.text("/", ATTRIBUTE))
        except (ValueError, RecursionError) as error:
            raise ContourFileError(f"{self.path}: attribute {ATTRIBUTE} of / is damaged: {error}") from error

    def require_attributes(self) -> None:
        """Refuse attributes that are not those which the file has digests of."""
        table = self.digest_table
        for group, digests in ({} if table is None else table.attributes).items():
            for key, digest in digests.items():
                value = self.attribute(group, key)
                if value is None or attribute_digest(value) != digest:
                    raise ContourFileError(f"{self.path}: attribute {key} of {group} is not what was written")

    def require_rows(self, name: str) -> None:
        """Read all rows of a dataset in bounded memory, refusing those that are not what was written."""
        _, shape = self.layout(name)
        for first in range(0, shape[0], _BLOCK_ROWS):
            self.read(name, first, first + _BLOCK_ROWS)

    def chunk_addresses(self, name: str) -> list[int]:
        """Where the chunks of a dataset lie in the file [byte], in the order of its rows."""
        with _failures(f"{self.path}: {name}"):
            identity: Any = self._dataset(name).id
            if self._dataset(name).chunks is None:  # it has no elements
                return []
            chunks: list[tuple[tuple[int, ...], int]] = []

            def note(chunk: Any) -> None:
                chunks.append((chunk.chunk_offset, chunk.byte_offset))

            if hasattr(identity, "chunk_iter"):  # h5py has it with HDF5 1.12.3 and newer
                identity.chunk_iter(note)
            else:
                for k in range(identity.get_num_chunks()):
                    note(identity.get_chunk_info(k))
            return [address for _, address in sorted(chunks)]

    def _proven(self, name: str, dataset: Any, digests: Digests, begin: int, end: int) -> NDArray[Any]:
        """Rows, read in whole blocks, each of which is what was written."""
        table = cast(DigestTable, self.digest_table)
        block_rows = table.block_rows
        first, stop = begin // block_rows, -(-end // block_rows)
        kept = self._kept.get(name)
        if kept is not None and (kept[0], stop) == (first, first + 1):
            return kept[1][begin - first * block_rows : end - first * block_rows].copy()
        rows = np.asarray(dataset[first * block_rows : stop * block_rows])
        differing = np.flatnonzero(block_digests(rows, block_rows) != digests[first:stop])
        if len(differing):
            row = (first + int(differing[0])) * block_rows
            raise ContourFileError(
                f"{self.path}: {name} is damaged: rows {row} to {min(row + block_rows, len(dataset))} "
                "are not what was written, by their digest"
            )
        rows = rows.astype(rows.dtype.newbyteorder("="), copy=False)
        asked = rows[begin - first * block_rows : end - first * block_rows]
        if stop != first + 1:
            return asked
        self._kept[name] = first, rows
        return asked.copy()

    def _digests_of(self, name: str) -> Digests | None:
        """Digests of a dataset's blocks; None where the file has none of it."""
        if name not in self._block_digests:
            self._block_digests[name] = self._read_digests(name)
        return self._block_digests[name]

    def _read_digests(self, name: str) -> Digests | None:
        table = self.digest_table if name != DIGESTS.path else None
        if table is None or name not in table.datasets:
            return None
        shape = tuple(int(size) for size in self._dataset(name).shape)
        first, stop = table.block_range(name, shape)
        digests = np.asarray(self._dataset(DIGESTS.path)[first:stop], np.uint64)
        if not table.is_dataset(name, shape, digests):
            raise ContourFileError(f"{self.path}: the digests of {name} are not what was written")
        return digests

    def attribute(self, name: str, key: str) -> Attribute | None:
        """An attribute of a group or dataset; None if it is not there."""
        with _failures(f"{self.path}: attribute {key} of {name}"):
            stored: Any = self._file[name].attrs.get(key)
            value: Any = stored.item() if hasattr(stored, "item") and stored.ndim == 0 else stored
            return cast(Attribute | None, value.decode(errors="replace") if isinstance(value, bytes) else value)

    def text(self, name: str, key: str) -> str:
        """An attribute that must be there and be text."""
        value = self.attribute(name, key)
        if not isinstance(value, str):
            raise ContourFileError(f"{self.path}: attribute {key} of {name} is missing or not text")
        return value

    def _dataset(self, name: str) -> Any:
        if name not in self._datasets:  # opening one takes longer than reading a pose of it
            dataset: Any = self._file.get(name)
            if not isinstance(dataset, h5py.Dataset):
                raise ContourFileError(f"{self.path}: {name} is missing or not a dataset")
            self._refuse_lost_chunks(name, dataset)
            self._datasets[name] = dataset
        return self._datasets[name]

    def _refuse_lost_chunks(self, name: str, dataset: Any) -> None:
        """Look through the index of chunks, which has no checksum: libhdf5 dies of some that are damaged."""
        if dataset.chunks is None or not dataset.size or not dataset.fletcher32:
            return
        if not hasattr(dataset.id, "chunk_iter"):  # h5py has it with HDF5 1.12.3 and newer
            return
        size = self.path.stat().st_size
        sound = 0

        def look(chunk: Any) -> None:
            nonlocal sound
            sound += _CHECKSUM_BYTES < chunk.size <= size - chunk.byte_offset

        dataset.id.chunk_iter(look)
        expected = math.prod(-(-rows // chunk) for rows, chunk in zip(dataset.shape, dataset.chunks, strict=True))
        if sound != expected:
            raise ContourFileError(
                f"{self.path}: {name} is damaged: {sound} of its {expected} chunks can be where its index says"
            )


FORMAT = ("v108", "v108")
"""HDF5 1.8's format, which every reader of today reads: its object headers carry checksums, so that damage to them is
an error; with older headers libhdf5 can read for ever. Not newer: those mark a file as open for writing."""


def fixed_text(text: str) -> Any:
    """Text of fixed length: HDF5 keeps it in the checksummed header, not in a heap without checksum."""
    raw = text.encode()
    return np.array(raw, h5py.string_dtype("utf-8", max(1, len(raw))))


def create_dataset(file: Any, spec: Field, shape: tuple[int, ...], *, gzip: int = 0) -> None:
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


class Hdf5Image:
    """Metadata of an HDF5 file, built in memory: HDF5 never meets a full disk. `image()` gives its bytes."""

    def __init__(self) -> None:
        self._file: Any = h5py.File(
            f"image-{secrets.token_hex(8)}",  # two of one name cannot be open at once, and writers may be threads
            "w",
            driver="core",
            backing_store=False,
            block_size=1 << 16,
            libver=FORMAT,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def attributes(self, name: str, values: Mapping[str, Attribute]) -> None:
        """Set attributes of a group, which is made if it is not there, or of a dataset."""
        target: Any = self._file.require_group(name) if name not in self._file else self._file[name]
        for key, value in values.items():
            target.attrs[key] = fixed_text(value) if isinstance(value, str) else value

    def reserve(self, spec: Field, shape: tuple[int, ...]) -> None:
        """Make a dataset of a final shape without content, in chunks with checksums."""
        create_dataset(self._file, spec, shape)

    def reserve_index(self, spec: Field, shape: tuple[int, ...]) -> None:
        """Make a dataset whose chunks lie elsewhere: one byte stands for the first, so that its index has a root."""
        self.reserve(spec, shape)
        self._file[spec.path].id.write_direct_chunk((0,) * len(shape), b"\0")

    def index_root(self, spec: Field, image: bytes | bytearray) -> int:
        """Where the root of a dataset's index lies in the image, to be overwritten."""
        dataset: Any = self._file[spec.path]
        address = int(dataset.id.get_chunk_info(0).byte_offset)
        return image.index(leaf_of_one(1, address, int(dataset.ndim)))

    def image(self) -> memoryview:
        """The file's bytes so far."""
        self._file.flush()
        return memoryview(self._file.id.get_file_image())


@contextmanager
def _failures(what: str, task: str = "read") -> Generator[None, None, None]:
    try:
        yield
    except FAILURES as error:
        raise ContourFileError(f"{what} {reason_of(error, task)}") from error


def is_of_system(sentence: str) -> bool:
    """Whether a problem of a file is the system's, which did not let it be read: it says nothing of the content."""
    return re.search(r"\[Errno [1-9]|errno = [1-9]|permission denied", sentence) is not None


def reason_of(error: BaseException, task: str) -> str:
    """What h5py's message says, in a user's words."""
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
