"""Digests of what files hold: a file with a trailer proves its own bytes, and a list of texts its own.

A trailer is 56 bytes behind a file's content: `palpate KIND VERSION` and a newline (16, filled with zeros), the
content's length (uint64, little-endian) and its BLAKE2b-256. Digests prove against accident: a failing disk, a torn
write, a cut copy. Who changes a file on purpose can also write its new digest.
"""

from __future__ import annotations

import hashlib
import os
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from ..bounded_file import ANY_SIZE, open_regular
from ..errors import SweepStoreError, name_nothing
from .durable import Buffer

TRAILER = struct.Struct("<16sQ32s")
_BLOCK_BYTES = 1 << 20


def content_trailer(kind: str, version: int, content: Buffer) -> bytes:
    """The trailer of content that is in memory; kind: of the file, at most 13 letters with the version."""
    digest = hashlib.blake2b(content, digest_size=32).digest()
    return TRAILER.pack(_mark(kind) + b"%d\n" % version, len(content), digest)


def read_whole(path: Path, kind: str, version: int) -> tuple[bytes, str]:
    """The bytes of a file with a trailer, and the digest of its content, which they are proven to have.

    Raises:
        SweepStoreError: It is missing, damaged, of another kind, or of a newer version than `version`.
    """
    content = _bytes_of(path)
    size, digest = _parse_trailer(path, content[-TRAILER.size :], len(content), kind, version)
    if hashlib.blake2b(memoryview(content)[:size], digest_size=32).digest() != digest:
        raise _damage_error(path)
    return content, digest.hex()


def require_whole(path: Path, kind: str, version: int) -> str:
    """Prove a file with a trailer, read in blocks; the digest of its content; raises as `read_whole`."""
    try:
        with open_regular(path, ANY_SIZE) as stream:
            total, last = _end_of(stream)
        size, digest = _parse_trailer(path, last, total, kind, version)
        found = _file_digest(path, size)
    except OSError as error:
        raise _unreadable(path, error) from error
    if found != digest:
        raise _damage_error(path)
    return digest.hex()


def has_trailer(path: Path, kind: str) -> bool:
    """Whether a file ends with a trailer of a kind; raises SweepStoreError for one that cannot be read."""
    try:
        with open_regular(path, ANY_SIZE) as stream:
            return _end_of(stream)[1].startswith(_mark(kind))
    except OSError as error:
        raise _unreadable(path, error) from error


def text_digest(texts: Iterable[bytes]) -> bytes:
    """BLAKE2b-128 of texts with a newline between two."""
    return hashlib.blake2b(b"\n".join(texts), digest_size=16).digest()


def _mark(kind: str) -> bytes:
    return f"palpate {kind} ".encode()


def _end_of(stream: BinaryIO) -> tuple[int, bytes]:
    """Size of a file [byte], and the bytes of its trailer."""
    total = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, total - TRAILER.size))
    return total, stream.read(TRAILER.size)


def _file_digest(path: Path, size: int) -> bytes:
    digest = hashlib.blake2b(digest_size=32)
    with open_regular(path, ANY_SIZE) as stream:
        while size > 0 and (block := stream.read(min(size, _BLOCK_BYTES))):
            digest.update(block)
            size -= len(block)
    return digest.digest()


def _parse_trailer(path: Path, last: bytes, total: int, kind: str, version: int) -> tuple[int, bytes]:
    """Length and digest of the content from a trailer."""
    if len(last) < TRAILER.size:
        raise SweepStoreError(f"{path} is damaged: {total} bytes are no {kind}")
    mark, size, digest = TRAILER.unpack(last)
    own = mark.rstrip(b"\0").removeprefix(_mark(kind)).strip()
    if not mark.startswith(_mark(kind)) or not own.isdigit():
        raise SweepStoreError(f"{path} is damaged, or no {kind}: its last bytes are not a {kind}'s")
    if int(own) > version:
        raise SweepStoreError(
            f"{path} has format version {int(own)}, this palpate reads up to {version}: a newer one wrote it"
        )
    if size != total - TRAILER.size:
        raise _damage_error(path)
    return size, digest


def _bytes_of(path: Path) -> bytes:
    try:
        with open_regular(path, ANY_SIZE) as stream:
            return stream.read()
    except OSError as error:
        raise _unreadable(path, error) from error


def _damage_error(path: Path) -> SweepStoreError:
    return SweepStoreError(f"{path} is damaged: its checksum does not match")


def _unreadable(path: Path, error: OSError) -> SweepStoreError:
    if isinstance(error, FileNotFoundError):
        return name_nothing(SweepStoreError(f"{path} does not exist"))
    return SweepStoreError(f"{path} cannot be read: {error.strerror or error}")
