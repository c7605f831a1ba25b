"""The parent of a sweep: gives tasks to an engine, records what comes back at once, and sees to what goes wrong."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ....datasets.errors import SweepStoreError
from ....datasets.sweeps.manifest import NAME as MANIFEST
from ....datasets.sweeps.record import Read
from ....datasets.sweeps.shard import read_shard
from ....datasets.sweeps.store import SweepStore
from ...errors import SweepError
from ...runtime.interrupt import interrupt_between
from ..make.poses import pose_count
from ..make.task import Engine, Outcome
from ..plan.code_version import code_version
from ..plan.recipe import Recipe, SweepPlan
from .limits import Limits
from .log import LOG, SweepLog, SweepProgress
from .missing import Counts, Failure, Missing, ResultKey
from .schedule import START_SECONDS, Schedule, device_kind

WAIT = 0.5  # [s] for an outcome, before what takes too long is looked at, and Ctrl-C
HOLD = 1.0  # [s] shards lie whole in the store before they are recorded together: each time waits for the disk
PROBE_BYTES = 1 << 20  # that must fit on the store's disk, or it counts as full


@dataclass(frozen=True)
class SweepReport:
    """The result of running a sweep."""

    recipes: int
    """Of the plan, each once."""
    poses: int
    """Of all recipes."""
    poses_rendered: int
    """By this run."""
    poses_reused: int
    """Poses of recipes for which nothing had to be rendered, or which others' renderings serve."""
    seconds: float
    """In all."""
    seconds_starting: float = 0.0
    """Until all workers could work: processes started, kernels compiled."""
    tasks: int = 0
    retries: int = 0
    workers_lost: int = 0
    recovered: int = 0
    """Rows that a killed run had left and that were taken over."""
    rows: int = 0
    """Results of chunks that this run made."""
    engine: str | None = None
    """None if there was nothing to make."""
    devices: tuple[str, ...] = ()
    failures: tuple[Failure, ...] = ()
    notes: tuple[str, ...] = ()
    """What else was not as it should be: workers that died, damaged shards."""

    @property
    def rate(self) -> float | None:
        """Poses a second once workers could work; None if nothing was rendered."""
        working = self.seconds - self.seconds_starting
        return self.poses_rendered / working if self.poses_rendered and working > 0.0 else None


@dataclass
class _Tally:
    """What has happened so far."""

    poses: int = 0
    rows: int = 0
    tasks: int = 0
    lost: int = 0
    failures: list[Failure] = field(default_factory=list)
    notes: dict[str, int] = field(default_factory=dict)
    """Sentences, and their numbers."""


def run_sweep(
    plan: SweepPlan,
    store_folder: str | Path,
    engine: Engine | Callable[[], Engine],
    *,
    progress: Callable[[SweepProgress], None] | None = None,
    approve: Callable[[Counts], None] | None = None,
    log: Path | None = None,
    made_by: str | None = None,
    limits: Limits | None = None,
    count_poses: Callable[[Recipe], int] = pose_count,
    clock: Callable[[], float] = time.monotonic,
) -> SweepReport:
    """Make everything of a plan that its store lacks; what was made is kept whatever happens, and not made again.

    engine: who makes it, or what gives it; neither called nor started if nothing is missing, and closed in the end.
    approve: called with what is missing, as far as the plan is read, before anything is made; what it raises ends the
    sweep. log: file of JSON lines, by default log.jsonl in the store. made_by: the code version that results count for,
    by default this code's. limits: what ends a worker. clock: seconds.
    Recipes that cannot be made are in the report. Raises SweepError if no worker can go on, or the store's disk is
    full; SweepStoreError for a folder that is no store; KeyboardInterrupt between two tasks.
    """
    code = made_by or code_version()
    with SweepStore(store_folder, maker=code) as store, SweepLog(log or store.folder / LOG) as lines:
        run = _Run(plan, store, lines, progress or _ignore, limits or Limits(), clock)
        return run.run(engine, count_poses, approve or _ignore)


def _ignore(value: object) -> None:
    """Takes what nobody asked for."""


