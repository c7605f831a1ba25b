"""Who makes a sweep's tasks: this process, several on this host (one a core, two a GPU), or a cluster."""

import os
from collections import deque
from pathlib import Path

from ...errors import StrategyError, SweepError
from ...runtime.span_workers import warp_device, worker_devices
from ..make.task import Engine, Outcome, Task
from .messages import worker_name
from .processes import WORK, Processes
from .worker import Work, attempt, find_work


class InProcess:
    """Tasks are made one after the other where `wait` is called, on one Warp device; Ctrl-C passes through.

    work: what makes a task, by default the sweep's own. A task that has begun cannot be dropped.
    """

    def __init__(self, device: str = "cpu", *, work: Work | None = None) -> None:
        self._device = device
        self._given = work
        self._work: Work | None = None
        self._queue: deque[Task] = deque()
        self._outcomes: list[Outcome] = []

    @property
    def name(self) -> str:
        """In the log."""
        return f"in this process, on {self._device}"

    @property
    def devices(self) -> tuple[str, ...]:
        """Its one device."""
        return (self._device,)

    def start(self, store: Path) -> None:
        """Look whether the device is there; raises SweepError if not."""
        del store  # this process made it
        try:
            self._device = warp_device(self._device)
        except StrategyError as error:
            raise SweepError(f"{self._worker}: {error}") from error
        self._work = self._given or find_work(WORK)

    @property
    def _worker(self) -> str:
        return worker_name(0, os.getpid(), self._device)

    def submit(self, task: Task) -> None:
        """Have a task made by a later `wait`."""
        self._queue.append(task)

    def wait(self, timeout: float | None = None) -> list[Outcome]:
        """Make the next task, however long it takes; without one, there is nothing to wait for."""
        del timeout
        if self._work is None:
            raise SweepError("the engine was not started")
        if not self._outcomes and self._queue:
            self._outcomes.append(attempt(self._work, self._queue.popleft(), self._device, self._worker))
        outcomes, self._outcomes = self._outcomes, []
        return outcomes

    def running(self) -> dict[int, float]:
        """None: whoever asks is not in `wait`."""
        return {}

    def drop(self, number: int) -> None:
        """Forget a task that waits."""
        for task in [task for task in self._queue if task.number == number]:
            self._queue.remove(task)
            self._outcomes.append(Outcome(number, self._worker, error="it was dropped before it began", is_lost=True))

    def close(self) -> None:
        """Forget what waits."""
        self._queue.clear()


def choose_engine(device: str = "auto", workers: int | None = None, scheduler: str | None = None) -> Engine:
    """The engine for the command line's words.

    device: "cpu", "cuda:0", several with commas between them, "cuda" (all GPUs), "auto" (the first GPU, else the CPU).
    workers: on each device; None is one for each core on the CPU, and two on a GPU. scheduler: of a cluster, see
    `DaskEngine`.

    | scheduler | workers in all  | engine                                                                      |
    |-----------|-----------------|-----------------------------------------------------------------------------|
    | given     |                 | DaskEngine                                                                  |
    | none      | one, on the CPU | InProcess: nobody else wants the core                                       |
    | none      | one, on a GPU   | Processes: the GPU goes on while this process files results                 |
    | none      | two, on a GPU   | Processes: it goes on, too, while one of them counts up (79 -> 83 % of it)  |
    | none      | several         | Processes: of two threads, host stages make half as many poses as of one    |

    Raises StrategyError for a device that this machine lacks, or named twice, and a number of workers that cannot be.
    """
    if scheduler is not None:
        from .dask_engine import DaskEngine

        return DaskEngine(scheduler, devices=device, workers=workers)
    names = worker_devices(device, workers)
    if names == ["cpu"]:
        return InProcess("cpu")
    return Processes(names)
