"""Reading files of strangers: regular files only, and no more bytes than a budget, also where they are compressed.

| a file that                                   | is refused                                                        |
|-----------------------------------------------|-------------------------------------------------------------------|
| is a pipe, a socket, a device or a folder     | when it is opened, without waiting for a writer                   |
| is larger than the budget                     | before it is read                                                 |
| unpacks to more than the budget, or says so   | before that is allocated; what it says of itself is not believed  |
| is JSON or TOML that would need more memory   | before it is parsed                                               |
| another file names, but lies in another place | before it is opened                                               |
"""

import bz2
import gzip
import io
import json
import os
import re
import stat
import sys
import tomllib
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO

LIMIT_VARIABLE = "PALPATE_READ_MB"
"""Environment variable: how much one file may hold, packed and unpacked [MB]."""
LIMIT_DEFAULT = 3_000_000_000
"""The same without it [byte]: the largest volume that Warp holds, in float32; or 60 million triangles of STL."""

ANY_SIZE = 1 << 63
"""[byte] that no file exceeds."""

DEPTH_MOST = 900
"""Lists and objects of JSON in each other."""
LINE_MOST = 1 << 20
"""Characters of one line of text."""
CODE_MOST = 16_000_000
"""Bytes of one file of source code, a hundred times the longest that people write."""
TOML_MOST = 1 << 24
"""Characters of one TOML text, a hundred times the longest plan."""
KEY_PARTS_MOST = 32
"""Parts of one dotted key of TOML."""

_BLOCK_BYTES = 1 << 20
_BROKEN = (zipfile.BadZipFile, zlib.error, gzip.BadGzipFile, EOFError, RuntimeError, NotImplementedError, ValueError)
# What CPython allocates at most for each of these in JSON, measured with 3.11: a list, an object, a name that is there
# once only, a number or a text with its place.
_MARK_BYTES = {"[": 64, "{": 160, ":": 128, "=": 128, ",": 64}


class FileBoundError(OSError):
    """A file is not read: it is no regular file, too large, or lies where it may not; the message says which."""


