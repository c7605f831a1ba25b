"""What `palpate sweep status`, `failures`, `prune` and `merge` do: they look after a store, and render nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...datasets.sweeps.merge import Merged, merge_store
from ...datasets.sweeps.status import StoreStatus, living_parents, store_status
from ...datasets.sweeps.store import SweepStore
from ..errors import PlanError, SweepError
from ..terminal import console
from ..terminal.foreign_text import show_table, visible
from .plan.code_version import code_version
from .report.failures import failure_rows
from .run.log import LOG, read_log
from .run.missing import Failure


def show_status(folder: Path, *, as_json: bool) -> int:
    """Show what a store holds, and how its last run ended."""
    status, last = store_status(folder), _last_run(folder)
    own, makers = code_version(), list(status.groups)
    values: dict[str, Any] = {
        "store": str(folder),
        "last_run": last,
        "parents": list(status.parents),
        "shards_waiting": status.shards_waiting,
        "bytes": status.bytes,
        "code_version": own,
        "makers": [
            {
                "maker": maker,
                "is_this_code": maker == own,
                "failures": status.failures.get(maker, 0),
                "groups": [vars(count) for count in status.groups[maker]],
            }
            for maker in makers
        ],
    }
    if as_json:
        console.show_values(values, as_json=True, title="")
        return console.DONE
    shown = {
        "last run": None if last is None else f"{last['plan']}, {last['time']}, {last['state']}",
        "at work now": ", ".join(status.parents) or "nobody",
        "shards waiting": status.shards_waiting,
        **{name: f"{size:,} bytes" for name, size in status.bytes.items()},
    }
    console.show_values(shown, as_json=False, title=str(folder))
    _show_makers(status, own)
    return console.DONE


def _show_makers(status: StoreStatus, own: str) -> None:
    """A row for each group of each code version."""
    rows: list[tuple[str, ...]] = []
    for maker, groups in reversed(status.groups.items()):
        name = f"{maker}{' (this code)' if maker == own else ''}"
        rows += [(name, visible(count.group), f"{count.results:,}", f"{count.parts:,}") for count in groups]
        if failures := status.failures.get(maker):
            rows.append((name, "recipes that failed", f"{failures:,}", ""))
    show_table("results by code version, the last one first", rows, ("code version", "group", "results", "parts"))


def _last_run(folder: Path) -> dict[str, Any] | None:
    """Plan, start and state of the run that began last, by the log; None without a log."""
    last: dict[str, Any] | None = None
    for event in read_log(folder / LOG):
        if event["event"] == "start":
            last = {"run": event["run"], "plan": event.get("plan"), "time": event["time"], "state": "not ended"}
        elif last is not None and event["run"] == last["run"] and event["event"] in ("end", "stopped"):
            last["state"] = "ended" if event["event"] == "end" else f"stopped: {event.get('sentence')}"
    return last


def show_failures(folder: Path, *, as_json: bool) -> int:
    """Show which recipes could not be made, and why: by this code version, or else by the one that recorded last."""
    own = code_version()
    with SweepStore(folder, maker=own if own in store_status(folder).groups else None, mode="read") as store:
        maker, failed = store.maker, store.failed()
    names = {
        str(event.get("recipe_hash")): str(event.get("recipe"))
        for event in read_log(folder / LOG)
        if event["event"] == "failure"
    }
    failures = [Failure(recipe, names.get(recipe, recipe), sentence) for recipe, sentence in failed.items()]
    if as_json:
        values = {"store": str(folder), "maker": maker, "failures": [vars(failure) for failure in failures]}
        console.show_values(values, as_json=True, title="")
        return console.DONE
    console.show_values({"code version": maker, "recipes failed": len(failures)}, as_json=False, title=str(folder))
    if rows := failure_rows(failures):
        show_table("recipes that could not be made", rows, ("recipe", "why"))
    return console.DONE


def prune_store(folder: Path, *, is_dry: bool, as_json: bool) -> int:
    """Remove results of other code versions that do not count for this one's.

    Raises PlanError where this code has no result that would stay, SweepError while a sweep runs in the store.
    """
    own = code_version()
    with SweepStore(folder, maker=own, mode="read") as store:
        makers = store.makers()
        kept = {maker: count for maker, count in makers.items() if count and maker in (own, *store.counted)}
        unused = store.unused()
    files = [path for path in unused.files if path.is_file()]
    byte_count = sum(path.stat().st_size for path in files)
    if not kept:
        raise PlanError(
            f"{folder}: all of its {sum(makers.values()):,} parts are of other code versions than this one's, {own}, "
            "so nothing would stay; run the sweep first, keep them by --same-results, or delete the folder"
        )
    if not is_dry:
        if parents := list(living_parents(folder)):
            raise SweepError(f"{folder}: a sweep runs in it ({', '.join(parents)}); prune it when that has ended")
        with SweepStore(folder, maker=own) as store:
            store.prune()
    removed = [maker for maker in makers if maker not in kept]
    values = {
        "store": str(folder),
        "is_dry_run": is_dry,
        "code_versions_removed": removed,
        "parts_removed": unused.part_count,
        "files_removed": len(files),
        "bytes_removed": byte_count,
        "parts_kept": sum(kept.values()),
    }
    shown = {name: len(own) if isinstance(own, list) else own for name, own in values.items() if name != "store"}
    console.show_values(values if as_json else shown, as_json=as_json, title=str(folder))
    return console.DONE


def merge_stores(target: Path, sources: Sequence[Path], *, with_other_code: bool, as_json: bool) -> int:
    """Take results of other stores over into one, those of one code version unless others are asked for, too.

    Raises PlanError for a source that is the target, or has results of another code version only.
    """
    found = {source: _makers_of(source) for source in sources}
    if twice := next(
        (source for source in sources if source.absolute().resolve() == target.absolute().resolve()), None
    ):
        raise PlanError(f"{twice} cannot be merged into itself")
    main = _main_maker(target, found, refuses_others=not with_other_code)
    others = dict.fromkeys(maker for own in found.values() for maker in own if maker != main)
    merged = {source: Merged() for source in sources}
    for maker in (*(others if with_other_code else ()), main):  # the main one last, so that it recorded last
        with SweepStore(target, maker=maker) as store:
            for source, own in merged.items():
                own.add(merge_store(store, source))
    for source, own in merged.items():
        for problem in own.problems:
            console.warn(f"{problem}; these parts were left out")
        left = [maker for maker in found[source] if maker != main]
        if left and not with_other_code:
            console.warn(f"{source}: results of {len(left)} other code versions were left out; --other-code takes them")
    values = {
        "store": str(target),
        "code_version": main,
        "parts_merged": sum(own.parts for own in merged.values()),
        "failures_merged": sum(own.failures for own in merged.values()),
        "sources": [{"store": str(source), **vars(own)} for source, own in merged.items()],
    }
    shown = ("code_version", "parts_merged", "failures_merged")
    console.show_values(values, as_json=as_json, title=str(target), shown_names=shown)
    return console.FAILED if any(own.problems for own in merged.values()) else console.DONE


def _makers_of(source: Path) -> list[str]:
    """Code versions with results or failures in a store, the one that recorded last at the end."""
    status = store_status(source)
    return [maker for maker, groups in status.groups.items() if groups or maker in status.failures]


def _main_maker(target: Path, found: dict[Path, list[str]], *, refuses_others: bool) -> str:
    """Whose results are merged: this code's if there are any, else those of the code version that all stores share."""
    stores = dict(found)
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        stores = {target: _makers_of(target)} | stores
    own = code_version()
    latest = {store: own if own in makers else makers[-1] for store, makers in stores.items() if makers}
    if refuses_others and len(set(latest.values())) > 1:
        each = "; ".join(f"{store} has {maker}" for store, maker in latest.items())
        raise PlanError(
            f"these stores have results of different code versions: {each}. Results of two code versions do not make "
            "one table: merge stores of one, or merge all with --other-code, where each keeps its code version"
        )
    return next(iter(latest.values()), own)
