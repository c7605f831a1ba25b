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
import re
import stat
import sys
import tomllib
import zipfile
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO

LIMIT_VARIABLE = "PALPATE_READ_MB"
"""Environment variable: budget of one file, compressed and decompressed [MB]."""
LIMIT_DEFAULT = 3_000_000_000
"""Budget without the variable [byte]: the largest float32 volume in Warp, or 60 million STL triangles."""

ANY_SIZE = 1 << 63
"""A size that no file exceeds [byte]."""

LINE_MOST = 1 << 20
"""Most characters of one line of text."""
CODE_MOST = 16_000_000
"""Largest file of source code [byte], a hundred times the longest that people write."""
TOML_MOST = 1 << 24
"""Most characters of one TOML text, a hundred times the longest sweep plan."""
KEY_PARTS_MOST = 32
"""Most parts of one dotted key in TOML."""

_BLOCK_BYTES = 1 << 20
_BROKEN = (zipfile.BadZipFile, zlib.error, gzip.BadGzipFile, EOFError, RuntimeError, NotImplementedError, ValueError)
# Most bytes that CPython 3.11 allocates per such character of JSON (measured): a list, an object, a unique name, and
# a number or text with its list entry.
_MARK_BYTES = {"[": 64, "{": 160, ":": 128, "=": 128, ",": 64}


class FileBoundError(OSError):
    """A file is not read because it is not a regular file, too large or in a forbidden place; the message names why."""


# One bare or quoted part of a key and its dot; possessive quantifiers never backtrack, so matching takes linear time.
_PART = r"""(?>(?<![A-Za-z0-9_-])[A-Za-z0-9_-]++|(?<!\\)"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(f"(?:{_PART}){{{KEY_PARTS_MOST}}}")


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


def read_content(path: str | os.PathLike[str]) -> bytes:
    """All bytes of a regular file within the budget; raises as `open_regular`."""
    with open_regular(path) as stream:
        return read_limited(stream, "it")


def read_code(path: str | os.PathLike[str]) -> bytes:
    """All bytes of a regular file of source code, at most CODE_MOST; raises as `open_regular`."""
    with open_regular(path, CODE_MOST) as stream:
        return stream.read(CODE_MOST)


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file, UTF-8 with or without a byte order mark, CRLF as LF; raises as `open_regular`, and
    UnicodeDecodeError."""
    with io.TextIOWrapper(io.BytesIO(read_content(path)), encoding="utf-8-sig") as stream:
        return stream.read()


def read_limited(stream: IO[bytes] | gzip.GzipFile | bz2.BZ2File, what: str, declared: int | None = None) -> bytes:
    """All bytes of a stream; raises FileBoundError once they exceed the budget or the declared size [byte]."""
    limit = byte_limit()
    if declared is not None and declared < limit:
        content = stream.read(declared + 1)
        if len(content) > declared:
            raise FileBoundError(f"{what} takes more than the {declared} bytes that are declared")
        return content
    content = bytearray()
    while block := stream.read(min(_BLOCK_BYTES, limit + 1 - len(content))):
        content += block
        if len(content) > limit:
            require_bytes(len(content), what)
    return bytes(content)


def gunzip(content: bytes, declared: int | None = None) -> bytes:
    """Decompress gzip; raises FileBoundError beyond the budget or the declared size [byte], ValueError if damaged."""
    return _decompress(gzip.open(io.BytesIO(content)), declared)


def gunzip_begin(content: bytes, count: int) -> bytes:
    """The first `count` bytes of what gzip packed, or all that there are; raises ValueError if they are damaged."""
    try:
        with gzip.open(io.BytesIO(content)) as stream:
            return stream.read(count)
    except (*_BROKEN, OSError) as error:
        raise ValueError(f"damaged where it is packed ({error})") from error


def bunzip(content: bytes, declared: int | None = None) -> bytes:
    """Decompress bzip2; raises as `gunzip`."""
    return _decompress(bz2.open(io.BytesIO(content)), declared)


