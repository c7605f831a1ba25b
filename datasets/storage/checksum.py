"""Jenkins' lookup3, the checksum that HDF5 keeps of its own metadata."""

from __future__ import annotations

_MASK = 0xFFFFFFFF


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
