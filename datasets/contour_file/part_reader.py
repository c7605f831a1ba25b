"""Reading rows of a part that is not sealed yet, as an HDF5 file's are read."""

from __future__ import annotations

import os
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..storage.schema import CHUNK_ROWS, TIMING, Arrays, Field
from .header import json_text
from .parts import FilePart
from .rows import chunk_bytes, decode_chunk, row_shape


class PartReader:
    """The rows of a part, as far as they were done when its log was read; has the methods of `Hdf5Reader`.

    Raises:
        ContourFileError: From every method, where the part is missing, truncated or damaged.
    """

    def __init__(self, part: FilePart) -> None:
        self.part = part
        self.path = part.path
        self._index = {spec.path: index for index, spec in enumerate(part.rows.fields)}
        self._kept: dict[int, tuple[int, NDArray[Any]]] = {}  # of each field, the chunk that was read last
        self._timing = timing_columns(part)
        try:
            self._handle = os.open(part.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise ContourFileError(f"{part.path} cannot be read: {error.strerror or error}") from error

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __contains__(self, name: str) -> bool:
        return name in self._index or name in self._timing

    def layout(self, name: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
        """Dtype and shape of a dataset."""
        if name in self._timing:
            return self._timing[name].dtype, self._timing[name].shape
        spec = self._field(name)
        return spec.dtype, (self.part.rows.counts[self._index[name]], *row_shape(spec))

    def has_checksum(self, name: str) -> bool:
        """Whether content is guarded by a checksum: all of it is."""
        return name in self

    def attribute(self, name: str, key: str) -> str | None:
        """The attribute that the sealed dataset will have; None if it will have none."""
        specs = {spec.path: spec for spec in (*self.part.rows.fields, *TIMING)}
        known = {"units": specs[name].unit, "frame": specs[name].frame} if name in specs else {}
        return known.get(key)

    def text(self, name: str, key: str) -> str:
        """The only text that a part has: the stages of its timing."""
        if (name, key) != ("/timing", "stages"):
            raise ContourFileError(f"{self.path}: attribute {key} of {name} is missing or not text")
        return json_text({"stages": _stages(self.part)}, "timing")

    def read(self, name: str, first: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `first` to `stop` (all) of a dataset."""
        if name in self._timing:
            return self._timing[name][first:stop]
        spec, index = self._field(name), self._index[name]
        rows = self.part.rows
        begin, end, _ = slice(first, stop).indices(rows.counts[index])
        whole = len(rows.addresses[index])
        pieces = [np.zeros((0, *row_shape(spec)), spec.dtype)]
        for chunk in range(begin // CHUNK_ROWS, min(-(-end // CHUNK_ROWS), whole)):
            base = chunk * CHUNK_ROWS
            pieces.append(self._chunk(spec, index, chunk)[max(begin - base, 0) : end - base])
        base = whole * CHUNK_ROWS
        if end > base:
            pieces.append(rows.tail(index)[max(begin - base, 0) : end - base])
        return np.concatenate(pieces)

    def require_rows(self, name: str) -> None:
        """Read all rows of a dataset, a chunk at a time, refusing those that are not what was written."""
        _, shape = self.layout(name)
        for first in range(0, shape[0], CHUNK_ROWS):
            self.read(name, first, first + CHUNK_ROWS)

    def _field(self, name: str) -> Field:
        if name not in self._index:
            raise ContourFileError(f"{self.path}: {name} is missing or not a dataset")
        return self.part.rows.fields[self._index[name]]

    def _chunk(self, spec: Field, index: int, chunk: int) -> NDArray[Any]:
        kept = self._kept.get(index)
        if kept is not None and kept[0] == chunk:
            return kept[1]
        try:
            content = os.pread(self._handle, chunk_bytes(spec), self.part.rows.addresses[index][chunk])
        except OSError as error:
            raise ContourFileError(f"{self.path}: {spec.path} cannot be read: {error.strerror or error}") from error
        rows = decode_chunk(spec, content, self.part.rows.digest(index, chunk))
        if rows is None:
            raise ContourFileError(
                f"{self.path}: {spec.path} is damaged: a chunk is not what was written, or it is truncated"
            )
        self._kept[index] = (chunk, rows)
        return rows


def timing_columns(part: FilePart) -> Arrays:
    """The datasets of /timing by path."""
    stages = _stages(part)
    stop = np.array([commit.stop for commit in part.commits], np.int64)
    seconds = [[commit.timing.get(stage, np.nan) for stage in stages] for commit in part.commits]
    return {
        "/timing/first": np.concatenate([np.array([part.first], np.int64), stop])[:-1],
        "/timing/stop": stop,
        "/timing/seconds": np.array(seconds, np.float64).reshape(len(stop), len(stages)),
    }


def _stages(part: FilePart) -> list[str]:
    return list(dict.fromkeys(stage for commit in part.commits for stage in commit.timing))
