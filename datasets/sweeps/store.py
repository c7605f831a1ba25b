"""A sweep's store: a folder with one SQLite file of results, and kept files beside it; nothing in it is made twice.

docs/formats/sweep-store.md describes the same for readers in other languages.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import sqlite3
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from ..errors import NotStoreError, SweepStoreError
from ..storage.durable import FolderLock, discard, discard_tree, sync
from .result_row import ResultRow, columns_of, digest_of, payload_of
from .store_database import NAME, naming_errors, open_store_file

KEPT_FOLDERS = ("contours", "focal-points", "drives")
"""Folders of files that a plan keeps, each file named by its result's key."""
KEEPING = "keep-"
"""Begins the names of groups that keep a file: their payloads hold its `path` within the store and its `bytes`."""
SCRATCH = "making"
"""Folder of files that are being made; the next run removes what a killed one left there."""
_BESIDE = (*KEPT_FOLDERS, SCRATCH, FolderLock.NAME)  # and tables and pictures, by their suffixes
_DERIVED = (".csv", ".json", ".parquet", ".png")
_ROWS_AT_ONCE = 1000  # that `rows` has in memory
_VARIABLES_MOST = 900  # of a statement; old versions of SQLite take 999

Key = tuple[str, str]
"""Group and key of a result."""
Mode = Literal["write", "read"]


@dataclass(frozen=True)
class Failure:
    """A recipe that could not be made."""

    recipe_hash: str
    name: str
    sentence: str


@dataclass(frozen=True)
class Pruned:
    """What `prune` removes, or would remove."""

    code_versions: tuple[str, ...]
    rows: int
    rows_kept: int
    files: tuple[Path, ...]


