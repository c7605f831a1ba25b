"""The options of `palpate sweep`, and the refusal of those that mean nothing, before anything is made."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from ...datasets.sweeps.store import SweepStore
from ...datasets.sweeps.table import PARQUET, SUFFIXES
from ..errors import PlanError
from ..runtime.worker_devices import worker_devices
from .plan.code_version import code_version
from .plan.loading import Plan

STORE_SUFFIX = ".sweep"
"""Of a store that is not named: it lies beside the first plan."""
WRITTEN = ("baseline", "update_baseline", "tables", "summary", "scheduler")  # options that a dry run does not use


@dataclass(frozen=True)
class SweepJob:
    """The options of `palpate sweep`."""

    plans: list[Path]
    store: Path | None
    overrides: list[str] | None
    dry_run: bool
    yes: bool
    same_results: bool
    device: str | None
    workers: str
    shard: str | None
    unit_timeout: float
    worker_memory: int | None
    scheduler: str | None
    baseline: Path | None
    update_baseline: bool
    tolerances: list[str] | None
    tables: list[Path] | None
    overwrite: bool
    figure: bool
    summary: Path | None
    allow_code: bool

    @property
    def folder(self) -> Path:
        """The store: beside the first plan unless given."""
        return self.plans[0].with_suffix(STORE_SUFFIX) if self.store is None else self.store

    @property
    def worker_count(self) -> int | None:
        """None for "auto"."""
        if self.workers != "auto" and not self.workers.isdecimal():
            raise PlanError(f"--workers must be a number or auto, not {self.workers!r}")
        return None if self.workers == "auto" else int(self.workers)

    @property
    def shard_number(self) -> tuple[int, int]:
        """Number of the shard, the first being 0, and the number of shards."""
        number, slash, count = (self.shard or "1/1").partition("/")
        if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
            raise PlanError(f"--shard must be I/N with I in 1..N, such as 2/4, not {self.shard!r}")
        return int(number) - 1, int(count)

    def device_of(self, plan: Plan) -> str:
        """The device that is asked for, by the command line or else by the plan."""
        return self.device or plan.device

    def workers_of(self, plan: Plan) -> int | None:
        """The number of workers on each device, by the command line or else by the plan; None for "auto"."""
        return plan.workers if self.worker_count is None else self.worker_count

    def refuse_nonsense(self) -> None:
        """Raise PlanError or StrategyError for options that mean nothing, whether or not there is anything to make."""
        for name in WRITTEN if self.dry_run else ():
            if getattr(self, name):
                option = "--" + name.removesuffix("s").replace("_", "-")
                raise PlanError(f"{option} does not go with --dry-run, which makes nothing")
        if not self.unit_timeout >= 0:  # NaN is not
            raise PlanError(f"--unit-timeout must be at least 0 s (0 is no limit), not {self.unit_timeout:g}")
        if self.worker_memory is not None and self.worker_memory < 0:
            raise PlanError(f"--worker-memory must be at least 0 MB (0 is no limit), not {self.worker_memory}")
        _ = self.shard_number
        if self.scheduler is None:
            worker_devices(self.device or "cpu", self.worker_count)
        else:
            self._refuse_scheduler(self.scheduler)
        self._refuse_files()

    def _refuse_scheduler(self, scheduler: str) -> None:
        for option, value in {"--workers": self.worker_count, "--worker-memory": self.worker_memory}.items():
            if value is not None:
                raise PlanError(f"{option} does not go with --scheduler: a Dask cluster has workers of its own")
        if "://" not in scheduler and not scheduler.endswith(".json"):
            raise PlanError(f"--scheduler must be tcp://HOST:PORT or a scheduler file (.json), not {scheduler!r}")
        if scheduler.endswith(".json") and not Path(scheduler).is_file():
            raise PlanError(f"--scheduler {scheduler}: there is no such file; dask scheduler --scheduler-file makes it")

    def _refuse_files(self) -> None:
        for table in self.tables or ():
            if table.suffix not in SUFFIXES:
                raise PlanError(f"--table {table}: a table must end in {' or '.join(SUFFIXES)}")
            if table.is_dir():
                raise PlanError(f"--table {table}: is a folder")
            if table.exists() and not self.overwrite:
                raise PlanError(f"--table {table}: exists; --overwrite replaces it")
            if table.suffix == PARQUET:
                require_pyarrow(f"--table {table}")
        if self.summary is not None and (self.summary.is_dir() or not self.summary.absolute().parent.is_dir()):
            raise PlanError(f"--summary {self.summary}: must be a file in a folder that exists")
        if self.baseline is None and self.update_baseline:
            raise PlanError("--update-baseline needs --baseline FILE, the file to write")
        if self.baseline is None and self.tolerances:
            raise PlanError("--tolerance needs --baseline OLD, the table or store to compare with")
        if self.baseline is not None and self.shard is not None:
            raise PlanError("--baseline does not go with --shard, whose table lacks results: merge the stores first")

    def refuse_plan(self, plan: Plan) -> None:
        """Raise PlanError for a plan that these options, or this installation, cannot make."""
        if "poses" in plan.groups:
            require_pyarrow(f"{plan.name}: per_pose = true")
        if self.scheduler is not None and "," in self.device_of(plan):
            raise PlanError(
                f"with --scheduler, device must be one that every worker uses, not {self.device_of(plan)!r}"
            )

    def other_code_version(self) -> str:
        """The other code version that last recorded results in the store; raises PlanError if there is none."""
        if not self.folder.exists():
            raise PlanError(f"--same-results: there is no store {self.folder}, so it has no results to take over")
        with SweepStore(self.folder) as store:
            versions = [code for code, count in store.code_versions().items() if count and code != code_version()]
        if not versions:
            raise PlanError(f"--same-results: {self.folder} has no results of another code version than this one's")
        return versions[-1]


def is_occupied(folder: Path) -> bool:
    """Whether a path is a file, or a folder that is not empty: it is a store, or must be refused."""
    return folder.exists() and not (folder.is_dir() and not any(folder.iterdir()))


def require_pyarrow(what: str) -> None:
    """Raise PlanError if PyArrow, which writes Parquet files, is not installed. what: needs it."""
    if importlib.util.find_spec("pyarrow") is None:
        raise PlanError(f"{what}: Parquet needs PyArrow: pip install -e '.[parquet]' in palpate's folder")
