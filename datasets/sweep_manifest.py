"""A store's manifest: one SQLite file, opened, made and judged; what goes wrong is one sentence with the way out.

A rollback journal, not a write-ahead log: that needs memory shared by all readers, so it neither works on network file
systems nor in folders that cannot be written. It is truncated, not removed, at the end of a transaction, because with
`synchronous=FULL` SQLite then has that on the disk, too.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, cast

from .durable import discard, sync
from .errors import SweepStoreError
from .hdf5_columns import temporary_name

NAME = "store.sqlite"
FORMAT_VERSION = 1
APPLICATION_ID = 0x70616C70
"""In the file's header: `palp`."""

BUSY_SECONDS = 60.0
"""How long a parent waits for another one's transaction, which takes milliseconds."""

_VARIABLES_MOST = 900  # of a statement; old versions of SQLite take 999

_SCHEMA = """
CREATE TABLE maker (id INTEGER PRIMARY KEY, maker TEXT NOT NULL UNIQUE);
CREATE TABLE shard (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE column_file (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE part (
    id INTEGER PRIMARY KEY,
    maker INTEGER NOT NULL REFERENCES maker,
    "group" TEXT NOT NULL,
    key TEXT NOT NULL,
    part INTEGER NOT NULL,
    payload TEXT NOT NULL,
    column_file INTEGER REFERENCES column_file,
    column_row INTEGER
);
CREATE UNIQUE INDEX part_of ON part (maker, "group", key, part);
CREATE INDEX part_columns ON part (column_file) WHERE column_file IS NOT NULL;
CREATE TABLE failure (
    maker INTEGER NOT NULL REFERENCES maker, recipe TEXT NOT NULL, sentence TEXT NOT NULL, PRIMARY KEY (maker, recipe)
);
CREATE VIEW parts AS
SELECT maker.maker, part."group", part.key, part.part, part.payload,
    'columns/' || column_file.name AS file, part.column_row AS "row"
FROM part JOIN maker ON maker.id = part.maker LEFT JOIN column_file ON column_file.id = part.column_file;
"""

Mode = Literal["create", "read"]


