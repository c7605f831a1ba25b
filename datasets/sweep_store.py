"""A sweep's store: a folder with what was made, found again by what it depends on; nothing in it is made twice.

Workers leave shards in `shards/`; parents take them into the manifest (`sweep_manifest.py`), which is the only truth
about what is done. A shard with per-pose columns then goes to `columns/`, named by its content; others are removed.
docs/sweep-store.md tells the same to readers of other languages.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from .durable import discard
from .errors import NotStoreError, SweepStoreError
from .hdf5_columns import Columns
from .sweep_manifest import NAME, Manifest, Mode
from .sweep_record import COLUMNS, SHARDS, Read, Recorder
from .sweep_shard import shard_columns

TEMPORARY_SECONDS = 900.0
"""Age of a temporary file at which its writer is taken for dead; writing one takes seconds."""

KEPT = "keep-"
"""Begins the names of groups that leave a file in the store: their payloads tell its `path` in there and `bytes`."""

Key = tuple[str, str]
"""Group and key."""


@dataclass(frozen=True)
class _Place:
    """Where the columns of a part lie."""

    part: int
    file: str
    row: int


class SweepStore:
    """A store, open. Several processes may have it open, and write, at once; threads may share one.

    maker: which code's results count as done, and under which new ones are recorded. None, only for reading: the one
    that recorded last.
    mode: "create" makes the folder, or takes it up again; "read" changes nothing.

    Raises:
        NotStoreError: The folder holds other things.
        SweepStoreError: It is damaged, of a newer version, or cannot be written.
    """

    def __init__(self, folder: str | Path, *, maker: str | None = None, mode: Mode = "create") -> None:
        self.folder = Path(folder).absolute()
        self.mode: Mode = mode
        self.damaged: list[str] = []
        """One sentence for each damaged shard that was met and set aside."""
        if mode == "create" and maker is None:
            raise SweepStoreError(f"{self.folder}: what is recorded needs a maker")
        _refuse_other_folder(self.folder, mode)
        if mode == "create":
            _make_folder(self.folder)
        self._manifest = Manifest(self.folder, mode, maker)
        try:
            if mode == "create":
                for name in (SHARDS, COLUMNS):
                    _make_folder(self.folder / name)
            self.maker = maker if maker is not None else next(reversed(self.makers()), "")
            self._maker = self._maker_number(self.maker)
            self._recorder = Recorder(self.folder, self._manifest, self.maker, self.damaged)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the manifest; closing twice does nothing."""
        self._manifest.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def makers(self) -> dict[str, int]:
        """Makers of what is in the store and how many parts each has made, the one that came last at the end."""
        rows = self._manifest.run(
            "SELECT maker.maker, count(part.id) FROM maker LEFT JOIN part ON part.maker = maker.id "
            "GROUP BY maker.id ORDER BY max(part.id), maker.id"
        )
        return {str(maker): int(count) for maker, count in rows}

    def done(self, keys: Sequence[Key]) -> dict[Key, set[int]]:
        """Parts that are there of each (group, key), all keys asked for, in their order; an empty set for nothing.

        A part that left a file is there as long as that is, with its bytes; else it counts as not done from now on
        (mode "create").
        """
        found: dict[Key, set[int]] = {key: set() for key in keys}
        for group, own in _by_group(found):
            if group.startswith(KEPT):
                for key, part in self._kept(group, sorted(own)):
                    found[group, key].add(part)
                continue
            statement = 'SELECT key, part FROM part INDEXED BY part_of WHERE maker = ? AND "group" = ? AND key IN ({})'
            for rows in self._manifest.among(statement, (self._maker, group), sorted(own)):  # along the index
                for key, part in rows:
                    found[group, key].add(part)
        return found

    def _kept(self, group: str, keys: Sequence[str]) -> Iterator[tuple[str, int]]:
        """Key and part of which the file is there; the others are forgotten if this may write."""
        statement = 'SELECT key, part, payload, id FROM part WHERE maker = ? AND "group" = ? AND key IN ({})'
        lost: list[tuple[int, str]] = []
        for rows in self._manifest.among(statement, (self._maker, group), keys):
            for key, part, payload, number in rows:
                if self._has_file(json.loads(payload)):
                    yield key, part
                else:
                    lost.append((number, payload))
        if lost and self.mode == "create":
            with self._manifest.transaction():  # unless another process has just made it again
                self._manifest.changed_by("DELETE FROM part WHERE id = ? AND payload = ?", lost)

    def _has_file(self, payload: dict[str, Any]) -> bool:
        """Whether the file that a payload tells of is there in full; none may have been made."""
        path = payload.get("path")
        if path is None:
            return True
        try:
            return os.stat(f"{self.folder}/{path}").st_size == payload.get("bytes")
        except OSError:
            return False

    def results(self, keys: Sequence[Key]) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
        """Group, key, part and payload of every part that is there, group by group, keys as asked for, parts upwards.

        A key asked for twice comes once.
        """
        statement = 'SELECT key, part, payload FROM part WHERE maker = ? AND "group" = ? AND key IN ({})'
        for group, own in _by_group(dict.fromkeys(keys)):
            number = {key: place for place, key in enumerate(own)}
            for rows in self._manifest.among(statement, (self._maker, group), own):
                rows.sort(key=lambda row: (number[row[0]], row[1]))
                for key, part, payload in rows:
                    yield group, key, part, json.loads(payload)

    def columns(self, key: str, *, group: str = "poses") -> Columns:
        """Per-pose columns of a rendering and sampling, all parts that are there, one behind another.

        Raises:
            SweepStoreError: Nothing of it is there; or a file is missing or damaged, and its parts count as not done
                from now on (mode "create").
        """
        parts = [own for _, own in self.column_parts(key, group=group)]
        if not parts:
            raise SweepStoreError(f"{self.folder} has no columns of {group} {key}")
        return {name: np.concatenate([own[name] for own in parts]) for name in parts[0]}

    def column_parts(self, key: str, *, group: str = "poses") -> Iterator[tuple[int, Columns]]:
        """The same part by part, as few in memory as that takes: part and its columns; raises as `columns`."""
        rows = self._manifest.run(
            "SELECT part.part, column_file.name, part.column_row FROM part JOIN column_file "
            'ON column_file.id = part.column_file WHERE maker = ? AND "group" = ? AND key = ? ORDER BY part',
            (self._maker, group, key),
        )
        places = [_Place(int(part), str(name), int(row)) for part, name, row in rows]
        first = 0
        while first < len(places):
            stop = first + 1
            while stop < len(places) and places[stop].file == places[first].file:
                stop += 1
            yield from self._file_parts(group, key, places[first:stop])
            first = stop

    def _file_parts(self, group: str, key: str, places: Sequence[_Place]) -> Iterator[tuple[int, Columns]]:
        """Columns of parts that lie in one file."""
        path = self.folder / COLUMNS / places[0].file
        try:
            with shard_columns(path) as reader:
                for place in places:
                    yield place.part, reader.columns(place.row, group, key, place.part)
        except SweepStoreError as error:
            if self.mode == "read":
                raise
            count = self._recorder.forget_file(path.name)
            again = f"; its {count} parts count as not done from now on: run the sweep again"
            raise SweepStoreError(f"{error}{again}") from error

    def record(self, shard: str | Path) -> int:
        """Take a shard into the manifest, in one transaction; how many of its parts were not there yet.

        shard: absolute, or within the store. When this returns its parts are on the disk, and the shard is gone or in
        `columns/`. Recording again what was recorded, also by another process, gives 0.

        Raises:
            SweepStoreError: It is missing, damaged, made by other code than `maker`; or the disk is full. A shard that
                is whole stays where it is.
        """
        checked = self.check(shard)
        return 0 if checked is None else self.record_all([checked])

    def check(self, shard: str | Path) -> Read | None:
        """A shard that is whole and may be recorded, for `record_all`; None for one that was recorded.

        Raises:
            SweepStoreError: It is missing, damaged, or made by other code than `maker`.
        """
        return self._recorder.check(self.folder / shard)

    def record_all(self, shards: Sequence[Read]) -> int:
        """Take shards into the manifest as `record` does, in one transaction: one wait for the disk for all of them.

        shards: from `check`; until then `recover` finds them, if this process is killed.
        """
        return self._recorder.record(shards)

    def recover(self, *, temporary_age: float = TEMPORARY_SECONDS) -> int:
        """Take over what killed processes have left; how many parts were found that way.

        Shards that no parent recorded are recorded, under the maker that they name (without one they are removed);
        damaged ones are set aside (`damaged`); parts whose columns are missing count as not done; files of columns that
        nothing refers to are recorded or removed; so are temporary files older than `temporary_age` [s].
        """
        return self._recorder.recover(temporary_age)

    def record_failure(self, recipe: str, sentence: str) -> None:
        """Note that a recipe (its hash) could not be made, and why; a later note of the same recipe replaces it."""
        with self._manifest.transaction():
            self._manifest.run("INSERT OR REPLACE INTO failure VALUES (?, ?, ?)", (self._maker, recipe, sentence))

    def forget_failures(self, recipes: Sequence[str]) -> None:
        """Forget why these recipes could not be made: they are tried again, or were made."""
        with self._manifest.transaction():
            statement = "DELETE FROM failure WHERE maker = ? AND recipe IN ({})"
            for _ in self._manifest.among(statement, (self._maker,), recipes):
                pass

    def failed(self) -> dict[str, str]:
        """Recipes (their hashes) that could not be made by this maker, and why."""
        return dict(self._manifest.run("SELECT recipe, sentence FROM failure WHERE maker = ?", (self._maker,)))

    def prune(self) -> int:
        """Remove what other makers have made, and files of columns that nothing refers to; how many parts."""
        with self._manifest.transaction():
            count = self._manifest.changed("DELETE FROM part WHERE maker != ?", (self._maker,))
            self._manifest.run("DELETE FROM failure WHERE maker != ?", (self._maker,))
            self._manifest.run("DELETE FROM maker WHERE id != ?", (self._maker,))
            unused = "id NOT IN (SELECT column_file FROM part WHERE column_file IS NOT NULL)"
            names = self._manifest.run(f"SELECT name FROM column_file WHERE {unused}")
            self._manifest.run(f"DELETE FROM column_file WHERE {unused}")
        for (name,) in names:
            discard(self.folder / COLUMNS / str(name))
        return count

    def _maker_number(self, maker: str) -> int:
        """The manifest's number of a maker, entered if it may be; -1 for one that it does not know."""
        if self.mode == "create":
            return self._manifest.number_of("maker", "maker", maker)
        rows = self._manifest.run("SELECT id FROM maker WHERE maker = ?", (maker,))
        return int(rows[0][0]) if rows else -1


