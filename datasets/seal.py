"""Joining the shards of a work folder into one ordinary HDF5 file, in blocks, on space reserved before."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .durable import reserve_space, sync, write_temporary
from .hdf5 import Hdf5Filler, Hdf5Image, Hdf5Reader
from .header import FileHeader, put_header
from .reader import INTENSITY_ABSENT, Timing, get_timing, join_timing
from .schema import CHUNK_ROWS, CONTOURS, METRICS, TIMING, Field
from .shards import Shard, put_stages

# Whole chunks at a time, whatever the shards are: then the file's bytes do not depend on their sizes.
_BLOCK_ROWS = 16 * CHUNK_ROWS

# What HDF5 adds at most: an entry of a version 1 B-tree (40 bytes in nodes at least half full) and a checksum a chunk,
# deflate's worst case, and headers. tests/test_file_writer.py holds that sealed files stay below.
_CHUNK_OVERHEAD = 256
_DATASET_OVERHEAD = 16384
_FILE_OVERHEAD = 1 << 20


@dataclass(frozen=True)
class ShardLayout:
    """What the sealed file must have room for."""

    rows: dict[str, int]
    """Rows by dim: pose, polyline, point."""
    has_intensity: bool
    """Whether any shard has intensities."""
    timing: Timing
    """Timing of all shards."""


def shard_layout(shards: Iterable[Shard]) -> ShardLayout:
    """Add up shards; raises ContourFileError where one cannot be read."""
    rows = {"pose": 0, "polyline": 0, "point": 0}
    has_intensity = False
    timings: list[Timing] = []
    for shard in shards:
        with Hdf5Reader(shard.path) as file:
            rows["pose"] += shard.stop - shard.first
            rows["polyline"] += file.layout("/contours/polyline_closed")[1][0]
            rows["point"] += file.layout("/contours/points")[1][0]
            has_intensity |= "/contours/intensity" in file
            timings.append(get_timing(file))
    return ShardLayout(rows, has_intensity, join_timing(timings))


def sealed_skeleton(header: FileHeader, layout: ShardLayout, *, gzip: int) -> tuple[memoryview, int]:
    """The sealed file with its header and empty datasets, and the size [byte] that it stays below once filled."""
    content = 0
    with Hdf5Image() as image:
        put_header(image, header)
        for spec in _filled(layout):
            rows = layout.rows[str(spec.dims[0]).removesuffix(" + 1")] + int(spec.is_offset)
            shape = (rows, *(size for size in spec.dims[1:] if isinstance(size, int)))
            image.reserve(spec, shape, gzip=gzip)
            content += _size_bound(spec, shape)
        put_stages(image, layout.timing.stages)
        for spec, column in zip(TIMING, layout.timing[1:], strict=True):
            image.write(spec, column)
        skeleton = image.image()
    return skeleton, content + len(skeleton) + _FILE_OVERHEAD


def seal_into(temporary: Path, header: FileHeader, shards: list[Shard], *, gzip: int = 0) -> None:
    """Make the sealed file under a temporary name; when this returns, it is on the disk.

    Raises:
        OSError: The disk has no room for it (found before HDF5 writes anything), or fails.
        ContourFileError: A shard cannot be read.
    """
    layout = shard_layout(shards)
    skeleton, size = sealed_skeleton(header, layout, gzip=gzip)
    write_temporary(temporary, skeleton)
    reserve_space(temporary, size)
    with Hdf5Filler(temporary) as file:
        for spec in _filled(layout):
            first = 0
            for block in _blocks(_columns(spec, shards)):
                file.write(spec, first, block)
                first += len(block)
    sync(temporary)


def _filled(layout: ShardLayout) -> list[Field]:
    return [spec for spec in (*CONTOURS, *METRICS) if not spec.optional or layout.has_intensity]


def _size_bound(spec: Field, shape: tuple[int, ...]) -> int:
    row_bytes = spec.dtype.itemsize * int(np.prod(shape[1:], dtype=np.int64))
    chunk_rows = min(CHUNK_ROWS, max(shape[0], 1))
    chunks = -(-shape[0] // chunk_rows)
    chunk_bytes = chunk_rows * row_bytes
    return chunks * (chunk_bytes + chunk_bytes // 512 + _CHUNK_OVERHEAD) + _DATASET_OVERHEAD


def _columns(spec: Field, shards: list[Shard]) -> Iterator[NDArray[Any]]:
    """One field of all shards in pose order, in pieces of bounded size; offsets go on where the last shard ended."""
    base = 0
    for index, shard in enumerate(shards):
        with Hdf5Reader(shard.path) as file:
            if spec.optional and spec.path not in file:
                yield from _absent(spec, file.layout("/contours/points")[1][0])
                continue
            _, shape = file.layout(spec.path)
            end = base
            # An offset array of a later shard begins with a 0 that the one before has told already.
            for first in range(1 if spec.is_offset and index else 0, shape[0], _BLOCK_ROWS):
                rows = file.read(spec.path, first, min(first + _BLOCK_ROWS, shape[0]))
                if spec.is_offset:
                    rows = rows + base
                    end = int(rows[-1])
                yield rows
            base = end


def _absent(spec: Field, count: int) -> Iterator[NDArray[Any]]:
    for first in range(0, count, _BLOCK_ROWS):
        yield np.full(min(_BLOCK_ROWS, count - first), INTENSITY_ABSENT, dtype=spec.dtype)


def _blocks(pieces: Iterable[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    """The same rows in blocks of _BLOCK_ROWS, the last one shorter."""
    held: list[NDArray[Any]] = []
    count = 0
    for piece in pieces:
        held.append(piece)
        count += len(piece)
        while count >= _BLOCK_ROWS:
            rows = np.concatenate(held)
            yield rows[:_BLOCK_ROWS]
            held, count = [rows[_BLOCK_ROWS:]], count - _BLOCK_ROWS
    if count:
        yield np.concatenate(held)
