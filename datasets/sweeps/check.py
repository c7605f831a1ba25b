"""Whether a sweep's store is whole: all of it is read, and nothing is changed."""

from __future__ import annotations

from pathlib import Path

from ..errors import SweepStoreError
from .merging import require_kept
from .result_row import columns_of, payload_of
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
