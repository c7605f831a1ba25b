"""Running a sweep: what is missing is made by an executor and recorded in the store."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from ....datasets.sweeps.store import Failure, SweepStore, is_read_only
from ....datasets.sweeps.store_database import network_file_system
from ...errors import SweepError
from ...runtime.worker_devices import worker_devices
from ...user_warnings import warn_user
from ..make.poses import pose_count
from ..make.unit import Unit
from ..plan.code_version import code_version
from ..plan.recipe import Recipe, SweepPlan
from .executors import Pool, default_memory, pools_of
from .missing import Counts, Missing, PendingChunk
from .unit_loop import UNIT_SECONDS, RunFigures, UnitCutter, UnitLoop


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is."""

    recipes: int
    """Made, there already, or given up."""
    recipe_count: int
    poses: int
    """Rendered in this run."""
    rate: float
    """Poses a second."""
    seconds_left: float | None
    """To go; None before any result has come."""


def clock_time(seconds: float) -> str:
    """A duration for people: seconds, minutes, hours or days, in two of them."""
    whole = round(seconds)
    for unit, length, lower, below in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if whole >= length:
            return f"{whole // length} {unit} {whole % length // below} {lower}"
    return f"{whole} s" if seconds >= 9.5 else f"{seconds:.1f} s"


GPU_PROCESSES = 4  # on each GPU: while one computes, others add up and encode results, half of a unit's time on an H200
SHOW_SECONDS = 0.5  # between two calls of `progress`


@dataclass(frozen=True)
class SweepReport:
    """The result of running a sweep."""

    recipes: int
    """Of the plan, each once."""
    recipes_left: int
    """Recipes that other shards make, in part at least."""
    poses: int
    """Of all recipes."""
    poses_rendered: int
    """By this run."""
    poses_reused: int
    """Poses of recipes for which nothing had to be rendered, or which others' renderings serve."""
    seconds: float
    """In all."""
    units: int = 0
    retries: int = 0
    """Units that were given because of an earlier one that went wrong."""
    workers_lost: int = 0
    rows: int = 0
    """Results of chunks that this run made."""
    executor: str | None = None
    """None if there was nothing to make."""
    failures: tuple[Failure, ...] = ()
    notes: tuple[str, ...] = ()
    """What else was not as it should be: workers that died, damaged results, warnings of workers."""

    @property
    def rate(self) -> float | None:
        """Poses a second; None if nothing was rendered."""
        return self.poses_rendered / self.seconds if self.poses_rendered and self.seconds > 0.0 else None