class SweepStore:
    """A sweep's store, open. One process at a time may have it open for writing; any number may read.

    code: the code version whose results count as done, and under which new ones are recorded. None, only for reading:
    the one that recorded last.
    mode: "write" makes the folder if it is not there, and holds its lock until `close`; "read" changes nothing.

    Raises:
        NotStoreError: The folder holds other things.
        SweepStoreError: It is damaged, of another format version, in use by another process, or cannot be written.

    >>> from palpate.datasets import ResultRow, SweepStore
    >>> with SweepStore("study.sweep", "own code 1.0", mode="write") as store:
    ...     count = store.add([ResultRow.of("own code 1.0", "contours", "a1b2", 0, {"length": 0.34})])
    ...     store.done([("contours", "a1b2"), ("contours", "c3d4")])
    {('contours', 'a1b2'): {0}, ('contours', 'c3d4'): set()}
    """

    def __init__(self, folder: str | Path, code: str | None = None, *, mode: Mode = "read") -> None:
        self.folder = Path(folder).absolute()
        self.path = self.folder / NAME
        self.mode: Mode = mode
        self._scratch = self.folder / SCRATCH / secrets.token_hex(8)
        self.damaged: list[str] = []
        """A sentence for each damage that was met; results with damage count as not done."""
        if mode == "write" and code is None:
            raise SweepStoreError(f"{self.folder}: writing needs the code version that computes")
        _require_store_folder(self.folder, writes=mode == "write")
        self._lock = _locked(self.folder) if mode == "write" else None
        try:
            self._database = open_store_file(self.path, writes=mode == "write")
            try:
                self.code = code if code is not None else next(reversed(self.code_versions()), "")
                self._code = self._number_of(self.code)
            except BaseException:
                self._database.close()
                raise
        except BaseException:
            self._release()
            raise

    def __repr__(self) -> str:
        """One line."""
        return f"SweepStore({str(self.folder)!r})"

    def close(self) -> None:
        """Close the file and give the lock back; closing twice does nothing."""
        self._database.close()
        self._release()

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # ---- results

    def add(self, rows: Iterable[ResultRow], files: Mapping[str, Path | bytes] | None = None) -> int:
        """Record results in one transaction; returns how many are new. When it returns, they are on the disk.

        files: kept files that the rows name, by their paths within the store: a file on the same disk, which is moved,
        or its content. A file takes the place of an earlier one, whose result is forgotten, whatever code made it.
        """
        rows = list(rows)
        if files:
            # A file that is made again, perhaps with another size, or by other code, has its new row only; the old one
            # goes before the file changes, as a kill may come between.
            made = [(row.group, row.key) for row in rows if _is_keeping(row.group)]
            with self._transaction():
                self._database.executemany('DELETE FROM result WHERE "group" = ? AND key = ?', made)
            for name, content in files.items():
                self._keep(kept_path(name), content)
        statement = "INSERT OR IGNORE INTO result VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
        values = [
            (self._code, row.group, row.key, row.chunk, row.payload, row.digest, row.columns, row.columns_digest)
            for row in rows
        ]
        with self._transaction():
            return self._database.executemany(statement, values).rowcount if values else 0

    def _keep(self, name: PurePosixPath, content: Path | bytes) -> None:
        """Have a kept file in its place."""
        path = self.folder / name
        with naming_errors(path):
            path.parent.mkdir(exist_ok=True)
            if isinstance(content, bytes):
                made = self.scratch() / path.name
                made.write_bytes(content)
                content = made
            sync(content)
            os.replace(content, path)
            sync(path.parent)

    def scratch(self) -> Path:
        """A folder on the store's disk for files that are being made; no other store, on any host, has its path."""
        with naming_errors(self._scratch):
            self._scratch.mkdir(parents=True, exist_ok=True)
        return self._scratch

    def clear_scratch(self) -> None:
        """Remove files that were being made, such as those of a killed run."""
        discard_tree(self.folder / SCRATCH)

    def done(self, keys: Sequence[Key]) -> dict[Key, set[int]]:
        """Chunks that are there of each (group, key), all keys asked for, in their order; an empty set for nothing.

        A result with a kept file is there as long as the file is, with its size. A row that does not have its digest
        counts as not done, and `damaged` names it; mode "write" removes it, so that it is made again.
        """
        found: dict[Key, set[int]] = {key: set() for key in keys}
        lost: dict[int, str] = {}
        for number, group, key, chunk, payload, digest in self._among("rowid, ", ", payload, digest", list(found)):
            if not _is_proven(self.code, group, key, chunk, payload, digest):
                lost[number] = f"chunk {chunk} of {group} {key}"
            elif not _is_keeping(group) or self._has_file(payload):
                found[group, key].add(chunk)
        if lost:
            first = next(iter(lost.values()))
            self.damaged.append(f"{self.path} is damaged: {len(lost)} results lack their digests, {first} first")
            if self.mode == "write":
                with self._transaction():
                    self._database.executemany("DELETE FROM result WHERE rowid = ?", [(own,) for own in lost])
        return found

    def _has_file(self, payload: str) -> bool:
        """Whether the file that a payload names is there in full, or it names none."""
        try:
            value = payload_of(payload)
            name = value.get("path")
            return name is None or os.stat(self.folder / kept_path(name)).st_size == value.get("bytes")
        except (OSError, ValueError, SweepStoreError):
            return False

    def results(self, keys: Sequence[Key]) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
        """Group, key, chunk and payload of every result that is there, keys as asked for, chunks upwards.

        Raises SweepStoreError for a damaged row; the next run of the sweep removes it and makes it again.
        """
        for group, key, chunk, text, digest in self._among("", ", payload, digest", list(dict.fromkeys(keys))):
            self._require_digest(group, key, chunk, text, digest)
            try:
                payload = payload_of(text)
            except ValueError as error:
                raise SweepStoreError(f"{self.path}: chunk {chunk} of {group} {key}: {error}") from error
            yield group, key, chunk, payload

    def _require_digest(self, group: str, key: str, chunk: int, content: str | bytes, digest: int) -> None:
        if not _is_proven(self.code, group, key, chunk, content, digest):
            raise SweepStoreError(
                f"{self.path} is damaged: chunk {chunk} of {group} {key} does not have its digest; run the sweep "
                "again: it makes the chunk anew"
            )

    def column_chunks(self, key: str, *, group: str = "poses") -> Iterator[tuple[int, dict[str, np.ndarray[Any, Any]]]]:
        """Columns of one value a pose, chunk by chunk: its number and the arrays by name.

        Raises SweepStoreError for damaged ones; mode "write" removes them first, so that they are made again.
        """
        statement = "SELECT columns, columns_digest FROM result WHERE rowid = ?"
        for number, _, _, chunk in self._among("rowid, ", "", [(group, key)]):
            ((blob, digest),) = self._run(statement, (number,)) or [(None, None)]
            if blob is None:
                continue
            try:
                self._require_digest(group, key, chunk, blob, digest)
                columns = columns_of(blob)
            except (SweepStoreError, ValueError) as error:
                if self.mode == "write":
                    with self._transaction():
                        self._database.execute("DELETE FROM result WHERE rowid = ?", (number,))
                raise SweepStoreError(str(error)) from error
            yield chunk, columns

    def _among(self, front: str, columns: str, keys: Sequence[Key]) -> Iterator[tuple[Any, ...]]:
        """Rows of keys, by group, key and chunk, with columns of the table before and after these three."""
        groups: dict[str, list[str]] = {}
        for group, key in keys:
            groups.setdefault(group, []).append(key)
        for group, own in groups.items():
            for first in range(0, len(own), _VARIABLES_MOST):
                some = own[first : first + _VARIABLES_MOST]
                places = {key: place for place, key in enumerate(some)}
                statement = (
                    f'SELECT {front}"group", key, chunk{columns} FROM result WHERE code = ? AND "group" = ? '
                    f"AND key IN ({','.join('?' * len(some))})"
                )
                at = front.count(",") + 1  # of the key
                rows = self._run(statement, (self._code, group, *some))
                yield from sorted(rows, key=lambda row: (places[row[at]], row[at + 1]))

    def rows(self) -> Iterator[ResultRow]:
        """Every row of this code version as it is stored, whether whole or damaged."""
        last = -1
        statement = (
            'SELECT rowid, "group", key, chunk, payload, digest, columns, columns_digest FROM result '
            "WHERE code = ? AND rowid > ? ORDER BY rowid LIMIT ?"
        )
        while rows := self._run(statement, (self._code, last, _ROWS_AT_ONCE)):
            for last, *values in rows:  # noqa: B007 - the last one is where the next statement goes on
                yield ResultRow(*values)

    def integrity(self) -> list[str]:
        """What SQLite itself finds wrong with the file, a sentence each."""
        return [f"{self.path} is damaged: {text}" for (text,) in self._run("PRAGMA integrity_check(8)") if text != "ok"]

    # ---- failures and runs

    def failures(self) -> list[Failure]:
        """Recipes that this code version could not make."""
        rows = self._run("SELECT recipe_hash, recipe, sentence FROM failure WHERE code = ?", (self._code,))
        return [Failure(*row) for row in rows]

    def replace_failures(self, failures: Iterable[Failure]) -> None:
        """Record the recipes that this code version could not make in its last run, in place of all earlier ones."""
        with self._transaction():
            self._database.execute("DELETE FROM failure WHERE code = ?", (self._code,))
            rows = [(self._code, own.recipe_hash, _stored(own.name), _stored(own.sentence)) for own in failures]
            self._database.executemany("INSERT OR REPLACE INTO failure VALUES (?, ?, ?, ?)", rows)

    def begin_run(self, plan: str) -> int:
        """Note that a sweep begins; returns the number of the run."""
        begun = datetime.now(UTC).isoformat(timespec="seconds")
        with self._transaction():
            values = (_stored(plan), begun, "not ended")
            number = self._database.execute("INSERT INTO run (plan, begun, state) VALUES (?, ?, ?)", values).lastrowid
        return number or 0

    def end_run(self, number: int, state: str) -> None:
        """Note how a run ended, such as "ended" or "stopped: interrupted"."""
        with self._transaction():
            self._database.execute("UPDATE run SET state = ? WHERE id = ?", (_stored(state), number))

    def last_run(self) -> dict[str, str] | None:
        """Plan, beginning and state of the run that began last; None if there was none."""
        rows = self._run("SELECT plan, begun, state FROM run ORDER BY id DESC LIMIT 1")
        return dict(zip(("plan", "begun", "state"), rows[0], strict=True)) if rows else None

    def group_counts(self) -> list[tuple[str, str, int, int]]:
        """Code version, group, number of keys and of rows, the code version that recorded last at the end."""
        order = list(self.code_versions())
        rows = self._run(
            'SELECT version, "group", count(DISTINCT key), count(*) FROM result JOIN code ON code.id = result.code '
            'GROUP BY version, "group"'
        )
        return sorted(((str(v), str(g), int(k), int(r)) for v, g, k, r in rows), key=lambda own: order.index(own[0]))

    def failure_counts(self) -> dict[str, int]:
        """Number of recipes that each code version could not make; those that have none are left out."""
        rows = self._run("SELECT version, count(*) FROM failure JOIN code ON code.id = failure.code GROUP BY version")
        return {str(version): int(count) for version, count in rows}

    # ---- code versions

    def code_versions(self) -> dict[str, int]:
        """Code versions and how many rows each has, the one that recorded last at the end."""
        rows = self._run(
            "SELECT version, count(result.code) FROM code LEFT JOIN result ON result.code = code.id "
            "GROUP BY code.id ORDER BY max(result.rowid), code.id"
        )
        return {str(version): int(count) for version, count in rows}

    def take_results_of(self, code: str) -> int:
        """Have another code version's results and failures be this one's: a person knows that they are the same.

        Returns how many results. What both have stays as this one made it.
        """
        other = self._number_of(code)

        def renewed(group: str, key: str, chunk: int, content: str | bytes | None, digest: int | None) -> int | None:
            """The digest of a row under this code version; a damaged row stays damaged."""
            if content is None or digest is None:
                return None
            blob = content.encode(errors="surrogateescape") if isinstance(content, str) else content
            is_whole = digest_of(code, group, key, chunk, blob) == digest
            return digest_of(self.code, group, key, chunk, blob) ^ (0 if is_whole else 1)

        self._database.create_function("renewed", 5, renewed, deterministic=True)
        with self._transaction():
            count = self._database.execute(
                'UPDATE OR IGNORE result SET code = ?, digest = renewed("group", key, chunk, payload, digest), '
                'columns_digest = renewed("group", key, chunk, columns, columns_digest) WHERE code = ?',
                (self._code, other),
            ).rowcount
            self._database.execute("UPDATE OR IGNORE failure SET code = ? WHERE code = ?", (self._code, other))
        return count

    def unused(self) -> Pruned:
        """What `prune` would remove: results of other code versions, and kept files that only these name."""
        versions = tuple(own for own in self.code_versions() if own != self.code)
        counts = self._run("SELECT total(code != ?), total(code = ?) FROM result", (self._code, self._code))[0]
        keeping = "SELECT payload FROM result WHERE code = ? AND \"group\" LIKE 'keep-%'"
        try:
            paths = [payload_of(text).get("path") for (text,) in self._run(keeping, (self._code,))]
        except ValueError as error:
            raise SweepStoreError(f"{self.path} is damaged: {error}; run the sweep again first") from error
        named = {self.folder / kept_path(name) for name in paths if name is not None}
        folders = [own for name in KEPT_FOLDERS if (own := self.folder / name).is_dir()]
        files = tuple(sorted(path for own in folders for path in own.iterdir() if path not in named))
        return Pruned(versions, int(counts[0]), int(counts[1]), files)

    def prune(self) -> Pruned:
        """Remove what `unused` finds."""
        found = self.unused()
        with self._transaction():
            for table in ("result", "failure"):
                self._database.execute(f"DELETE FROM {table} WHERE code != ?", (self._code,))
            self._database.execute("DELETE FROM code WHERE id != ?", (self._code,))
        for path in found.files:
            discard(path)
        with contextlib.suppress(SweepStoreError):  # it makes the file smaller, which needs room for a second one
            self._run("VACUUM")
        return found

    def _number_of(self, code: str) -> int:
        """The number of a code version, entered if it may be; -1 for one that is not there."""
        if self.mode == "write":
            with self._transaction():
                self._database.execute("INSERT OR IGNORE INTO code (version) VALUES (?)", (code,))
        rows = self._run("SELECT id FROM code WHERE version = ?", (code,))
        return int(rows[0][0]) if rows else -1

    # ---- SQL

    def _run(self, statement: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """The rows of a statement, all read, so that no lock stays."""
        with naming_errors(self.path):
            return self._database.execute(statement, values).fetchall()

    @contextmanager
    def _transaction(self) -> Generator[None, None, None]:
        """Everything within happens, and is on the disk, or nothing."""
        if self.mode == "read":
            raise SweepStoreError(f"{self.path} was opened for reading")
        with naming_errors(self.path):
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._database.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):  # a full disk may have rolled it back already
                    self._database.execute("ROLLBACK")
                raise


