"""A store's manifest: one SQLite file, opened, made and judged; what goes wrong is one sentence with the way out.

A rollback journal, not a write-ahead log: that needs memory shared by all readers, so it neither works on network file
systems nor in folders that cannot be written. It is truncated, not removed, at the end of a transaction, because with
`synchronous=FULL` SQLite then has that on the disk, too.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sqlite3
import threading
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, cast

from ..bounded_file import FileBoundError
from ..errors import SweepStoreError
from ..storage.content_digest import text_digest
from ..storage.durable import discard, sync, temporary_name
from ..storage.sqlite_opening import open_database

NAME = "store.sqlite"
FORMAT_VERSION = 3
"""The newest. Version 1 has no digests: it is read as it is, and becomes version 2 when it is opened for writing.
Version 3 has the table `same_results`; a manifest becomes one when a person first states that results are the same, so
that an earlier palpate can use all other stores, and refuses this one by its version."""
NEW_VERSION = 2
"""Of a manifest that is made."""
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

_DIGESTS = """
ALTER TABLE maker ADD COLUMN digest BLOB;
ALTER TABLE part ADD COLUMN digest BLOB;
ALTER TABLE failure ADD COLUMN digest BLOB;
CREATE TABLE tally (
    maker INTEGER NOT NULL REFERENCES maker, "group" TEXT NOT NULL, key TEXT NOT NULL, parts INTEGER NOT NULL,
    PRIMARY KEY (maker, "group", key)
) WITHOUT ROWID;
INSERT INTO tally SELECT maker, "group", key, count(*) FROM part GROUP BY maker, "group", key;
CREATE TRIGGER part_comes AFTER INSERT ON part BEGIN
    INSERT OR IGNORE INTO tally VALUES (new.maker, new."group", new.key, 0);
    UPDATE tally SET parts = parts + 1 WHERE maker = new.maker AND "group" = new."group" AND key = new.key;
END;
CREATE TRIGGER part_goes AFTER DELETE ON part BEGIN
    UPDATE tally SET parts = parts - 1 WHERE maker = old.maker AND "group" = old."group" AND key = old.key;
    DELETE FROM tally WHERE maker = old.maker AND "group" = old."group" AND key = old.key AND parts = 0;
END;
"""
"""What version 2 adds: a digest in every row that is believed, and how many parts each key has, counted apart."""

_SAME_RESULTS = """
CREATE TABLE same_results (
    maker INTEGER NOT NULL REFERENCES maker, counted INTEGER NOT NULL REFERENCES maker, time TEXT NOT NULL,
    digest BLOB NOT NULL, PRIMARY KEY (maker, counted)
);
"""
"""What version 3 adds: which code versions' results count for which other one, since when."""

_FILL = """
UPDATE maker SET digest = digest_of(maker);
UPDATE failure SET digest = digest_of((SELECT maker FROM maker WHERE id = failure.maker), recipe, sentence);
UPDATE part SET digest = digest_of(
    (SELECT maker FROM maker WHERE id = part.maker), "group", key, part,
    (SELECT name FROM column_file WHERE id = part.column_file), column_row, payload
);
"""

Mode = Literal["create", "read"]


def row_digest(*fields: str | bytes | int | None) -> bytes:
    """Digest of a row: of a part its maker, group, key, part, file of columns, row in there and payload."""
    texts = [own if type(own) is bytes else b"" if own is None else str(own).encode() for own in fields]
    return text_digest(texts)


