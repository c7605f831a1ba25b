"""Workers of a sweep as processes of this host, watched over: one that dies costs the task it had begun, nothing else.

Not a pool of the standard library, which is broken as a whole as soon as one of its processes is killed. Everything
on this side happens within calls of the engine, on the caller's thread.

| a worker ...                         | its task                                  | its place                     |
|--------------------------------------|-------------------------------------------|-------------------------------|
| dies at a task, or is dropped        | is lost                                   | is taken by another           |
| dies without one                     |                                           | the same, `DEATHS_MOST` times |
| cannot do the work                   |                                           | an error                      |
| does any of these, and holds another | that one goes back, and is the next       |                               |
| has nothing to do                    | it takes what a busy one holds in advance |                               |
"""

import selectors
import time
import warnings
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from ...errors import PalpateWarning, SweepError
from ..make.task import Outcome, Task
from .messages import Begun, Done, Ready, Return, Returned, Told, Unfit
from .worker import Work
from .worker_process import END_LONGEST, WorkerProcess

WORK = f"{__name__.removesuffix('run.processes')}make.work:run_task"
AHEAD = 1  # tasks that a worker holds besides the one it makes, so that it never waits for its parent
DEATHS_MOST = 3  # in a row, none of them at a task
START_LONGEST = 900.0  # [s]; kernels of a GPU that were never compiled take minutes


