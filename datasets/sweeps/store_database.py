"""The SQLite file of a sweep's store: opened strictly, made, and its errors in sentences.

A rollback journal, not a write-ahead log, which needs memory that all readers share: it works neither on network file
systems nor in folders that cannot be written.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sqlite3
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from ..bounded_file import FileBoundError
from ..errors import NotStoreError, SweepStoreError
from ..storage.durable import sync
from ..storage.sqlite_opening import open_database

MOUNTS = Path("/proc/self/mounts")
NETWORK = (
    "9p",
    "afs",
    "beegfs",
    "ceph",
    "cifs",
    "gfs2",
    "glusterfs",
    "gpfs",
    "lustre",
    "nfs",
    "smb",
    "sshfs",
    "vboxsf",
)
"""Beginnings of the types of file systems that several machines share, also behind `fuse.`."""


def network_file_system(folder: Path, mounts: Path = MOUNTS) -> str | None:
    """The type of the network file system that a folder is on; None on a local disk, or where it is not known."""
    try:
        lines = mounts.read_text(errors="replace").splitlines()
    except OSError:
        return None
    path, best, kind = os.path.realpath(folder), "", ""
    for line in lines:
        fields = line.split(" ")
        if len(fields) < 3:
            continue
        place = fields[1].replace("\\040", " ")  # as proc(5) writes spaces
        is_above = path == place or path.startswith(place.rstrip("/") + "/")
        if is_above and len(place) >= len(best):
            best, kind = place, fields[2]
    return kind if kind.removeprefix("fuse.").startswith(NETWORK) else None


NAME = "store.sqlite"
FORMAT_VERSION = 4
APPLICATION_ID = 0x70616C70
"""In the file's header: `palp`."""
BUSY_SECONDS = 60.0
"""Longest wait for another process's transaction, which takes milliseconds [s]."""

_SCHEMA = """
CREATE TABLE code (id INTEGER PRIMARY KEY, version TEXT NOT NULL UNIQUE);
CREATE TABLE result (
    code INTEGER NOT NULL REFERENCES code, "group" TEXT NOT NULL, key TEXT NOT NULL, chunk INTEGER NOT NULL,
    payload TEXT NOT NULL, digest INTEGER NOT NULL, columns BLOB, columns_digest INTEGER
);
CREATE UNIQUE INDEX result_of ON result (code, "group", key, chunk);
CREATE TABLE failure (
    code INTEGER NOT NULL REFERENCES code, recipe_hash TEXT NOT NULL, recipe TEXT NOT NULL, sentence TEXT NOT NULL,
    PRIMARY KEY (code, recipe_hash)
);
CREATE TABLE run (id INTEGER PRIMARY KEY, plan TEXT NOT NULL, begun TEXT NOT NULL, state TEXT NOT NULL);
CREATE VIEW results AS SELECT version AS code_version, "group", key, chunk, payload
    FROM result JOIN code ON code.id = result.code;
"""

WAY_OUT = ": move it away and run the sweep again, which makes its results anew"


def open_store_file(path: Path, *, writes: bool) -> sqlite3.Connection:
    """Open a store's file; one that is missing or empty is made if `writes`.

    Raises:
        NotStoreError: There is none, or it is another program's.
        SweepStoreError: It is damaged, of another format version, or cannot be written.
    """
    with naming_errors(path):
        if writes:
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666))
            sync(path.parent)
        try:
            connection = open_database(path, writes=writes, busy_seconds=BUSY_SECONDS)
        except FileBoundError as error:
            raise SweepStoreError(str(error)) from error
        try:
            # A flipped bit may leave no UTF-8, which is one row's damage: its digest tells.
            connection.text_factory = _decoded
            if writes and not connection.execute("SELECT 1 FROM sqlite_master").fetchone():
                _make(connection)
            _require_ours(connection, path)
            connection.execute("PRAGMA synchronous=FULL" if writes else "PRAGMA query_only=ON")
            connection.execute("PRAGMA cell_size_check=ON")
        except BaseException:
            connection.close()
            raise
    return connection


