"""The parent of a sweep: gives tasks to an engine, records results at once, and deals with what goes wrong."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ....datasets.errors import SweepStoreError
from ....datasets.sweeps.store import SweepStore, is_read_only
from ...errors import SweepError
from ...runtime.interrupt import interrupt_between
from ..make.poses import pose_count
from ..make.task import Engine, Outcome
from ..plan.code_version import code_version
from ..plan.recipe import Recipe, SweepPlan
from .limits import WorkerLimits
from .log import LOG, SweepLog, SweepProgress
from .missing import Counts, Failure, Missing, ResultKey
from .recording import ShardRecording
from .schedule import START_SECONDS, Schedule, device_kind
from .sharing import Sharing

STRAY_LONGEST = 10.0  # [s] for which all workers may be free although tasks are given: their outcomes are under way


class StrayTasks:
    """Watches for tasks that were given and that no worker has: nobody would ever make them. clock: seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._held_at = clock()
        """When workers last had tasks, or none were given."""

    def look(self, numbers: Sequence[int], engine: Engine, *, is_moving: bool) -> None:
        """Raise SweepError if all workers have been free for `STRAY_LONGEST` although tasks were given.

        numbers: of tasks that were given and of which no outcome has come. is_moving: whether outcomes have just come.
        """
        workers = len(engine.devices)
        if is_moving or not numbers or not workers or engine.free_count() < workers:
            self._held_at = self._clock()
        elif self._clock() - self._held_at > STRAY_LONGEST:
            named = ", ".join(map(str, numbers))
            raise SweepError(
                f"no worker has task {named}, which was given to {engine.name}: a fault of palpate. What was made is "
                "kept; `--workers 1` makes the rest in one process"
            )


FOREIGN = -1  # number of a task of another parent
WAIT = 0.5  # [s] for an outcome, before what takes too long is looked at, and Ctrl-C


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
    limits: WorkerLimits | None = None,
    shard: tuple[int, int] = (0, 1),
    share: str | None = None,
    count_poses: Callable[[Recipe], int] = pose_count,
    clock: Callable[[], float] = time.monotonic,
) -> SweepReport:
    """Make everything of a plan that its store lacks; what was made is kept whatever happens, and not made again.

    engine: who makes it, or what gives it; neither called nor started if nothing is missing, and closed in the end.
    approve: called with what is missing, as far as the plan is read, before anything is made; what it raises ends the
    sweep. log: file of JSON lines, by default log.jsonl in the store. made_by: the code version that results count for,
    by default this code's. limits: what ends a worker. shard: (k, n) makes part k of n, from 0.
    share: URL of a folder where parents of several machines share the work; parents of one store share it anyway.
    clock: seconds. A store on a read-only disk suffices if it lacks nothing. Recipes that cannot be made are in the
    report. Raises SweepError if no worker can go on, or the store's disk is full; SweepStoreError for a folder that is
    no store; KeyboardInterrupt between two tasks.

    >>> from pathlib import Path
    >>> from palpate.render import InProcess, load_plans, run_sweep
    >>> _ = Path("study.toml").write_text('object.source = "cube"')
    >>> plan = load_plans(["study.toml"], ["motion.duration=0.1"])
    >>> [run_sweep(plan, "twice.sweep", InProcess()).poses_rendered for _ in range(2)]  # the second finds all made
    [9, 0]
    """
    code = made_by or code_version()
    with contextlib.ExitStack() as stack:
        mode = "read" if is_read_only(Path(store_folder)) else "create"
        store = stack.enter_context(SweepStore(store_folder, maker=code, mode=mode))
        lines = stack.enter_context(SweepLog(log or store.folder / LOG))
        sharing = stack.enter_context(Sharing(store.folder, share))
        run = _Run(plan, store, lines, sharing, progress or _ignore, limits or WorkerLimits(), clock)
        return run.run(engine, count_poses, approve or _ignore, shard)


