"""Who makes a sweep's tasks: processes of this host (one a core, two a GPU), a Dask cluster, or this process."""

import json
import os
import time
from collections import deque
from functools import lru_cache
from pathlib import Path

from ...errors import StrategyError, SweepError
from ...runtime.worker_devices import worker_devices
from ..make.task import Chunk, Engine, Outcome, Running, Task
from ..plan.recipe import is_user_metric
from .messages import worker_name
from .processes import WORK, Processes
from .worker import Work, attempt, find_work

IDLE = 0.02  # [s] of sleep where there is no task


class InProcess:
    """Tasks are made one after the other where `wait` is called, on one Warp device; Ctrl-C passes through.

    work: what makes a task, by default the sweep's own. A stage that crashes ends this process, and one that never
    ends is never ended: for plans with code of that kind there is `Processes`.

    >>> from pathlib import Path
    >>> from palpate.render import InProcess, load_plans, run_sweep
    >>> _ = Path("study.toml").write_text('object.source = "cube"')
    >>> plan = load_plans(["study.toml"], ["motion.duration=0.1"])
    >>> run_sweep(plan, "study.sweep", InProcess("cpu")).engine
    'in this process, on cpu'
    """

    def __init__(self, device: str = "cpu", *, work: Work | None = None) -> None:
        self._device = device
        self._given = work
        self._work: Work | None = None
        self._queue: deque[Task] = deque()

    def __repr__(self) -> str:
        """One line."""
        return f"InProcess({self._device!r})"

    @property
    def name(self) -> str:
        """In the log."""
        return f"in this process, on {self._device}"

    @property
    def devices(self) -> tuple[str, ...]:
        """Its one device."""
        return (self._device,)

    @property
    def worker_most(self) -> int:
        """One: this process."""
        return 1

    def start(self, store: Path) -> None:
        """Look whether the device is there; raises SweepError if not."""
        from ...runtime.span_workers import warp_device  # Warp

        del store  # this process made it
        try:
            self._device = warp_device(self._device)
        except StrategyError as error:
            raise SweepError(f"{self._worker}: {error}") from error
        self._work = self._given or find_work(WORK)

    @property
    def _worker(self) -> str:
        return worker_name(0, os.getpid(), self._device)

    def grow(self, worker_count: int) -> None:
        """Nothing: there is one worker."""

    def free_count(self) -> int:
        """One, unless a task waits."""
        return 0 if self._queue else 1

    def submit(self, task: Task) -> None:
        """Have a task made by the next `wait`."""
        self._queue.append(task)

    def wait(self, timeout: float) -> list[Outcome]:
        """Make the task, however long it takes; without one, sleep for a moment."""
        if self._work is None:
            raise SweepError("the engine was not started")
        if not self._queue:
            time.sleep(min(timeout, IDLE))
            return []
        return [attempt(self._work, self._queue.popleft(), self._device, self._worker, lambda places: None)]

    def running(self) -> dict[int, Running]:
        """None: the caller is not in `wait`."""
        return {}

    def drop(self, number: int, reason: str) -> None:
        """Nothing: no task is running."""

    def take_back(self) -> list[Task]:
        """Tasks that wait and were not begun; they are no longer this engine's."""
        tasks = list(self._queue)
        self._queue.clear()
        return tasks

    def close(self) -> None:
        """Forget what waits."""
        self._queue.clear()


