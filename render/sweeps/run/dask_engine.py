"""Dask's distributed scheduler as an engine: tasks go out as a few kilobytes, an `Outcome` comes back, arrays never.

| what happens                            | what comes of it                                                         |
|-----------------------------------------|--------------------------------------------------------------------------|
| a worker dies with a task it had begun  | an outcome that is lost, naming worker and host                          |
| with one that it only held in advance   | that one is sent again, unnoticed (SENDS times at most)                  |
| a task raises                           | an outcome with the error: the worker lives on                           |
| a worker joins later                    | it is judged at its first task; an unfit one is told of, and passed over |
| no worker, or no scheduler, is left     | SweepError from `wait` or `submit`                                       |

A cluster that we start leaves trying again to the sweep's schedule (`allowed_failures` 0); somebody else's tries a task
that kills its worker again by itself, as it is configured, before it gives up.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import PlanError, SweepError
from ..make.task import Outcome, Task
from .cluster import INSTALL, Connection, connect_cluster, hushed_logs
from .crew import Crew, new_run
from .dask_worker import Fitness, Work, pack_task, travelling

if TYPE_CHECKING:
    from distributed import Client, Future

SENDS = 4  # of a task whose worker died before it was seen to begin
POLL = 1.0  # [s] between looks at the cluster while nothing comes
AGAIN = "again"
"""Came of a task that nobody began."""


@dataclass
class _Held:
    """A task that is out."""

    task: Task
    future: Future | None = None
    send_count: int = 0
    fit: frozenset[str] = frozenset()
    """Workers that it may go to; empty is any."""
    begun: float | None = None
    """When a worker began it, `time.monotonic` [s]."""
    worker: str = ""
    """Address of that one."""
    words: str = ""
    """Its last: why it ended itself."""


class DaskEngine:
    """Workers of a Dask cluster; an Engine, whose workers are each worker's threads.

    scheduler: "local" or None, an address, "slurm" and other queueing systems, or a Client (`cluster`'s table).
    devices: the Warp device of each worker: "auto", "cpu", "cuda" (the first it sees), "cuda:0"; locally also several.
    workers: processes a device (local), jobs (slurm), or how many must be there (others). work: what makes a task,
    `work.run_task`; importable on the workers. patience: [s] for the scheduler to answer and workers to be there,
    and later on, how long none may be there; 30 s, and a day for jobs.

    Raises SweepError at `start`: what `connect_cluster` raises, workers that do not come, or are not fit.
    """

    def __init__(
        self,
        scheduler: str | Client | None = None,
        *,
        devices: str = "auto",
        workers: int | None = None,
        work: Work | None = None,
        patience: float | None = None,
    ) -> None:
        self._scheduler, self._work = scheduler, work
        self._asked: dict[str, Any] = {"devices": devices, "workers": workers, "patience": patience}
        self._run = new_run()
        self._came: queue.Queue[tuple[_Held, Outcome | Fitness | str]] = queue.Queue()
        self._held: dict[int, _Held] = {}
        self._sends = 0
        self._lock = threading.Lock()
        self._stack = contextlib.ExitStack()
        self._connection: Connection | None = None
        self._crew: Crew | None = None

    @property
    def name(self) -> str:
        """In the log."""
        shown = self._connection.name if self._connection else self._scheduler or "local"
        return f"dask {shown}"

    @property
    def devices(self) -> tuple[str, ...]:
        """Warp device of each thread of each worker that is there now."""
        return self._crew.devices() if self._crew else ()

    def start(self, store: Path) -> None:
        """Connect, wait for workers, and see that each can do the work, its kernels compiled.

        store: its folder; every worker must find it at the same path. Raises SweepError (see the class).
        """
        try:
            import distributed
        except ImportError as error:
            raise PlanError(INSTALL) from error
        self._make, _ = travelling()
        try:
            if not isinstance(self._scheduler, distributed.Client):  # whose log is its owner's
                self._stack.enter_context(hushed_logs())
            self._connection = connect_cluster(self._scheduler, **self._asked)
            self._stack.callback(self._connection.close)
            self._crew = Crew(self._connection, store.resolve(), self._run)
            self._stack.callback(self._crew.leave)
            self._connection.client.subscribe_topic(self._run, self._note_begun)
            self._crew.gather()
        except BaseException:
            self.close()
            raise

    def submit(self, task: Task) -> None:
        """Have a task made; workers take tasks in the order in which they are submitted.

        Raises SweepError if no fit worker or no scheduler is left.
        """
        held = _Held(task)
        with self._lock:
            self._held[task.number] = held
        self._send(held)

    def wait(self, timeout: float | None = None) -> list[Outcome]:
        """What has come of tasks since the last call: at least one, unless nothing came within `timeout` [s].

        Raises SweepError when no scheduler or no worker is left.
        """
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = POLL if end is None else min(POLL, end - time.monotonic())
            came = self._take(max(left, 0.0))
            if came:
                return came
            self._look_after()
            if end is not None and time.monotonic() >= end:
                return []

    def running(self) -> dict[int, float]:
        """Tasks that a worker has begun: number, and seconds since then."""
        now = time.monotonic()
        with self._lock:
            return {number: now - held.begun for number, held in self._held.items() if held.begun is not None}

    def drop(self, number: int) -> None:
        """End a task that takes too long; a worker that has begun it is ended, and with it what else it makes."""
        crew, held = self._open(), self._held.get(number)
        if held is None:
            return
        who = crew.name(held.worker) if held.worker else "no worker"
        error = f"task {number} took too long and was ended ({who})"
        self._came.put((held, Outcome(number, who, error=error, is_lost=True)))
        if held.future is not None:
            held.future.cancel(force=True)
        if held.worker:
            crew.end(held.worker)
            held.worker = ""

    def close(self) -> None:
        """End what this engine started, whatever it does; in somebody's cluster, what has begun is made to its end."""
        with self._lock:
            futures = [held.future for held in self._held.values() if held.future is not None]
            self._held.clear()
        if self._crew is not None and self._crew.client.status == "running":
            with contextlib.suppress(Exception):  # the scheduler may go at this very moment
                self._crew.client.cancel(futures, force=True)
        self._connection = self._crew = None
        self._stack.close()

    def _open(self) -> Crew:
        """The crew of a started engine."""
        if self._crew is None:
            raise SweepError("the engine is not started, or closed")
        return self._crew

    def _send(self, held: _Held) -> None:
        """Hand a task to the scheduler."""
        crew = self._open()
        crew.look()
        held.fit = crew.fit()
        with self._lock:
            self._sends += 1
            order = self._sends
            held.send_count += 1
            held.begun, held.worker, held.words = None, "", ""
        held.future = future = crew.client.submit(
            self._make,
            pack_task(held.task, crew.terms, self._work or _work()),
            key=f"{self._run}-{held.task.number}-{order}",
            pure=False,
            retries=0,
            priority=-order,  # Dask itself takes what comes within 100 ms in any order
            workers=sorted(held.fit) or None,
        )
        future.add_done_callback(partial(self._receive, held))

    def _note_begun(self, event: tuple[float, Any]) -> None:
        """A worker's event, on the client's loop: it begins, or it has spoilt its GPU and ends."""
        with self._lock:
            held = self._held.get(event[1]["number"])
            if held is not None:
                address = event[1]["fitness"]["address"]
                if held.worker != address:
                    held.begun, held.worker = time.monotonic(), address
                held.words = event[1].get("words", "")
        if self._crew is not None:
            self._crew.meet(Fitness(**event[1]["fitness"]))

    def _receive(self, held: _Held, future: Future) -> None:
        """What came of a task, on a thread of Dask's."""
        if held.future is future:
            self._came.put((held, self._came_of(held, future)))

    def _came_of(self, held: _Held, future: Future) -> Outcome | Fitness | str:
        """See the module's table."""
        from distributed import KilledWorker

        number = held.task.number
        if future.status == "cancelled":
            return Outcome(number, held.worker, error=f"the cluster has lost task {number}", is_lost=True)
        try:
            made = future.result()
        except KilledWorker as error:
            return self._came_of_death(held, error.last_worker.address)
        except Exception as error:
            return Outcome(number, held.worker, error=f"task {number}: {type(error).__name__}: {error}")
        return made if isinstance(made, (Outcome, Fitness)) else Fitness(*made)

    def _came_of_death(self, held: _Held, address: str) -> Outcome | str:
        """Dask blames every task that was with the worker; only one that had begun is to blame."""
        if held.worker != address and held.send_count < SENDS:
            return AGAIN
        who = self._crew.name(address) if self._crew else address
        number = held.task.number
        error = held.words or f"worker {who} died while it made task {number}"
        return Outcome(number, who, error=error, is_lost=True)

    def _take(self, timeout: float) -> list[Outcome]:
        """What has come by now, or first within `timeout` [s]; what must be sent again is."""
        outcomes: list[Outcome] = []
        with contextlib.suppress(queue.Empty):
            held, came = self._came.get(timeout=timeout) if timeout > 0 else self._came.get_nowait()
            while True:
                self._settle(held, came, outcomes)
                held, came = self._came.get_nowait()
        return outcomes

    def _settle(self, held: _Held, came: Outcome | Fitness | str, outcomes: list[Outcome]) -> None:
        """An outcome is told, once; all else is sent again."""
        number = held.task.number
        if self._held.get(number) is not held:
            return  # dropped meanwhile
        if isinstance(came, Outcome):
            with self._lock:
                del self._held[number]
            outcomes.append(came)
            return
        if isinstance(came, Fitness):
            self._open().meet(came)
        self._send(held)

    def _look_after(self) -> None:
        """Nothing comes: see that somebody is there to make it."""
        crew = self._open()
        crew.look()
        there = crew.threads().keys()
        for held in list(self._held.values()):
            if held.fit and not held.fit & there:  # those that it was meant for are gone, others may be there
                old, held.future = held.future, None
                if old is not None:
                    old.cancel(force=True)
                self._send(held)


def _work() -> Work:
    """What makes a sweep's tasks."""
    from ..make.work import run_task

    return run_task
