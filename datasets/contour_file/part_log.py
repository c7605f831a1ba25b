"""The log of a part: records one after another, each proven by checksums, read one at a time.

A record is the length and CRC-32 of its content and the CRC-32 of these two (uint32, little endian), then its content:
length of a JSON (uint32), the JSON, and binary data. Sizes in a log are checked before memory is allocated for them.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from ..json_text import parse_json
from ..storage.schema import CHUNK_ROWS

RECORD_MOST = 1 << 28
"""[byte] of a record's content: tails take less than a megabyte, and each chunk 9 bytes."""
COUNT_MOST = 1 << 53
"""Rows, poses and bytes that a log may speak of: beyond, not every whole number is a float64."""

_PREFIX = struct.Struct("<III")
_GUARDED = 8  # bytes of the prefix that its last number guards
_LENGTH = struct.Struct("<I")

Record = tuple[dict[str, Any], memoryview, int]
"""JSON, binary data, and where the record ends [byte]."""


def record(head: Mapping[str, Any], *content: bytes) -> bytes:
    """The bytes of a record."""
    text = json.dumps(head).encode()
    payload = b"".join([_LENGTH.pack(len(text)), text, *content])
    prefix = struct.pack("<II", len(payload), zlib.crc32(payload))
    return prefix + _LENGTH.pack(zlib.crc32(prefix)) + payload


def records(stream: BinaryIO, limit: int | None = None) -> Iterator[Record]:
    """Each whole record, up to the one that ends at `limit`; raises ValueError at a damaged one."""
    end = 0
    while len(prefix := stream.read(_PREFIX.size)) == _PREFIX.size:
        size, crc, guard = _PREFIX.unpack(prefix)
        if zlib.crc32(prefix[:_GUARDED]) != guard or not _LENGTH.size <= size <= RECORD_MOST:
            raise ValueError("CRC of a prefix")
        end += _PREFIX.size + size
        if (limit is not None and end > limit) or len(payload := stream.read(size)) < size:
            return
        if zlib.crc32(payload) != crc:
            raise ValueError("CRC")
        begin = _LENGTH.size + _LENGTH.unpack_from(payload)[0]
        head = parse_json(payload[_LENGTH.size : begin], allow_nan=True)  # a stage's time may be NaN
        if not isinstance(head, dict):
            raise ValueError("no JSON object")
        yield cast("dict[str, Any]", head), memoryview(payload)[begin:], end


def number(value: object, least: int = 0) -> int:
    """A whole number that a log may speak of; raises ValueError for anything else."""
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= COUNT_MOST:
        raise ValueError(f"{value!r:.40} is no whole number from {least} to {COUNT_MOST}")
    return value


def counts_of(value: object, order: NDArray[np.uint8], old: list[int]) -> list[int]:
    """Rows of each field after a range of poses, `old` before it; the chunks of `order` are those made whole."""
    counts = [number(count) for count in cast("list[object]", value)] if isinstance(value, list) else []
    if len(counts) != len(old) or any(count < before for count, before in zip(counts, old, strict=True)):
        raise ValueError(f"counts {counts}, after {old}")
    made = [count // CHUNK_ROWS - before // CHUNK_ROWS for count, before in zip(counts, old, strict=True)]
    if np.bincount(order, minlength=len(old)).tolist() != made:
        raise ValueError(f"{len(order)} chunks, expected {made}")
    return counts


def timing_of(value: object) -> dict[str, float]:
    """Seconds by stage; raises ValueError for anything else."""
    if not isinstance(value, dict):
        raise ValueError("timing is no JSON object")
    timing = cast("dict[str, object]", value)
    if not all(isinstance(seconds, int | float) for seconds in timing.values()):
        raise ValueError("timing has what is no number")
    return {stage: float(cast("float", seconds)) for stage, seconds in timing.items()}