class Manifest:
    """The connection to a manifest; every method raises SweepStoreError naming the file. Threads may share it.

    maker: that a new one begins with.
    """

    def __init__(self, folder: Path, mode: Mode, maker: str | None = None) -> None:
        self.path = folder / NAME
        self._mode: Mode = mode
        self._lock = threading.RLock()
        self.adopted: int | None = None
        """Parts that had no digest when this was opened for writing, and have one now; None if all had."""
        if mode == "create" and not self.path.exists():
            self._make(maker)
        with self._named():
            self._connection = _connected(self.path, mode)
        try:
            self.version = self._required_version()
            """Of the format."""
            if self.version == 1 and mode == "create":
                self._add_digests()
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

    def among(
        self, statements: Sequence[str], values: Sequence[Any], keys: Sequence[str]
    ) -> Iterator[list[list[tuple[Any, ...]]]]:
        """Rows of statements whose last `IN ({})` takes keys, some hundred keys at a time.

        Of each batch, the rows of every statement, of one moment: nobody writes between two of them.
        """
        for first in range(0, len(keys), _VARIABLES_MOST):
            some = keys[first : first + _VARIABLES_MOST]
            marks = ",".join("?" * len(some))
            with self._lock, self._named(), self._moment():
                run = self._connection.execute
                found = [run(statement.format(marks), (*values, *some)).fetchall() for statement in statements]
            yield found

    @contextmanager
    def _moment(self) -> Generator[None, None, None]:
        """A transaction that reads, or the one that is open."""
        if self._connection.in_transaction:
            yield
            return
        self._connection.execute("BEGIN")
        try:
            yield
        finally:
            self._connection.execute("COMMIT")

    def number_of(self, table: str, column: str, name: str) -> int:
        """The id of a name in a table of names, which is entered if it is not there."""
        rows = self.run(f"SELECT id FROM {table} WHERE {column} = ?", (name,))
        if not rows:
            more, values = (", digest", (name, row_digest(name))) if table == "maker" else ("", (name,))
            marks = ", ".join("?" * len(values))
            self.run(f"INSERT OR IGNORE INTO {table} ({column}{more}) VALUES ({marks})", values)
            rows = self.run(f"SELECT id FROM {table} WHERE {column} = ?", (name,))
        return int(rows[0][0])

    def damaged(self, what: str) -> SweepStoreError:
        """An error that says what is damaged beyond one row, and the way out."""
        return SweepStoreError(f"{self.path} is damaged ({what}){_WAY_OUT}")

    def _add_digests(self) -> None:
        """Make version 2 of version 1: what it holds is believed this once, and proven from now on."""
        with self.transaction():
            self.version = int(self.run("PRAGMA user_version")[0][0])
            if self.version > 1:  # another parent's just now
                return
            self._connection.create_function("digest_of", -1, row_digest, deterministic=True)
            for statement in _statements(_DIGESTS + _FILL):
                self.run(statement)
            self.run(f"PRAGMA user_version={NEW_VERSION}")
            self.adopted = int(self.run("SELECT count(*) FROM part")[0][0])
        self.version = NEW_VERSION

    def add_same_results(self) -> None:
        """Make version 3 of version 2, within a transaction of the caller's."""
        if int(self.run("PRAGMA user_version")[0][0]) < FORMAT_VERSION:
            self.run(_SAME_RESULTS)
            self.run(f"PRAGMA user_version={FORMAT_VERSION}")
        self.version = FORMAT_VERSION

    def _make(self, maker: str | None) -> None:
        """Make a manifest under another name, then link it: it is never there without its tables."""
        temporary = temporary_name(self.path)
        try:
            with self._named():
                connection = sqlite3.connect(temporary, isolation_level=None)
                with contextlib.closing(connection):
                    connection.executescript(
                        f"PRAGMA journal_mode=MEMORY; PRAGMA synchronous=FULL; BEGIN; {_SCHEMA} {_DIGESTS}"
                        f"PRAGMA application_id={APPLICATION_ID}; PRAGMA user_version={NEW_VERSION};"
                    )
                    if maker is not None:
                        connection.execute(
                            "INSERT INTO maker (maker, digest) VALUES (?, ?)", (maker, row_digest(maker))
                        )
                    connection.execute("COMMIT")
                _link(temporary, self.path)
                sync(self.path.parent)
        finally:
            discard(temporary)

    def _required_version(self) -> int:
        """The format's version; refuses what is no manifest, a damaged one, and one of a newer version."""
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
        if version < 1:
            raise self.damaged(f"its version is {version}")
        with self._named():
            differing = _schema_of(self._connection) ^ _schema(version)
        if differing:
            name = min((str(own[1]) for own in differing), key=lambda own: (own.startswith("sqlite_"), own))
            raise self.damaged(f"its tables are not those of version {version}: {name!r:.80} differs")
        if version > 1:
            for maker, digest in self.run("SELECT CAST(maker AS BLOB), digest FROM maker"):
                if maker is None or row_digest(maker) != digest:
                    raise self.damaged(f"the name of a maker: {maker!r:.80}")
        return version

    @contextmanager
    def _named(self) -> Generator[None, None, None]:
        try:
            yield
        except sqlite3.Error as error:
            raise SweepStoreError(f"{self.path} {_reason(error)}") from error
        except UnicodeDecodeError as error:  # of a name, or of SQLite's own sentence about one
            raise self.damaged(str(error)) from error
        except OSError as error:
            raise SweepStoreError(f"{error.filename or self.path} cannot be written: {error.strerror}") from error


