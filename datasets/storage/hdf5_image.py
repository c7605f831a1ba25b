"""Metadata of HDF5 files as palpate writes them: datasets in chunks with checksums, text of fixed length."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

import numpy as np

from .chunk_index import leaf_of_one
from .hdf5_opening import Attribute
from .hdf5_structure import h5py
from .schema import CHUNK_ROWS, Field

FILL = {"f": np.nan, "i": -1, "u": 255}
"""A chunk that was never written must show: no field has one of these values by right."""

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
        """Address of the root of a dataset's index in the image, which the caller overwrites."""
        dataset: Any = self._file[spec.path]
        address = int(dataset.id.get_chunk_info(0).byte_offset)
        return image.index(leaf_of_one(1, address, int(dataset.ndim)))

    def image(self) -> memoryview:
        """The file's bytes so far."""
        self._file.flush()
        return memoryview(self._file.id.get_file_image())
