"""Whether all of a dataset's bytes are in its file, and become no more than its header declares."""

from __future__ import annotations

import math
import zlib
from typing import Any

import numpy as np

from .errors import Hdf5Error
from .hdf5_structure import Declared

_CHECKSUM_BYTES = 4
_INDEX_BYTES = 8  # of a chunk's entry in the smallest of HDF5's indices
_DEFLATE_RATIO = 1032  # the most that zlib's deflate compresses, by its authors
_INFLATED_MOST = 1 << 26
"""[byte] that a chunk may become without having been tried."""


def require_allocated(dataset: Any, own: Declared, file_bytes: int) -> None:
    """Raise Hdf5Error unless every element that a dataset declares is stored in the file.

    HDF5 gives fill values for what is not: a few bytes would declare any number of rows.

    dataset: `h5py.h5d.DatasetID`. file_bytes: size of the file.
    """
    if not own.nbytes:
        return
    if own.layout == "chunked":
        _require_chunks(dataset, own, file_bytes)
        return
    stored = int(dataset.get_storage_size())
    begin = 0 if own.layout == "compact" else dataset.get_offset()
    if begin is None or stored != own.nbytes or begin + stored > file_bytes:
        where = "" if begin is None else f" from byte {begin} on of {file_bytes}"
        raise Hdf5Error(f"{own.path} is damaged: it declares {own.nbytes} bytes, {stored} are stored{where}")


def _require_chunks(dataset: Any, own: Declared, file_bytes: int) -> None:
    """Look through the index of chunks, which has no checksum: libhdf5 dies of some that are damaged."""
    expected = math.prod(-(-size // chunk) for size, chunk in zip(own.shape, own.chunk, strict=True))
    if expected * _INDEX_BYTES > file_bytes:
        raise Hdf5Error(f"{own.path} declares {expected} chunks, which a file of {file_bytes} bytes cannot hold")
    if not hasattr(dataset, "chunk_iter"):  # h5py has it with HDF5 1.12.3 and newer
        return
    nominal = math.prod(own.chunk) * own.item_bytes
    least, most = _stored_bounds(own, nominal)
    unchecked = 1 << own.filters.index("fletcher32") if "fletcher32" in own.filters else 0
    places: list[tuple[int, ...]] = []
    stored = 0
    large: list[tuple[int, ...]] = []

    def look(chunk: Any) -> bool | None:
        nonlocal stored
        sound = least <= chunk.size <= min(most, file_bytes - chunk.byte_offset) and not chunk.filter_mask & unchecked
        if sound:
            places.append(chunk.chunk_offset)
            stored += chunk.size
            if "gzip" in own.filters and chunk.size * _DEFLATE_RATIO > _INFLATED_MOST:
                large.append(chunk.chunk_offset)
        return True if len(places) > expected else None  # anything but None ends the iteration

    dataset.chunk_iter(look)
    if _distinct(places, own) != expected or stored > file_bytes:
        raise Hdf5Error(
            f"{own.path} is damaged: {_distinct(places, own)} of its {expected} chunks can be where its index says"
        )
    for place in large:
        _refuse_bomb(dataset, own, place, nominal)


def _stored_bounds(own: Declared, nominal: int) -> tuple[int, int]:
    """Least and most bytes of a stored chunk: only compression changes its size, and lengthens it by little."""
    checksum = _CHECKSUM_BYTES * ("fletcher32" in own.filters)
    if "gzip" in own.filters or "lzf" in own.filters:
        return checksum + 1, nominal + nominal // 100 + 1024
    return nominal + checksum, nominal + checksum


def _distinct(places: list[tuple[int, ...]], own: Declared) -> int:
    """How many chunks of the dataset's grid the places are; -1 where there are more than it has."""
    if not places:
        return 0
    offsets = np.array(places, np.uint64)
    inside = (offsets < np.array(own.shape, np.uint64)) & (offsets % np.array(own.chunk, np.uint64) == 0)
    return len(np.unique(offsets[inside.all(axis=1)], axis=0)) if inside.all() else -1


def _refuse_bomb(dataset: Any, own: Declared, place: tuple[int, ...], nominal: int) -> None:
    """Raise Hdf5Error where a chunk inflates to more than its size: libhdf5 would hold all of it."""
    mask, content = dataset.read_direct_chunk(place)
    gzip = own.filters.index("gzip")
    if mask & 1 << gzip:
        return
    if "fletcher32" in own.filters[gzip:]:
        content = content[:-_CHECKSUM_BYTES]
    most = nominal + _CHECKSUM_BYTES  # a checksum may have been taken before
    try:
        inflated = zlib.decompressobj().decompress(content, most + 1)
    except zlib.error as error:
        raise Hdf5Error(f"{own.path} is damaged: chunk {list(place)} cannot be inflated: {error}") from None
    if len(inflated) > most:
        raise Hdf5Error(f"{own.path} is damaged: chunk {list(place)} inflates to more than its {nominal} bytes")
