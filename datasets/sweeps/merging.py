"""Taking results of another store over: rows that have their digests, and the kept files that they name."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..contour_file.check import check_file
from ..errors import SweepStoreError
from ..focus_files.frame_reader import check_frames, frame_format
from ..storage.durable import open_own
from .result_row import ResultRow, columns_of, payload_of
from .store import KEEPING, SweepStore, kept_path
from .store_database import NAME


def is_store(path: str | Path) -> bool:
    """Whether a path is a folder with a sweep's store."""
    return (Path(path) / NAME).exists()


def check_store(folder: str | Path) -> list[str]:
    """A sentence for each damage of a store; none if it is whole."""
    problems: list[str] = []
    try:
        with SweepStore(folder) as store:
            problems += store.integrity()
            codes = list(store.code_versions())
        for code in codes:
            with SweepStore(folder, code) as store:
                problems += _row_problems(store)
    except SweepStoreError as error:
        problems.append(str(error))
    return problems


def _row_problems(store: SweepStore) -> list[str]:
    """Of the rows of one code version, and of the kept files that they name."""
    problems: list[str] = []
    for row in store.rows():
        place = f"{store.path}: chunk {row.chunk} of {row.group} {row.key}"
        if not row.is_whole(store.code):
            problems.append(f"{place} is damaged: it does not have its digest")
            continue
        try:
            payload = payload_of(row.payload)
            if row.columns is not None:
                columns_of(row.columns)
            if row.group.startswith(KEEPING) and payload.get("path") is not None:
                require_kept(store.folder / kept_path(payload["path"]), payload.get("bytes"))
        except (SweepStoreError, ValueError) as error:
            problems.append(f"{place}: {error}")
        except OSError as error:
            problems.append(f"{error.filename or place} cannot be read: {error.strerror or error}")
    return problems


_ROWS_AT_ONCE = 1000  # of a transaction


@dataclass
class Merged:
    """What one store gave to another."""

    results: int = 0
    """Rows that were not there yet."""
    failures: int = 0
    """Recipes that could not be made."""
    problems: list[str] = field(default_factory=list[str])
    """A sentence for each damage; what is damaged was left out."""


def merge_store(target: SweepStore, source: SweepStore) -> Merged:
    """Take over what the target's code version made in another store, which stays as it is.

    source: open for that code version. Merging again adds nothing. After a kill the target is whole, and merging again
    completes it. Raises SweepStoreError if the target cannot be written.
    """
    merged, rows = Merged(), list[ResultRow]()
    for row in _whole_rows(source, merged):
        files = _kept_file(target, source, row, merged)
        if files is None:
            continue
        if files:
            merged.results += target.add([row], files)
            continue
        rows.append(row)
        if len(rows) == _ROWS_AT_ONCE:
            merged.results += target.add(rows)
            rows.clear()
    merged.results += target.add(rows)
    before = target.failures()
    known = {failure.recipe_hash for failure in before}
    failures = [failure for failure in source.failures() if failure.recipe_hash not in known]
    target.replace_failures([*before, *failures])
    merged.failures = len(failures)
    target.clear_scratch()
    return merged


def _whole_rows(source: SweepStore, merged: Merged) -> Iterator[ResultRow]:
    """Rows of the source's code version that have their digests."""
    for row in source.rows():
        if row.is_whole(source.code):
            yield row
        else:
            place = f"chunk {row.chunk} of {row.group} {row.key}"
            merged.problems.append(f"{source.path} is damaged: {place} does not have its digest")


def _kept_file(
    target: SweepStore, source: SweepStore, row: ResultRow, merged: Merged
) -> dict[str, Path | bytes] | None:
    """A copy of the file that a row names, on the target's disk; none for a row without one; None to leave it out.

    Raises SweepStoreError if the target cannot be written.
    """
    if not row.group.startswith(KEEPING):
        return {}
    try:
        payload = payload_of(row.payload)
        if payload.get("path") is None:
            return {}
        name = kept_path(payload["path"])
        if name.stem != row.key:
            raise SweepStoreError(f"chunk {row.chunk} of {row.group} {row.key} names the file of another, {name}")
        if row.chunk in target.done([(row.group, row.key)])[row.group, row.key]:
            return None  # the target has a whole one
        path = source.folder / name
        require_kept(path, payload.get("bytes"))
    except (SweepStoreError, ValueError) as error:
        merged.problems.append(str(error) if str(source.folder) in str(error) else f"{source.path}: {error}")
        return None
    except OSError as error:
        merged.problems.append(f"{error.filename or source.folder} cannot be read: {error.strerror or error}")
        return None
    copy = target.scratch() / name.name
    try:
        shutil.copyfile(path, copy)
    except OSError as error:
        raise SweepStoreError(f"{copy} cannot be written: {error.strerror or error}") from error
    return {str(name): copy}


def require_kept(path: Path, size: object) -> None:
    """Read all of a kept file; raises SweepStoreError, or OSError, for one that is damaged or cannot be read."""
    os.close(open_own(path, os.O_RDONLY))
    if path.stat().st_size != size:
        raise SweepStoreError(f"{path} is damaged: it does not have {size} bytes")
    problems = check_file(path) if frame_format(path) is None else check_frames(path)
    if problems:
        raise SweepStoreError(problems[0])