def kept_path(name: object) -> PurePosixPath:
    """The path within a store of a kept file, such as contours/KEY.h5; raises SweepStoreError for any other path."""
    path = PurePosixPath(str(name))
    if len(path.parts) != 2 or path.parts[0] not in KEPT_FOLDERS or path.suffix != ".h5" or "\0" in path.name:
        raise SweepStoreError(f"the path {str(name)!r:.80} is none of a kept file in a store")
    return path


def is_read_only(folder: Path) -> bool:
    """Whether a folder is a store that this process cannot write, such as one on a read-only mount."""
    return (folder / NAME).exists() and not os.access(folder, os.W_OK)


def _is_proven(code: str, group: str, key: str, chunk: object, content: object, digest: object) -> bool:
    """Whether a row has its digest, and the types that only a hostile store can lack."""
    content = content.encode(errors="surrogateescape") if isinstance(content, str) else content
    if not (isinstance(chunk, int) and chunk >= 0 and isinstance(content, bytes)):
        return False
    return digest_of(code, group, key, chunk, content) == digest


def _stored(text: str) -> str:
    """A text as SQLite holds it, such as the name of a file that is no UTF-8."""
    return text.encode(errors="backslashreplace").decode()


def _is_keeping(group: str) -> bool:
    return group.startswith(KEEPING)


