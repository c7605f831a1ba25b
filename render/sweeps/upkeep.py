"""What `palpate sweep status`, `failures`, `prune` and `merge` do: they look after a store, and render nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...datasets.storage.durable import FolderLock
from ...datasets.sweeps.merging import Merged, merge_store
from ...datasets.sweeps.store import SweepStore
from ..errors import PlanError
from ..terminal import console
from ..terminal.foreign_text import show_table, visible
from .plan.code_version import code_version
from .report.failures import failure_rows


def show_status(folder: Path, *, as_json: bool) -> int:
    """Show what a store holds, and how its last run ended."""
    own = code_version()
    with SweepStore(folder) as store:
        last, counts, failures = store.last_run(), store.group_counts(), store.failure_counts()
        versions = list(store.code_versions())
    paths = [path for path in folder.iterdir() if path.is_file() or path.is_dir()]
    sizes = {path.name: size for path in sorted(paths) if (size := _bytes(path))}
    values: dict[str, Any] = {
        "store": str(folder),
        "last_run": last,
        "is_in_use": FolderLock.is_held(folder),
        "bytes": sizes,
        "code_version": own,
        "code_versions": [
            {
                "code_version": version,
                "is_this_code": version == own,
                "failures": failures.get(version, 0),
                "groups": [
                    {"group": group, "results": results, "chunks": chunks}
                    for code, group, results, chunks in counts
                    if code == version
                ],
            }
            for version in versions
        ],
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
    rows: list[tuple[str, ...]] = []
    for version in reversed(versions):
        name = f"{visible(version)}{' (this code)' if version == own else ''}"
        rows += [(name, visible(own), f"{results:,}", f"{n:,}") for code, own, results, n in counts if code == version]
        if version in failures:
            rows.append((name, "recipes that failed", f"{failures[version]:,}", ""))
    show_table("results by code version, the last one first", rows, ("code version", "group", "results", "chunks"))
    return console.DONE


def _bytes(path: Path) -> int:
    """Of a file, or of the files of a folder [byte]."""
    files = path.glob("*") if path.is_dir() else [path]
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


def prune_store(folder: Path, *, is_dry: bool, as_json: bool) -> int:
    """Remove results of other code versions than this one.

    Raises PlanError where this code has no result that would stay, SweepStoreError while the store is in use.
    """
    own = code_version()
    with SweepStore(folder, own) as store:
        found = store.unused()
    if not found.rows_kept:
        raise PlanError(
            f"{folder}: all of its {found.rows:,} results are of other code versions than this one's, {own}, so "
            "nothing would stay; run the sweep first, keep them by --same-results, or delete the folder"
        )
    byte_count = sum(path.stat().st_size for path in found.files if path.is_file())
    if not is_dry:
        with SweepStore(folder, own, mode="write") as store:
            found = store.prune()
    values = {
        "store": str(folder),
        "is_dry_run": is_dry,
        "code_versions_removed": list(found.code_versions),
        "results_removed": found.rows,
        "files_removed": len(found.files),
        "bytes_removed": byte_count,
        "results_kept": found.rows_kept,
    }
    shown = {name: len(own) if isinstance(own, list) else own for name, own in values.items() if name != "store"}
    console.show_values(values if as_json else shown, as_json=as_json, title=str(folder))
    return console.DONE


def merge_stores(target: Path, sources: Sequence[Path], *, with_other_code: bool, as_json: bool) -> int:
    """Take results of other stores over into one, those of one code version unless others are asked for, too.

    Raises PlanError for a source that is the target, or has results of another code version only.
    """
    found = {source: _versions_of(source) for source in sources}
    if twice := next((own for own in sources if own.absolute().resolve() == target.absolute().resolve()), None):
        raise PlanError(f"{twice} cannot be merged into itself")
    main = _main_version(target, found, refuses_others=not with_other_code)
    others = dict.fromkeys(code for own in found.values() for code in own if code != main)
    merged = {source: Merged() for source in sources}
    for code in (*(others if with_other_code else ()), main):  # the main one last, so that it recorded last
        with SweepStore(target, code, mode="write") as store:
            for source, own in merged.items():
                with SweepStore(source, code) as other:
                    new = merge_store(store, other)
                own.results += new.results
                own.failures += new.failures
                own.problems += new.problems
    for source, own in merged.items():
        for problem in own.problems:
            console.warn(f"{problem}; it was left out")
        left = [code for code in found[source] if code != main]
        if left and not with_other_code:
            console.warn(f"{source}: results of {len(left)} other code versions were left out; --other-code takes them")
    values = {
        "store": str(target),
        "code_version": main,
        "results_merged": sum(own.results for own in merged.values()),
        "failures_merged": sum(own.failures for own in merged.values()),
        "sources": [{"store": str(source), **vars(own)} for source, own in merged.items()],
    }
    shown = ("code_version", "results_merged", "failures_merged")
    console.show_values(values, as_json=as_json, title=str(target), shown_names=shown)
    return console.FAILED if any(own.problems for own in merged.values()) else console.DONE


def _versions_of(source: Path) -> list[str]:
    """Code versions with results or failures in a store, the one that recorded last at the end."""
    with SweepStore(source) as store:
        failures = store.failure_counts()
        return [code for code, count in store.code_versions().items() if count or code in failures]


def _main_version(target: Path, found: dict[Path, list[str]], *, refuses_others: bool) -> str:
    """The code version that is merged: this one if there are results of it, else the one that all stores share."""
    stores = dict(found)
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        stores = {target: _versions_of(target)} | stores
    own = code_version()
    latest = {store: own if own in codes else codes[-1] for store, codes in stores.items() if codes}
    if refuses_others and len(set(latest.values())) > 1:
        each = "; ".join(f"{store} has {code}" for store, code in latest.items())
        raise PlanError(
            f"these stores have results of different code versions: {each}. Results of two code versions do not make "
            "one table: merge stores of one, or merge all with --other-code, where each keeps its code version"
        )
    return next(iter(latest.values()), own)