def inflate(content: bytes, declared: int | None = None) -> bytes:
    """Decompress zlib; raises as `gunzip`."""
    limit = byte_limit() if declared is None else min(byte_limit(), declared)
    try:
        unpacked = zlib.decompressobj().decompress(content, limit + 1)
    except zlib.error as error:
        raise ValueError(f"damaged where it is packed ({error})") from error
    if declared is not None and declared < len(unpacked):
        raise FileBoundError(f"what is packed in it takes more than the {declared} bytes that are declared")
    require_bytes(len(unpacked), "what is packed in it")
    return unpacked


def _decompress(stream: gzip.GzipFile | bz2.BZ2File, declared: int | None) -> bytes:
    try:
        with stream:
            return read_limited(stream, "what is packed in it", declared)
    except FileBoundError:
        raise
    except (*_BROKEN, OSError) as error:
        raise ValueError(f"damaged where it is packed ({error})") from error


def unzip(content: bytes, names: Collection[str] | None = None) -> dict[str, bytes]:
    """Members of a zip file by name, None for all; the budget holds for their total decompressed size.

    Raises FileBoundError beyond the budget, ValueError for a damaged file.
    """
    members: dict[str, bytes] = {}
    taken = 0
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            wanted = [member for member in archive.infolist() if names is None or member.filename in names]
            require_bytes(sum(member.file_size for member in wanted), "what is packed in it")
            for member in wanted:
                with archive.open(member) as stream:
                    members[member.filename] = read_limited(stream, "what is packed in it")
                taken += len(members[member.filename])
                require_bytes(taken, "what is packed in it")
    except FileBoundError:
        raise
    except _BROKEN as error:
        raise ValueError(f"damaged zip file: {error}") from error
    return members


def zip_names(content: bytes) -> list[str]:
    """Names of the members of a zip file; raises ValueError for a damaged file."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return archive.namelist()
    except _BROKEN as error:
        raise ValueError(f"damaged zip file: {error}") from error


def file_beside(path: Path, name: str) -> Path:
    """Path of the file that the file `path` refers to by `name`, in the same folder or below.

    Raises FileBoundError for an absolute name, for one that leads out of the folder by `..` or a symbolic link, and
    if it is not a regular file.
    """
    folder = path.parent.resolve()
    try:
        found = (folder / name).resolve()
        lies_within = not os.path.isabs(name) and found.is_relative_to(folder)
        is_regular = lies_within and found.is_file()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, a name that is too long, a cycle of links
        raise FileBoundError(f"names the file {name[:200]!r}, which cannot be: {error}") from error
    if not lies_within:
        raise FileBoundError(f"names the file {name[:200]!r}, which must lie in the folder of {path.name} or below")
    if not found.exists():
        raise FileBoundError(f"names the file {name[:200]!r}, which is not there")
    if not is_regular:
        raise FileBoundError(f"names the file {name[:200]!r}, which is no regular file in its folder")
    return found


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


def text_lines(stream: IO[bytes]) -> Iterator[str]:
    """Lines of UTF-8 text, with or without a byte order mark; each ends with one LF, except perhaps the last.

    Raises ValueError, naming the line, for a line of more than LINE_MOST characters; UnicodeDecodeError.
    """
    with io.TextIOWrapper(stream, encoding="utf-8-sig") as lines:
        number = 1
        while line := lines.readline(LINE_MOST + 1):
            if len(line) > LINE_MOST:
                raise ValueError(f"line {number}: has more than {LINE_MOST} characters")
            yield line
            number += 1


def parse_toml(text: str) -> dict[str, Any]:
    """The table of a TOML text.

    Raises ValueError (tomllib.TOMLDecodeError) if it is not TOML, is nested too deeply, has more than TOML_MOST
    characters, or more than KEY_PARTS_MOST parts joined by dots, also in a text or a comment. The reason: memory of
    Python's parser grows with the square of a key's parts, to 4 GB for a key of 60 kB.
    """
    if len(text) > TOML_MOST:
        raise ValueError(f"it holds {len(text)} characters, more than {TOML_MOST}")
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"a key has more than {KEY_PARTS_MOST} parts (at line {line})")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