def _require_store_folder(folder: Path, *, writes: bool) -> None:
    """Refuse a folder that holds other things than a store; make one that is not there, if `writes`."""
    if (folder / NAME).exists():
        if writes:
            _refuse_links(folder)
        return
    if not writes:
        raise NotStoreError(f"{folder} is not a sweep's store: it has no {NAME}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = sorted(path.name for path in folder.iterdir())
    except OSError as error:
        raise SweepStoreError(f"{folder} cannot be a sweep's store: {error.strerror or error}") from error
    _refuse_links(folder)
    other = [name for name in names if name not in _BESIDE and not name.endswith(_DERIVED)]
    if other:
        shown = ", ".join(other[:3])
        raise NotStoreError(f"{folder} is not a sweep's store, but holds other things ({shown}): name a new folder")


def _refuse_links(folder: Path) -> None:
    """Refuse links in the place of folders: files behind them are not the store's to replace."""
    for name in (*KEPT_FOLDERS, SCRATCH):
        if (folder / name).is_symlink():
            raise SweepStoreError(f"{folder / name} is a link, which no sweep makes: remove it, or name another store")


def _locked(folder: Path) -> FolderLock:
    try:
        return FolderLock(folder)
    except BlockingIOError as error:
        raise SweepStoreError(
            f"{folder} is in use by another process, and a store takes one sweep at a time: wait for it, or name "
            "another store (--shard divides a plan among several)"
        ) from error
    except OSError as error:
        raise SweepStoreError(f"{folder} cannot be written: {error.strerror or error}") from error
