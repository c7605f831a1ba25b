"""The parent of a sweep: gives tasks to an engine, records what comes back at once, and sees to what goes wrong."""

from __future__ import annotations

import contextlib
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
from .log import LOG, SweepLog, SweepProgress
from .missing import Counts, Failure, Key, Missing
from .pace import Pace, device_kind
from .schedule import STORAGE_SENTENCES, Schedule

WAIT = 0.5  # [s] for an outcome, before what takes too long is looked at, and Ctrl-C
IDLE = 0.02  # [s] between looks when nobody has anything to do
HOLD = 1.0  # [s] shards lie whole in the store before they are recorded together: each time waits for the disk
PROBE_BYTES = 1 << 20  # that must fit on the store's disk, or it counts as full


@dataclass(frozen=True)
class SweepReport:
    """What running a sweep came to."""

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
    """Parts that a killed run had left and that were taken over."""
    parts: int = 0
    """Made by this run."""
    engine: str | None = None
    """None if there was nothing to make."""
    devices: tuple[str, ...] = ()
    failures: tuple[Failure, ...] = ()
    notes: tuple[str, ...] = ()
    """What else was not as it should be: errors that were mended by making things again, damaged shards."""

    @property
    def rate(self) -> float | None:
        """Poses a second once workers could work; None if nothing was rendered."""
        working = self.seconds - self.seconds_starting
        return self.poses_rendered / working if self.poses_rendered and working > 0.0 else None


@dataclass
class _Tally:
    """What has happened so far."""

    poses: int = 0
    parts: int = 0
    tasks: int = 0
    lost: int = 0
    failures: list[Failure] = field(default_factory=list)
    notes: dict[str, int] = field(default_factory=dict)
    """Sentences, and how often."""


def run_sweep(
    plan: SweepPlan,
    store_folder: str | Path,
    engine: Engine | Callable[[], Engine],
    *,
    progress: Callable[[SweepProgress], None] | None = None,
    approve: Callable[[Counts], None] | None = None,
    log: Path | None = None,
    made_by: str | None = None,
    count_poses: Callable[[Recipe], int] = pose_count,
    clock: Callable[[], float] = time.monotonic,
) -> SweepReport:
    """Make everything of a plan that its store lacks; what was made is kept whatever happens, and not made again.

    engine: who makes it, or what gives it; neither called nor started if nothing is missing, and closed in the end.
    approve: told what is missing, as far as the plan is read, before anything is made; what it raises ends the sweep.
    log: file of JSON lines, by default log.jsonl in the store. made_by: the maker that results count for, by default
    this code's. clock: seconds.
    Recipes that cannot be made are in the report. Raises SweepError if no worker can go on, or the store's disk is
    full; SweepStoreError for a folder that is no store; KeyboardInterrupt between two tasks.
    """
    code = made_by or code_version()
    with SweepStore(store_folder, maker=code) as store, SweepLog(log or store.folder / LOG) as lines:
        return _Run(plan, store, lines, progress or _ignore, clock).run(engine, count_poses, approve or _ignore)


def _ignore(told: object) -> None:
    """What nobody asked for."""