_WAY_OUT = (
    ": move it away and run the sweep again; per-pose columns and kept files are taken over, metrics are made anew"
)


_Schema = frozenset[tuple[object, ...]]
_ENTRIES = "SELECT type, name, tbl_name, sql FROM sqlite_master"


def _schema_of(connection: sqlite3.Connection) -> _Schema:
    """Tables, indexes, views and triggers of a database, whatever spaces their definitions have."""
    rows: list[tuple[object, ...]] = connection.execute(_ENTRIES).fetchall()
    return frozenset(tuple(" ".join(own.split()) if isinstance(own, str) else own for own in row) for row in rows)


@functools.cache
def _schema(version: int) -> _Schema:
    """What a manifest of a version has: a view or trigger of a stranger would be run as the query that it is."""
    with contextlib.closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        added = (_DIGESTS, _SAME_RESULTS)
        connection.executescript(_SCHEMA + "".join(added[: version - 1]))
        return _schema_of(connection)


def _statements(script: str) -> Iterator[str]:
    """Statements of a script, one by one: `executescript` would end the transaction."""
    statement = ""
    for line in script.splitlines():
        statement += line + "\n"
        if sqlite3.complete_statement(statement):
            yield statement
            statement = ""


def _connected(path: Path, mode: Mode) -> sqlite3.Connection:
    try:
        connection = open_database(path, writes=mode == "create", busy_seconds=BUSY_SECONDS)
    except FileBoundError as error:
        raise SweepStoreError(str(error)) from error
    try:
        if mode == "create":
            connection.execute("PRAGMA journal_mode=TRUNCATE")
            connection.execute("PRAGMA synchronous=FULL")
        else:
            connection.execute("PRAGMA query_only=ON")
        connection.execute("PRAGMA cell_size_check=ON")
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
    """SQLite's reason, in a user's words."""
    text = str(error)
    code = cast("str", getattr(error, "sqlite_errorname", ""))
    if code.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")) or "Could not decode" in text or "malformed" in text:
        return f"is damaged ({text}){_WAY_OUT}"
    if code.startswith("SQLITE_BUSY"):
        return f"has been held by another process for {BUSY_SECONDS:.0f} s"
    if code == "SQLITE_READONLY_ROLLBACK":  # while it was being read; `open_database` would have taken a copy
        return "has a transaction that another process left unfinished just now: try again"
    if code.startswith("SQLITE_FULL"):
        return "cannot be written: the disk is full; what was recorded before is safe"
    if code.startswith(("SQLITE_READONLY", "SQLITE_PERM")):
        return "cannot be written: no permission"
    if code.startswith("SQLITE_CANTOPEN"):
        return "cannot be opened: it does not exist, or there is no permission"
    if code.startswith("SQLITE_IOERR"):
        return f"cannot be read or written ({text}; a full disk or a quota, perhaps); what was recorded before is safe"
    return f"cannot be used: {text}"
