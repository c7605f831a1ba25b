"""A study's data file: made whole, opened strictly, and written by transactions that are on the disk when they end.

A power cut decides how it is written. SQLite's rollback journal is truncated at the end of a transaction, and with
`synchronous=FULL` that is synced as well: the transaction is on the disk when the call returns. If the journal were
removed instead, its entry could come back with the power, and SQLite would undo an answer that was reported as saved.
A write-ahead log would keep answers in a second file until they are copied over: who copies `answers.sqlite` alone
would lose them, and it works on no network file system.
"""

import contextlib
import sqlite3
import threading
from collections.abc import Generator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from ....datasets.bounded_file import FileBoundError
from ....datasets.storage.durable import NewFile, sync
from ....datasets.storage.sqlite_opening import open_database
from ...errors import StudyError, StudyStorageError
from .store_rows import APPLICATION_ID, FORMAT_VERSION, SCHEMA

NAME = "answers.sqlite"
BUSY_SECONDS = 20.0
"""How long a write waits for another process's transaction, which takes milliseconds."""

_WAY_OUT = "; move it away and put a copy of it in its place, or name another folder"


class StudyFile:
    """The connection to a study's data file; threads may share it. Every error is a StudyError that names the file."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        self.lock = threading.RLock()
        """Held by a thread that reads or writes."""
        self._connection: sqlite3.Connection | None = None
        self._is_closed = False
        try:
            _make_folder(folder)
            if not self.path.exists():
                self._make()
        except (OSError, sqlite3.Error) as error:
            raise StudyError(f"{self.path} cannot be made: {_reason(error)}") from error
        try:
            with self.lock:
                self._judge(self._connected())
        except (OSError, sqlite3.Error) as error:
            self.close()
            raise StudyError(f"{self.path} cannot be opened: {_reason(error)}") from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close it; closing twice does nothing."""
        with self.lock:
            self._is_closed = True
            self._disconnect()

    def rows(self, statement: str, values: Sequence[Any] = ()) -> list[sqlite3.Row]:
        """The rows of a statement that reads, all read, so that no lock stays."""
        with self.lock:
            try:
                return self._connected().execute(statement, values).fetchall()
            except (OSError, sqlite3.Error) as error:
                self._disconnect()
                raise file_error(self.path, error) from error

    @contextmanager
    def transaction(self, what: str) -> Generator[sqlite3.Connection, None, None]:
        """All within is on the disk when this ends, or nothing of it is there; nobody else writes meanwhile.

        what: subject of the sentence "... is not saved".

        Raises:
            StudyError: It could not be written. What was saved before is there, and the same may be tried again.
            sqlite3.IntegrityError: A row of the kind is there already.
        """
        with self.lock:
            try:
                connection = self._connected()
                connection.execute("BEGIN IMMEDIATE")
                yield connection
                connection.execute("COMMIT")
            except BaseException as error:
                # A disk that was taken away, or a file that was replaced, may be back: the next call opens the file
                # again, and SQLite undoes what lies in its journal.
                with contextlib.suppress(sqlite3.Error):
                    if self._connection is not None and self._connection.in_transaction:
                        self._connection.execute("ROLLBACK")
                self._disconnect()
                if isinstance(error, sqlite3.IntegrityError) or not isinstance(error, OSError | sqlite3.Error):
                    raise
                raise StudyStorageError(
                    f"{what} is not saved: {self.path} cannot be written ({_reason(error)}). Everything that was saved "
                    "before is there. Put this right, then go on"
                ) from error

    def _connected(self) -> sqlite3.Connection:
        if self._is_closed:
            raise StudyError(f"{self.path} is closed")
        if self._connection is None:
            connection = open_database(self.path, writes=True, busy_seconds=BUSY_SECONDS)
            connection.row_factory = sqlite3.Row
            try:
                for pragma in (
                    "journal_mode=TRUNCATE",
                    "synchronous=FULL",
                    "foreign_keys=ON",
                    "secure_delete=ON",  # what a participant withdraws does not stay in free pages
                    "trusted_schema=OFF",
                    "cell_size_check=ON",
                ):
                    connection.execute(f"PRAGMA {pragma}")
            except BaseException:
                connection.close()
                raise
            self._connection = connection
        return self._connection

    def _disconnect(self) -> None:
        if self._connection is not None:
            with contextlib.suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None

    def _make(self) -> None:
        """Make the file under another name, then publish it: it is never there without its tables."""
        with NewFile(self.path) as new:
            with closing(sqlite3.connect(new.temporary, isolation_level=None)) as connection:
                connection.executescript(
                    f"PRAGMA journal_mode=MEMORY; PRAGMA synchronous=FULL; BEGIN; {SCHEMA}"
                    f"PRAGMA application_id={APPLICATION_ID}; PRAGMA user_version={FORMAT_VERSION}; COMMIT"
                )
            with contextlib.suppress(FileExistsError):  # another process was first
                new.publish(replaces=False)

    def _judge(self, connection: sqlite3.Connection) -> None:
        """Refuse what is no study's data, a newer format, and a damaged file."""
        application, version = (
            int(connection.execute(f"PRAGMA {name}").fetchone()[0]) for name in ("application_id", "user_version")
        )
        if application != APPLICATION_ID:
            what = "is empty" if self.path.stat().st_size == 0 else "holds no data of a palpate study"
            raise StudyError(f"{self.path} {what}: move it away, or name another folder")
        if version > FORMAT_VERSION:
            raise StudyError(
                f"{self.path} has format version {version}, this palpate knows up to {FORMAT_VERSION}: a newer one "
                "made it; update palpate"
            )
        with closing(sqlite3.connect(":memory:")) as example:
            example.executescript(SCHEMA)
            lacking = _entries(example) - _entries(connection)
        if lacking or version < 1:
            name = min((own[1] for own in lacking), default="its version")
            raise StudyError(f"{self.path} is damaged: {name!r} is not as palpate made it{_WAY_OUT}")
        triggers = [own[1] for own in _entries(connection) if own[0] == "trigger"]
        if triggers:
            raise StudyError(f"{self.path} has a trigger, {min(triggers)!r:.80}, which could change answers: remove it")
        found = [own[0] for own in connection.execute("PRAGMA integrity_check(1)")]
        if found != ["ok"]:
            fault = " ".join(str(found[0]).replace("*** in database main ***", "").split())
            raise StudyError(f"{self.path} is damaged: {fault}{_WAY_OUT}")


