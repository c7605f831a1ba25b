"""HDF5's index of a chunked dataset, and the end of its superblock, for chunks that libhdf5 did not write.

The index is a version 1 B-tree of chunks, which every HDF5 reads (HDF5 File Format Specification 3.0, III.A.1).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .checksum import lookup3

NO_ADDRESS = (1 << 64) - 1
CHILDREN_MOST = 64  # of a node: twice the K that files have unless they say otherwise
_HEAD = struct.Struct("<4sBBHQQ")  # signature, type, level, children, left and right sibling
_CHUNKS = 1  # type of a tree of chunks
_END_AT, _CHECKSUM_AT = 28, 44  # in a superblock of version 2


@dataclass(frozen=True)
class ChunkTable:
    """The chunks of one dataset, in the order of its rows."""

    addresses: Sequence[int]
    sizes: Sequence[int]
    """In the file, checksums included [byte]."""
    chunk_shape: tuple[int, ...]
    """Rows of a chunk, then the shape of a row."""
    item_size: int
    """Of an element [byte]."""


def leaf_of_one(size: int, address: int, dimensions: int) -> bytes:
    """Start of libhdf5's index root for a dataset with only its first chunk."""
    head = _HEAD.pack(b"TREE", _CHUNKS, 0, 1, NO_ADDRESS, NO_ADDRESS)
    return head + struct.pack(f"<II{dimensions + 1}QQ", size, 0, *[0] * (dimensions + 1), address)


def index_nodes(table: ChunkTable, address: int) -> tuple[bytes, list[bytes]]:
    """The root of a dataset's index, and the nodes below it, which go to `address` and after, one behind another."""
    dimensions = len(table.chunk_shape)
    entry = np.dtype([("size", "<u4"), ("mask", "<u4"), ("offset", "<u8", (dimensions + 1,)), ("child", "<u8")])
    entries = np.zeros(len(table.addresses), entry)
    entries["size"] = table.sizes
    entries["offset"][:, 0] = np.arange(len(entries)) * table.chunk_shape[0]
    entries["child"] = table.addresses
    end = struct.pack(
        f"<II{dimensions + 1}Q",
        *(0, 0, len(entries) * table.chunk_shape[0], *table.chunk_shape[1:], table.item_size),
    )
    size = _HEAD.size + CHILDREN_MOST * entry.itemsize + len(end)
    below: list[bytes] = []
    level = 0
    while len(entries) > CHILDREN_MOST:
        firsts = range(0, len(entries), CHILDREN_MOST)
        here = [address + (len(below) + k) * size for k in range(len(firsts))]
        around = [NO_ADDRESS, *here, NO_ADDRESS]
        for k, first in enumerate(firsts):
            stop = first + CHILDREN_MOST
            right_key = entries[stop : stop + 1].tobytes()[: len(end)] or end
            below.append(_node(level, entries[first:stop], right_key, (around[k], around[k + 2]), size))
        entries = entries[::CHILDREN_MOST].copy()
        entries["child"] = here
        level += 1
    return _node(level, entries, end, (NO_ADDRESS, NO_ADDRESS), size), below


def with_end(superblock: bytes, end: int) -> bytes:
    """A superblock (version 2, its first 48 bytes) with the address of the file's end."""
    return with_checksum(superblock[:_END_AT] + struct.pack("<Q", end) + superblock[_END_AT + 8 :])


def with_checksum(superblock: bytes) -> bytes:
    """A superblock (version 2, its first 48 bytes) with the checksum that belongs to it."""
    return superblock[:_CHECKSUM_AT] + struct.pack("<I", lookup3(superblock[:_CHECKSUM_AT]))


def _node(level: int, entries: np.ndarray, right_key: bytes, siblings: tuple[int, int], size: int) -> bytes:
    head = _HEAD.pack(b"TREE", _CHUNKS, level, len(entries), *siblings)
    return (head + entries.tobytes() + right_key).ljust(size, b"\0")
