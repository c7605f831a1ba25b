"""Frames of a playback as one HDF5 file, written block by block: whole or not there, also after kill -9."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..storage.durable import NewFile
from ..storage.hdf5_opening import Attribute
from ..storage.hdf5_output import hdf5_output
from ..storage.schema import Field


@dataclass(frozen=True)
class FrameField:
    """A dataset with one row a frame."""

    path: str
    """Within the file, as /focus/position."""
    row_shape: tuple[int, ...]
    """Of one frame."""
    units: str
    dtype: str = "<f4"
    """NumPy's name of the type of its values."""

    @property
    def spec(self) -> Field:
        """The same as a field of a file's format."""
        _, group, name = self.path.split("/")
        return Field(group, name, np.dtype(self.dtype), ("frame", *self.row_shape), self.units)


class _Discarded(Exception):
    """Ends the writing of a file that nobody wants any more."""


class FrameFile:
    """A file of frames being written; use it in a `with`: what is not published by then is removed.

    fields: what each frame has. frame_count: how many frames will come. attributes: of the groups and "/". arrays:
    whole datasets beside the frames.

    Raises:
        OSError: From the system (ENOSPC, EFBIG, ...), from the constructor if there is no room for all frames;
            nothing is left behind.
    """

    def __init__(
        self,
        path: Path,
        fields: Sequence[FrameField],
        frame_count: int,
        *,
        attributes: Mapping[str, Mapping[str, Attribute]],
        arrays: Mapping[FrameField, NDArray[Any]] | None = None,
    ) -> None:
        self.path = path
        self.frame_count = frame_count
        self._at = 0
        self._specs = {field.path: field.spec for field in fields}
        shapes = {
            spec: (frame_count, *field.row_shape) for field, spec in zip(fields, self._specs.values(), strict=True)
        }
        size = sum(int(np.prod(shape, dtype=np.int64)) * spec.dtype.itemsize for spec, shape in shapes.items())
        with contextlib.ExitStack() as stack:
            self._new = stack.enter_context(NewFile(path))
            self._output = stack.enter_context(hdf5_output(self._new.temporary, reserved_bytes=size))
            for name, values in attributes.items():
                self._output.attributes(name, values)
            for field, array in (arrays or {}).items():
                self._output.add(field.spec, array)
            for spec, shape in shapes.items():
                self._output.begin(spec, shape)
            self._writing = stack.pop_all()

    def append(self, rows: Mapping[str, NDArray[Any]]) -> None:
        """Write the next frames: rows of each field by its path. Raises ValueError for more than were announced."""
        count = len(next(iter(rows.values())))
        stop = self._at + count
        if stop > self.frame_count or rows.keys() != self._specs.keys():
            raise ValueError(f"{self.path}: frames up to {stop} of {sorted(rows)} do not fit {self.frame_count}")
        for name, values in rows.items():
            spec = self._specs[name]
            self._output.append(spec, np.asarray(values, spec.dtype))
        self._at = stop

    def publish(self, attributes: Mapping[str, Mapping[str, Attribute]] | None = None) -> int:
        """Have the file on the disk under its name; returns its bytes. Raises ValueError if frames are missing.

        attributes: further ones of groups, which are known only now.
        """
        if self._at != self.frame_count:
            raise ValueError(f"{self.path}: has {self._at} frames, {self.frame_count} were announced")
        for name, values in (attributes or {}).items():
            self._output.attributes(name, values)
        self._writing.close()
        return self.path.stat().st_size

    def discard(self) -> None:
        """Remove what was written, unless it is published; once more does nothing."""
        with contextlib.suppress(OSError):  # of a full disk, on which HDF5 closes the file
            self._writing.pop_all().__exit__(_Discarded, _Discarded(), None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()
