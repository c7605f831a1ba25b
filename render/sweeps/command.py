"""`palpate sweep`: make what the store lacks of a plan, write table and figure, compare, and report."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any

from ...datasets.counted import counted
from ...datasets.sweeps.store import Key, SweepStore
from ..runtime.warp_start import start_warp
from ..runtime.worker_devices import worker_devices
from ..terminal import console
from ..terminal.foreign_text import print_message, show_table, write
from .baseline_check import BaselineCheck
from .job import SweepJob, is_occupied
from .make.poses import pose_count
from .plan.code_version import code_version
from .plan.loading import Plan, draft_plans
from .report.compare import Comparison
from .report.progress import sweep_bar
from .report.results import Results
from .report.summary import append_summary, failure_rows, sweep_summary
from .run.estimate import Estimate, estimate, refuse_too_large
from .run.executors import dask_executor
from .run.missing import Missing
from .run.sweep_run import SweepProgress, SweepReport, run_sweep

SHOWN = 20  # rows of failures, and of values that moved; JSON has all
SHOWN_NAMES = "recipes recipes_failed poses poses_rendered poses_per_second seconds executor"
SHOWN_IF_ANY = "recipes_left retries workers_lost"


def run_sweep_command(options: dict[str, Any], *, as_json: bool) -> int:
    """Make a sweep, or estimate what it would cost; the options are those of `SweepJob`."""
    job = SweepJob(**options)
    job.refuse_nonsense()
    check = None if job.baseline is None else BaselineCheck.of(job, job.baseline)
    other = job.other_code_version() if job.same_results else None
    plan = draft_plans(job.plans, job.overrides or ())
    job.refuse_plan(plan)
    if job.dry_run:
        return _show_estimate(_estimated(job, plan, other), as_json=as_json)
    executor = None if job.scheduler is None else dask_executor(job.scheduler)  # before code of a user runs
    plan = plan.with_code(job.allow_code)
    if check is not None:
        check.require_recipes_of(plan)
    if other is not None:
        with SweepStore(job.folder, code_version(), mode="write") as store:
            count = store.take_results_of(other)
        console.warn(f"--same-results: {counted(count, 'chunk')} of {other} now count as those of {code_version()}")
    report = _made(job, plan, executor, as_json=as_json)
    if report is None:
        return console.FAILED
    is_complete = not report.failures and not report.recipes_left
    results = Results(plan, job.folder, is_complete=is_complete, has_news=report.rows > 0)
    results.write(job.tables or (), figure=job.figure)
    comparison = None if check is None else check.compare(results.columns)
    if check is not None and check.is_updated:
        if report.failures:
            console.warn(f"{check.path} is not written, because {_failed_text(report)}")
        else:
            check.update(results.columns)
            results.files["baseline"] = str(check.path)
    if job.summary is not None:
        append_summary(job.summary, sweep_summary(plan.name, report, comparison, row_count=SHOWN))
    _show_report(report, {"store": str(job.folder), **results.files}, comparison, as_json=as_json)
    has_moved = comparison is not None and not comparison.is_kept and not job.update_baseline
    return console.FAILED if report.failures or has_moved else console.DONE


def _made(job: SweepJob, plan: Plan, executor: Executor | None, *, as_json: bool) -> SweepReport | None:
    """Run the sweep; None, after an error message, if it was interrupted."""
    last = SweepProgress(0, plan.recipe_count, 0, 0.0, None)
    with sweep_bar(as_json=as_json) as bar:

        def progress(now: SweepProgress) -> None:
            nonlocal last
            last = now
            bar(now)

        try:
            return run_sweep(
                plan,
                job.folder,
                executor,
                device=job.device_of(plan),
                workers=job.workers_of(plan),
                unit_timeout=job.unit_timeout,
                worker_memory=None if job.worker_memory is None else job.worker_memory * 1_000_000,
                shard=job.shard_number,
                progress=progress,
                approve=(lambda counts: None) if job.yes else partial(refuse_too_large, plan, job.folder),
            )
        except KeyboardInterrupt:
            pass
    console.fail(
        f"interrupted: {last.recipes:,} of {last.recipe_count:,} recipes are done, and this run has rendered "
        f"{last.poses:,} poses; {job.folder} keeps all results, and the same command goes on",
        console.FAILED,
        as_json,
    )
    return None


# ---- the report


def _show_report(report: SweepReport, files: dict[str, str], comparison: Comparison | None, *, as_json: bool) -> None:
    for note in report.notes:
        console.warn(note)
    values = {"recipes": report.recipes, "recipes_failed": len(report.failures), **vars(report)}
    values |= {"chunks_made": values.pop("rows"), "poses_per_second": report.rate, **files}
    if as_json:
        values["failures"] = [vars(failure) for failure in report.failures]
        values["comparison"] = None if comparison is None else comparison.to_dict()
    shown = [*SHOWN_NAMES.split(), *files, *(name for name in SHOWN_IF_ANY.split() if values[name])]
    console.show_values(values, as_json=as_json, title=files["store"], shown_names=shown)
    if as_json:
        return
    _show_rows(_failed_text(report), ("recipe", "why"), failure_rows(report.failures))
    if comparison is not None:
        for sentence in comparison.sentences():
            print_message(sentence)
        moved = comparison.rows(len(comparison.moved))
        _show_rows("what moved", ("recipe", "metric", "was", "is", "change"), moved)
    if report.recipes_left:
        left = counted(report.recipes_left, "recipe")
        console.conclude(f"{left} left to other shards: palpate sweep merge joins the stores", as_json=as_json)


def _failed_text(report: SweepReport) -> str:
    return f"{counted(len(report.failures), 'recipe')} could not be made"


def _show_rows(title: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """The first rows of a table, and how many it has beyond; nothing for a table without rows."""
    if rows:
        show_table(title, rows[:SHOWN], names, to_errors=True)
    if len(rows) > SHOWN:
        print_message(f"and {len(rows) - SHOWN} more (--json has all)")


# ---- the estimate


def _estimated(job: SweepJob, plan: Plan, other: str | None) -> Estimate:
    """Look what is missing, and make samples of it. other: a code version whose results would be taken over."""
    start_warp()
    devices = worker_devices(job.device_of(plan), job.workers_of(plan))
    with contextlib.ExitStack() as stack:
        done = _nothing_done
        if is_occupied(job.folder):
            done = stack.enter_context(SweepStore(job.folder, other or code_version())).done
        missing = Missing(plan.recipes(), plan.groups, done=done, pose_count=pose_count, shard=job.shard_number)
        return estimate(plan, missing, job.folder, devices=devices)


def _nothing_done(keys: Sequence[Key]) -> dict[Key, set[int]]:
    return {key: set() for key in keys}


def _show_estimate(found: Estimate, *, as_json: bool) -> int:
    if as_json:
        console.show_values(found.as_dict(), as_json=True, title="")
    else:
        for sentence in found.sentences():
            write(console.worded(sentence))
    for problem in found.problems:
        console.warn(problem)
    return console.DONE
