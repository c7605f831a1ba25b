"""Workers of a sweep as processes of this host: one that dies costs its task, nothing else.

Not a pool of the standard library, which is broken as a whole as soon as one of its processes is killed. Everything
on this side happens within calls of the engine, on the caller's thread.

| a worker ...              | its task                                 | its place                     |
|---------------------------|------------------------------------------|-------------------------------|
| dies at a task, or is ended | is lost, with the chunks that it was making | is taken by another      |
| dies without one          |                                          | the same, `DEATHS_MOST` times |
| cannot do the work        |                                          | an error                      |
"""

import selectors
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

from ...errors import PalpateWarning, SweepError
from ..make.task import Outcome, Running, Task
from .messages import Done, Progress, Ready, Unfit, Warned
from .worker import Work
from .worker_process import END_LONGEST, WorkerProcess

WORK = f"{__name__.removesuffix('run.processes')}make.work:run_task"
DEATHS_MOST = 3  # in a row, none of them at a task
START_LONGEST = 900.0  # [s] until the first worker is ready


class Processes:
    """Workers as processes of this host, at most one for each name in `devices`, which are Warp's.

    The first is started at once, the others when `grow` asks for them. work: what makes a task, importable by its name,
    by default the sweep's own.
    """

    def __init__(self, devices: Sequence[str], *, work: Work | None = None) -> None:
        if not devices:
            raise SweepError("processes need a device each; none was given")
        self._names = tuple(devices)
        self._work = WORK if work is None else _importable(work)
        self._started: selectors.BaseSelector | None = None
        self._deadline = 0.0
        self._workers: list[WorkerProcess] = []
        self._wanted = 0
        self._outcomes: list[Outcome] = []
        self._unfit: list[str] = []
        self._idle_deaths: list[str] = []
        self._warnings: dict[tuple[type[Warning], str], bool] = {}

    @property
    def name(self) -> str:
        """In the log."""
        counts = {device: self._names.count(device) for device in self._names}
        return "processes, " + ", ".join(f"{count} on {device}" for device, count in counts.items())

    @property
    def devices(self) -> tuple[str, ...]:
        """Warp device of each worker that is ready."""
        return tuple(worker.device for worker in self._workers if worker.is_ready)

    @property
    def worker_most(self) -> int:
        """One for each device given."""
        return len(self._names)

    @property
    def pids(self) -> tuple[int, ...]:
        """Process of each worker at present."""
        return tuple(worker.process.pid for worker in self._workers)

    def start(self, store: Path) -> None:
        """Start the first worker, without waiting for it."""
        del store  # on this host, what one process sees all see
        self._started = selectors.DefaultSelector()
        self._deadline = time.monotonic() + START_LONGEST
        self.grow(1)

    def grow(self, worker_count: int) -> None:
        """Have so many workers, at most one for each device given; the first must be ready before others start.

        So a device that is not there is one error, and kernels are compiled once.
        """
        self._wanted = max(self._wanted, min(worker_count, len(self._names)))
        while len(self._workers) < self._wanted and (not self._workers or self._workers[0].is_ready):
            self._workers.append(self._launch(len(self._workers)))

    def free_count(self) -> int:
        """Workers without a task."""
        return sum(worker.is_free for worker in self._workers)

    def submit(self, task: Task) -> None:
        """Give a task to a free worker; raises SweepError if there is none."""
        worker = next((worker for worker in self._workers if worker.is_free), None)
        if worker is None:
            raise SweepError(f"task {task.number}: no worker is free")
        worker.give(task)

    def wait(self, timeout: float) -> list[Outcome]:
        """Outcomes since the last call; waits for one, or for a free worker, at most `timeout` [s].

        Warns the user of what workers warned of, each once. Raises SweepError, naming the worker, for one that cannot
        do the work, and if workers do not live long enough to work.
        """
        until = time.monotonic() + timeout
        free = self.free_count()
        self._pump(0.0)
        while not self._outcomes and self.free_count() <= free and (left := until - time.monotonic()) > 0:
            self._pump(left)
        if not self.devices and not self._idle_deaths and time.monotonic() > self._deadline:
            raise SweepError(f"{self._workers[0].name} is not ready after {START_LONGEST:.0f} s")
        for warning in [warning for warning, is_shown in self._warnings.items() if not is_shown]:
            self._warnings[warning] = True
            warnings.warn(warning[1], warning[0], stacklevel=2)
        outcomes, self._outcomes = self._outcomes, []
        return outcomes

    def running(self) -> dict[int, Running]:
        """How far workers are with their tasks, by number."""
        self._pump(0.0)
        return {worker.task.number: worker.running() for worker in self._workers if worker.task is not None}

    def drop(self, number: int, reason: str) -> None:
        """Kill the worker that makes a task; another takes its place."""
        for worker in self._workers:
            if worker.task is not None and worker.task.number == number:
                worker.kill(reason)

    def close(self) -> None:
        """End all workers, whatever they do, and wait until they are gone."""
        workers, self._workers = self._workers, []
        self._wanted = 0
        for worker in workers:
            worker.port.close()  # which ends them
        deadline = time.monotonic() + END_LONGEST
        for worker in workers:
            worker.end(max(0.0, deadline - time.monotonic()))
        if self._started is not None:
            self._started.close()
            self._started = None

    @property
    def _selector(self) -> selectors.BaseSelector:
        if self._started is None:
            raise SweepError("the engine was not started, or is closed")
        return self._started

    def _launch(self, index: int) -> WorkerProcess:
        worker = WorkerProcess.launch(index, self._names[index], self._work)
        self._selector.register(worker.port, selectors.EVENT_READ, worker)
        return worker

    def _pump(self, timeout: float) -> None:
        """Let messages pass for so long, or until some have; replace workers that have ended."""
        for worker in self._workers:
            wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if worker.outgoing else 0)
            self._selector.modify(worker.port, wanted, worker)
        for key, events in self._selector.select(timeout):
            worker = key.data
            if events & selectors.EVENT_WRITE:
                worker.flush()
            if events & selectors.EVENT_READ:
                self._receive(worker)
        for worker in [own for own in self._workers if own.process.poll() is not None]:
            self._bury(worker)
        if self._unfit:
            raise SweepError(self._unfit[0])
        if len(self._idle_deaths) >= DEATHS_MOST:
            text = f"{DEATHS_MOST} workers in a row died without having begun a task"
            raise SweepError(f"{text}; the last: {self._idle_deaths[-1]}")

    def _receive(self, worker: WorkerProcess) -> None:
        try:
            for message in worker.messages():
                self._take(worker, message)
        except EOFError:
            self._replace(worker)

    def _bury(self, worker: WorkerProcess) -> None:
        """Replace a worker whose process has ended; a child that user code left may hold its socket open."""
        self._receive(worker)  # what it had sent before
        if worker in self._workers:
            self._replace(worker)

    def _take(self, worker: WorkerProcess, message: object) -> None:
        match message:
            case Ready(device):
                worker.is_ready, worker.device = True, device
                self.grow(self._wanted)
            case Unfit(error):
                worker.is_leaving = True
                self._unfit.append(error)
            case Progress(places):
                worker.note_progress(places)
            case Done(outcome, is_last):
                worker.is_leaving, worker.task = is_last, None
                self._outcomes.append(outcome)
                self._idle_deaths.clear()
            case Warned(category, text):
                self._warnings.setdefault((category, text), False)
            case _:
                raise SweepError(f"{worker.name} sent what it should not: {message!r:.80}")

    def _replace(self, worker: WorkerProcess) -> None:
        """Account for a worker that has ended, and start another, unless it could not do the work at all."""
        sentence = worker.ending_sentence()
        self._selector.unregister(worker.port)
        worker.end(0.0)
        if worker.task is not None:
            seconds = time.monotonic() - worker.begun
            number = worker.task.number
            lost = Outcome(number, worker.name, seconds=seconds, error=sentence, is_lost=True, suspects=worker.places)
            self._outcomes.append(lost)
            self._idle_deaths.clear()
        elif not worker.is_leaving:
            self._idle_deaths.append(sentence)
            self._warnings.setdefault((PalpateWarning, f"{sentence}; another takes its place"), False)
        place = self._workers.index(worker)
        self._workers[place : place + 1] = [] if self._unfit else [self._launch(worker.index)]


def _importable(work: Work) -> str:
    """The name by which a worker finds it."""
    module, name = getattr(work, "__module__", None), getattr(work, "__qualname__", "<>")
    if module in (None, "__main__") or "<" in name:
        raise SweepError(f"workers cannot import {work!r:.80}: it must be a function of a module, not of a script")
    return f"{module}:{name}"
