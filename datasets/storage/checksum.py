"""The two checksums that HDF5 keeps: Fletcher-32 of a chunk, Jenkins' lookup3 of its own metadata.

Both are computed exactly as libhdf5 does, because datasets/contour_file/rows.py writes chunks without libhdf5; tests
compare the two.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MODULUS = 65535
_COLUMNS = 2048  # words a row: sums of rows and of columns then run at the speed of memory
_BYTES_MOST = 1 << 24  # of one content, so that weighted sums fit 63 bits

_MASK = 0xFFFFFFFF


def fletcher32(contents: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Fletcher-32 of each row of bytes as HDF5's filter computes it: big-endian words of 16 bits, modulo 65535.

    contents: shape [content, byte]. Sums are taken of little-endian words: swapping a word's bytes multiplies it by 256
    modulo 65535.

    Raises:
        ValueError: A content has more than 16 MiB.
    """
    size = contents.shape[1]
    if size > _BYTES_MOST:
        raise ValueError(f"a checksum is of at most {_BYTES_MOST} bytes, not {size}")
    if size % 2:  # a last byte counts as the high one of a word
        contents = np.pad(contents, ((0, 0), (0, 1)))
    total, weighted = _sums(np.ascontiguousarray(contents).view("<u2"))
    return _fold(weighted) << np.uint32(16) | _fold(total)


def _sums(words: NDArray[np.uint16]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of each row, the sum of its words, and that sum weighted with how many are left, the word itself included."""
    count, size = words.shape
    whole = size // _COLUMNS * _COLUMNS
    table = words[:, :whole].reshape(count, -1, _COLUMNS)
    rows = table.sum(axis=2, dtype=np.uint32).astype(np.int64)
    columns = table.sum(axis=1, dtype=np.uint32).astype(np.int64)
    rest = words[:, whole:].astype(np.int64)
    total = rows.sum(axis=1) + rest.sum(axis=1)
    placed = (
        _weighted_sum(rows, _COLUMNS) + _weighted_sum(columns, 1) + _weighted_sum(rest, 1) + whole * rest.sum(axis=1)
    )
    return total, size * total - placed


def _weighted_sum(sums: NDArray[np.int64], step: int) -> NDArray[np.int64]:
    """Of each row, the sum of its entries, each times its place; places are `step` apart."""
    return np.asarray(sums @ np.arange(0, step * sums.shape[1], step), np.int64)


def _fold(total: NDArray[np.int64]) -> NDArray[np.uint32]:
    """Sums of little-endian words as of big-endian ones, folded to 16 bits: never 0 unless all words are."""
    folded = (total % _MODULUS * 256 - 1) % _MODULUS + 1
    return np.where(total > 0, folded, 0).astype(np.uint32)


def lookup3(content: bytes) -> int:
    """Bob Jenkins' lookup3 (hashlittle, initial value 0) of some bytes, for the superblock's few."""
    a = b = c = 0xDEADBEEF + len(content) & _MASK
    rest = content
    while len(rest) > 12:
        a, b, c = (x + int.from_bytes(rest[4 * k : 4 * k + 4], "little") & _MASK for k, x in enumerate((a, b, c)))
        for bits in (4, 6, 8, 16, 19, 4):
            a = (a - c & _MASK) ^ _rotate_bits(c, bits)
            c = c + b & _MASK
            a, b, c = b, c, a
        rest = rest[12:]
    if not rest:
        return c
    rest = rest.ljust(12, b"\0")
    a, b, c = (x + int.from_bytes(rest[4 * k : 4 * k + 4], "little") & _MASK for k, x in enumerate((a, b, c)))
    for bits in (14, 11, 25, 16, 4, 14, 24):
        c = (c ^ b) - _rotate_bits(b, bits) & _MASK
        a, b, c = b, c, a
    return b


def _rotate_bits(x: int, bits: int) -> int:
    return (x << bits | x >> 32 - bits) & _MASK
