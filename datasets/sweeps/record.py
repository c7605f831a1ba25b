"""From shards to the manifest: recording what workers left, and taking over what killed processes left.

The manifest names a file of columns only if it is there: a shard is moved, its new name put on the disk, and then the
transaction committed. A parent that is killed in between leaves a file that nothing refers to, which is found again.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import SweepStoreError
from ..storage.durable import TEMPORARY_SUFFIX, discard, discard_left, discard_tree, sync
from .manifest import Manifest, row_digest
from .shard import DAMAGED_SUFFIX, Shard, read_shard

SHARDS = "shards"
"""Folder of a store that workers write into; empty once all is recorded."""
COLUMNS = "columns"
"""Folder of shards that have per-pose columns, `<digest>.h5`, after they were recorded."""

KEPT = ("contours", "focal-points", "drives")
"""Folders of files that a plan keeps, by their recipes' keys."""

SHARD_SUFFIX = ".h5"


def kept_path(payload: Mapping[str, Any]) -> PurePosixPath | None:
    """The kept file that a payload names, such as contours/KEY.h5, within the store; None if it names none.

    Raises SweepStoreError for a path that no sweep writes.
    """
    path = payload.get("path")
    if path is None:
        return None
    own = PurePosixPath(str(path))
    if len(own.parts) != 2 or own.parts[0] not in KEPT or own.suffix != SHARD_SUFFIX or "\0" in own.name:
        raise SweepStoreError(f"the path {path!r:.80} is none of a kept file in the store")
    return own


_SHARDS_AT_A_TIME = 64  # a transaction when many are recovered
_OF_FILE = "column_file = (SELECT id FROM column_file WHERE name = ?)"

Read = tuple[Path, Shard]
"""Where a shard lies, and its rows."""


