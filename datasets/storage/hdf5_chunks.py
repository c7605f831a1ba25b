"""Whether all of a dataset's bytes are in its file, and become no more than its header declares."""

from __future__ import annotations

import math
import zlib
from typing import Any

import numpy as np

from ..errors import Hdf5Error
from .hdf5_declared import Declared

_CHECKSUM_BYTES = 4
_INDEX_BYTES = 8  # of a chunk's entry in the smallest of HDF5's indices
_DEFLATE_RATIO = 1032  # the most that zlib's deflate compresses, by its authors
_INFLATED_MOST = 1 << 26
"""[byte] that a chunk may become without having been tried."""


def require_room(dataset: Any, own: Declared, file_bytes: int) -> None:
    """Raise Hdf5Error where a dataset declares more than the file can hold: a few bytes would declare any rows.

    HDF5 gives fill values for what was never written. Nothing is read for this.

    dataset: `h5py.h5d.DatasetID`. file_bytes: size of the file.
    """
    if not own.nbytes:
        return
    if own.layout == "chunked":
        if (count := _chunk_count(own)) * _INDEX_BYTES > file_bytes:
            raise Hdf5Error(f"{own.path} declares {count} chunks, which a file of {file_bytes} bytes cannot hold")
        return
    stored = int(dataset.get_storage_size())
    begin = 0 if own.layout == "compact" else dataset.get_offset()
    if begin is None or stored != own.nbytes or begin + stored > file_bytes:
        where = "nowhere" if begin is None else f"from byte {begin} on of {file_bytes}"
        raise Hdf5Error(f"{own.path} is damaged: it declares {own.nbytes} bytes, {stored} are stored {where}")


def _chunk_count(own: Declared) -> int:
    return math.prod(-(-size // chunk) for size, chunk in zip(own.shape, own.chunk, strict=True))


def require_chunks(dataset: Any, own: Declared, file_bytes: int) -> None:
    """Raise Hdf5Error unless each chunk of a dataset lies in the file by itself, and becomes no more than it may.

    The index of chunks has no checksum: libhdf5 dies of some that are damaged.
    """
    if own.layout != "chunked" or not own.nbytes or not hasattr(dataset, "chunk_iter"):  # HDF5 1.12.3 and newer
        return
    nominal = math.prod(own.chunk) * own.item_bytes
    least, most = _stored_bounds(own, nominal)
    unchecked = 1 << own.filters.index("fletcher32") if "fletcher32" in own.filters else 0
    count = _chunk_count(own)
    seen = 0  # entries, which a few nodes that hold each other would make endless
    places: list[tuple[int, ...]] = []
    extents: list[tuple[int, int]] = []

    def look(chunk: Any) -> bool | None:
        nonlocal seen
        seen += 1
        if least <= chunk.size <= min(most, file_bytes - chunk.byte_offset) and not chunk.filter_mask & unchecked:
            places.append(chunk.chunk_offset)
            extents.append((chunk.byte_offset, chunk.size))
        return True if seen > count else None  # anything but None ends the iteration

    dataset.chunk_iter(look)
    found = _apart(places, extents, own)
    if found != count:
        raise Hdf5Error(f"{own.path} is damaged: {count - found} of its {count} chunks cannot be where its index says")
    for place, (_, size) in zip(places, extents, strict=True) if "gzip" in own.filters else ():
        if size * _DEFLATE_RATIO > _INFLATED_MOST:
            _refuse_bomb(dataset, own, place, nominal)


def _stored_bounds(own: Declared, nominal: int) -> tuple[int, int]:
    """Least and most bytes of a stored chunk: only compression changes its size, and lengthens it by little."""
    checksum = _CHECKSUM_BYTES * ("fletcher32" in own.filters)
    if "gzip" in own.filters or "lzf" in own.filters:
        return checksum + 1, nominal + nominal // 100 + 1024
    return nominal + checksum, nominal + checksum


def _apart(places: list[tuple[int, ...]], extents: list[tuple[int, int]], own: Declared) -> int:
    """Number of distinct chunks that lie on the dataset's grid and overlap no other chunk in the file."""
    if not places:
        return 0
    offsets, stored = np.array(places, np.uint64), np.array(sorted(extents), np.uint64)
    shape, chunk = np.array(own.shape, np.uint64), np.array(own.chunk, np.uint64)
    inside = ((offsets < shape) & (offsets % chunk == 0)).all(axis=1)
    count = len({row.tobytes() for row in offsets[inside]})
    return min(count, len(places) - int(np.count_nonzero(stored[:-1].sum(axis=1) > stored[1:, 0])))


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