class Processes:
    """Workers as processes of this host, one for each name in `devices`, which are Warp's.

    work: what makes a task, importable by its name, by default the sweep's own.
    """

    def __init__(self, devices: Sequence[str], *, work: Work | None = None) -> None:
        if not devices:
            raise SweepError("processes need a device each; none was given")
        self._devices = tuple(devices)
        self._work = WORK if work is None else _importable(work)
        self._started: selectors.BaseSelector | None = None
        self._workers: list[WorkerProcess] = []
        self._queue: deque[Task] = deque()
        self._outcomes: list[Outcome] = []
        self._unfit: list[str] = []
        self._idle_deaths: list[str] = []
        self._warnings: dict[tuple[type[Warning], str], bool] = {}

    @property
    def name(self) -> str:
        """In the log."""
        counts = {device: self._devices.count(device) for device in self._devices}
        return "processes, " + ", ".join(f"{count} on {device}" for device, count in counts.items())

    @property
    def devices(self) -> tuple[str, ...]:
        """Warp device of each worker."""
        return self._devices

    @property
    def pids(self) -> tuple[int, ...]:
        """Process of each worker at present."""
        return tuple(worker.process.pid for worker in self._workers)

    def start(self, store: Path) -> None:
        """Start all workers and wait until they can work; the first on each kind of device compiles the kernels.

        Raises SweepError, naming the worker, for one that cannot: its device is not there, or it dies DEATHS_MOST
        times.
        """
        del store  # on this host, what one process sees all see
        self._started = selectors.DefaultSelector()
        deadline = time.monotonic() + START_LONGEST
        try:
            for index in range(len(self._devices)):
                self._workers.append(self._launch(index))
            while waiting := [worker.name for worker in self._workers if not worker.is_ready]:
                if time.monotonic() > deadline:
                    raise SweepError(f"not ready after {START_LONGEST:.0f} s: {', '.join(waiting)}")
                self._pump(1.0)
        except BaseException:
            self.close()
            raise

    def submit(self, task: Task) -> None:
        """Have a task made: at once, or as soon as a worker has room for it."""
        self._queue.append(task)
        self._share()

    def wait(self, timeout: float | None = None) -> list[Outcome]:
        """Outcomes since the last call, at least one unless `timeout` [s] passes or nothing is under way.

        Tells the user what workers warned of, each once. Raises SweepError if workers do not live long enough to work.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        self._pump(0.0)
        while not self._outcomes and (self._queue or any(worker.load for worker in self._workers)):
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0:
                break
            self._pump(left)
        for warning in [warning for warning, is_told in self._warnings.items() if not is_told]:
            self._warnings[warning] = True
            warnings.warn(warning[1], warning[0], stacklevel=2)
        outcomes, self._outcomes = self._outcomes, []
        return outcomes

    def running(self) -> dict[int, float]:
        """Tasks that a worker has begun: number, and seconds since then."""
        self._pump(0.0)
        now = time.monotonic()
        return {worker.begun.number: now - worker.since for worker in self._workers if worker.begun is not None}

    def drop(self, number: int) -> None:
        """End a task: its outcome is `is_lost`; a worker that has begun it is killed, and another takes its place."""
        self._pump(0.0)
        for worker in self._workers:
            if worker.begun is not None and worker.begun.number == number:
                seconds = time.monotonic() - worker.since
                worker.kill(f"was ended {seconds:.0f} s after it had begun the task")
                self._lose(worker, number, f"{worker.name} {worker.ending}", seconds)
                return
            if any(task.number == number for task in worker.handed):
                self._ask_back(worker, number)
                self._lose(worker, number, "it was dropped before it began")
                return
        for task in [task for task in self._queue if task.number == number]:
            self._queue.remove(task)
            self._lose(None, number, "it was dropped before it began")

    def close(self) -> None:
        """End all workers, whatever they do, and wait until they are gone."""
        workers, self._workers = self._workers, []
        for worker in workers:
            worker.port.close()  # which ends them
        deadline = time.monotonic() + END_LONGEST
        for worker in workers:
            worker.end(max(0.0, deadline - time.monotonic()))
        self._queue.clear()
        if self._started is not None:
            self._started.close()
            self._started = None

    @property
    def _selector(self) -> selectors.BaseSelector:
        if self._started is None:
            raise SweepError("the engine was not started, or is closed")
        return self._started

    def _launch(self, index: int) -> WorkerProcess:
        kinds = [name.split(":")[0] for name in self._devices]
        leads = kinds.index(kinds[index]) == index
        worker = WorkerProcess.launch(index, self._devices[index], self._work, compiles=leads)
        self._selector.register(worker.port, selectors.EVENT_READ, worker)
        return worker

    def _pump(self, timeout: float | None) -> None:
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
        self._share()
        if self._unfit:
            raise SweepError(self._unfit[0])
        if len(self._idle_deaths) >= DEATHS_MOST:
            told = f"{DEATHS_MOST} workers in a row died without having begun a task"
            raise SweepError(f"{told}; the last: {self._idle_deaths[-1]}")

    def _receive(self, worker: WorkerProcess) -> None:
        try:
            for message in worker.messages():
                self._hear(worker, message)
        except EOFError:
            self._replace(worker)

    def _hear(self, worker: WorkerProcess, message: object) -> None:
        match message:
            case Ready():
                worker.is_ready = True
            case Unfit(error):
                worker.is_leaving = True
                self._unfit.append(error)
            case Begun(number, at):
                worker.begun, worker.since = worker.taken(number), at
                if number in worker.dropped:
                    worker.kill("was ended at a task that had been dropped")
            case Done(outcome, is_last):
                worker.is_leaving = is_last
                self._finish(worker, outcome)
            case Returned(number):
                task = worker.taken(number)
                if number not in worker.dropped:
                    self._queue.appendleft(task)
            case Told(category, text):
                self._warnings.setdefault((category, text), False)
            case _:
                raise SweepError(f"{worker.name} said what it should not: {message!r:.80}")

    def _finish(self, worker: WorkerProcess, outcome: Outcome) -> None:
        """Pass on what came of the task that a worker had begun."""
        worker.begun = None
        if outcome.number not in worker.dropped:
            self._outcomes.append(outcome)
            self._idle_deaths.clear()

    def _lose(self, worker: WorkerProcess | None, number: int, error: str, seconds: float = 0.0) -> None:
        """Pass on that a task is dropped, and pass nothing on that still comes of it."""
        self._outcomes.append(
            Outcome(number, worker.name if worker else "no worker", seconds=seconds, error=error, is_lost=True)
        )
        if worker:
            worker.dropped.add(number)

    def _share(self) -> None:
        """Give tasks to workers, those without one first; take back for these what others hold in advance."""
        workers = [worker for worker in self._workers if worker.takes_tasks]
        while self._queue and workers:
            worker = min(workers, key=lambda worker: worker.load)
            if worker.load > AHEAD:
                return
            worker.handed.append(self._queue[0])
            worker.send(self._queue.popleft())
        idle = sum(not worker.load for worker in workers) - sum(len(worker.asked) for worker in workers)
        for worker in sorted(workers, key=lambda worker: worker.since):
            if idle > 0 and worker.begun is not None and worker.handed and not worker.asked:
                self._ask_back(worker, worker.handed[-1].number)
                idle -= 1

    def _ask_back(self, worker: WorkerProcess, number: int) -> None:
        worker.asked.add(number)
        worker.send(Return(number))

    def _replace(self, worker: WorkerProcess) -> None:
        """Account for a worker that has ended, and start another, unless it could not do the work at all."""
        sentence = worker.told_of_end()
        self._selector.unregister(worker.port)
        worker.end(0.0)
        back = [task for task in worker.handed if task.number not in worker.dropped]
        if worker.begun is not None and worker.ending is None:
            seconds = time.monotonic() - worker.since
            lost = Outcome(worker.begun.number, worker.name, seconds=seconds, error=sentence, is_lost=True)
            self._finish(worker, lost)
        elif worker.begun is not None and worker.begun.number not in worker.dropped:
            back.insert(0, worker.begun)  # begun in the moment in which we killed it for the one before
        elif not worker.is_leaving and worker.ending is None:
            self._idle_deaths.append(sentence)
            self._warnings.setdefault((PalpateWarning, f"{sentence}; another takes its place"), False)
        self._queue.extendleft(reversed(back))
        place = self._workers.index(worker)
        self._workers[place : place + 1] = [] if self._unfit else [self._launch(worker.index)]


def _importable(work: Work) -> str:
    """The name by which a worker finds it."""
    module, name = getattr(work, "__module__", None), getattr(work, "__qualname__", "<>")
    if module in (None, "__main__") or "<" in name:
        raise SweepError(f"workers cannot import {work!r:.80}: it must be a function of a module, not of a script")
    return f"{module}:{name}"
