"""A sweep's store: a folder with what was made, found again by what it depends on; nothing in it is made twice.

Workers leave shards in `shards/`; parents take them into the manifest (`manifest.py`), which is the only truth
about what is done. A shard with per-pose columns then goes to `columns/`, named by its content; others are removed.
docs/formats/sweep-store.md describes the same for readers in other languages.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..errors import NotStoreError, SweepStoreError
from ..storage.hdf5_columns import Columns
from .counted_versions import counted_for, write_statements
from .failures import add_failures, failures_of, remove_failures
from .manifest import NAME, Manifest, Mode
from .parts import PartRow, Parts, payload_of
from .prune import Unused, remove_parts, unused_parts
from .record import COLUMNS, SHARDS, Read, Recorder
from .same_results import add_statement, latest_maker, statements_of
from .shard import require_named, shard_columns

TEMPORARY_SECONDS = 900.0
"""Age of a temporary file at which its writer is taken for dead; writing one takes seconds."""

KEPT = "keep-"
"""Begins the names of groups that leave a file in the store: their payloads hold its `path` in there and `bytes`."""

Key = tuple[str, str]
"""Group and key."""


@dataclass(frozen=True)
class _Place:
    """Where the columns of a part lie."""

    part: int
    file: str
    row: int


class SweepStore:
    """A sweep's store, open. Several processes may have it open, and write, at once; threads may share one.

    maker: which code's results count as done, and under which new ones are recorded. None, only for reading: the one
    that recorded last.
    mode: "create" makes the folder, or takes it up again; "read" changes nothing.
    Raises NotStoreError where the folder holds other things, SweepStoreError where the store is damaged, of a newer
    version, or cannot be written.

    >>> from palpate.datasets import ShardRow, SweepStore, write_shard
    >>> with SweepStore("study.sweep", maker="own code 1.0") as store:
    ...     write_shard("study.sweep/shards/0.h5", [ShardRow("contours", "a1b2", 0, {"length": 0.34})])
    ...     recorded = store.record("shards/0.h5")
    ...     store.done([("contours", "a1b2"), ("contours", "c3d4")])
    {('contours', 'a1b2'): {0}, ('contours', 'c3d4'): set()}
    """

    def __init__(self, folder: str | Path, *, maker: str | None = None, mode: Mode = "create") -> None:
        self.folder = Path(folder).absolute()
        self.mode: Mode = mode
        self.damaged: list[str] = []
        """One sentence for each damage that was met: a shard set aside, parts that count as not done."""
        if mode == "create" and maker is None:
            raise SweepStoreError(f'{self.folder}: recording needs maker=, who computes; mode="read" only reads')
        _refuse_other_folder(self.folder, mode)
        if mode == "create":
            _make_folder(self.folder)
        self._note_lost_manifest()
        self._manifest = Manifest(self.folder, mode, maker)
        if self._manifest.adopted:
            self.damaged.append(
                f"{self._manifest.path} carried no digests: its {self._manifest.adopted} parts are believed as they "
                "are, and proven from now on"
            )
        try:
            if mode == "create":
                for name in (SHARDS, COLUMNS):
                    _make_folder(self.folder / name)
            self.maker = maker if maker is not None else next(reversed(self.makers()), "")
            self._maker = self._maker_number(self.maker)
            self._count(counted_for(statements_of(self._manifest), self.maker))
            if mode == "create":
                write_statements(self.folder, statements_of(self._manifest))
            self._proven: dict[Path, tuple[int, int, int]] = {}
            self._recorder = Recorder(self.folder, self._manifest, self.maker, self.damaged)
        except BaseException:
            self.close()
            raise

    def __repr__(self) -> str:
        """One line."""
        return f"SweepStore({str(self.folder)!r})"

    @property
    def is_proven(self) -> bool:
        """Whether the manifest carries digests; one of version 1, opened for reading, is believed as it is."""
        return self._parts.are_proven

    def _note_lost_manifest(self) -> None:
        """Say that a folder had a manifest once, which is gone."""
        if self.mode == "create" and (self.folder / SHARDS).is_dir() and not (self.folder / NAME).exists():
            self.damaged.append(
                f"{self.folder / NAME} is missing, so a new one is made: per-pose columns and kept files are taken "
                "over, metrics are made anew"
            )

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
        found = {str(maker): int(count) for maker, count in rows}
        if self._manifest.version > 1:
            statement = (
                "SELECT maker.maker, total(parts) FROM maker LEFT JOIN tally ON tally.maker = maker.id GROUP BY 1"
            )
            counted = {str(maker): int(count) for maker, count in self._manifest.run(statement)}
            if counted != found:
                raise self._manifest.damaged(f"makers have {found} parts, and {counted} were recorded")
        return found

    @property
    def made_by(self) -> str:
        """Whose results this gives, for people: the maker, and others whose results count for it."""
        return "; ".join((self.maker, *(f"also results of {maker}" for maker in self.counted)))

    def latest_other(self) -> str | None:
        """Of other makers the one that recorded a result last; None if no other has one in the store."""
        return latest_maker(self._manifest, self._maker)

    def count_results_of(self, maker: str) -> None:
        """Have another maker's results, and what counts for that, count for this one; mode "create" records it.

        In mode "read" they count until the store is closed. Stating it again does nothing.
        """
        if self.mode == "create":
            add_statement(self._manifest, (self._maker, self.maker), (self._maker_number(maker), maker))
            write_statements(self.folder, statements_of(self._manifest))
        statements = statements_of(self._manifest)
        statements.setdefault(self.maker, []).append(maker)
        self._count(counted_for(statements, self.maker))

    def _count(self, makers: tuple[str, ...]) -> None:
        """Let results of other makers count as this one's, which come first."""
        self.counted = makers
        """Other makers whose results count, because a person stated that they are the same."""
        self._makers = [(self._maker_number(name), name) for name in (self.maker, *makers)]
        self._parts = Parts(self._manifest, self._makers)

    def done(self, keys: Sequence[Key]) -> dict[Key, set[int]]:
        """Parts that are there of each (group, key), all keys asked for, in their order; an empty set for nothing.

        A part that left a file is there as long as that is, with its bytes; else it counts as not done from now on
        (mode "create"). So does a part whose row in the manifest is damaged; `damaged` names it.

        Raises:
            SweepStoreError: The manifest is damaged beyond that; mode "read": or at all.
        """
        found: dict[Key, set[int]] = {key: set() for key in keys}
        for group, own in _by_group(found):
            lost: list[PartRow] = []
            for rows, damaged in self._parts.of(group, own):
                if damaged:
                    self._forget_damaged(group, damaged)
                for row in rows:
                    if group.startswith(KEPT) and not self._has_file(payload_of(row, self._manifest.path)):
                        lost.append(row)
                    else:
                        found[group, row.key].add(row.part)
            if self.mode == "create":
                self._parts.forget(lost)
        return found

    def _forget_damaged(self, group: str, rows: Sequence[PartRow]) -> None:
        """Have parts made again whose rows are damaged."""
        sentence = (
            f"{self._manifest.path} is damaged: {len(rows)} parts of {group} do not have their digests, "
            f"part {rows[0].part} of {rows[0].key} first"
        )
        if self.mode == "read":
            raise SweepStoreError(f"{sentence}; run the sweep again: it makes them anew")
        self._parts.forget(rows)
        self.damaged.append(f"{sentence}; they count as not done")

    def _has_file(self, payload: dict[str, Any]) -> bool:
        """Whether the file that a payload names is there in full, or it names none."""
        path = payload.get("path")
        if path is None:
            return True
        try:
            return os.stat(f"{self.folder}/{path}").st_size == payload.get("bytes")
        except (OSError, ValueError):  # a name with a null character
            return False

    def results(self, keys: Sequence[Key]) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
        """Group, key, part and payload of every part that is there, group by group, keys as asked for, parts upwards.

        A key asked for twice comes once. Raises SweepStoreError where the manifest is damaged.
        """
        for group, own in _by_group(dict.fromkeys(keys)):
            number = {key: place for place, key in enumerate(own)}
            for rows in self._whole_rows(group, own):
                rows.sort(key=lambda row: (number[row.key], row.part))
                for row in rows:
                    yield group, row.key, row.part, payload_of(row, self._manifest.path)

    def _whole_rows(self, group: str, keys: Sequence[str]) -> Iterator[list[PartRow]]:
        """Rows of keys, all of them whole."""
        for rows, damaged in self._parts.of(group, keys):
            if damaged:
                self._forget_damaged(group, damaged)
                raise SweepStoreError(f"{self.damaged[-1]} from now on: run the sweep again")
            yield rows

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
        rows = [row for batch in self._whole_rows(group, [key]) for row in batch]
        places = [_Place(row.part, row.file.decode(), row.row) for row in rows if row.file and row.row is not None]
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
            self._require_named(path)
            with shard_columns(path) as reader:
                for place in places:
                    yield place.part, reader.columns(place.row, group, key, place.part)
        except SweepStoreError as error:
            if self.mode == "read":
                raise SweepStoreError(f"{error}; remove it and run the sweep again: its parts are made anew") from error
            count = self._recorder.forget_file(path.name)
            again = f"; its {count} parts count as not done from now on: run the sweep again"
            raise SweepStoreError(f"{error}{again}") from error

    def _require_named(self, path: Path) -> None:
        """Prove a file of columns by its name, once as long as nobody touches it."""
        try:
            state = path.stat()
        except FileNotFoundError:
            raise SweepStoreError(f"{path} does not exist") from None
        except (OSError, ValueError) as error:
            raise SweepStoreError(f"{path} cannot be read: {error}") from error
        touched = (state.st_ino, state.st_size, state.st_mtime_ns)
        if self._proven.get(path) != touched:
            require_named(path)
            self._proven[path] = touched

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

        Raises SweepStoreError where it is missing, damaged, or made by other code than `maker`.
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
        self.record_failures({recipe: sentence})

    def record_failures(self, failures: Mapping[str, str]) -> None:
        """The same of several recipes, in one transaction."""
        add_failures(self._manifest, (self._maker, self.maker), failures)

    def forget_failures(self, recipes: Sequence[str]) -> None:
        """Forget why these recipes could not be made: they are tried again, or were made."""
        remove_failures(self._manifest, self._makers, recipes)

    def failed(self) -> dict[str, str]:
        """Recipes (their hashes) that could not be made by this maker, and why.

        A damaged note is forgotten, and `damaged` names it; mode "read": it raises SweepStoreError.
        """
        found: dict[str, str] = {}
        for maker in reversed(self._makers):  # of two sentences for a recipe, the own one stays
            found |= failures_of(self._manifest, maker, None if self.mode == "read" else self.damaged)
        return found

    def unused(self) -> Unused:
        """What `prune` would remove."""
        return unused_parts(self._manifest, self.folder, (number for number, _ in self._makers))

    def prune(self) -> Unused:
        """Remove what makers have made whose results do not count, and files that nothing else refers to."""
        unused = remove_parts(self._manifest, self.folder, (number for number, _ in self._makers))
        write_statements(self.folder, statements_of(self._manifest))
        return unused

    def _maker_number(self, maker: str) -> int:
        """The manifest's number of a maker, entered if it may be; -1 for one that it does not know."""
        if self.mode == "create":
            return self._manifest.number_of("maker", "maker", maker)
        rows = self._manifest.run("SELECT id FROM maker WHERE maker = ?", (maker,))
        return int(rows[0][0]) if rows else -1


def is_read_only(folder: Path) -> bool:
    """Whether a folder is a store that this process cannot write, such as one on a read-only mount."""
    return (folder / NAME).exists() and not os.access(folder, os.W_OK)


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