class LocalEngine:
    """Workers of this host's cores: this process while little is left, then processes.

    Starting a process takes longer than a few hundred poses do. It is worth that for seconds of work, and for chunks
    that run Python: a stage that crashes, or never ends, must not take the sweep with it.
    """

    def __init__(self, worker_count: int) -> None:
        self._here = InProcess("cpu")
        self._processes = Processes(["cpu"] * worker_count)
        self._store = Path()
        self._has_processes = False
        self._kept: deque[Task] = deque()
        """Tasks for processes that are not ready yet."""

    @property
    def _engine(self) -> Engine:
        return self._processes if self._has_processes else self._here

    @property
    def name(self) -> str:
        """In the log."""
        return self._engine.name

    @property
    def devices(self) -> tuple[str, ...]:
        """Of the processes that are ready, or of this one."""
        return self._engine.devices

    @property
    def worker_most(self) -> int:
        """Processes that there may be."""
        return self._processes.worker_most

    def start(self, store: Path) -> None:
        """Start Warp in this process, quietly."""
        from ...runtime.warp_start import start_warp

        self._store = store
        start_warp()
        self._here.start(store)

    def grow(self, worker_count: int) -> None:
        """Start processes if there is work for more than one worker."""
        if worker_count > 1:
            self._start_processes()
        if self._has_processes:
            self._processes.grow(worker_count)

    def _start_processes(self) -> None:
        if not self._has_processes:
            self._has_processes = True
            self._processes.start(self._store)
            self._kept.extend(self._here.take_back())  # this process makes none any more

    def free_count(self) -> int:
        """Workers without a task; none while one waits for a process."""
        return 0 if self._kept else self._engine.free_count()

    def submit(self, task: Task) -> None:
        """Give a task to a worker, or keep it until the first process is ready."""
        if not self._has_processes and any(map(runs_python, task.chunks)):
            self._start_processes()
            self._kept.append(task)
        else:
            self._engine.submit(task)

    def wait(self, timeout: float) -> list[Outcome]:
        """Outcomes since the last call, see `Processes.wait`."""
        outcomes = self._engine.wait(timeout)
        while self._kept and self._processes.free_count():
            self._processes.submit(self._kept.popleft())
        return outcomes

    def running(self) -> dict[int, Running]:
        """How far workers are with their tasks, by number."""
        return self._engine.running()

    def drop(self, number: int, reason: str) -> None:
        """Kill the worker that makes a task."""
        self._engine.drop(number, reason)

    def close(self) -> None:
        """End all processes."""
        self._here.close()
        self._processes.close()


@lru_cache(maxsize=256)
def _is_python(strategy: str) -> bool:
    """Whether a strategy, as JSON, has stages that run on the host or are a user's."""
    from ...stages.registry import known_stages

    described = json.loads(strategy)
    stages = [(role, stage) for role in ("prune", "transform") for stage in described.get(role, ())]
    names = [(role, stage if isinstance(stage, str) else stage["stage"]) for role, stage in stages]
    entries = [known_stages(role).get(name) for role, name in names]
    return any(entry is None or not entry.own or (entry.function and entry.on == "host") for entry in entries)


def runs_python(chunk: Chunk) -> bool:
    """Whether making a chunk runs Python of stages, or code of a user: such may crash or never end."""
    if any(map(is_user_metric, chunk.groups)):
        return True
    parts = json.loads(chunk.recipe)
    described = parts["strategy"]["described"]
    has_code = parts["thing"].get("function") is not None or bool(described.get("modules"))
    return has_code or _is_python(json.dumps(described))


def choose_engine(device: str = "auto", workers: int | None = None, scheduler: str | None = None) -> Engine:
    """The engine for the command line's words.

    device: "cpu", "cuda:0", several with commas between them, "cuda" (all GPUs), "auto" (the first GPU, else the CPU).
    workers: on each device; None is one for each core on the CPU, and two on a GPU. scheduler: of a cluster.

    | scheduler | devices   | engine                                                                             |
    |-----------|-----------|------------------------------------------------------------------------------------|
    | given     |           | DaskEngine                                                                         |
    | none      | the CPU   | LocalEngine: this process, and processes once seconds of work are left             |
    | none      | GPUs      | Processes: one renders while the other adds up (79 -> 83 % of the GPU's time)      |

    Raises StrategyError for a device that this machine lacks, or named twice, and a number of workers that cannot be.
    """
    if scheduler is not None:
        from .dask_engine import DaskEngine

        return DaskEngine(scheduler, devices=device, workers=workers)
    names = worker_devices(device, workers)
    return LocalEngine(len(names)) if set(names) == {"cpu"} else Processes(names)
