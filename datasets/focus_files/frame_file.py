"""Frames of a playback as one HDF5 file, written block by block: whole or not there, also after kill -9.

HDF5 never meets a full disk: the file's head is made in memory, all of its room is reserved by the system, and only
then do rows come. Under its own name it appears when the last row is on the disk.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..storage.digests import ATTRIBUTE, BlockDigester, Digests, block_digests, digests_text
from ..storage.durable import NewFile
from ..storage.hdf5_columns import image_of
from ..storage.hdf5_opening import Attribute
from ..storage.hdf5_output import fixed_text
from ..storage.hdf5_structure import h5py

_FORMAT = ("v108", "v108")  # readers of today all read it
_SLACK = 1 << 20  # [byte] for HDF5's own lists and digests, given back in the end
_BLOCK_ROWS = 256  # frames of a digest: reading one reads all of these


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
    def row_bytes(self) -> int:
        """Bytes of one frame."""
        return np.dtype(self.dtype).itemsize * int(np.prod(self.row_shape, dtype=np.int64))


class FrameFile:
    """A file of frames being written; use it in a `with`: what is not published by then is removed.

    fields: what each frame has. frame_count: how many frames will come. attributes: of the groups and "/". arrays:
    whole datasets beside the frames, by path. What killed writers of the same file have left is removed.

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
        arrays: Mapping[str, NDArray[Any]] | None = None,
    ) -> None:
        self.path = path
        self.frame_count = frame_count
        self._at = 0
        self._file: Any = None
        self._datasets: dict[str, Any] = {}
        self._digesters = {field.path: BlockDigester(_BLOCK_ROWS) for field in fields}
        self._dtypes = {field.path: field.dtype for field in fields}
        self._attributes, self._arrays = {name: dict(own) for name, own in attributes.items()}, arrays or {}
        image = _image(attributes, self._arrays)
        rows = frame_count * sum(field.row_bytes for field in fields)
        self._new = NewFile(path)
        try:
            self._new.write(image)
            os.posix_fallocate(self._new.handle, 0, len(image) + rows + _SLACK)
            self._file = h5py.File(self._new.temporary, "r+", libver=_FORMAT, locking=False)
            for field in fields:
                self._datasets[field.path] = self._dataset(field)
        except BaseException:
            self.discard()
            raise

    def _dataset(self, field: FrameField) -> Any:
        shape = (self.frame_count, *field.row_shape)
        dataset: Any = self._file.create_dataset(field.path, shape=shape, dtype=field.dtype, track_times=False)
        dataset.attrs["units"] = field.units
        return dataset

    def append(self, rows: Mapping[str, NDArray[Any]]) -> None:
        """Write the next frames: rows of each field by its path. Raises ValueError for more than were announced."""
        count = len(next(iter(rows.values())))
        stop = self._at + count
        if stop > self.frame_count or rows.keys() != self._datasets.keys():
            raise ValueError(f"{self.path}: frames up to {stop} of {sorted(rows)} do not fit {self.frame_count}")
        for name, values in rows.items():
            self._datasets[name][self._at : stop] = values
            self._digesters[name].add(np.asarray(values, self._dtypes[name]))
        self._at = stop

    def publish(self, attributes: Mapping[str, Mapping[str, Attribute]] | None = None) -> int:
        """Have the file on the disk under its name; returns its bytes. Raises ValueError if frames are missing.

        attributes: further ones of groups, which are known only now.
        """
        if self._at != self.frame_count:
            raise ValueError(f"{self.path}: has {self._at} frames, {self.frame_count} were announced")
        for name, values in (attributes or {}).items():
            self._attributes.setdefault(name, {}).update(values)
            group: Any = self._file.require_group(name)
            group.attrs.update(values)
        self._write_digests()
        self._close()
        size = self._new.temporary.stat().st_size
        self._new.publish()
        return size

    def _write_digests(self) -> None:
        """Digests of all datasets and attributes, as those of contour files (docs/formats/file-format.md)."""
        digests: dict[str, tuple[tuple[int, ...], Digests]] = {
            name: (array.shape, block_digests(array, _BLOCK_ROWS)) for name, array in self._arrays.items() if array.ndim
        }
        for name, digester in self._digesters.items():
            digests[name] = self._datasets[name].shape, digester.finish()
        self._file["/digests/block"] = np.concatenate([own for _, own in digests.values()])
        text = digests_text(digests, self._attributes, _BLOCK_ROWS)
        self._file.attrs[ATTRIBUTE] = fixed_text(text)

    def discard(self) -> None:
        """Remove what was written, unless it is published; once more does nothing."""
        self._close()
        self._new.discard()

    def _close(self) -> None:
        self._datasets.clear()
        if self._file is not None:
            self._file.close()
            self._file = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()


def _image(attributes: Mapping[str, Mapping[str, Attribute]], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The file without its frames."""
    with h5py.File("image", "w", driver="core", backing_store=False, libver=_FORMAT) as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=values, track_times=False)
        for name, values in attributes.items():
            group: Any = file.require_group(name)
            group.attrs.update(values)
        return bytes(image_of(file))
