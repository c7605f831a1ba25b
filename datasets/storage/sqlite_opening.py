"""One strict way to open a SQLite file that another program may have written.

Beside a database may lie the journal of a transaction that was not finished. SQLite undoes it when it opens the
database, and then removes the file that the end of the journal names (a super-journal, of a transaction in several
databases): https://www.sqlite.org/fileformat.html#the_rollback_journal. palpate never writes such a name, so a journal
with one is refused. So is what is no regular file: a pipe would keep SQLite waiting, a link leads out of the folder.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import stat
import tempfile
from pathlib import Path

from ..bounded_file import ANY_SIZE, FileBoundError, open_regular

_BESIDE = ("", "-journal", "-wal", "-shm")
_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")  # also ends a journal that names a super-journal
_NAMED_LEAST = 16  # [byte] of a journal that names one: length, checksum and magic, behind the name
_COPIES = 10  # of files that others change meanwhile


def open_database(path: Path, *, writes: bool, busy_seconds: float) -> sqlite3.Connection:
    """Open a database that exists; threads may share the connection.

    writes: whether it may change, which begins with undoing a transaction that a killed process left. Else nothing
    changes: such a transaction is undone in a copy, which lies in the folder for temporary files without a name, and
    is gone when the connection is closed.

    Raises:
        FileBoundError: It, or a file of SQLite's beside it, is no regular file; or its journal names another file.
        OSError, sqlite3.Error: From the system and SQLite.
    """
    _require_own_files(path)
    connection = _connect(path, "rw" if writes else "ro", busy_seconds)
    try:
        connection.execute("PRAGMA user_version")  # the first access: SQLite checks the journal
        return connection
    except sqlite3.OperationalError as error:
        connection.close()
        if writes or error.sqlite_errorname != "SQLITE_READONLY_ROLLBACK":
            raise
    except BaseException:
        connection.close()
        raise
    return _open_copy(path, busy_seconds)


def _connect(path: Path, access: str, busy_seconds: float) -> sqlite3.Connection:
    return sqlite3.connect(
        f"{path.absolute().as_uri()}?mode={access}",
        uri=True,
        timeout=busy_seconds,
        isolation_level=None,
        check_same_thread=False,
    )


def _require_own_files(path: Path) -> None:
    """Refuse what SQLite should not touch. The database itself is not opened: closing it would drop its locks."""
    for suffix in _BESIDE:
        own = Path(f"{path}{suffix}")
        try:
            is_regular = stat.S_ISREG(own.lstat().st_mode)
        except FileNotFoundError:
            continue
        if not is_regular:
            raise FileBoundError(f"{own} is no regular file")
    journal = Path(f"{path}-journal")
    try:
        with open_regular(journal, ANY_SIZE) as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(0, size - len(_JOURNAL_MAGIC)))
            names_another = size >= _NAMED_LEAST and stream.read() == _JOURNAL_MAGIC
    except FileNotFoundError:
        return
    if names_another:
        raise FileBoundError(
            f"{journal} names another file, which SQLite would remove: palpate never writes such a journal, so "
            "another program did; do not use this store"
        )


def _open_copy(path: Path, busy_seconds: float) -> sqlite3.Connection:
    """Open a copy of a database and its journal, in which SQLite undoes the transaction."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        copy = Path(folder) / path.name
        _copy_unchanging(path, copy)
        connection = _connect(copy, "rw", busy_seconds)
        try:
            connection.execute("PRAGMA user_version")
        except BaseException:
            connection.close()
            raise
        return connection  # the file stays as long as it is open; its name goes now


def _copy_unchanging(path: Path, copy: Path) -> None:
    """Copy a database with its journal, as both were at one moment."""
    for _ in range(_COPIES):
        before = _states(path)
        for suffix in ("", "-journal"):
            if Path(f"{path}{suffix}").exists():
                shutil.copyfile(f"{path}{suffix}", f"{copy}{suffix}")
        if _states(path) == before:
            _require_own_files(copy)
            return
    raise FileBoundError(f"{path} is being changed by another process: try again")


def _states(path: Path) -> list[tuple[int, int, int] | None]:
    found: list[tuple[int, int, int] | None] = []
    for suffix in ("", "-journal"):
        try:
            status = os.lstat(f"{path}{suffix}")
        except FileNotFoundError:
            found.append(None)
        else:
            found.append((status.st_ino, status.st_size, status.st_mtime_ns))
    return found