def _decoded(text: bytes) -> str:
    return text.decode(errors="surrogateescape")


def _make(connection: sqlite3.Connection) -> None:
    """All tables in one transaction: a killed process leaves an empty file, which the next one takes."""
    connection.executescript(
        f"BEGIN IMMEDIATE; PRAGMA application_id={APPLICATION_ID}; PRAGMA user_version={FORMAT_VERSION};"
        f"{_SCHEMA} COMMIT;"
    )


def _require_ours(connection: sqlite3.Connection, path: Path) -> None:
    application = int(connection.execute("PRAGMA application_id").fetchone()[0])
    version = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if application != APPLICATION_ID:
        if path.stat().st_size == 0:
            raise SweepStoreError(f"{path} is empty, so damaged{WAY_OUT}")
        raise NotStoreError(f"{path} is not a sweep's store: another program wrote it")
    if version > FORMAT_VERSION:
        raise SweepStoreError(
            f"{path} has format version {version}, and this palpate reads version {FORMAT_VERSION}: a newer one wrote "
            "it; update palpate, or name another store"
        )
    if version < FORMAT_VERSION:
        raise SweepStoreError(
            f"{path} has format version {version}, and this palpate reads version {FORMAT_VERSION}: an earlier one "
            "wrote it; delete its folder or name another store, and run the sweep again"
        )
    # A view or a trigger of a stranger would run as the query that it is.
    if differing := _schema_of(connection) ^ _own_schema():
        name = min(str(own[1]) for own in differing)
        raise SweepStoreError(f"{path} is damaged (its tables are not a store's: {name!r:.80} differs){WAY_OUT}")


_Schema = frozenset[tuple[object, ...]]


def _schema_of(connection: sqlite3.Connection) -> _Schema:
    """Tables, indexes and views of a database, whatever spaces their definitions have."""
    rows = connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master").fetchall()
    return frozenset(tuple(" ".join(own.split()) if isinstance(own, str) else own for own in row) for row in rows)


@functools.cache
def _own_schema() -> _Schema:
    with contextlib.closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript(_SCHEMA)
        return _schema_of(connection)


@contextmanager
def naming_errors(path: Path) -> Generator[None, None, None]:
    """Turn errors of SQLite and the system into a SweepStoreError that names the file and the way out."""
    try:
        yield
    except sqlite3.Error as error:
        raise SweepStoreError(f"{path} {_reason(error)}") from error
    except UnicodeDecodeError as error:  # of a text, or of SQLite's own sentence about one
        raise SweepStoreError(f"{path} is damaged ({error}){WAY_OUT}") from error
    except OSError as error:
        raise SweepStoreError(f"{error.filename or path} cannot be written: {error.strerror or error}") from error


def _reason(error: sqlite3.Error) -> str:
    """SQLite's reason, in a user's words."""
    text, code = str(error), str(getattr(error, "sqlite_errorname", ""))
    if code.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")) or "Could not decode" in text or "malformed" in text:
        return f"is damaged ({text}){WAY_OUT}"
    if code == "SQLITE_READONLY_ROLLBACK":  # while it was being read; `open_database` would have taken a copy
        return "has a transaction that another process left unfinished just now: try again"
    sentences = {
        "SQLITE_BUSY": f"has been held by another process for {BUSY_SECONDS:.0f} s",
        "SQLITE_FULL": "cannot be written: the disk is full; what was recorded before is safe",
        "SQLITE_READONLY": "cannot be written: no permission",
        "SQLITE_PERM": "cannot be written: no permission",
        "SQLITE_CANTOPEN": "cannot be opened: it does not exist, or there is no permission",
        "SQLITE_IOERR": f"cannot be read or written ({text}; perhaps a full disk or a quota); what was recorded "
        "before is safe",
    }
    return next((own for start, own in sentences.items() if code.startswith(start)), f"cannot be used: {text}")
