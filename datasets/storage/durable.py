"""Files that are whole or not there, also after kill -9 and on a full disk; and one writer at a time."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import glob
import os
import secrets
import stat
import time
from collections import deque
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

_BUFFERS_MOST = 1024  # IOV_MAX of Linux
_BLOCK_BYTES = 1 << 22

Buffer = memoryview | bytes | bytearray
"""Bytes to write, one item a byte."""

TEMPORARY_SUFFIX = ".tmp"
"""Ends the names of files still being written; such a file found later was left by a killed process."""

ABANDONED_SECONDS = 3600.0
"""A temporary file that was last written to so long ago was left by a killed process."""

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC  # nobody's file, and through nobody's link


def write_file(path: Path, content: memoryview) -> None:
    """Write a file such that `path` never shows a part of it; when this returns, it survives a power cut.

    Raises:
        OSError: As the system says (ENOSPC, EFBIG, EDQUOT, ...); nothing is left behind.
    """
    remove_abandoned(path)
    temporary = temporary_name(path)
    try:
        write_temporary(temporary, content)
        publish(temporary, path)
    except OSError:
        discard(temporary)
        raise


def temporary_name(path: Path) -> Path:
    """Another name beside a file for while it is written, one that nobody can guess and plant a link at."""
    return path.with_name(f"{path.name}.{secrets.token_hex(6)}{TEMPORARY_SUFFIX}")


def remove_abandoned(path: Path) -> None:
    """Remove what killed processes have left of a file, by names of `temporary_name`."""
    for name in glob.glob(f"{glob.escape(str(path))}.{'[0-9a-f]' * 12}{TEMPORARY_SUFFIX}"):
        with contextlib.suppress(OSError):  # another process has removed it
            if time.time() - os.lstat(name).st_mtime >= ABANDONED_SECONDS:
                os.unlink(name)


def write_temporary(path: Path, content: memoryview) -> None:
    """Write a new file, and have it on the disk when this returns; raises OSError, also where the name is taken."""
    handle = os.open(path, _NEW, 0o666)
    try:
        while content:
            content = content[os.write(handle, content) :]
        os.fsync(handle)
    finally:
        os.close(handle)


def append_at(
    path: Path,
    end: int,
    buffers: Sequence[Buffer],
    *,
    front: Buffer = b"",
    durable: bool = True,
    fresh: bool = False,
) -> None:
    """Write behind the first `end` bytes of a file, dropping what else it has.

    front: overwrites its first bytes. durable: have all of it on the disk when this returns. fresh: begin a new file,
    or an old one anew, with `end` zeros; no other file is made or grown, so one that somebody has removed or cut off
    never comes back as zeros.

    Raises:
        OSError: As the system says, or the file has fewer than `end` bytes; it has its first `end` bytes as before,
            but for the front.
    """
    flags = os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC
    handle = os.open(path, flags | (os.O_CREAT | os.O_TRUNC if fresh else 0), 0o666)
    try:
        if not fresh:
            require_size(handle, path, end)
        if os.fstat(handle).st_size != end:  # what a write left that failed or was killed; or a file just made
            os.ftruncate(handle, end)
        _write_at(handle, end, buffers)
        _write_at(handle, 0, [front])
        if durable:
            os.fsync(handle)
    except OSError:
        with contextlib.suppress(OSError):
            if os.fstat(handle).st_size > end:
                os.ftruncate(handle, end)
        raise
    finally:
        os.close(handle)


def require_size(handle: int, path: Path, end: int) -> None:
    """Refuse an open file that has fewer bytes than were written; raises OSError."""
    size = os.fstat(handle).st_size
    if size < end:
        raise OSError(errno.EIO, f"{path.name} has {size} bytes, of {end} that were written: it was cut off")


def copy_range(source: Path, path: Path, first: int, stop: int, *, fresh: bool = False) -> None:
    """Copy a range of bytes of a file to the same place of another one, and have them on the disk; raises OSError.

    fresh: the other one is a new file, or begins anew; else it must be there.
    """
    with source.open("rb") as stream:
        flags = os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC
        handle = os.open(path, flags | (os.O_CREAT | os.O_TRUNC if fresh else 0), 0o666)
        try:
            while first < stop:
                block = os.pread(stream.fileno(), min(_BLOCK_BYTES, stop - first), first)
                if not block:
                    raise OSError(errno.EIO, f"{source} ends at {first} bytes, before {stop}")
                _write_at(handle, first, [block])
                first += len(block)
            os.fsync(handle)
        finally:
            os.close(handle)


def _write_at(handle: int, offset: int, buffers: Sequence[Buffer]) -> None:
    """Write buffers one after another to an open file, from an offset on; raises OSError."""
    left = deque(memoryview(buffer) for buffer in buffers if len(buffer))
    while left:
        count = os.pwritev(handle, list(islice(left, _BUFFERS_MOST)), offset)
        offset += count
        while left and count >= len(left[0]):
            count -= len(left.popleft())
        if count:
            left[0] = left[0][count:]


def publish(temporary: Path, path: Path) -> None:
    """Give a file on the disk its final name, replacing what had it, and have the name on the disk too."""
    os.replace(temporary, path)
    sync(path.parent)


def sync(path: Path) -> None:
    """Have a file's content, or a folder's names, on the disk when this returns; raises OSError."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def discard(path: Path) -> None:
    """Remove a file if it can be removed: a leftover of this kind is removed again by the next writer."""
    with contextlib.suppress(OSError):
        path.unlink()


def open_own(path: Path, flags: int) -> int:
    """Open a regular file that palpate writes, through nobody's link, without waiting for the other end of a pipe.

    Raises:
        OSError: As the system says, or it is no regular file.
    """
    handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC, 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    return handle


def is_locked(path: Path) -> bool:
    """Whether some process holds a lock on a file at this moment."""
    try:
        handle = open_own(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


class FolderLock:
    """Sole right to write in a folder, held until `release` or the end of the process, however it ends.

    Raises:
        BlockingIOError: Another process (or another lock of this one) holds it.
        OSError: As the system says, or the file to lock is no regular file.
    """

    NAME = "lock"

    def __init__(self, folder: Path) -> None:
        self._path = folder / self.NAME
        self._handle = open_own(self._path, os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._refuse_if_replaced()
        except OSError:
            os.close(self._handle)
            raise

    def _refuse_if_replaced(self) -> None:
        # The holder that just finished may have removed the file between open and flock: that lock keeps nobody out.
        try:
            current = os.stat(self._path)
        except FileNotFoundError:
            current = None
        if current is None or current.st_ino != os.fstat(self._handle).st_ino:
            raise BlockingIOError(errno.EWOULDBLOCK, "the folder was being finished by another process", self._path)

    @classmethod
    def is_held(cls, folder: Path) -> bool:
        """Whether some process holds the lock of a folder at this moment."""
        return is_locked(folder / cls.NAME)

    def remove(self) -> None:
        """Remove the lock's file while holding it, when the folder itself is about to go."""
        discard(self._path)

    def release(self) -> None:
        """Let others write; releasing twice does nothing."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1