def _ignore(value: object) -> None:
    """Takes what nobody asked for."""


class _Run:
    """One run."""

    def __init__(
        self,
        plan: SweepPlan,
        store: SweepStore,
        log: SweepLog,
        sharing: Sharing,
        progress: Callable[[SweepProgress], None],
        limits: WorkerLimits,
        clock: Callable[[], float],
    ) -> None:
        self._plan, self._store, self._log, self._sharing = plan, store, log, sharing
        self._progress, self._limits, self._clock = progress, limits, clock
        self._begun = clock()
        self._ready: float | None = None  # when the first worker was ready
        self._tally = _Tally()
        self._recording = ShardRecording(store, log.run)
        self._is_read_only = store.mode == "read"
        self._devices: tuple[str, ...] = ()
        self._looked_at = 0.0  # when other parents' results were last looked for
        self._stray = StrayTasks(clock)

    def run(
        self,
        engine: Engine | Callable[[], Engine],
        count_poses: Callable[[Recipe], int],
        approve: Callable[[Counts], None],
        shard: tuple[int, int],
    ) -> SweepReport:
        recovered = 0 if self._is_read_only else self._store.recover()
        if self._sharing.is_remote:
            self._sharing.open()
            self._fetch()
        plan, failed = self._plan, self._store.failed()
        missing = Missing(plan.recipes(), plan.groups, done=self._done, pose_count=count_poses, failed=failed)
        schedule = Schedule(
            missing,
            store=str(self._store.folder),
            run=self._log.run,
            code=self._plan.granted,
            user_metrics=self._plan.user_metrics,
            timeout=self._limits.timeout,
            memory=self._limits.memory,
            takes=self._sharing.takes,
            has_company=self._sharing.has_company,
            shard=shard,
        )
        schedule.read()
        self._record_failures(missing)
        report = SweepReport(0, 0, 0, 0, 0.0, recovered=recovered)
        if schedule.has_work:
            self._refuse_read_only(missing)
            approve(missing.counts)
            self._sharing.open()
            worker = engine if not callable(engine) else engine()
            self._make(schedule, worker, recovered)
            recovered += self._store.recover()  # of workers who outlived their parent, or whose task went to another
            report = replace(
                report, engine=worker.name, devices=self._devices, retries=schedule.retried, recovered=recovered
            )
        self._forget_failures(missing)
        return self._finished(report, missing)

    def _refuse_read_only(self, missing: Missing) -> None:
        """Raise SweepError for a store that lacks something and cannot be written."""
        if self._is_read_only:
            lacking = missing.counts.recipes - missing.counts.done
            raise SweepError(
                f"{self._store.folder} cannot be written, and lacks results of at least {lacking:,} recipes of the "
                "plan: name another store, or make them where it can be written"
            )

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
            self._devices = max(engine.devices, self._devices, key=len)  # with those that came later
            self._recording.record()
        except KeyboardInterrupt:
            self._log.write("stopped", sentence="interrupted")
            raise
        except Exception as error:
            self._log.write("stopped", sentence=str(error))
            raise
        finally:
            engine.close()
            with contextlib.suppress(SweepStoreError, SweepError):  # the next run takes them over
                self._recording.record()

    def _turn(self, schedule: Schedule, engine: Engine) -> None:
        """Give tasks to free workers, take outcomes, look after the rest."""
        self._note_workers(schedule, engine)
        self._give(schedule, engine)
        outcomes = engine.wait(WAIT)
        self._give(schedule, engine)  # before outcomes are looked at, so that no worker waits for that
        self._recording.require_store()
        for outcome in outcomes:
            self._take(outcome, schedule)
        self._stray.look(schedule.given_numbers, engine, is_moving=bool(outcomes))
        self._give(schedule, engine)
        self._recording.record_old(self._clock())
        self._record_failures(schedule.missing)
        self._look_elsewhere(schedule)
        for number, reason in schedule.overdue(engine.running()).items():
            self._log.write("dropped", number=number, sentence=reason)
            engine.drop(number, reason)
        self._show(schedule)

    def _give(self, schedule: Schedule, engine: Engine) -> None:
        """Give tasks to free workers."""
        while engine.free_count() and (task := schedule.next_task(self._clock())) is not None:
            engine.submit(task)

    def _note_workers(self, schedule: Schedule, engine: Engine) -> None:
        """See who is there, and have more workers started if seconds of work are left for each."""
        devices = engine.devices
        if devices and self._ready is None:
            self._ready = self._clock()
        if devices:
            schedule.set_kind(device_kind(devices))
            self._devices = max(devices, self._devices, key=len)
        schedule.worker_count = max(1, len(devices))
        if len(devices) < engine.worker_most and not (schedule.missing.is_exhausted and not schedule.has_work):
            engine.grow(min(engine.worker_most, math.ceil(schedule.seconds_waiting() / START_SECONDS)))

    def _look_elsewhere(self, schedule: Schedule) -> None:
        """See what other parents have made of the chunks that they claimed."""
        now = self._clock()
        if now - self._looked_at < self._sharing.look_seconds:
            return
        self._looked_at = now
        if not self._sharing.has_company():
            return
        self._fetch()
        if keys := schedule.elsewhere_keys():
            schedule.look_elsewhere(self._done(keys))

    def _fetch(self) -> None:
        """Take over what other parents have published."""
        for shard in self._sharing.fetch():
            self._checked(Outcome(FOREIGN, "another parent", shard))
        while self._sharing.problems:
            self._note(self._sharing.problems.pop(0))

    def _take(self, outcome: Outcome, schedule: Schedule) -> None:
        """Hold what a task left, to be recorded, then let the schedule know."""
        self._tally.lost += outcome.is_lost
        outcome = self._checked(outcome)
        self._tally.tasks += 1
        self._recording.task_count += 1
        self._tally.poses += outcome.pose_count
        self._tally.rows += outcome.row_count
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
            raise SweepError(self._recording.with_remedy(str(error))) from error

    def _note_error(self, outcome: Outcome) -> None:
        """Keep an error in mind that is no recipe's; stop if it was the store's disk that is full."""
        is_storage = any(own.is_transient for own in outcome.failed)
        if is_storage:
            self._recording.require_room()
        if outcome.is_lost or is_storage:
            error = outcome.error or ""
            self._note(error if outcome.worker in error else f"{outcome.worker}: {error}")

    def _checked(self, outcome: Outcome) -> Outcome:
        """Hold a task's shard to be recorded; a missing or damaged one is an error of its task."""
        if outcome.shard is None:
            return outcome
        damage = self._recording.hold(outcome.shard, self._clock())
        if damage is not None:
            self._note(damage)
            return replace(outcome, shard=None, row_count=0, pose_count=0, error=damage, is_lost=True)
        if outcome.number != FOREIGN:
            self._sharing.publish(outcome.shard)
        return outcome

    def _done(self, keys: Sequence[ResultKey]) -> dict[ResultKey, set[int]]:
        """Chunks that are there, those too that have just come."""
        self._recording.record()
        return self._store.done(keys)

    def _record_failures(self, missing: Missing) -> None:
        """Note recipes that were given up, in the store too, so that others see why they are not there."""
        failures, missing.failures[:] = list(missing.failures), []
        for failure in failures:
            self._tally.failures.append(failure)
            if not self._is_read_only:
                self._store.record_failure(failure.recipe_hash, failure.sentence)
            self._log.write("failure", recipe_hash=failure.recipe_hash, recipe=failure.name, sentence=failure.sentence)

    def _forget_failures(self, missing: Missing) -> None:
        made = missing.met_again - {failure.recipe_hash for failure in self._tally.failures}
        if made and not self._is_read_only:
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
