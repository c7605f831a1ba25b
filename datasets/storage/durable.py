"""Writing files completely or not at all, also with kill -9 or a full disk, and locks that admit one writer."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import glob
import hashlib
import os
import secrets
import shutil
import stat
import time
from collections.abc import Generator, Sequence
from pathlib import Path

Buffer = memoryview | bytes | bytearray
"""Bytes to write; a memoryview must have items of one byte."""

TEMPORARY_SUFFIX = ".tmp"
"""Suffix of files that are still being written."""

ABANDONED_SECONDS = 3600.0
"""Age of the last write [s] from which a temporary file counts as left by a killed process."""

_NAME_BYTES = 255  # NAME_MAX of Linux
_DIGEST_DIGITS = 12

_unfinished: set[Path] = set()

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC  # never an existing file or a link


def write_file(path: Path, content: memoryview) -> None:
    """Write a file so that `path` never holds only a part of it; when this returns, it survives a power cut.

    Raises:
        OSError: From the system (ENOSPC, EFBIG, EDQUOT, ...); no temporary file stays.
    """
    with _temporary_file(path) as temporary:
        write_temporary(temporary, content)
        publish(temporary, path)


@contextlib.contextmanager
def whole_file(path: Path, suffix: str = "") -> Generator[Path, None, None]:
    """A temporary path to write a file under; it gets its name, durably, when the block ends, and goes if it raises.

    suffix: how the temporary name ends, for writers that choose a format by it.

    Raises:
        OSError: From the system (ENOSPC, EFBIG, EDQUOT, ...); no temporary file stays.
    """
    with _temporary_file(path, suffix) as temporary:
        yield temporary
        sync(temporary)
        publish(temporary, path)


@contextlib.contextmanager
def _temporary_file(path: Path, suffix: str = "") -> Generator[Path, None, None]:
    """A temporary path, removed if the block raises or `discard_unfinished` is called."""
    remove_abandoned(path, suffix)
    temporary = temporary_name(path, suffix)
    with unfinished(temporary):
        try:
            yield temporary
        except BaseException:
            discard(temporary)
            raise


@contextlib.contextmanager
def unfinished(temporary: Path) -> Generator[None, None, None]:
    """Have `discard_unfinished` remove a file, until the block ends."""
    _unfinished.add(temporary)
    try:
        yield
    finally:
        _unfinished.discard(temporary)


def discard_unfinished() -> None:
    """Remove all files that are half written, before this process ends in the middle of its work."""
    for temporary in tuple(_unfinished):
        discard(temporary)


def temporary_name(path: Path, suffix: str = "") -> Path:
    """A random name in the file's folder to write it under, so that no other user can plant a link there.

    suffix: how it ends, for writers that choose a format by the name.
    """
    return fitting_name(path, f".{secrets.token_hex(6)}{TEMPORARY_SUFFIX}{suffix}")


def fitting_name(path: Path, ending: str) -> Path:
    """A path with an ASCII ending behind its name; of a name that is too long then, its front and a digest."""
    most = _NAME_BYTES - len(ending)
    if len(os.fsencode(path.name)) <= most:
        return path.with_name(path.name + ending)
    digest, front = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:_DIGEST_DIGITS], path.name
    while len(os.fsencode(front)) > most - 1 - _DIGEST_DIGITS:
        front = front[:-1]  # whole characters, as some file systems take no other bytes
    return path.with_name(f"{front}~{digest}{ending}")


def temporary_files(path: Path, suffix: str = "") -> list[Path]:
    """Temporary files of `path` that are there (`temporary_name`), of whichever process."""
    ending = f".{'0' * 12}{TEMPORARY_SUFFIX}{suffix}"
    front = glob.escape(str(fitting_name(path, ending)).removesuffix(ending))
    return [Path(name) for name in glob.glob(f"{front}.{'[0-9a-f]' * 12}{TEMPORARY_SUFFIX}{suffix}")]


def remove_abandoned(path: Path, suffix: str = "") -> None:
    """Remove temporary files of `path` (`temporary_name`) that killed processes have left."""
    for left in temporary_files(path, suffix):
        with contextlib.suppress(OSError):  # another process has removed it
            if time.time() - os.lstat(left).st_mtime >= ABANDONED_SECONDS:
                os.unlink(left)


def write_temporary(path: Path, content: memoryview) -> None:
    """Write a new file and sync it to the disk; raises OSError, also if the name exists."""
    handle = os.open(path, _NEW, 0o666)
    try:
        while content:
            content = content[os.write(handle, content) :]
        os.fsync(handle)
    finally:
        os.close(handle)


def write_buffers(path: Path, buffers: Sequence[Buffer]) -> None:
    """Write buffers one after another into a new file, or anew, without syncing it; raises OSError."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC
    with os.fdopen(os.open(path, flags, 0o666), "wb") as stream:
        stream.writelines(buffers)


def publish(temporary: Path, path: Path) -> None:
    """Rename a synced file to its final name, replacing any old file, and sync the folder."""
    os.replace(temporary, path)
    sync(path.parent)


def sync(path: Path) -> None:
    """Sync a file's content, or a folder's entries, to the disk; raises OSError."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def discard(path: Path) -> None:
    """Remove a file; errors are ignored, as the next writer tries again."""
    with contextlib.suppress(OSError):
        path.unlink()


def discard_tree(path: Path) -> None:
    """Remove a file, a link, or a folder with all that is in it; errors are ignored."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        discard(path)


def open_own(path: Path, flags: int) -> int:
    """Open a regular file that palpate writes; a symbolic link is refused, and a FIFO is refused without waiting.

    Raises:
        OSError: From the system, or it is not a regular file.
    """
    handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC, 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    return handle


def is_locked(path: Path) -> bool:
    """Whether any process holds a lock on a file now."""
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
    """Exclusive lock on writing in a folder, held until `release` or until the process ends, even by kill -9.

    name: of the lock's file, where a folder has several things to lock.

    Raises:
        BlockingIOError: Another process, or another lock object of this process, holds it.
        OSError: From the system, or the lock's file is not a regular file.
    """

    NAME = "lock"

    def __init__(self, folder: Path, name: str = NAME) -> None:
        self._path = folder / name
        self._handle = open_own(self._path, os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._refuse_if_replaced()
        except OSError:
            os.close(self._handle)
            raise

    def _refuse_if_replaced(self) -> None:
        # Between open and flock the last holder may have removed the file; a lock on a removed file excludes no one.
        try:
            current = os.stat(self._path)
        except FileNotFoundError:
            current = None
        if current is None or current.st_ino != os.fstat(self._handle).st_ino:
            raise BlockingIOError(errno.EWOULDBLOCK, "the folder was being finished by another process", self._path)

    @classmethod
    def is_held(cls, folder: Path) -> bool:
        """Whether any process holds the lock of a folder now."""
        return is_locked(folder / cls.NAME)

    def remove(self) -> None:
        """Remove the lock's file while holding the lock, before the folder itself is removed."""
        discard(self._path)

    def release(self) -> None:
        """Release the lock; a second call does nothing."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1