def _make_folder(folder: Path) -> None:
    """Make a folder whose entry, and whose parents' entries, survive a power cut."""
    if not folder.is_dir():
        _make_folder(folder.parent)
        folder.mkdir(exist_ok=True)
        sync(folder.parent)


def _entries(connection: sqlite3.Connection) -> set[tuple[str, str, str]]:
    """Type, name and definition of tables, indexes, views and triggers, whatever spaces they have."""
    rows = connection.execute("SELECT type, name, coalesce(sql, '') FROM sqlite_master")
    return {(str(own[0]), str(own[1]), " ".join(str(own[2]).split())) for own in rows}


def file_error(path: Path, error: OSError | sqlite3.Error | FileBoundError) -> StudyError:
    """The error of a data file that cannot be read."""
    return StudyError(f"{path} cannot be read: {_reason(error)}")


def _reason(error: OSError | sqlite3.Error) -> str:
    """The system's or SQLite's reason, in a user's words."""
    if isinstance(error, FileBoundError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror or error)
    code, text = str(getattr(error, "sqlite_errorname", "")), str(error)
    if code.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")) or "Could not decode" in text:
        return f"it is damaged ({text}){_WAY_OUT}"
    if code.startswith("SQLITE_BUSY"):
        return f"another program has read or written it for {BUSY_SECONDS:.0f} s: close that program"
    if code.startswith("SQLITE_FULL"):
        return "the disk is full: free space"
    if code == "SQLITE_READONLY_DBMOVED":
        return "it was moved, removed or replaced while it was open: put it back"
    if code.startswith(("SQLITE_READONLY", "SQLITE_PERM")):
        return "no permission"
    if code.startswith("SQLITE_CANTOPEN"):
        return "it was removed, or there is no permission"
    if code.startswith("SQLITE_IOERR"):
        return f"{text}: the disk or a quota may be full, so free space"
    return text
