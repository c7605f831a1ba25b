"""Making rows an ordinary HDF5 file.

| rows                                                       | how they are sealed                             |
|------------------------------------------------------------|-------------------------------------------------|
| of one part that begins with pose 0, metadata fit the room | in place: nothing is copied, metadata are added |
| of several parts, or to be compressed, or with long texts  | libhdf5 copies them, in blocks                  |

Either way what is done stays done until the name changes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bounded_file import ANY_SIZE, open_regular
from ..errors import ContourFileError
from ..storage.digests import Digests
from ..storage.durable import require_size
from ..storage.hdf5 import Hdf5Reader
from ..storage.hdf5_output import hdf5_output
from ..storage.schema import CHUNK_ROWS, CONTOURS, HEADER, METRICS, TIMING, Field
from .assembly import Assembly, write_assembly
from .header import FileHeader, header_attributes, json_text
from .parts import FilePart
from .reader import ContourFile
from .rows import Rows, chunk_bytes, proven_digest, row_fields
from .timing import Timing

_ROOM_STEP = 1 << 12
_ROOM_TO_SPARE = 1 << 14
"""Bytes of room for what is not known before the first pose: the names of the stages that were timed."""


@dataclass(frozen=True)
class FileFrame:
    """Content of a file before its rows; equal for all writers of one run."""

    room: int
    """Bytes for HDF5's metadata, at the beginning."""
    begin: int
    """Where rows begin; motion and mesh lie between the two, as in header.h5."""


