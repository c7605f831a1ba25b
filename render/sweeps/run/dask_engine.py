"""Dask's distributed scheduler as an engine: tasks go out as a few kilobytes, an `Outcome` comes back, arrays never.

Each thread of a worker has one task at a time, sent to that worker and no other. So Dask repeats none by itself, in
anybody's cluster, and a worker that dies is charged to the task that it made.

| what happens                    | what follows                                                                    |
|---------------------------------|---------------------------------------------------------------------------------|
| a worker dies, or is ended      | its task is lost, naming worker and host; of several tasks none is charged       |
| a task raises                   | an outcome with the error: the worker lives on                                  |
| a worker joins later            | its plugin shows whether it is fit; an unfit one is reported, and not used       |
| no worker, or no scheduler left | SweepError from `wait`                                                          |
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
import uuid
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import PlanError, SweepError
from ...user_warnings import warn_user
from ..make.task import Outcome, Running, Task
from ..plan.code_version import code_version
from .dask_connection import (
    INSTALL,
    DaskConnection,
    connect_cluster,
    end_process,
    hushed_logs,
    is_seen,
    remove_token,
)
from .limits import AwakeClock

if TYPE_CHECKING:
    from distributed import Client, Future

    from .dask_worker import DaskWork, Fitness

ALONE = 60.0  # [s] that a fit worker may be missed while unfit ones are there: what died is replaced within that


@dataclass(eq=False)
class SentTask:
    """A task that a worker has."""

    task: Task
    address: str
    sent: float  # [s, `time.monotonic`]
    future: Future | None = None
    progressed: float | None = None  # when it last showed progress [s, the engine's AwakeClock]; None: not begun
    used: float = 0.0  # processor time that its thread has used since then [s]
    places: tuple[int, ...] = ()  # chunks that it is making
    ending: str | None = None  # why its worker ends


class DaskEngine:
    """Workers of a Dask cluster; an Engine, each of whose workers is a thread of one of Dask's.

    scheduler: "local" or None, an address, Dask's scheduler file, or a Client (`dask_connection`'s table). devices: the
    Warp device of each worker: "auto", "cpu", "cuda" (the first it sees), "cuda:0"; locally also several. workers:
    processes a device (local), or how many must be there (others). work: what makes a task, `work.run_task`; importable
    on the workers. patience: [s] for the scheduler to answer and workers to be there, and later on, how long none may
    be there; a client's own, else 30 s.

    Raises SweepError at `start`: what `connect_cluster` raises, workers that do not come, or are not fit.

    >>> from palpate.render import DaskEngine
    >>> DaskEngine("tcp://10.0.0.1:8786", workers=4)  # connects when `run_sweep` starts it
    DaskEngine('tcp://10.0.0.1:8786', devices='auto', workers=4)
    """

    def __init__(
        self,
        scheduler: str | Client | None = None,
        *,
        devices: str = "auto",
        workers: int | None = None,
        work: DaskWork | None = None,
        patience: float | None = None,
    ) -> None:
        self._scheduler, self._work = scheduler, work
        self._asked: dict[str, Any] = {"devices": devices, "workers": workers, "patience": patience}
        self._run = f"palpate-{uuid.uuid4().hex}"
        self._events: queue.Queue[tuple[str, Any]] = queue.Queue()
        self._fitness: dict[str, Fitness] = {}  # of each worker that is there and has shown it, by address
        self._sent: dict[int, SentTask] = {}
        self._sent_count = 0
        self._outcomes: list[Outcome] = []
        self._there_at = self._fit_at = 0.0
        self._awake = AwakeClock()
        self._stack = contextlib.ExitStack()
        self._connection: DaskConnection | None = None

    def __repr__(self) -> str:
        """One line."""
        asked = ", ".join(f"{name}={value!r}" for name, value in self._asked.items() if value is not None)
        return f"DaskEngine({self._scheduler or 'local'!r}, {asked})"

    @property
    def name(self) -> str:
        """In the log."""
        shown = self._connection.name if self._connection else self._scheduler or "local"
        return f"dask {shown}"

    @property
    def devices(self) -> tuple[str, ...]:
        """Warp device of each thread of each fit worker that is there now."""
        return tuple(own.device for own in self._fit() for _ in range(own.threads))

    @property
    def worker_most(self) -> int:
        """Those that are there: a cluster grows by itself."""
        return len(self.devices)

    def start(self, store: Path) -> None:
        """Connect, wait for workers, and see that each can do the work, its kernels compiled.

        store: its folder; every worker must find it at the same path. Raises SweepError (see the class).
        """
        try:
            import distributed
        except ImportError as error:
            raise PlanError(INSTALL) from error
        try:
            if not isinstance(self._scheduler, distributed.Client):  # whose log is its owner's
                self._stack.enter_context(hushed_logs())
            self._connection = connect_cluster(self._scheduler, **self._asked)
            self._stack.callback(self._connection.close)
            self._gather(store.resolve())
        except BaseException:
            self.close()
            raise

    def _gather(self, store: Path) -> None:
        """Wait for the workers, and have each show that it can do the work."""
        from .dask_worker import SweepPlugin, Terms

        connection = self._open()
        client, patience = connection.client, connection.patience
        token = store / f".workers-{self._run}"
        self._stack.callback(remove_token, token)
        token.write_text(self._run)
        try:
            client.wait_for_workers(connection.worker_count, timeout=patience)
        except TimeoutError as error:
            there = f"{len(client.nthreads())} of {connection.worker_count} workers are"
            raise SweepError(f"only {there} there after {patience:g} s ({connection.name})") from error
        client.subscribe_topic(self._run, partial(self._receive, "run"))
        client.subscribe_topic("all", partial(self._receive, "all"))
        self._stack.callback(self._leave, client)
        terms = Terms(self._run, code_version(), connection.device, str(token))
        try:
            client.register_plugin(SweepPlugin(terms))
        except Exception as error:  # Dask gives an error of a worker as text
            if "ModuleNotFoundError" not in f"{type(error).__name__} {error}":
                raise
            text = f"a worker cannot import palpate ({error}); install the same there as here"
            raise SweepError(text) from error
        self._wait_for_fitness(token, set(client.nthreads()), patience)

    def _wait_for_fitness(self, token: Path, addresses: set[str], patience: float) -> None:
        """Until every worker that was there has shown its fitness; none may be unfit."""
        until = time.monotonic() + patience
        client = self._open().client
        while not addresses <= self._fitness.keys() and time.monotonic() < until:
            for _, event in client.get_events(self._run):  # also those from before we were subscribed
                self._take_event("run", event)
            self._take(0.1)
        for address, own in list(self._fitness.items()):
            if own.fault is None and not is_seen(token.with_name(own.answer)):
                fault = f"what it writes into {token.parent} is not seen here; the store must be a shared folder"
                self._fitness[address] = replace(own, fault=fault)
        faults = sorted(own.complaint for own in self._fitness.values() if own.fault is not None)
        faults += [f"worker {address} gave no answer" for address in sorted(addresses - self._fitness.keys())]
        if faults:
            raise SweepError(faults[0] + (f" (and {len(faults) - 1} more workers)" if len(faults) > 1 else ""))
        self._warn_shared_cards()
        self._there_at = self._fit_at = time.monotonic()

    def grow(self, worker_count: int) -> None:
        """Nothing: the cluster has its workers."""

    def free_count(self) -> int:
        """Threads of fit workers without a task."""
        self._take(0.0)
        return sum(self._free().values())

    def submit(self, task: Task) -> None:
        """Give a task to a free thread; raises SweepError if there is none."""
        from .dask_worker import make_task, pack_task

        free = self._free()
        if not free:
            raise SweepError(f"task {task.number}: no worker is free")
        address = free.most_common(1)[0][0]
        self._sent_count += 1
        sent = SentTask(task, address, time.monotonic())
        self._sent[task.number] = sent
        sent.future = future = self._open().client.submit(
            make_task,
            pack_task(task, self._run, self._work or _own_work()),
            key=f"{self._run}-{task.number}-{self._sent_count}",
            pure=False,
            retries=0,
            workers=[address],
            allow_other_workers=False,
        )
        future.add_done_callback(partial(self._receive_future, sent))

    def wait(self, timeout: float) -> list[Outcome]:
        """Outcomes since the last call; waits for one, or for a free worker, at most `timeout` [s].

        Raises SweepError when no scheduler, or no fit worker, is left.
        """
        until = time.monotonic() + timeout
        free = sum(self._free().values())
        self._take(0.0)
        while not self._outcomes and sum(self._free().values()) <= free and (left := until - time.monotonic()) > 0:
            self._take(left)
        if not self._outcomes:
            self._require_workers()
        outcomes, self._outcomes = self._outcomes, []
        return outcomes

    def running(self) -> dict[int, Running]:
        """Tasks that a worker has begun, by number."""
        now, awake = time.monotonic(), self._awake()
        return {
            number: Running(now - sent.sent, sent.used, waiting_seconds=awake - sent.progressed)
            for number, sent in self._sent.items()
            if sent.progressed is not None
        }

    def drop(self, number: int, reason: str) -> None:
        """End the worker that makes a task, without waiting; a nanny starts another."""
        sent = self._sent.get(number)
        if sent is not None:
            sent.ending = reason
            client = self._open().client
            threading.Thread(target=end_process, args=(client, sent.address), daemon=True).start()
            self._events.put(("gone", sent.address))

    def close(self) -> None:
        """End what this engine started, whatever it does; in somebody's cluster, what has begun is made to its end."""
        futures = [sent.future for sent in self._sent.values() if sent.future is not None]
        self._sent.clear()
        if self._connection is not None and self._connection.client.status == "running":
            with contextlib.suppress(Exception):  # the scheduler may go at this very moment
                self._connection.client.cancel(futures, force=True)
        self._connection = None
        self._stack.close()

    def _leave(self, client: Any) -> None:
        if client.status == "running":
            with contextlib.suppress(Exception):  # the scheduler may go at this very moment
                client.unsubscribe_topic("all")
                client.unsubscribe_topic(self._run)
                client.unregister_worker_plugin(self._run)

    def _open(self) -> DaskConnection:
        if self._connection is None:
            raise SweepError("the engine is not started, or closed")
        return self._connection

    def _fit(self) -> list[Fitness]:
        return [own for own in self._fitness.values() if own.fault is None]

    def _free(self) -> Counter[str]:
        """Free threads of each fit worker that has any."""
        busy = Counter(sent.address for sent in self._sent.values())
        free = Counter({own.address: own.threads - busy[own.address] for own in self._fit()})
        return +free

    def _require_workers(self) -> None:
        connection, now = self._open(), time.monotonic()
        name, patience = connection.name, connection.patience
        if connection.client.status == "closed":
            raise SweepError(f"the scheduler is gone ({name}); what was finished is kept")
        if self._fit():
            self._there_at = self._fit_at = now
        elif self._fitness:
            self._there_at = now
            if now - self._fit_at > min(ALONE, patience):
                raise SweepError(min(self._fitness.values(), key=lambda own: own.address).complaint)
        elif now - self._there_at > patience:
            if connection.client.status != "running":
                raise SweepError(f"the scheduler is gone ({name}); what was finished is kept")
            raise SweepError(f"no worker was there for {patience:g} s ({name}); what was finished is kept")

    # ---- events, which come on threads of Dask's and are taken on the caller's

    def _receive(self, topic: str, event: tuple[float, Any]) -> None:
        self._events.put((topic, event[1]))

    def _receive_future(self, sent: SentTask, future: Future) -> None:
        self._events.put(("future", (sent, future)))

    def _take(self, timeout: float) -> None:
        """Take what has come by now, or first within `timeout` [s]."""
        with contextlib.suppress(queue.Empty):
            kind, value = self._events.get(timeout=timeout) if timeout > 0 else self._events.get_nowait()
            while True:
                self._take_event(kind, value)
                kind, value = self._events.get_nowait()

    def _take_event(self, kind: str, value: Any) -> None:
        if kind == "future":
            self._take_future(*value)
        elif kind == "gone":
            self._lose_worker(value)
        elif kind == "run":
            self._take_progress(value)
        elif isinstance(value, dict) and value.get("action") == "remove-worker":
            self._lose_worker(value["worker"])

    def _take_progress(self, event: dict[str, Any]) -> None:
        """A worker's event: its fitness, that it ends, or how far it is with a task."""
        if "fitness" in event:
            self._meet(event["fitness"])
            return
        sent = self._sent.get(event["number"])
        if sent is None:
            return
        sent.ending = event.get("ending", sent.ending)
        sent.used = event.get("used", 0.0)
        if "used" not in event:
            sent.progressed = self._awake()
        if event.get("places") is not None:
            sent.places = tuple(event["places"])

    def _meet(self, values: dict[str, Any]) -> None:
        """Take note of a worker; one that joined later and is unfit is reported once."""
        from .dask_worker import Fitness

        fitness = Fitness(**values)
        self._fitness[fitness.address] = fitness
        if fitness.fault is not None and self._there_at:
            warn_user(f"{fitness.complaint}; it is not used")

    def _take_future(self, sent: SentTask, future: Future) -> None:
        """The end of a task, however it came."""
        number = sent.task.number
        if self._sent.get(number) is not sent:
            return
        if future.status == "finished":
            del self._sent[number]
            self._outcomes.append(future.result())
            return
        error = future.exception() if future.status == "error" else None
        from distributed import KilledWorker

        if future.status == "error" and not isinstance(error, KilledWorker):
            del self._sent[number]
            text = f"task {number}: {type(error).__name__}: {error}"
            self._outcomes.append(Outcome(number, self._worker_name(sent.address), error=text))
        else:
            self._lose_worker(sent.address)

    def _lose_worker(self, address: str) -> None:
        """A worker is gone, or will be: its tasks are lost. Only one that was alone there is a suspect."""
        own = [sent for sent in self._sent.values() if sent.address == address]
        ended = [sent for sent in own if sent.ending is not None]
        who = self._worker_name(address)
        self._fitness.pop(address, None)
        for sent in own:
            del self._sent[sent.task.number]
            if sent.future is not None:
                sent.future.cancel(force=True)
            error = sent.ending or f"worker {who} died while it made task {sent.task.number}"
            is_suspect = sent in ended or (not ended and len(own) == 1 and sent.progressed is not None)
            suspects = sent.places if is_suspect else ()
            seconds = time.monotonic() - sent.sent
            lost = Outcome(sent.task.number, who, seconds=seconds, error=error, is_lost=True, suspects=suspects)
            self._outcomes.append(lost)

    def _worker_name(self, address: str) -> str:
        return self._fitness[address].name if address in self._fitness else address

    def _warn_shared_cards(self) -> None:
        """Several workers on one GPU take turns, which nobody meant."""
        cards = Counter(own.card for own in self._fit() if own.card)
        shared = [own for own in self._fit() if cards.get(own.card, 0) > 1]
        if shared:
            names = " and ".join(sorted(own.name for own in shared if own.card == shared[0].card)[:2])
            warn_user(f"{names} share one GPU; start each with a CUDA_VISIBLE_DEVICES of its own")


def _own_work() -> DaskWork:
    """What makes a sweep's tasks."""
    from ..make.work import run_task

    return run_task