class Recorder:
    """Takes shards of a store into its manifest; every method raises SweepStoreError."""

    def __init__(self, folder: Path, manifest: Manifest, maker: str, damaged: list[str]) -> None:
        self._folder = folder
        self._manifest = manifest
        self._maker = maker
        self._damaged = damaged

    def check(self, path: Path) -> Read | None:
        """A shard that may be recorded; None if it was; `SweepStore.check`."""
        if not path.exists() and self._is_recorded(path.name):
            return None
        try:
            content = read_shard(path, columns=False)
        except SweepStoreError:
            if not path.exists() and self._is_recorded(path.name):  # by another process, just now
                return None
            raise
        if content.maker not in (None, self._maker):
            raise SweepStoreError(
                f"{path} was made by {content.maker}, not by {self._maker}: a worker runs other code than its parent"
            )
        return path, content

    def record(self, shards: Sequence[Read]) -> int:
        """How many parts of shards were not there yet; `SweepStore.record_all`."""
        return self._record_present(shards)

    def recover(self, temporary_age: float) -> int:
        """How many parts killed processes have left; `SweepStore.recover`."""
        found = self._recover_columns()
        shards = sorted((self._folder / SHARDS).glob(f"*{SHARD_SUFFIX}"))
        for first in range(0, len(shards), _SHARDS_AT_A_TIME):
            found += self._take_over(shards[first : first + _SHARDS_AT_A_TIME])
        self._remove_temporary(temporary_age)
        return found

    def forget_file(self, name: str) -> int:
        """Set a file of columns that cannot be read aside; how many parts are no longer done."""
        with self._manifest.transaction():
            count = self._forget(name)
        path = self._folder / COLUMNS / name
        with contextlib.suppress(OSError):
            os.replace(path, path.with_name(name + DAMAGED_SUFFIX))
        return count

    def _is_recorded(self, name: str) -> bool:
        return bool(self._manifest.run("SELECT 1 FROM shard WHERE name = ?", (name,)))

    def _record(self, shards: Sequence[Read]) -> int:
        """Record shards; what is not kept for its columns is removed."""
        count = 0
        moved: list[tuple[Path, Path]] = []
        try:
            with self._manifest.transaction():
                for path, content in shards:
                    added, is_kept = self._insert(path, content)
                    count += added
                    if is_kept:
                        kept = self._folder / COLUMNS / (content.digest + SHARD_SUFFIX)
                        os.replace(path, kept)
                        moved.append((path, kept))
                for _, kept in moved:
                    sync(kept)  # workers do not wait for that
                if moved:
                    sync(self._folder / COLUMNS)
        except BaseException:
            for path, kept in moved:
                with contextlib.suppress(OSError):
                    os.replace(kept, path)
            raise
        kept_paths = {path for path, _ in moved}
        for path, _ in shards:
            if path not in kept_paths:
                discard(path)
        return count

    def _insert(self, path: Path, content: Shard) -> tuple[int, bool]:
        """Enter the rows of a shard that are new: how many, and whether the manifest now names its columns."""
        manifest = self._manifest
        name = content.maker if content.maker is not None else self._maker
        maker = manifest.number_of("maker", "maker", name)
        manifest.run("INSERT OR IGNORE INTO shard (name) VALUES (?)", (path.name,))
        has_columns = any(content.with_columns)
        kept = content.digest + SHARD_SUFFIX
        file = manifest.number_of("column_file", "name", kept) if has_columns else None
        count = manifest.changed_by(
            'INSERT OR IGNORE INTO part (maker, "group", key, part, payload, column_file, column_row, digest) '
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            [
                (
                    *(maker, *place, payload),
                    *((file, number) if has else (None, None)),
                    row_digest(name, *place, *((kept, number) if has else (None, None)), payload),
                )
                for number, (place, payload, has) in enumerate(
                    zip(content.places, content.payloads, content.with_columns, strict=True)
                )
            ],
        )
        if file is None or manifest.run("SELECT 1 FROM part WHERE column_file = ? LIMIT 1", (file,)):
            return count, file is not None
        manifest.run("DELETE FROM column_file WHERE id = ?", (file,))
        return count, False

    def _record_present(self, whole: Sequence[Read]) -> int:
        """Record shards that may be recorded by another parent at this moment."""
        try:
            return self._record(whole) if whole else 0
        except SweepStoreError:
            present = [item for item in whole if item[0].exists()]
            if len(present) == len(whole):
                raise
        return self._record_present(present)

    def _take_over(self, paths: Iterable[Path]) -> int:
        """Record the shards among these that are whole."""
        whole: list[Read] = []
        for path in paths:
            try:
                content = read_shard(path, columns=False)
            except SweepStoreError as error:
                if path.exists():  # else another parent has just recorded it
                    self._set_aside(path, str(error))
                continue
            if content.maker is None:
                discard(path)
            else:
                whole.append((path, content))
        return self._record_present(whole)

    def _recover_columns(self) -> int:
        """Make the manifest and `columns/` agree; how many parts came from files that it did not name."""
        folder = self._folder / COLUMNS
        with self._manifest.transaction():  # nobody moves a shard meanwhile
            named = {str(name) for (name,) in self._manifest.run("SELECT name FROM column_file")}
            there = {path.name for path in folder.glob(f"*{SHARD_SUFFIX}")}
            for name in sorted(named - there):
                lost = self._forget(name)
                self._damaged.append(f"{folder / name} is missing: its {lost} parts count as not done")
        return self._take_over(folder / name for name in sorted(there - named))

    def _forget(self, name: str) -> int:
        count = self._manifest.changed(f"DELETE FROM part WHERE {_OF_FILE}", (name,))
        self._manifest.run("DELETE FROM column_file WHERE name = ?", (name,))
        return count

    def _set_aside(self, path: Path, sentence: str) -> None:
        with contextlib.suppress(OSError):
            os.replace(path, path.with_name(path.name + DAMAGED_SUFFIX))
        self._damaged.append(sentence)

    def _remove_temporary(self, age: float) -> None:
        """Remove what killed writers have left; files that take long to write are locked meanwhile."""
        now = time.time()
        for folder in (self._folder, *(self._folder / name for name in (SHARDS, *KEPT))):
            for path in folder.glob(f"*{TEMPORARY_SUFFIX}"):
                with contextlib.suppress(OSError):
                    if now - path.lstat().st_mtime >= age:
                        (discard_tree if path.is_dir() else discard_left)(path)  # a folder is that of a table of poses