class _Run:
    """One run."""

    def __init__(
        self,
        plan: SweepPlan,
        store: SweepStore,
        log: SweepLog,
        progress: Callable[[SweepProgress], None],
        limits: Limits,
        clock: Callable[[], float],
    ) -> None:
        self._plan, self._store, self._log = plan, store, log
        self._progress, self._limits, self._clock = progress, limits, clock
        self._begun = clock()
        self._ready: float | None = None
        """When the first worker was ready."""
        self._tally = _Tally()
        self._held: list[Read] = []
        """Shards to be recorded."""
        self._held_since = 0.0
        self._devices: tuple[str, ...] = ()

    def run(
        self,
        engine: Engine | Callable[[], Engine],
        count_poses: Callable[[Recipe], int],
        approve: Callable[[Counts], None],
    ) -> SweepReport:
        recovered = self._store.recover()
        missing = Missing(
            self._plan.recipes(),
            self._plan.groups,
            done=self._done,
            pose_count=count_poses,
            failed=self._store.failed(),
        )
        schedule = Schedule(
            missing,
            store=str(self._store.folder),
            run=self._log.run,
            code=self._plan.granted,
            user_metrics=self._plan.user_metrics,
            timeout=self._limits.timeout,
            memory=self._limits.memory,
        )
        schedule.read()
        self._record_failures(missing)
        report = SweepReport(0, 0, 0, 0, 0.0, recovered=recovered)
        if schedule.has_work:
            approve(missing.counts)
            worker = engine if not callable(engine) else engine()
            self._make(schedule, worker, recovered)
            recovered += self._store.recover()  # of workers who outlived their parent, or whose task went to another
            report = replace(
                report, engine=worker.name, devices=self._devices, retries=schedule.retried, recovered=recovered
            )
        self._forget_failures(missing)
        return self._finished(report, missing)

    def _finished(self, report: SweepReport, missing: Missing) -> SweepReport:
        counts, tally = missing.counts, self._tally
        for sentence in self._store.damaged:
            self._note(sentence)
        report = replace(
            report,
            recipes=counts.recipes,
            poses=counts.poses,
            poses_rendered=tally.poses,
            poses_reused=max(0, counts.poses - counts.poses_once),
            seconds=self._clock() - self._begun,
            seconds_starting=0.0 if self._ready is None else self._ready - self._begun,
            tasks=tally.tasks,
            rows=tally.rows,
            workers_lost=tally.lost,
            failures=tuple(tally.failures),
            notes=tuple(text if times == 1 else f"{text} ({times} times)" for text, times in tally.notes.items()),
        )
        if report.engine is not None:
            self._log.write(
                "end",
                recipes=report.recipes,
                recipes_failed=len(report.failures),
                poses_rendered=report.poses_rendered,
                seconds=round(report.seconds, 3),
            )
        return report

    def _make(self, schedule: Schedule, engine: Engine, recovered: int) -> None:
        """Make what is missing."""
        counts = schedule.missing.counts
        self._progress(SweepProgress(counts.done + counts.failed, self._plan.recipe_count, 0, 0.0, None))
        try:
            engine.start(self._store.folder)
            self._log.write(
                "start",
                plan=self._plan.name,
                recipe_count=self._plan.recipe_count,
                groups=self._plan.groups,
                maker=self._store.made_by,
                engine=engine.name,
                recovered=recovered,
            )
            with interrupt_between() as raise_if_interrupted:
                while not schedule.is_done:
                    self._turn(schedule, engine)
                    raise_if_interrupted()
            self._note_devices(engine)  # with those that came later
            self._record_held()
        except KeyboardInterrupt:
            self._log.write("stopped", sentence="interrupted")
            raise
        except Exception as error:
            self._log.write("stopped", sentence=str(error))
            raise
        finally:
            engine.close()
            with contextlib.suppress(SweepStoreError, SweepError):  # the next run takes them over
                self._record_held()

    def _turn(self, schedule: Schedule, engine: Engine) -> None:
        """Give tasks to free workers, take outcomes, look after the rest."""
        self._note_workers(schedule, engine)
        while engine.free_count() and (task := schedule.next_task(self._clock())) is not None:
            engine.submit(task)
        outcomes = engine.wait(WAIT)
        self._refuse_removed()
        for outcome in outcomes:
            self._take(outcome, schedule)
        while engine.free_count() and (task := schedule.next_task(self._clock())) is not None:
            engine.submit(task)  # before anything waits for the disk
        if self._held and self._clock() - self._held_since >= HOLD:
            self._record_held()
        self._record_failures(schedule.missing)
        for number, reason in schedule.overdue(engine.running()).items():
            self._log.write("dropped", number=number, sentence=reason)
            engine.drop(number, reason)
        self._show(schedule)

    def _note_workers(self, schedule: Schedule, engine: Engine) -> None:
        """See who is there, and have more workers started if seconds of work are left for each."""
        devices = engine.devices
        if devices and self._ready is None:
            self._ready = self._clock()
        if devices:
            schedule.set_kind(device_kind(devices))
            self._note_devices(engine)
        schedule.worker_count = max(1, len(devices))
        if len(devices) < engine.worker_most and not (schedule.missing.is_exhausted and not schedule.has_work):
            engine.grow(min(engine.worker_most, math.ceil(schedule.seconds_waiting() / START_SECONDS)))

    def _note_devices(self, engine: Engine) -> None:
        self._devices = max(engine.devices, self._devices, key=len)

    def _take(self, outcome: Outcome, schedule: Schedule) -> None:
        """Hold what a task left, to be recorded, then let the schedule know."""
        outcome = self._checked(outcome)
        self._tally.tasks += 1
        self._tally.poses += outcome.pose_count
        self._tally.rows += outcome.row_count
        self._tally.lost += outcome.is_lost
        event = "lost" if outcome.is_lost else "error" if outcome.error is not None else "task"
        values = {"sentence": outcome.error} if outcome.error is not None else {}
        self._log.write(
            event,
            number=outcome.number,
            worker=outcome.worker,
            rows=outcome.row_count,
            poses=outcome.pose_count,
            seconds=round(outcome.seconds, 4),
            **values,
        )
        if outcome.error is not None:
            self._note_error(outcome)
        try:
            schedule.settle(outcome, self._clock())
        except SweepError as error:
            raise self._stopped(str(error)) from error

    def _note_error(self, outcome: Outcome) -> None:
        """Keep an error in mind that is no recipe's; stop if it was the store's disk that is full."""
        is_storage = any(own.is_transient for own in outcome.failed)
        if is_storage:
            self._refuse_full_disk()
        if outcome.is_lost or is_storage:
            error = outcome.error or ""
            self._note(error if outcome.worker in error else f"{outcome.worker}: {error}")

    def _checked(self, outcome: Outcome) -> Outcome:
        """Hold a task's shard to be recorded; one that is missing or damaged is an error of its task."""
        if outcome.shard is None:
            return outcome
        try:
            shard = self._store.check(outcome.shard)
        except SweepStoreError as error:
            self._refuse_full_disk()
            try:
                read_shard(self._store.folder / outcome.shard, columns=False)
            except SweepStoreError as damage:
                self._note(str(damage))
                return Outcome(outcome.number, outcome.worker, seconds=outcome.seconds, error=str(damage))
            raise self._stopped(str(error)) from error
        if shard is not None:
            self._held_since = self._held_since if self._held else self._clock()
            self._held.append(shard)
        return outcome

    def _record_held(self) -> None:
        """Put shards into the manifest, all in one transaction."""
        held, self._held = self._held, []
        try:
            self._store.record_all(held)
        except SweepStoreError as error:
            self._refuse_full_disk()
            raise self._stopped(str(error)) from error

    def _refuse_full_disk(self) -> None:
        """Raise SweepError if the store's disk takes no more, or the store is gone."""
        self._refuse_removed()
        probe = self._store.folder / f"probe-{self._log.run}.tmp"
        try:
            with probe.open("xb") as file:
                file.write(bytes(PROBE_BYTES))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise self._stopped(f"{self._store.folder} takes no more: {error.strerror}") from error
        finally:
            with contextlib.suppress(OSError):
                probe.unlink()

    def _refuse_removed(self) -> None:
        if not (self._store.folder / MANIFEST).exists():
            raise SweepError(
                f"{self._store.folder} was removed while the sweep ran, with all that was made: the same command "
                "begins anew"
            )

    def _stopped(self, sentence: str) -> SweepError:
        """An error that ends the run, and what is safe."""
        return SweepError(
            f"{sentence}; what {self._tally.tasks} tasks of this run made is safe, and the same command "
            "goes on from there"
        )

    def _done(self, keys: Sequence[ResultKey]) -> dict[ResultKey, set[int]]:
        """Chunks that are there, those too that have just come."""
        if self._held:
            self._record_held()
        return self._store.done(keys)

    def _record_failures(self, missing: Missing) -> None:
        """Note recipes that were given up, in the store too, so that others see why they are not there."""
        failures, missing.failures[:] = list(missing.failures), []
        for failure in failures:
            self._tally.failures.append(failure)
            self._store.record_failure(failure.recipe_hash, failure.sentence)
            self._log.write("failure", recipe_hash=failure.recipe_hash, recipe=failure.name, sentence=failure.sentence)

    def _forget_failures(self, missing: Missing) -> None:
        made = missing.met_again - {failure.recipe_hash for failure in self._tally.failures}
        if made:
            self._store.forget_failures(sorted(made))

    def _note(self, sentence: str) -> None:
        self._tally.notes[sentence] = self._tally.notes.get(sentence, 0) + 1

    def _show(self, schedule: Schedule) -> None:
        """Show how far it is."""
        counts = schedule.missing.counts
        total = counts.recipes if schedule.missing.is_exhausted else self._plan.recipe_count
        spent = 0.0 if self._ready is None else self._clock() - self._ready
        left = None
        if self._tally.poses:
            unread = (total - counts.recipes) * counts.poses_missing / max(1, counts.recipes)
            unread += schedule.missing.poses_unread
            seconds = schedule.seconds_left() + schedule.rates.seconds({"": round(unread)})
            left = seconds / schedule.worker_count
        rate = self._tally.poses / spent if spent > 0.0 else 0.0
        self._progress(SweepProgress(counts.done + counts.failed, total, self._tally.poses, rate, left))
