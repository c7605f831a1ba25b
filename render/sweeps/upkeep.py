"""`palpate sweep status`, `failures`, `prune` and `merge`: they look after a store, and render nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...datasets.counted import counted
from ...datasets.storage.durable import FolderLock
from ...datasets.sweeps.merging import Merged, merge_store
from ...datasets.sweeps.store import SweepStore
from ..errors import PlanError
from ..terminal import console
from ..terminal.foreign_text import show_table
from .job import is_occupied
from .plan.code_version import code_version
from .report.summary import failure_rows


def show_status(folder: Path, *, as_json: bool) -> int:
    """Show what a store holds, and how its last run ended."""
    own = code_version()
    with SweepStore(folder) as store:
        last, counts, failed = store.last_run(), store.group_counts(), store.failure_counts()
    sizes = {path.name: size for path in sorted(folder.iterdir()) if (size := _size(path))}
    values: dict[str, Any] = {
        "store": str(folder),
        "last_run": last,
        "is_in_use": FolderLock.is_held(folder),
        "bytes": sizes,
        "code_version": own,
        "results": [dict(zip(("code_version", "group", "results", "chunks"), row, strict=True)) for row in counts],
        "recipes_failed": failed,
    }
    if as_json:
        console.show_values(values, as_json=True, title="")
        return console.DONE
    shown = {
        "last run": None if last is None else f"{last['plan']}, {last['begun']}, {last['state']}",
        "in use now": "yes" if values["is_in_use"] else "no",
        **{name: f"{size:,} bytes" for name, size in sizes.items()},
    }
    console.show_values(shown, as_json=False, title=str(folder))
    rows = [(code, group, f"{results:,}", f"{chunks:,}") for code, group, results, chunks in counts]
    rows += [(code, "recipes that failed", f"{count:,}", "") for code, count in failed.items()]
    named = [(f"{code} (this code)" if code == own else code, *row) for code, *row in rows]
    if named:
        show_table("results by code version, the latest last", named, ("code version", "group", "results", "chunks"))
    return console.DONE


def _size(path: Path) -> int:
    """Of a file, or of the files of a folder [byte]."""
    files = path.iterdir() if path.is_dir() else [path]
    return sum(own.lstat().st_size for own in files if own.is_file())


def show_failures(folder: Path, *, as_json: bool) -> int:
    """Show which recipes could not be made, and why: by this code version, or else by the one that recorded last."""
    own = code_version()
    with SweepStore(folder) as store:
        is_known = own in store.code_versions()
    with SweepStore(folder, own if is_known else None) as store:
        code, failures = store.code, store.failures()
    if as_json:
        values = {"store": str(folder), "code_version": code, "failures": [vars(failure) for failure in failures]}
        console.show_values(values, as_json=True, title="")
        return console.DONE
    console.show_values({"code version": code, "recipes failed": len(failures)}, as_json=False, title=str(folder))
    if rows := failure_rows(failures):
        show_table("recipes that could not be made", rows, ("recipe", "why"))
    return console.DONE


def prune_store(folder: Path, is_dry: bool, *, as_json: bool) -> int:
    """Remove results of other code versions than this one.

    Raises PlanError where this code has no result that would stay, SweepStoreError while the store is in use.
    """
    own = code_version()
    with SweepStore(folder, own) as store:
        found = store.unused()
    if not found.rows_kept:
        raise PlanError(
            f"{folder} has no result of this code version, {own}, so nothing would stay: run the sweep first, keep the "
            f"{found.rows:,} results of other code versions by --same-results, or delete the folder"
        )
    byte_count = sum(path.stat().st_size for path in found.files if path.is_file())
    if not is_dry:
        with SweepStore(folder, own, mode="write") as store:
            found = store.prune()
    values = {
        "store": str(folder),
        "is_dry_run": is_dry,
        "code_versions_removed": list(found.code_versions),
        "chunks_removed": found.rows,
        "files_removed": len(found.files),
        "bytes_removed": byte_count,
        "chunks_kept": found.rows_kept,
    }
    shown = list(values)[1:]  # the store is the title
    console.show_values(values, as_json=as_json, title=str(folder), shown_names=shown)
    return console.DONE


def merge_stores(target: Path, sources: Sequence[Path], *, as_json: bool) -> int:
    """Take over results of other stores: those of this code version, or else of the one that all stores have.

    Raises PlanError for a source that is the target, and for stores without a code version in common.
    """
    if twice := next((own for own in sources if own.resolve() == target.resolve()), None):
        raise PlanError(f"{twice} cannot be merged into itself")
    code = _common_code([*([target] if is_occupied(target) else []), *sources])
    merged: dict[Path, Merged] = {}
    with SweepStore(target, code, mode="write") as store:
        for source in dict.fromkeys(sources):
            with SweepStore(source, code) as other:
                merged[source] = merge_store(store, other)
                left = [own for own, count in other.code_versions().items() if count and own != code]
            for problem in merged[source].problems:
                console.warn(f"{problem}; it was left out")
            if left:
                console.warn(f"{source}: results of {counted(len(left), 'other code version')} were left out")
    values = {
        "store": str(target),
        "code_version": code,
        "chunks_merged": sum(own.results for own in merged.values()),
        "failures_merged": sum(own.failures for own in merged.values()),
        "sources": [
            {"store": str(source), "chunks": own.results, "failures": own.failures, "problems": own.problems}
            for source, own in merged.items()
        ],
    }
    shown = ("code_version", "chunks_merged", "failures_merged")
    console.show_values(values, as_json=as_json, title=str(target), shown_names=shown)
    return console.FAILED if any(own.problems for own in merged.values()) else console.DONE


def _common_code(stores: Sequence[Path]) -> str:
    """The code version that is merged: of each store this one's results if it has some, else those recorded last."""
    own, found = code_version(), dict[Path, str]()
    for folder in stores:
        with SweepStore(folder) as store:
            failed = store.failure_counts()
            codes = [code for code, count in store.code_versions().items() if count or code in failed]
        if codes:
            found[folder] = own if own in codes else codes[-1]
    if len(set(found.values())) > 1:
        each = "; ".join(f"{folder} has {code}" for folder, code in found.items())
        raise PlanError(
            f"these stores have results of different code versions, which do not make one table: {each}. Where you "
            "know that the results are the same, palpate sweep --same-results takes them over, in each store"
        )
    return next(iter(found.values()), own)
