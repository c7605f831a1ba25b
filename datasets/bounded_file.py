"""Reading untrusted files: only regular files, and within a byte budget, which also holds for decompressed content.

| a file is refused if it                          | when                                                           |
|--------------------------------------------------|----------------------------------------------------------------|
| is a pipe, a socket, a device or a folder        | on opening, without waiting for a writer                       |
| is larger than the budget                        | before it is read                                              |
| decompresses to more than the budget             | before that is allocated, whatever size the file declares      |
| is JSON or TOML that would need more memory      | before it is parsed                                            |
| is named by a file in another folder             | before it is opened                                            |
"""

import bz2
import gzip
import io
import os
import stat
import sys
import zipfile
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, BinaryIO

LIMIT_VARIABLE = "PALPATE_READ_MB"
"""Environment variable: budget of one file, compressed and decompressed [MB]."""
LIMIT_DEFAULT = 3_000_000_000
"""Budget without the variable [byte]: the largest float32 volume in Warp, or 60 million STL triangles."""

ANY_SIZE = 1 << 63
"""A size that no file exceeds [byte]."""


_BLOCK_BYTES = 1 << 20
_BROKEN = (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError, ValueError)
_PACKED = "what is packed in it"
# Most bytes that CPython 3.11 allocates per such character of JSON (measured): a list, an object, a unique name, and
# a number or text with its list entry.
_MARK_BYTES = {"[": 64, "{": 160, ":": 128, "=": 128, ",": 64}


class FileBoundError(OSError):
    """A file is not read because it is not a regular file, too large or in a forbidden place; the message names why."""


def byte_limit() -> int:
    """Budget of one file, compressed and decompressed [byte]; raises FileBoundError if LIMIT_VARIABLE is no number."""
    text = os.environ.get(LIMIT_VARIABLE, "")
    if not text:
        return LIMIT_DEFAULT
    if not (text.isascii() and text.isdecimal() and 0 < int(text[:12]) <= 10**9):
        raise FileBoundError(f"{LIMIT_VARIABLE} must be a whole number of megabytes above 0, not {text[:40]!r}")
    return int(text) * 10**6


def require_bytes(count: int, what: str) -> None:
    """Raise FileBoundError if `count` bytes exceed the budget; `what` is the subject of the message."""
    limit = byte_limit()
    if count > limit:
        raise FileBoundError(
            f"{what} takes {count} bytes, more than the {limit} that one file may: "
            f"{LIMIT_VARIABLE}={-(-count // 10**6)} in the environment allows it"
        )


def open_regular(path: str | os.PathLike[str], most: int | None = None) -> BinaryIO:
    """Open a regular file for reading; a pipe or device is refused at once, where `open` would wait for its writer.

    most: largest size [byte]; None: the budget. Callers that read in blocks pass `ANY_SIZE`.

    Raises:
        FileBoundError: It is not a regular file, or larger than `most`.
        OSError: From the system.
    """
    stream = open(path, "rb", opener=_open_unblocked)  # noqa: SIM115 - the caller closes it
    try:
        status = os.fstat(stream.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise FileBoundError("is no regular file")
        if most is None:
            require_bytes(status.st_size, "it")
        elif status.st_size > most:
            raise FileBoundError(f"it takes {status.st_size} bytes, more than the {most} that such a file may")
    except BaseException:
        stream.close()
        raise
    return stream


def _open_unblocked(path: str, flags: int) -> int:
    """Open a file with O_NONBLOCK, so that opening a pipe does not wait for its writer."""
    return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)


def read_content(path: str | os.PathLike[str], most: int | None = None) -> bytes:
    """All bytes of a regular file; arguments and errors as `open_regular`."""
    with open_regular(path, most) as stream:
        return read_limited(stream, "it", most)


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file, UTF-8 with or without a byte order mark, CRLF as LF; raises as `open_regular`, and
    UnicodeDecodeError."""
    with io.TextIOWrapper(io.BytesIO(read_content(path)), encoding="utf-8-sig") as stream:
        return stream.read()


def read_limited(stream: IO[bytes] | gzip.GzipFile | bz2.BZ2File, what: str, declared: int | None = None) -> bytes:
    """All bytes of a stream; raises FileBoundError once they exceed the budget or the declared size [byte]."""
    limit = byte_limit() if declared is None else min(declared, byte_limit())
    content = bytearray()
    while block := stream.read(min(_BLOCK_BYTES, limit + 1 - len(content))):
        content += block
        if len(content) > limit == declared:
            raise FileBoundError(f"{what} takes more than the {declared} bytes that are declared")
        require_bytes(len(content), what)
    return bytes(content)


def unpack(content: bytes, codec: str, declared: int | None = None, begin: int | None = None) -> bytes:
    """Decompress `gzip`, `bzip2` or `zlib`; begin: only the first so many bytes, or all if there are fewer.

    Raises FileBoundError beyond the budget or the declared size [byte], ValueError if damaged.
    """
    with _naming_damage("where it is packed"):
        if codec == "zlib":
            limit = byte_limit() if declared is None else min(declared, byte_limit())
            stream = io.BytesIO(zlib.decompressobj().decompress(content, limit + 1))
        else:
            stream = {"gzip": gzip.open, "bzip2": bz2.open}[codec](io.BytesIO(content))
        with stream:
            return read_limited(stream, _PACKED, declared) if begin is None else stream.read(begin)


@contextmanager
def _naming_damage(where: str) -> Generator[None]:
    """Errors of the decompressors as ValueError."""
    try:
        yield
    except FileBoundError:
        raise
    except _BROKEN as error:
        raise ValueError(f"damaged {where}: {error}") from error


def file_beside(path: Path, name: str) -> Path:
    """Path of the file that the file `path` refers to by `name`, in the same folder or below.

    Raises FileBoundError for an absolute name, for one that leads out of the folder by `..` or a symbolic link, and
    if it is not a regular file.
    """
    folder = path.parent.resolve()
    try:
        found = (folder / name).resolve()
        if os.path.isabs(name) or not found.is_relative_to(folder):
            why = f"must lie in the folder of {path.name} or below"
        elif found.is_file():
            return found
        else:
            why = "is no regular file in its folder" if found.exists() else "is not there"
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, a name that is too long, a cycle of links
        why = f"cannot be: {error}"
    raise FileBoundError(f"names the file {name[:200]!r}, which {why}")


def require_parsable(content: str | bytes) -> None:
    """Raise FileBoundError for JSON, TOML or CSV whose values could take more memory than the budget.

    The bound counts brackets and separators, also those inside texts; this takes a thousandth of the time of parsing.
    """
    marks = _MARK_BYTES.items()
    if isinstance(content, str):
        size = sum(size * content.count(mark) for mark, size in marks)
    else:
        size = sum(size * content.count(mark.encode()) for mark, size in marks)
    require_bytes(size + sys.getsizeof(content), "what its text holds")