def new_frame(header: FileHeader) -> FileFrame:
    """The frame of a new file with this header: its room takes the metadata of a file with every optional field."""
    rows = Rows(row_fields([spec.name for spec in (*CONTOURS, *METRICS) if spec.optional]), 0)
    for index in range(len(rows.fields)):  # one chunk each: then each has an index
        rows.counts[index] = CHUNK_ROWS
        rows.addresses[index].append(0)
    once, timing = np.zeros(1, np.int64), np.zeros((1, 1))
    digests = [np.zeros(1, np.uint64) for _ in rows.fields]
    assembly = _assembly_of(rows, digests, header, Timing(["stage"], once, once, timing), FileFrame(0, 0))
    room = -(-(assembly.metadata_size() + _ROOM_TO_SPARE) // _ROOM_STEP) * _ROOM_STEP
    return FileFrame(room, _add_arrays(Assembly(room), header, room))


def read_frame(header_file: Hdf5Reader, header: FileHeader) -> FileFrame:
    """The frame that the writer of header.h5 chose; raises ContourFileError."""
    first = _arrays(header)[0][0].path  # a motion has at least one pose, so it has a chunk
    room = header_file.chunk_addresses(first)[0]
    return FileFrame(room, _add_arrays(Assembly(room), header, room))


def write_header(path: Path, header: FileHeader) -> FileFrame:
    """Write a file with a header alone; when this returns, it is on the disk. Raises OSError."""
    frame = new_frame(header)
    assembly = _new_assembly(header, frame.room)
    for spec, array in _arrays(header):
        assembly.add(spec, array)
    if not write_assembly(path, assembly, frame.room, frame.room, fresh=True):
        raise ContourFileError(f"{path}: metadata of the header take more than the {frame.room} bytes kept for them")
    return frame


def seal_in_place(part: FilePart, header: FileHeader, timing: Timing, frame: FileFrame) -> bool:
    """Make a part, behind motion and mesh, an HDF5 file; when this returns, it is on the disk.

    Its chunks are read once more and compared with its log. Returns False, having written nothing, where the metadata
    do not fit the room.

    Raises:
        OSError: The disk is full or fails: what lies between the room and the end of the rows is as it was.
        ContourFileError: A chunk is not what was written.
    """
    rows = part.rows
    assembly = _assembly_of(rows, list(_reread(part)), header, timing, frame)
    if not write_assembly(part.path, assembly, rows.end, frame.room):
        return False
    with Hdf5Reader(part.path) as file:
        for index, spec in enumerate(rows.fields):
            found = file.chunk_addresses(spec.path)[: len(rows.addresses[index])]
            if found != rows.addresses[index].tolist():
                raise ContourFileError(f"{part.path}: the index of {spec.path} is not of the chunks written")
    return True


def copy_sealed(path: Path, source: ContourFile, header: FileHeader, *, gzip: int) -> None:
    """Write motion, mesh and all rows as a new HDF5 file, and read it once more.

    Raises OSError, ContourFileError.
    """
    fields = row_fields(source.optional)
    counts = {"pose": source.pose_count, "polyline": source.polyline_count, "point": source.point_count}
    with hdf5_output(path, gzip=gzip) as output:
        for name, values in _attributes(header, timing := source.timing()).items():
            output.attributes(name, values)
        for spec, array in _arrays(header):
            output.add(spec, array)
        for spec in fields:
            dim = str(spec.dims[0]).removesuffix(" + 1")
            output.begin(spec, (counts[dim] + int(spec.is_offset), *(int(size) for size in spec.dims[1:])))
        offset = {"pose_start": 0, "polyline_start": 0}
        for first, stop in source.blocks():
            arrays = source.contours(first, stop) | source.metrics(first, stop)
            for spec in fields:
                output.append(spec, _continue_rows(spec, arrays, offset, first))
            offset["pose_start"] += len(arrays["polyline_patch"])
            offset["polyline_start"] += len(arrays["points"])
        for spec, column in zip(TIMING, timing[1:], strict=True):
            output.add(spec, column)
    with ContourFile(path) as copied:
        copied.require_whole()


def _continue_rows(spec: Field, arrays: dict[str, NDArray[Any]], offset: dict[str, int], first: int) -> NDArray[Any]:
    """Rows of a field as they go on behind those before; a block that is not the first has its 0 left out."""
    if spec.name not in arrays:  # this block is of a part without it
        return np.full(len(arrays["points"]), spec.absent, spec.dtype)
    rows = arrays[spec.name]
    return rows[int(first > 0) :] + offset[spec.name] if spec.is_offset else rows


def _reread(part: FilePart) -> Iterator[Digests]:
    """Digests of the content of each field's whole chunks, read from the disk; raises ContourFileError, OSError."""
    with open_regular(part.path, ANY_SIZE) as stream:
        require_size(stream.fileno(), part.path, part.rows.end)
        for index, spec in enumerate(part.rows.fields):
            content = memoryview(bytearray(chunk_bytes(spec)))
            digests = np.zeros(len(part.rows.addresses[index]), np.uint64)
            for number, address in enumerate(part.rows.addresses[index]):
                count = os.preadv(stream.fileno(), [content], address)
                rows_digest = proven_digest(content[:count], spec, part.rows.digest(index, number))
                if rows_digest is None:
                    first = number * CHUNK_ROWS
                    raise ContourFileError(
                        f"{part.path}: rows {first} to {first + CHUNK_ROWS} of {spec.path} are not what was written; "
                        'mode="resume" renders them again'
                    )
                digests[number] = rows_digest
            yield digests


def _assembly_of(rows: Rows, digests: list[Digests], header: FileHeader, timing: Timing, frame: FileFrame) -> Assembly:
    assembly = _new_assembly(header, rows.end)
    for name, values in _attributes(header, timing).items():
        assembly.attributes(name, values)
    _add_arrays(assembly, header, frame.room)
    assembly.add_rows(rows, digests)
    for spec, column in zip(TIMING, timing[1:], strict=True):
        assembly.add(spec, column)
    return assembly


def _attributes(header: FileHeader, timing: Timing) -> dict[str, dict[str, Any]]:
    return header_attributes(header) | {"/timing": {"stages": json_text({"stages": timing.stages}, "timing")}}


def _new_assembly(header: FileHeader, end: int) -> Assembly:
    assembly = Assembly(end)
    for name, values in header_attributes(header).items():
        assembly.attributes(name, values)
    return assembly


def _add_arrays(assembly: Assembly, header: FileHeader, address: int) -> int:
    """Give a file motion and mesh, which lie there from an address on; where they end."""
    for spec, array in _arrays(header):
        address = assembly.add_written(spec, array, address)
    return address


def _arrays(header: FileHeader) -> list[tuple[Field, NDArray[Any]]]:
    arrays = header.arrays()
    return [(spec, arrays[spec.name]) for spec in HEADER if spec.name in arrays]
