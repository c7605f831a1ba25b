"""Making rows an ordinary HDF5 file.

One part that begins with pose 0 is sealed where it lies: nothing is copied, and what is done stays done until the name
changes. Several parts, or gzip, are copied into rows of their own first.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from .assembly import ROOM, Assembly, write_assembly
from .durable import append_at, copy_range
from .header import FileHeader, header_attributes, json_text
from .reader import ContourFile, Timing
from .rows import Rows, row_fields
from .schema import HEADER, TIMING, Field


@dataclass(frozen=True)
class Frame:
    """What a file has before its rows: the same for every writer of one run."""

    room: int
    """Bytes for HDF5's metadata, at the beginning."""
    begin: int
    """Where rows begin; motion and mesh lie between the two, as in header.h5."""


def frame_of(header: FileHeader) -> Frame:
    """The frame of a file with this header."""
    texts = sum(len(str(value)) for values in header_attributes(header).values() for value in values.values())
    room = ROOM + (2 * texts // ROOM) * ROOM
    return Frame(room, _add_arrays(Assembly(room), header, room))


def write_header(path: Path, header: FileHeader) -> None:
    """Write a file with a header alone; when this returns, it is on the disk. Raises OSError."""
    room = frame_of(header).room
    assembly = _begun(header, room)
    for spec, array in _arrays(header):
        assembly.add(spec, array)
    write_assembly(path, assembly, room, room, fresh=True)


def seal_rows(path: Path, rows: Rows, header: FileHeader, timing: Timing, frame: Frame) -> None:
    """Make a file of rows, behind motion and mesh, an HDF5 file; when this returns, it is on the disk.

    Raises OSError where the disk is full or fails: what lies between the room and `rows.end` is as it was.
    """
    assembly = _begun(header, rows.end)
    _add_arrays(assembly, header, frame.room)
    assembly.add_rows(rows)
    assembly.attributes("/timing", {"stages": json_text({"stages": timing.stages}, "timing")})
    for spec, column in zip(TIMING, timing[1:], strict=True):
        assembly.add(spec, column)
    write_assembly(path, assembly, rows.end, frame.room)


def copy_rows(path: Path, source: ContourFile, header_path: Path, frame: Frame, *, gzip: int) -> Rows:
    """Motion, mesh and rows of a file of several parts, all poses of it done, in a new file.

    Raises OSError, ContourFileError.
    """
    copy_range(header_path, path, frame.room, frame.begin, fresh=True)
    rows = Rows(row_fields(source.optional), frame.begin, gzip)
    for first, stop in source.blocks():
        growth, chunks = rows.grown(source.contours(first, stop), source.metrics(first, stop))
        append_at(path, rows.end, chunks, durable=False)  # sealing makes it so
        rows.accept(growth)
    return rows


def _begun(header: FileHeader, end: int) -> Assembly:
    assembly = Assembly(end)
    for name, values in header_attributes(header).items():
        assembly.attributes(name, values)
    return assembly


def _add_arrays(assembly: Assembly, header: FileHeader, address: int) -> int:
    """Give a file motion and mesh, which lie there from an address on; where they end."""
    for spec, array in _arrays(header):
        address = assembly.add_written(spec, array.shape, address)
    return address


def _arrays(header: FileHeader) -> list[tuple[Field, NDArray[Any]]]:
    arrays = header.arrays()
    return [(spec, arrays[spec.name]) for spec in HEADER if spec.name in arrays]
