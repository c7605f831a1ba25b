"""Writing files completely or not at all, also with kill -9 or a full disk, and locks that admit one writer."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import shutil
import stat
from collections.abc import Generator
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Self

Buffer = memoryview | bytes | bytearray
"""Bytes to write; a memoryview must have items of one byte."""

TEMPORARY_SUFFIX = ".tmp"
"""Suffix of files that are still being written."""

_NAME_BYTES = 255  # NAME_MAX of Linux
_DIGEST_DIGITS = 12
_NAMES_SOUGHT = 4  # temporary names of a path under which what killed writers have left is always found

_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC  # never an existing file or a link

_unfinished: set[NewFile] = set()


class NewFile:
    """A file that is written under a temporary name until `publish` gives it its own name; use it in a `with`.

    Leaving the `with` publishes the file, unless that has happened; leaving it by an exception discards the file. A
    writer holds a shared lock (flock) on its temporary file. So the next writer of the same path knows what killed
    writers have left, and removes it. Two writers of one path do not disturb each other: what is published last stays.
    Temporary names are numbered, so leftovers are found without a listing of the folder, which may have many files.

    path: the file to make or to replace. suffix: end of the temporary name, for libraries that choose a format by it.

    Raises:
        OSError: From the system (ENOSPC, EACCES, ...).
    """

    # A file without a name (O_TMPFILE) would leave nothing after a kill, but linkat replaces no old file, so that a
    # temporary name would come back; besides, SQLite and writers that look at the suffix need a name.

    def __init__(self, path: Path, suffix: str = "") -> None:
        self.path = path
        """The file to make."""
        self.is_named = False
        """Whether the file has its name, if perhaps not for sure on the disk."""
        self._is_published = False
        self.process = os.getpid()
        """The process that writes it."""
        for left in temporary_files(path, suffix):
            discard_left(left)
        self.temporary, self.handle = _create(path, suffix)
        """Path of an empty file to write the content to, and a handle of that file, for reading and writing."""
        _unfinished.add(self)

    def write(self, *buffers: Buffer) -> None:
        """Write buffers one after another, behind what `write` has written before.

        Raises:
            OSError: From the system. The file is discarded, as it may hold a part of a buffer.
        """
        with self._discarding():
            for buffer in buffers:
                left = memoryview(buffer)
                while left:
                    left = left[os.write(self.handle, left) :]

    def publish(self, *, replaces: bool = True) -> None:
        """Give the file its name and have it on the disk; once more does nothing.

        replaces: False refuses to replace a file that has come meanwhile.

        Raises:
            OSError: From the system, or the file was discarded before. If it comes from syncing the folder, the file
                has its name, but a power cut may take that back; publishing again syncs the folder again. Else the file
                is discarded: Linux reports only once that it has lost content, so that trying again proves nothing.
            FileExistsError: There is a file, and `replaces` is False. The new one is discarded.
        """
        if self._is_published:
            return
        if not self.is_named:
            if self.handle < 0:
                raise OSError(errno.EBADF, "was discarded", str(self.temporary))
            with self._discarding():
                os.fsync(self.handle)
                (os.replace if replaces else _link)(self.temporary, self.path)
            self.is_named = True
        sync(self.path.parent)
        self._is_published = True
        self._close()

    @contextlib.contextmanager
    def _discarding(self) -> Generator[None, None, None]:
        try:
            yield
        except OSError:
            self.discard()
            raise

    def discard(self) -> None:
        """Remove the temporary file, unless it has its name; once more does nothing."""
        if not self.is_named:
            discard(self.temporary)
        self._close()

    def _close(self) -> None:
        _unfinished.discard(self)
        if self.handle >= 0:
            os.close(self.handle)
            self.handle = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None and self.handle >= 0:
                self.publish()  # again, if the folder could not be synced
        finally:
            self.discard()


def write_file(path: Path, *buffers: Buffer) -> None:
    """Write a file so that `path` never holds only a part of it; when this returns, it survives a power cut.

    Raises:
        OSError: From the system (ENOSPC, EFBIG, EDQUOT, ...); no temporary file stays.
    """
    with NewFile(path) as new:
        new.write(*buffers)
        new.publish()


def discard_unfinished() -> None:
    """Remove all files that are half written, before this process ends in the middle of its work."""
    for new in tuple(_unfinished):
        if new.process == os.getpid():  # a forked child leaves its parent's files alone
            discard(new.temporary)  # its handle stays open: another thread may be writing to it


def _create(path: Path, suffix: str) -> tuple[Path, int]:
    """A new temporary file and a handle that holds its lock."""
    number = 0
    while True:
        temporary, number = temporary_name(path, number, suffix), number + 1
        try:
            handle = os.open(temporary, _NEW, 0o666)
        except FileExistsError:  # another writer's, or one that somebody planted
            continue
        try:
            # Shared, as readers of HDF5 lock: they may open the file as soon as it has its name.
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:  # another writer has taken it for a left file, and removes it
            os.close(handle)
            continue
        except OSError:  # a file system without locks, where no writer removes what others have left
            return temporary, handle
        if _is_named(handle, temporary):  # it was not removed before it was locked
            return temporary, handle
        os.close(handle)


def discard_left(temporary: Path) -> None:
    """Remove a temporary file, unless a process is writing it, or the file system has no locks that tell."""
    with contextlib.suppress(OSError):
        handle = open_own(temporary, os.O_RDWR)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_named(handle, temporary):  # names are used again: another process may have removed it before
                os.unlink(temporary)
        finally:
            os.close(handle)


def _link(temporary: Path, path: Path) -> None:
    """Give a file its name, unless there is one of that name (FileExistsError)."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without links: two that do this at the same moment replace each other
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        os.replace(temporary, path)
    discard(temporary)


def _is_named(handle: int, path: Path) -> bool:
    """Whether an open file has a name for sure: it may be that of another file by now, or of none."""
    try:
        return os.path.samestat(os.fstat(handle), os.lstat(path))
    except OSError:
        return False


def temporary_name(path: Path, number: int = 0, suffix: str = "") -> Path:
    """A name in the file's folder to write it under; a file or link that has this name is never written to.

    suffix: how it ends, for writers that choose a format by the name.
    """
    return fitting_name(path, f".{number}{TEMPORARY_SUFFIX}{suffix}")


def temporary_files(path: Path, suffix: str = "") -> list[Path]:
    """Temporary files of `path` that are there (`temporary_name`), of whichever process."""
    found: list[Path] = []
    for number in count():
        temporary = temporary_name(path, number, suffix)
        if os.path.lexists(temporary):
            found.append(temporary)
        elif number >= _NAMES_SOUGHT:
            break
    return found


def fitting_name(path: Path, ending: str) -> Path:
    """A path with an ASCII ending behind its name; of a name that is too long then, its front and a digest."""
    most = _NAME_BYTES - len(ending)
    if len(os.fsencode(path.name)) <= most:
        return path.with_name(path.name + ending)
    digest, front = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:_DIGEST_DIGITS], path.name
    while len(os.fsencode(front)) > most - 1 - _DIGEST_DIGITS:
        front = front[:-1]  # whole characters, as some file systems take no other bytes
    return path.with_name(f"{front}~{digest}{ending}")


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
            fcntl.flock(self._handle, fcntl.LOCK_UN)  # closing alone does not while a forked child has the handle, too
            os.close(self._handle)
            self._handle = -1
