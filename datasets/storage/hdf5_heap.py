"""Collections of HDF5's global heap, where texts of any length lie, tried before libhdf5 walks through them.

libhdf5 (2.0 and older) walks through a collection's objects for ever if free space declares 0 bytes (HDF5
File Format Specification 3.0, III.E).
"""

from __future__ import annotations

import struct

SIGNATURE = b"GCOL"
_HEAD = struct.Struct("<4sB3xQ")  # signature, version, size of the collection
_OBJECT = struct.Struct("<HHIQ")  # index, references, reserved, size of the content


def collection_size(content: memoryview) -> int:
    """Size that a heap collection declares [byte]; 0 if it is none. content: its first bytes."""
    if len(content) < _HEAD.size or content[: len(SIGNATURE)].tobytes() != SIGNATURE:
        return 0
    return int(_HEAD.unpack_from(content)[2])


def refuse_endless_heap(content: memoryview) -> None:
    """Raise OSError for a collection in which a walk from object to object does not reach the end."""
    at = _HEAD.size
    while at + _OBJECT.size <= len(content):
        index, _, _, length = _OBJECT.unpack_from(content, at)
        step = length if index == 0 else _OBJECT.size + -(-length // 8) * 8  # free space counts its own head
        if step < _OBJECT.size or at + step > len(content):
            raise OSError(
                f"its heap of texts is damaged: object {index} at byte {at} takes {step} of {len(content)} bytes"
            )
        at += step