def run_sweep(
    plan: SweepPlan,
    store_folder: str | Path,
    executor: Executor | None = None,
    *,
    device: str = "auto",
    workers: int | None = None,
    unit_timeout: float = UNIT_SECONDS,
    worker_memory: int | None = None,
    shard: tuple[int, int] = (0, 1),
    progress: Callable[[SweepProgress], None] = lambda now: None,
    approve: Callable[[Counts], None] = lambda counts: None,
    count_poses: Callable[[Recipe], int] = pose_count,
) -> SweepReport:
    """Make everything of a plan that its store lacks; what was made is kept whatever happens, and not made again.

    executor: any of `concurrent.futures` whose workers are processes, such as Dask's `Client.get_executor()`, which the
    caller closes. By default this process makes what takes seconds and runs no code of a user, and processes of this
    host the rest.
    device: as `worker_devices` takes it, with `workers` on each; of an executor, one name that each of its workers
    uses, "auto" for the first GPU of each or else its CPU.
    unit_timeout: seconds that a unit of work may take, which is planned to take 2 to 3; 0 for no limit.
    worker_memory: that a process of this host may allocate [byte], by default an equal share; 0 for no limit.
    shard: (k, n) makes part k of n, from 0; each shard has a store of its own.
    approve: called with what is missing before anything is made; what it raises ends the sweep.

    A store on a read-only disk suffices if it lacks nothing. Recipes that cannot be made are in the report. Raises
    SweepError if no worker can go on; SweepStoreError for a folder that is no store, is in use by another process or
    cannot be written; KeyboardInterrupt between two units.

    >>> from pathlib import Path
    >>> from palpate.render import load_plans, run_sweep
    >>> _ = Path("study.toml").write_text('object.source = "cube"')
    >>> plan = load_plans(["study.toml"], ["motion.duration=0.1"])
    >>> [run_sweep(plan, "twice.sweep", device="cpu").poses_rendered for _ in range(2)]  # the second finds all made
    [9, 0]
    """
    if not 0 <= shard[0] < shard[1]:
        raise SweepError(f"shard must be (k, n) with 0 <= k < n, not {shard}")
    if not unit_timeout >= 0:  # NaN is not
        raise SweepError(f"unit_timeout must be at least 0 s (0 is no limit), not {unit_timeout:g}")
    if worker_memory is not None and worker_memory < 0:
        raise SweepError(f"worker_memory must be at least 0 bytes (0 is no limit), not {worker_memory}")
    begun, code, folder = time.monotonic(), code_version(), Path(store_folder)
    mode = "read" if is_read_only(folder) else "write"
    with SweepStore(folder, code, mode=mode) as store:
        missing = Missing(plan.recipes(), plan.groups, done=store.done, pose_count=count_poses, shard=shard)
        counts = missing.counts
        cutter = UnitCutter(missing.places(), missing.poses_by_family)
        figures = RunFigures()
        if not cutter.is_empty:
            if mode == "read":
                raise SweepError(
                    f"{store.folder} cannot be written, and lacks results of {counts.recipes - counts.done:,} recipes "
                    "of the plan: name another store, or make them where it can be written"
                )
            approve(counts)
            if (system := network_file_system(store.folder)) is not None:
                warn_user(
                    f"{store.folder} is on a network file system ({system}), where SQLite's locks may fail: keep the "
                    "store on a local disk, one for each machine, and merge them"
                )
            devices = [device] if executor is not None else worker_devices(device, workers)
            if executor is None and workers is None and devices[0] != "cpu":
                devices = [name for name in dict.fromkeys(devices) for _ in range(GPU_PROCESSES)]
            memory = default_memory(len(devices)) if worker_memory is None else worker_memory
            pools = pools_of(executor, devices, memory, cutter.seconds_left)
            loop = _SweepLoop(plan, store, missing, cutter, pools, progress, unit_timeout, begun)
            try:
                loop.run()
            finally:
                _note_failures(store, missing)
            figures = loop.figures
        else:
            _note_failures(store, missing)
        for sentence in store.damaged:
            figures.note(sentence)
    return SweepReport(
        recipes=counts.recipes,
        recipes_left=counts.left,
        poses=counts.poses,
        poses_rendered=figures.poses,
        poses_reused=max(0, counts.poses - counts.poses_once),
        seconds=time.monotonic() - begun,
        units=figures.units,
        retries=figures.retries,
        workers_lost=figures.workers_lost,
        rows=figures.rows,
        executor="; ".join(figures.names) or None,
        failures=tuple(missing.failures),
        notes=tuple(text if times == 1 else f"{text} ({times} times)" for text, times in figures.notes.items()),
    )


class _SweepLoop:
    """The loop of one run, with its progress, and its state in the store."""

    def __init__(
        self,
        plan: SweepPlan,
        store: SweepStore,
        missing: Missing,
        cutter: UnitCutter,
        pools: list[Pool],
        progress: Callable[[SweepProgress], None],
        limit: float,
        begun: float,
    ) -> None:
        self._plan, self._store, self._missing, self._cutter = plan, store, missing, cutter
        self._progress, self._begun, self._shown = progress, begun, 0.0
        self._loop = UnitLoop(missing, cutter, store, pools, self._unit_of, limit=limit, on_turn=self._show)

    @property
    def figures(self) -> RunFigures:
        """What has happened."""
        return self._loop.figures

    def run(self) -> None:
        """Make everything."""
        self._store.clear_scratch()
        self._scratch = str(self._store.scratch())
        number, state = self._store.begin_run(self._plan.name), "ended"
        try:
            self._loop.run()
        except BaseException as error:
            state = f"stopped: {str(error) or type(error).__name__}"
            raise
        finally:
            self._store.clear_scratch()
            self._store.end_run(number, state)

    def _unit_of(self, chunks: list[PendingChunk]) -> Unit:
        return Unit(
            tuple(own.chunk for own in chunks),
            self._store.code,
            self._plan.granted,
            tuple(self._plan.user_metrics.items()),
            self._scratch,
        )

    def _show(self) -> None:
        now = time.monotonic()
        if now < self._shown + SHOW_SECONDS:
            return
        self._shown = now
        counts, poses, seconds = self._missing.counts, self.figures.poses, now - self._begun
        left = None
        if poses:
            capacity = sum(pool.capacity for pool in self._loop.pools)
            left = self._cutter.seconds_left() / max(1, capacity)
        done = counts.done + counts.failed + counts.left
        self._progress(SweepProgress(done, counts.recipes, poses, poses / seconds if seconds > 0 else 0.0, left))


def _note_failures(store: SweepStore, missing: Missing) -> None:
    """Record recipes that could not be made, in place of those of earlier runs."""
    if store.mode == "write" and (missing.failures or store.failures()):
        store.replace_failures(missing.failures)
