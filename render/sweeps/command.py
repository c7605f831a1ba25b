"""What `palpate sweep` does: plan, run, table, figure, comparison, and the report on them."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...datasets.sweeps.store import Key, SweepStore
from ..errors import PlanError, SweepError
from ..runtime.warp_start import start_warp
from ..runtime.worker_devices import WORKERS_MOST, has_cuda_driver, worker_devices
from ..terminal import console
from ..terminal.foreign_text import print_message, show_table, write
from .make.poses import pose_count
from .plan.code_version import code_version
from .plan.loading import Plan, draft_plans
from .refusals import (
    other_code_version,
    refuse_baseline,
    refuse_baseline_file,
    refuse_poses,
    refuse_summary,
    refuse_tables,
)
from .report.failures import failure_rows
from .report.progress import sweep_bar
from .report.results import Results
from .run.estimate import Estimate, estimate, refuse_too_large
from .run.executors import dask_executor
from .run.missing import Counts, Missing
from .run.progress import SweepProgress
from .run.sweep_run import SweepReport, run_sweep

if TYPE_CHECKING:
    from .report.compare import Baseline, Comparison, Tolerance

STORE_SUFFIX = ".sweep"
SHOWN = 20  # failures, and values that moved; JSON has all
TOLD = (
    "recipes",
    "recipes_failed",
    "poses",
    "poses_rendered",
    "poses_per_second",
    "seconds",
    "executor",
    "retries",
    "workers_lost",
    "store",
    "table",
    "figure",
    "baseline",
)


@dataclass(frozen=True)
class SweepJob:
    """The options of `palpate sweep`."""

    plans: list[Path]
    store: Path | None
    overrides: list[str]
    dry_run: bool
    yes: bool
    same_results: bool
    device: str | None
    workers: str
    scheduler: str | None
    shard: str | None
    unit_timeout: float
    worker_memory: int | None
    baseline: Path | None
    update_baseline: bool
    tolerances: list[str]
    tables: list[Path]
    overwrite: bool
    figure: bool
    summary: Path | None
    allow_code: bool

    @property
    def folder(self) -> Path:
        """The store: beside the first plan unless given."""
        return self.plans[0].with_suffix(STORE_SUFFIX) if self.store is None else self.store

    def worker_count(self) -> int | None:
        """None for "auto"."""
        if self.workers == "auto":
            return None
        if not self.workers.isdecimal() or not 1 <= int(self.workers) <= WORKERS_MOST:
            raise PlanError(f"--workers must be a number in 1..{WORKERS_MOST} or auto, not {self.workers!r}")
        return int(self.workers)

    def shard_of(self) -> tuple[int, int]:
        """Which part of how many is made, the first being 0; raises PlanError for what is no part."""
        if self.shard is None:
            return 0, 1
        number, slash, count = self.shard.partition("/")
        if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
            raise PlanError(f"--shard must be I/N with I in 1..N, such as 2/4, not {self.shard!r}")
        return int(number) - 1, int(count)

    def require_sense(self) -> None:
        """Raise PlanError or StrategyError for options that cannot be, whether or not there is anything to make."""
        self.worker_count()
        refuse_tables(self.tables, overwrite=self.overwrite)
        refuse_summary(self.summary)
        if self.update_baseline:
            refuse_baseline_file(self.baseline)
        if self.dry_run:
            given = {
                "--update-baseline": self.update_baseline,
                "--baseline": self.baseline,
                "--table": self.tables,
                "--summary": self.summary,
                "--scheduler": self.scheduler,
            }
            for option, value in given.items():
                if value:
                    raise PlanError(f"{option} does not go with --dry-run: it makes nothing, on this machine")
        self.shard_of()
        if not self.unit_timeout >= 0:  # NaN is not
            raise PlanError(f"--unit-timeout must be at least 0 s (0 is no limit), not {self.unit_timeout:g}")
        if self.worker_memory is not None and self.worker_memory < 0:
            raise PlanError(f"--worker-memory must be at least 0 MB (0 is no limit), not {self.worker_memory}")
        if self.device not in (None, "auto", "cpu") and self.scheduler is None:
            _named_devices(self.device)

    def device_of(self, plan: Plan) -> str:
        """The device that is asked for, by the command line or else by the plan."""
        return self.device or plan.device

    def workers_of(self, plan: Plan) -> int | None:
        """So is the number of workers."""
        count = self.worker_count()
        return plan.workers if count is None else count


def _named_devices(device: str, workers: int | None = None) -> list[str]:
    """`worker_devices`; where Warp has to be asked, its greeting stays away from standard output."""
    if device != "cpu" and (device != "auto" or has_cuda_driver()):
        start_warp()
    return worker_devices(device, workers)


@dataclass(frozen=True)
class Check:
    """What the results are compared with."""

    baseline: Baseline
    tolerances: tuple[Tolerance, ...]


def run_sweep_command(options: dict, *, as_json: bool) -> int:
    """Make a sweep, or report what it would cost; the options are those of `SweepJob`."""
    job = SweepJob(**options)
    job.require_sense()
    check = _check_of(job)
    other = other_code_version(job.folder) if job.same_results else None
    plan = draft_plans(job.plans, job.overrides)
    refuse_poses(plan)
    if job.dry_run:
        return _show_estimate(_estimated(job, plan, other), as_json=as_json)
    plan = plan.with_code(job.allow_code)
    if check is not None:
        refuse_baseline(check.baseline, check.tolerances, plan, needs_match=not job.update_baseline)
    if other is not None:
        with SweepStore(job.folder, code_version(), mode="write") as store:
            count = store.take_results_of(other)
        console.warn(f"--same-results: {count:,} results that {other} made are from now on those of {code_version()}")
    report = _made(job, plan, as_json=as_json)
    if report is None:
        return console.FAILED
    results = Results(plan, job.folder, is_complete=not report.failures, has_news=report.rows > 0)
    results.write(job.tables, figure=job.figure)
    comparison = None if check is None else _compared(check, results)
    if job.update_baseline:
        _update_baseline(job, check, report, results)
    if job.summary is not None:
        from .report.summary import append_summary, sweep_summary

        append_summary(job.summary, sweep_summary(plan.name, report, comparison, row_count=SHOWN))
    outputs = {"store": str(job.folder), **results.files}
    _say(report, outputs, comparison, as_json=as_json)
    is_kept = comparison is None or comparison.is_kept or job.update_baseline
    return console.FAILED if report.failures or not is_kept else console.DONE


def _compared(check: Check, results: Results) -> Comparison:
    from .report.compare import compare_tables

    return compare_tables(check.baseline, results.columns, check.tolerances)


def _update_baseline(job: SweepJob, check: Check | None, report: SweepReport, results: Results) -> None:
    """Write the baseline, unless recipes failed: it would then lack them from now on."""
    if report.failures or job.baseline is None:
        console.warn(f"{job.baseline} is not written, because {len(report.failures)} recipes could not be made")
        return
    from .report.baseline import write_baseline

    old, tolerances = (check.baseline, check.tolerances) if check else (None, ())
    write_baseline(job.baseline, results.columns, old=old, tolerances=tolerances)
    results.files["baseline"] = str(job.baseline)


def _check_of(job: SweepJob) -> Check | None:
    """The baseline, read before anything is made: a mistake in it should not cost a sweep.

    None if there is none, or none yet that could be updated.
    """
    if job.baseline is None:
        if job.tolerances:
            raise PlanError("--tolerance is of a comparison: name what to compare with by --baseline")
        return None
    from .report.compare import load_baseline, parse_tolerances

    if job.update_baseline and not job.baseline.exists():
        return None
    try:
        return Check(load_baseline(job.baseline), parse_tolerances(job.tolerances))
    except SweepError as error:
        raise PlanError(str(error)) from error


def _made(job: SweepJob, plan: Plan, *, as_json: bool) -> SweepReport | None:
    """Run the sweep; None, after an error message, if it was interrupted."""
    last = SweepProgress(0, plan.recipe_count, 0, 0.0, None)

    def approve(counts: Counts) -> None:
        if not job.yes:
            refuse_too_large(plan, job.folder, counts)

    executor = None if job.scheduler is None else dask_executor(job.scheduler)
    if executor is None and job.device_of(plan) != "cpu":
        _named_devices(job.device_of(plan), job.workers_of(plan))
    try:
        with sweep_bar(as_json=as_json) as bar:

            def progress(now: SweepProgress) -> None:
                nonlocal last
                last = now
                bar(now)

            return run_sweep(
                plan,
                job.folder,
                executor,
                device=job.device_of(plan),
                workers=job.workers_of(plan),
                unit_timeout=job.unit_timeout,
                worker_memory=None if job.worker_memory is None else job.worker_memory * 1_000_000,
                shard=job.shard_of(),
                progress=progress,
                approve=approve,
            )
    except KeyboardInterrupt:
        message = (
            f"interrupted: {last.recipes:,} of {last.recipe_count:,} recipes are done; {last.poses:,} poses rendered "
            f"in this run, of unfinished recipes too, are kept in {job.folder}; the same command goes on"
        )
        console.fail(message, console.FAILED, as_json)
        return None


# ---- the report


def _say(report: SweepReport, outputs: dict[str, Any], comparison: Comparison | None, *, as_json: bool) -> None:
    values: dict[str, Any] = {
        "recipes": report.recipes,
        "recipes_failed": len(report.failures),
        "poses": report.poses,
        "poses_rendered": report.poses_rendered,
        "poses_reused": report.poses_reused,
        "chunks_made": report.rows,
        "seconds": report.seconds,
        "poses_per_second": report.rate,
        "executor": report.executor,
        "units": report.units,
        "retries": report.retries,
        "workers_lost": report.workers_lost,
        **outputs,
    }
    for note in report.notes:
        console.warn(note)
    if as_json:
        values["failures"] = [vars(failure) for failure in report.failures]
        values["notes"] = list(report.notes)
        values["comparison"] = None if comparison is None else comparison.to_dict()
    console.show_values(values, as_json=as_json, title=outputs["store"], shown_names=TOLD)
    if not as_json:
        rows = failure_rows(report.failures)
        _show(f"{len(report.failures)} recipes could not be made", ("recipe", "why"), rows[:SHOWN], len(rows))
        if comparison is not None:
            for sentence in comparison.sentences():
                print_message(sentence)
            moved = comparison.rows(SHOWN)
            _show("what moved", ("recipe", "metric", "was", "is", "change"), moved, len(comparison.moved))


def _show(title: str, names: Sequence[str], rows: Sequence[Sequence[str]], count: int) -> None:
    if not rows:
        return
    show_table(title, rows, names, to_errors=True)
    if count > len(rows):
        print_message(f"and {count - len(rows)} more (--json has all)")


# ---- what it would cost


def _estimated(job: SweepJob, plan: Plan, other: str | None) -> Estimate:
    """Look what is missing, and make samples of it. other: a code version whose results would count."""
    start_warp()
    devices = worker_devices(job.device_of(plan), job.workers_of(plan))
    with contextlib.ExitStack() as stack:
        done = _nothing
        if job.folder.is_file() or (job.folder.is_dir() and any(job.folder.iterdir())):
            # A dry run changes nothing, so with --same-results it looks at the other code's results instead.
            store = stack.enter_context(SweepStore(job.folder, other or code_version()))
            done = store.done
        missing = Missing(plan.recipes(), plan.groups, done=done, pose_count=pose_count, shard=job.shard_of())
        return estimate(plan, missing, job.folder, devices=devices)


def _nothing(keys: Sequence[Key]) -> dict[Key, set[int]]:
    """What is done where there is no store."""
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