def _by_group(keys: Iterable[Key]) -> Iterator[tuple[str, list[str]]]:
    """Groups in the order in which they come, each with its keys."""
    groups: dict[str, list[str]] = {}
    for group, key in keys:
        groups.setdefault(group, []).append(key)
    yield from groups.items()


def _refuse_other_folder(folder: Path, mode: Mode) -> None:
    """Refuse a folder that is not a store: no manifest, and more in it than a store that lost its manifest has."""
    if (folder / NAME).exists():
        return
    try:
        names = {path.name for path in folder.iterdir()} if mode == "create" else set[str]()
    except FileNotFoundError:
        return
    except NotADirectoryError as error:
        raise NotStoreError(f"{folder} cannot be a sweep's store: {error.strerror}") from error
    except OSError as error:
        raise SweepStoreError(f"{folder} cannot be a sweep's store: {error.strerror}") from error
    if mode == "read":
        raise NotStoreError(f"{folder} is not a sweep's store: it has no {NAME}")
    if names and SHARDS not in names and not all(name.startswith(NAME) for name in names):
        shown = ", ".join(sorted(names)[:3])
        raise NotStoreError(f"{folder} is not a sweep's store, but holds other things ({shown}): name a new folder")


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SweepStoreError(f"{folder} cannot be made: {error.strerror}") from error