class _Run:
    """One run."""

    def __init__(
        self,
        plan: SweepPlan,
        store: SweepStore,
        log: SweepLog,
        progress: Callable[[SweepProgress], None],
        clock: Callable[[], float],
    ) -> None:
        self._plan, self._store, self._log = plan, store, log
        self._progress, self._clock = progress, clock
        self._begun = self._ready = clock()
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
        failed = self._store.failed()
        missing = Missing(
            self._plan.recipes(), self._plan.groups, done=self._done, pose_count=count_poses, failed=failed
        )
        while not missing.is_exhausted and not missing.stretches:
            missing.read()
        self._record_failures(missing)
        report = SweepReport(0, 0, 0, 0, 0.0, recovered=recovered)
        if missing.stretches:
            approve(missing.counts)
            worker = engine if not callable(engine) else engine()
            retries = self._make(missing, worker, recovered)
            recovered += self._store.recover()  # of workers who outlived their parent, or whose task went to another
            report = replace(report, engine=worker.name, devices=self._devices, retries=retries, recovered=recovered)
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
            seconds_starting=self._ready - self._begun,
            tasks=tally.tasks,
            parts=tally.parts,
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

    def _make(self, missing: Missing, engine: Engine, recovered: int) -> int:
        """Make what is missing; how many tasks were made again."""
        done = missing.counts.done + missing.counts.failed
        self._progress(SweepProgress(done, self._plan.recipe_count, 0, 0.0, None))
        try:
            engine.start(self._store.folder)
            self._ready = self._clock()
            self._devices = engine.devices
            self._log.write(
                "start",
                plan=self._plan.name,
                recipe_count=self._plan.recipe_count,
                groups=self._plan.groups,
                maker=self._store.made_by,
                engine=engine.name,
                devices=engine.devices,
                recovered=recovered,
            )
            pace = Pace(device_kind(engine.devices))
            schedule = Schedule(
                missing,
                pace,
                worker_count=len(engine.devices),
                store=str(self._store.folder),
                run=self._log.run,
                code=self._plan.granted,
            )
            with interrupt_between() as raise_if_interrupted:
                while not schedule.is_done:
                    self._turn(schedule, engine)
                    raise_if_interrupted()
            self._record_held()
            self._devices = engine.devices or self._devices  # with those who came later
            return schedule.retried
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
        """Give out what workers have room for, take back what has come, look after the rest."""
        schedule.worker_count = max(1, len(engine.devices))
        while (task := schedule.next_task(self._clock())) is not None:
            engine.submit(task)
        outcomes = engine.wait(WAIT)
        self._refuse_removed()
        for outcome in outcomes:
            self._take(outcome, schedule, engine)
        if self._held and self._clock() - self._held_since >= HOLD:
            self._record_held()
        self._record_failures(schedule.missing)
        running = engine.running()
        for number in schedule.late(running):
            self._log.write("dropped", number=number, seconds=round(running[number], 1))
            engine.drop(number)
        copy = schedule.copy_for_idle(running)
        if copy is not None:
            self._log.write("copied", number=copy[0].number, of=copy[1])
            engine.submit(copy[0])
        self._tell(schedule)
        if not outcomes and not running:
            time.sleep(IDLE)

    def _take(self, outcome: Outcome, schedule: Schedule, engine: Engine) -> None:
        """Have what a task left recorded, then let the schedule know."""
        outcome = self._checked(outcome)
        self._tally.tasks += 1
        self._tally.poses += outcome.pose_count
        self._tally.parts += outcome.part_count
        self._tally.lost += outcome.is_lost and schedule.is_open(outcome.number)
        if outcome.error is None:
            self._log.write(
                "task",
                number=outcome.number,
                worker=outcome.worker,
                parts=outcome.part_count,
                poses=outcome.pose_count,
                seconds=round(outcome.seconds, 4),
            )
        else:
            event = "lost" if outcome.is_lost else "error"
            self._log.write(event, number=outcome.number, worker=outcome.worker, sentence=outcome.error)
            self._judge(outcome, is_needed=schedule.is_open(outcome.number))
        try:
            unneeded = schedule.settle(outcome, self._clock())
        except SweepError as error:
            raise self._stopped(str(error)) from error
        for number in unneeded if not schedule.is_done else ():  # closing ends them, too
            engine.drop(number)

    def _judge(self, outcome: Outcome, *, is_needed: bool) -> None:
        """Keep an error in mind that is no recipe's; stop if it was the store's disk that is full."""
        error = outcome.error or ""
        is_storage = any(told in error for told in STORAGE_SENTENCES)
        if is_storage:
            self._refuse_full_disk()
        if is_needed and (outcome.is_lost or is_storage):
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

    def _done(self, keys: Sequence[Key]) -> dict[Key, set[int]]:
        """Parts that are there, those too that have just come."""
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

    def _tell(self, schedule: Schedule) -> None:
        """Tell who waits how far it is."""
        counts, spent = schedule.missing.counts, self._clock() - self._ready
        total = counts.recipes if schedule.missing.is_exhausted else self._plan.recipe_count
        left = None
        if self._tally.poses:
            unread = (total - counts.recipes) * counts.poses_missing / max(1, counts.recipes)
            left = (schedule.seconds_left() + schedule.pace.seconds({"": round(unread)})) / schedule.worker_count
        rate = self._tally.poses / spent if spent > 0.0 else 0.0
        self._progress(SweepProgress(counts.done + counts.failed, total, self._tally.poses, rate, left))