# A bare or quoted part and its dot, in linear time: nothing that a part has taken is tried again.
_PART = r"""(?>(?<![A-Za-z0-9_-])[A-Za-z0-9_-]++|(?<!\\)"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(f"(?:{_PART}){{{KEY_PARTS_MOST}}}")


def byte_limit() -> int:
    """How many bytes one file may hold, packed and unpacked; raises FileBoundError where the variable is no number."""
    text = os.environ.get(LIMIT_VARIABLE, "")
    if not text:
        return LIMIT_DEFAULT
    if not (text.isascii() and text.isdecimal() and 0 < int(text[:12]) <= 10**9):
        raise FileBoundError(f"{LIMIT_VARIABLE} must be a whole number of megabytes above 0, not {text[:40]!r}")
    return int(text) * 10**6


def require_bytes(count: int, what: str) -> None:
    """Raise FileBoundError for more bytes than may be read; `what` needs them."""
    limit = byte_limit()
    if count > limit:
        raise FileBoundError(
            f"{what} takes {count} bytes, more than the {limit} that one file may: "
            f"{LIMIT_VARIABLE}={-(-count // 10**6)} in the environment allows it"
        )


def open_regular(path: str | os.PathLike[str], most: int | None = None) -> BinaryIO:
    """Open a regular file for reading; a pipe or a device is refused at once, where `open` would wait for its writer.

    most: bytes that it may hold; None: the budget. `ANY_SIZE` is for callers that read in blocks.

    Raises:
        FileBoundError: It is no regular file, or larger than that.
        OSError: As the system says.
    """
    stream = open(path, "rb", opener=_unblocked)  # noqa: SIM115 - the caller closes it
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


def _unblocked(path: str, flags: int) -> int:
    """Open a file without waiting, as a pipe would for its writer."""
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
    """All that a stream gives; raises FileBoundError once it is more than the budget, or than is declared."""
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


def gunzipped(content: bytes, declared: int | None = None) -> bytes:
    """What gzip has packed; raises FileBoundError for more than the budget or than declared, ValueError where it is
    damaged."""
    return _unpacked(gzip.open(io.BytesIO(content)), declared)


def bunzipped(content: bytes, declared: int | None = None) -> bytes:
    """What bzip2 has packed; raises as `gunzipped`."""
    return _unpacked(bz2.open(io.BytesIO(content)), declared)


def inflated(content: bytes) -> bytes:
    """What zlib has packed; raises as `gunzipped`."""
    limit = byte_limit()
    try:
        unpacked = zlib.decompressobj().decompress(content, limit + 1)
    except zlib.error as error:
        raise ValueError(f"damaged where it is packed ({error})") from error
    require_bytes(len(unpacked), "what is packed in it")
    return unpacked


def _unpacked(stream: gzip.GzipFile | bz2.BZ2File, declared: int | None) -> bytes:
    try:
        with stream:
            return read_limited(stream, "what is packed in it", declared)
    except FileBoundError:
        raise
    except (*_BROKEN, OSError) as error:
        raise ValueError(f"damaged where it is packed ({error})") from error


def unzipped(content: bytes) -> dict[str, bytes]:
    """The members of a zip file by name, within the budget together, whatever it says of their sizes.

    Raises FileBoundError; ValueError for a damaged file.
    """
    members: dict[str, bytes] = {}
    taken = 0
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            require_bytes(sum(member.file_size for member in archive.infolist()), "what is packed in it")
            for member in archive.infolist():
                with archive.open(member) as stream:
                    members[member.filename] = read_limited(stream, "what is packed in it")
                taken += len(members[member.filename])
                require_bytes(taken, "what is packed in it")
    except FileBoundError:
        raise
    except _BROKEN as error:
        raise ValueError(f"damaged zip file: {error}") from error
    return members


def file_beside(path: Path, name: str) -> Path:
    """The file that another one names, in its own folder or below.

    Raises FileBoundError for an absolute name, one that leads out of the folder, by `..` or by a symbolic link, and
    for what is no regular file there.
    """
    folder = path.parent.resolve()
    try:
        found = (folder / name).resolve()
        lies_within = not os.path.isabs(name) and found.is_relative_to(folder)
        is_regular = lies_within and found.is_file()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, a name too long, links in a circle
        raise FileBoundError(f"names the file {name[:200]!r}, which cannot be: {error}") from error
    if not lies_within:
        raise FileBoundError(f"names the file {name[:200]!r}, which must lie in the folder of {path.name} or below")
    if not found.exists():
        raise FileBoundError(f"names the file {name[:200]!r}, which is not there")
    if not is_regular:
        raise FileBoundError(f"names the file {name[:200]!r}, which is no regular file in its folder")
    return found


def require_parsable(content: str | bytes) -> None:
    """Raise FileBoundError for JSON, TOML or CSV whose values might take more memory than the budget.

    Its brackets and separators are counted for that, also those in texts, which takes a thousandth of parsing it.
    """
    marks = _MARK_BYTES.items()
    if isinstance(content, str):
        size = sum(size * content.count(mark) for mark, size in marks)
    else:
        size = sum(size * content.count(mark.encode()) for mark, size in marks)
    require_bytes(size + sys.getsizeof(content), "what its text holds")


def text_lines(stream: IO[bytes]) -> Iterator[str]:
    """Lines of UTF-8 text with or without a byte order mark, each ended by one LF, the last maybe not.

    Raises ValueError, naming the line, for one of more than 1 MiB; UnicodeDecodeError.
    """
    with io.TextIOWrapper(stream, encoding="utf-8-sig") as lines:
        number = 1
        while line := lines.readline(LINE_MOST + 1):
            if len(line) > LINE_MOST:
                raise ValueError(f"line {number}: has more than {LINE_MOST} characters")
            yield line
            number += 1


def parse_json(text: str) -> Any:
    """What JSON says.

    Raises:
        FileBoundError: It might take more memory than the budget.
        ValueError: It is no JSON (json.JSONDecodeError), nested too deeply, or has a number of too many digits.
    """
    require_parsable(text)
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except json.JSONDecodeError:
        raise
    except ValueError:  # Python's bound on the digits of an integer
        raise ValueError("a number has too many digits") from None
    _require_shallow(value)
    return value


def _require_shallow(value: Any) -> None:
    """Refuse depth that what comes after could not follow; Python 3.13 parses far more than 3.11 did."""
    level: list[Any] = [value] if isinstance(value, list | dict) else []
    below: list[Any]
    for _ in range(DEPTH_MOST):
        below = [own.values() if isinstance(own, dict) else own for own in level]
        level = [item for items in below for item in items if isinstance(item, list | dict)]
        if not level:
            return
    raise ValueError("nested too deeply")


def read_json(path: str | os.PathLike[str]) -> Any:
    """What a JSON file says; raises as `read_text` and `parse_json`."""
    return parse_json(read_text(path))


def parse_toml(text: str) -> dict[str, Any]:
    """What TOML says.

    Python's parser takes memory with the square of a key's parts: 4 GB for a key of 60 kB.

    Raises ValueError (tomllib.TOMLDecodeError) for what is no TOML, is nested too deeply, holds more than TOML_MOST
    characters, or more than KEY_PARTS_MOST parts joined by dots, also in a text or a comment.
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