class Manifest:
    """The connection to a manifest; every method raises SweepStoreError naming the file. Threads may share it.

    maker: that a new one begins with.
    """

    def __init__(self, folder: Path, mode: Mode, maker: str | None = None) -> None:
        self.path = folder / NAME
        self._mode: Mode = mode
        self._lock = threading.RLock()
        if mode == "create" and not self.path.exists():
            self._make(maker)
        with self._named():
            self._connection = _connected(self.path, mode)
        try:
            self._refuse_foreign()
        except SweepStoreError:
            self._connection.close()
            raise

    def close(self) -> None:
        """Close it; closing twice does nothing."""
        with self._lock:
            self._connection.close()

    @contextmanager
    def transaction(self) -> Generator[None, None, None]:
        """Everything within happens, and is on the disk, or nothing; nobody else writes meanwhile."""
        if self._mode == "read":
            raise SweepStoreError(f"{self.path} was opened for reading")
        with self._lock, self._named():
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._connection.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):  # a full disk may have rolled it back already
                    self._connection.execute("ROLLBACK")
                raise

    def run(self, statement: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """The rows of a statement, all read, so that no lock stays."""
        with self._lock, self._named():
            return self._connection.execute(statement, values).fetchall()

    def changed(self, statement: str, values: Sequence[Any] = ()) -> int:
        """How many rows a statement changed."""
        with self._lock, self._named():
            return self._connection.execute(statement, values).rowcount

    def changed_by(self, statement: str, rows: Sequence[Sequence[Any]]) -> int:
        """How many rows a statement changed, run for each of many rows of values."""
        with self._lock, self._named():
            return self._connection.executemany(statement, rows).rowcount if rows else 0

    def among(self, statement: str, values: Sequence[Any], keys: Sequence[str]) -> Iterable[list[tuple[Any, ...]]]:
        """Rows of a statement whose last `IN ({})` takes keys: a batch for some hundred keys at a time."""
        for first in range(0, len(keys), _VARIABLES_MOST):
            some = keys[first : first + _VARIABLES_MOST]
            yield self.run(statement.format(",".join("?" * len(some))), (*values, *some))

    def number_of(self, table: str, column: str, name: str) -> int:
        """The id of a name in a table of names, which is entered if it is not there."""
        rows = self.run(f"SELECT id FROM {table} WHERE {column} = ?", (name,))
        if not rows:
            self.run(f"INSERT OR IGNORE INTO {table} ({column}) VALUES (?)", (name,))
            rows = self.run(f"SELECT id FROM {table} WHERE {column} = ?", (name,))
        return int(rows[0][0])

    def _make(self, maker: str | None) -> None:
        """Make a manifest under another name, then link it: it is never there without its tables."""
        temporary = temporary_name(self.path)
        try:
            with self._named():
                connection = sqlite3.connect(temporary, isolation_level=None)
                with contextlib.closing(connection):
                    connection.executescript(
                        f"PRAGMA journal_mode=MEMORY; PRAGMA synchronous=FULL; BEGIN; {_SCHEMA}"
                        f"PRAGMA application_id={APPLICATION_ID}; PRAGMA user_version={FORMAT_VERSION};"
                    )
                    if maker is not None:
                        connection.execute("INSERT INTO maker (maker) VALUES (?)", (maker,))
                    connection.execute("COMMIT")
                _link(temporary, self.path)
                sync(self.path.parent)
        finally:
            discard(temporary)

    def _refuse_foreign(self) -> None:
        """Refuse what is no manifest, a damaged one, and one of a newer version."""
        application = int(self.run("PRAGMA application_id")[0][0])
        version = int(self.run("PRAGMA user_version")[0][0])
        if application != APPLICATION_ID:
            size = self.path.stat().st_size
            what = "empty, so damaged" if size == 0 else "not a sweep's manifest"
            raise SweepStoreError(f"{self.path} is {what}{_WAY_OUT if size == 0 else ''}")
        if version > FORMAT_VERSION:
            raise SweepStoreError(
                f"{self.path} has format version {version}, this palpate reads up to {FORMAT_VERSION}: "
                "a newer one wrote it; update palpate, or name another store"
            )
        self.run("SELECT count(*) FROM maker")  # reads the schema

    @contextmanager
    def _named(self) -> Generator[None, None, None]:
        try:
            yield
        except sqlite3.Error as error:
            raise SweepStoreError(f"{self.path} {_reason(error)}") from error
        except OSError as error:
            raise SweepStoreError(f"{error.filename or self.path} cannot be written: {error.strerror}") from error


_WAY_OUT = (
    ": move it away and run the sweep again; per-pose columns and kept files are taken over, metrics are made anew"
)


def _connected(path: Path, mode: Mode) -> sqlite3.Connection:
    # A reader who may write undoes what a killed parent left half done; one who may not just reads.
    access = "rw" if mode == "create" or (os.access(path.parent, os.W_OK) and os.access(path, os.W_OK)) else "ro"
    connection = sqlite3.connect(
        f"{path.absolute().as_uri()}?mode={access}",
        uri=True,
        timeout=BUSY_SECONDS,
        isolation_level=None,
        check_same_thread=False,
    )
    try:
        if mode == "create":
            connection.execute("PRAGMA journal_mode=TRUNCATE")
            connection.execute("PRAGMA synchronous=FULL")
        else:
            connection.execute("PRAGMA query_only=ON")
        connection.execute("PRAGMA cache_size=-65536")  # KiB
    except BaseException:
        connection.close()
        raise
    return connection


def _link(temporary: Path, path: Path) -> None:
    """Give a new manifest its name, unless another parent was first."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        return
    except OSError:  # a file system without links
        if not path.exists():
            os.replace(temporary, path)


def _reason(error: sqlite3.Error) -> str:
    """What SQLite says, in a user's words."""
    text = str(error)
    code = cast("str", getattr(error, "sqlite_errorname", ""))
    if code.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")):
        return f"is damaged ({text}){_WAY_OUT}"
    if code.startswith("SQLITE_BUSY"):
        return f"has been held by another process for {BUSY_SECONDS:.0f} s"
    if code.startswith("SQLITE_FULL"):
        return "cannot be written: the disk is full; what was recorded before is safe"
    if code.startswith(("SQLITE_READONLY", "SQLITE_PERM")):
        return "cannot be written: no permission"
    if code.startswith("SQLITE_CANTOPEN"):
        return "cannot be opened: it does not exist, or there is no permission"
    if code.startswith("SQLITE_IOERR"):
        return f"cannot be read or written ({text}; a full disk or a quota, perhaps); what was recorded before is safe"
    return f"cannot be used: {text}"
