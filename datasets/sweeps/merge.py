"""Taking over results of another store: its manifest is read, the files that it names are copied, then recorded."""

from __future__ import annotations

import contextlib
import filecmp
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from ..contour_file.check import check_file
from ..errors import SweepStoreError
from ..focus_files.frame_reader import check_frames, frame_format
from ..storage.durable import NewFile, discard, open_own
from .failures import failures_of
from .manifest import Manifest
from .parts import PartRow, Parts, payload_of
from .record import COLUMNS, SHARD_SUFFIX, SHARDS, kept_path
from .same_results import Maker
from .shard import ShardRow, require_named, write_shard
from .store import SweepStore

ROWS_MOST = 10_000  # of a shard that is written here


@dataclass
class Merged:
    """What one store gave to another."""

    parts: int = 0
    """That were not there yet."""
    failures: int = 0
    """Recipes that could not be made."""
    problems: list[str] = field(default_factory=list[str])
    """A sentence for each kind of damage: these parts were left out."""

    def add(self, other: Merged) -> None:
        """Count what came of another merge, too."""
        self.parts += other.parts
        self.failures += other.failures
        self.problems += other.problems


def merge_store(target: SweepStore, source: Path) -> Merged:
    """Take over what the target's code version made in another store, which stays as it is.

    Merged again, nothing is added. Killed in between, the target is whole, and merging again completes it.

    Raises:
        SweepStoreError: The source is no store, or damaged beyond single rows and files; the target cannot be written.
    """
    merged = Merged()
    with contextlib.closing(Manifest(source, "read")) as manifest:
        numbers = manifest.run("SELECT id FROM maker WHERE maker = ?", (target.maker,))
        if not numbers:
            return merged
        maker: Maker = (int(numbers[0][0]), target.maker)
        columns: dict[str, None] = {}
        bare: list[ShardRow] = []
        for group, row in _missing_rows(target, manifest, maker, merged):
            if row.file is not None:
                columns[row.file.decode()] = None
                continue
            own = ShardRow(group, row.key, row.part, payload_of(row, manifest.path))
            if _take_file(target, source, own.payload, merged):
                bare.append(own)
        for name in columns:
            merged.parts += _take_columns(target, source / COLUMNS, name, merged)
        for first in range(0, len(bare), ROWS_MOST):
            merged.parts += _take_rows(target, bare[first : first + ROWS_MOST], first)
        known = target.failed()
        failures = {recipe: why for recipe, why in failures_of(manifest, maker, None).items() if recipe not in known}
        target.record_failures(failures)
        merged.failures = len(failures)
    return merged


def _missing_rows(
    target: SweepStore, manifest: Manifest, maker: Maker, merged: Merged
) -> Iterator[tuple[str, PartRow]]:
    """Whole rows of a maker that the target lacks, and their groups."""
    keys: dict[str, list[str]] = {}
    for group, key in manifest.run('SELECT DISTINCT "group", key FROM part WHERE maker = ? ORDER BY 1, 2', maker[:1]):
        keys.setdefault(str(group), []).append(str(key))
    parts, damaged = Parts(manifest, [maker]), Counter[str]()
    for group, own in keys.items():
        there = target.done([(group, key) for key in own])
        for rows, broken in parts.of(group, own):
            damaged[group] += len(broken)
            yield from ((group, row) for row in rows if row.part not in there[group, row.key])
    for group, count in damaged.items():
        if count:
            merged.problems.append(f"{manifest.path} is damaged: {count} parts of {group} do not have their digests")


def _take_columns(target: SweepStore, folder: Path, name: str, merged: Merged) -> int:
    """Copy a file of columns, which is a shard, and record it; how many parts that adds."""
    shard = target.folder / SHARDS / name
    try:
        if PurePosixPath(name).name != name:
            raise SweepStoreError(f"{folder / name} is not in its store")
        require_named(folder / name)
        _copy(folder / name, shard)
        return target.record(shard)
    except _UnwritableError:
        raise
    except SweepStoreError as error:
        discard(shard)
        merged.problems.append(str(error))
        return 0


def _take_rows(target: SweepStore, rows: list[ShardRow], number: int) -> int:
    """Record rows without columns; how many parts that adds."""
    shard = target.folder / SHARDS / f"merge-{os.getpid()}-{number}{SHARD_SUFFIX}"
    try:
        write_shard(shard, rows, maker=target.maker)
    except OSError as error:
        raise _unwritable(target.folder, error) from error
    return target.record(shard)


def _take_file(target: SweepStore, source: Path, payload: Any, merged: Merged) -> bool:
    """Copy the file that a row is about, if there is one; whether the row can be recorded."""
    try:
        name = kept_path(payload)
        if name is None:
            return True
        _require_kept(source / name, payload.get("bytes"))
        own = target.folder / name
        if own.exists():
            if not filecmp.cmp(source / name, own, shallow=False):
                raise SweepStoreError(f"{source / name} differs from {own}, which stays; remove that to take this")
            return True
        with contextlib.suppress(FileNotFoundError):  # a file beside contours names the code that made them
            _copy((source / name).with_suffix(".json"), own.with_suffix(".json"))
        _copy(source / name, own)
        return True
    except _UnwritableError:
        raise
    except SweepStoreError as error:
        merged.problems.append(str(error) if str(source) in str(error) else f"{source}: {error}")
    except OSError as error:
        merged.problems.append(f"{error.filename or source} cannot be read: {error.strerror}")
    return False


def _require_kept(path: Path, size: object) -> None:
    """Raise SweepStoreError, or OSError, for a kept file that is damaged or cannot be read; all of it is."""
    os.close(open_own(path, os.O_RDONLY))
    if path.stat().st_size != size:
        raise SweepStoreError(f"{path} is damaged: it does not have {size} bytes")
    problems = check_file(path) if frame_format(path) is None else check_frames(path)
    if problems:
        raise SweepStoreError(problems[0])


def _copy(path: Path, to: Path) -> None:
    """Copy a regular file; its new name shows it whole or not at all.

    Raises OSError where it cannot be read, _UnwritableError where the copy cannot be written.
    """
    with os.fdopen(open_own(path, os.O_RDONLY), "rb") as old:
        try:
            to.parent.mkdir(exist_ok=True)
            with NewFile(to) as new:
                shutil.copyfileobj(old, new)
        except OSError as error:
            raise _unwritable(to, error) from error


class _UnwritableError(SweepStoreError):
    """The target takes nothing more."""


def _unwritable(path: Path, error: OSError) -> _UnwritableError:
    return _UnwritableError(f"{path} cannot be written: {error.strerror or error}; what was merged so far is safe")
