"""What a worker of a Dask cluster does: shows once that it is fit for the sweep, then makes tasks.

A plugin of Dask's makes each worker show that, also one that joins later.

| what a worker must have        | how it is seen                                                                |
|--------------------------------|-------------------------------------------------------------------------------|
| the same code version          | `code_version()` gives the same                                               |
| the device that the plan names | Warp lists it                                                                 |
| the store, at the same path    | it reads the parent's token there, and writes an answer that the parent sees  |
| compiled kernels               | one process of a host compiles, under a lock beside Warp's cache; others wait |
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import pickle
import platform
import signal
import threading
import time
import uuid
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

from distributed import WorkerPlugin, get_worker

from ...errors import SweepError
from ..make.task import Outcome, Task
from ..plan.code_version import code_version
from .worker import attempt, is_usable, message_of

LAST_EVENT = 0.5  # [s] for an event to leave a process that ends
PROGRESS_SECONDS = 1.0  # between two signs of progress that are sent, unless other chunks are begun
WATCH_SECONDS = 5.0  # between two reports of a task that shows no progress

DaskWork = Callable[..., Outcome]
"""Makes a task: `work(task, device, worker=name, progress=function)`, importable by name on every worker."""


@dataclass(frozen=True)
class Terms:
    """What the parent asks of every worker."""

    run: str
    """Of this engine: the topic of its events, and what its token holds."""
    maker: str
    device: str
    """Warp's word, or "auto" or "cuda": the first that the worker sees."""
    token: str
    """Path of a file that the parent has written into the store."""


@dataclass(frozen=True)
class Fitness:
    """What a worker showed."""

    address: str
    host: str
    threads: int = 1
    """Tasks that it makes at a time."""
    device: str = ""
    card: str = ""
    """Which GPU it is, whatever the worker calls it; empty for a CPU."""
    answer: str = ""
    """Name of the file that it wrote beside the token."""
    fault: str | None = None
    """Why it cannot do the work; None if it can."""

    @property
    def name(self) -> str:
        """The worker for people, and in the log."""
        return f"{self.address} on {self.host}" + (f" ({self.device})" if self.device else "")

    @property
    def complaint(self) -> str:
        """The fault, and whose it is."""
        return f"worker {self.name}: {self.fault}"


class SweepPlugin(WorkerPlugin):
    """Has each worker of a cluster show whether it is fit, in an event of the run's topic."""

    def __init__(self, terms: Terms) -> None:
        self.name = terms.run
        self._terms = terms

    async def setup(self, worker: Any) -> None:
        """On a thread: a worker that compiles still answers its scheduler."""
        first = partial(Fitness, worker.address, platform.node(), worker.state.nthreads)
        fitness = await asyncio.to_thread(_show_fitness, self._terms, first)
        _fitness[self._terms.run] = fitness
        worker.log_event(self._terms.run, {"fitness": asdict(fitness)})


_fitness: dict[str, Fitness] = {}
"""Of this process, by run."""


def pack_task(task: Task, run: str, work: DaskWork) -> bytes:
    """A task as it travels: its recipes are much alike, so that it shrinks to a few kilobytes."""
    return zlib.compress(pickle.dumps((task, run, work)), 1)


def make_task(packed: bytes) -> Outcome:
    """Make a task on the worker that runs this."""
    task, run, work = pickle.loads(zlib.decompress(packed))
    worker, fitness = get_worker(), _fitness[run]
    with _Progress(worker, run, task.number) as progress:
        outcome = attempt(work, task, fitness.device, fitness.name, progress)
    if outcome.error is not None and not is_usable(fitness.device):
        message = f"{outcome.error} (it left {fitness.device} unusable)"
        worker.log_event(run, {"number": task.number, "ending": message})
        time.sleep(LAST_EVENT)
        os._exit(1)  # in this process nothing works any more; a nanny starts another
    return outcome


class _Progress:
    """Events of a task: signs of progress, and the processor time that its thread uses without any."""

    def __init__(self, worker: Any, run: str, number: int) -> None:
        self._worker, self._run, self._number = worker, run, number
        self._clock = time.pthread_getcpuclockid(threading.get_ident())
        self._progressed = time.clock_gettime(self._clock)
        self._sent = time.monotonic()
        self._is_over = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="palpate progress", daemon=True)

    def __enter__(self) -> Self:
        self(())
        self._watcher.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._is_over.set()
        self._watcher.join()

    def __call__(self, places: Sequence[int] | None) -> None:
        self._progressed = time.clock_gettime(self._clock)
        if places is not None or time.monotonic() - self._sent >= PROGRESS_SECONDS:
            self._send({"places": None if places is None else list(places)})

    def _watch(self) -> None:
        while not self._is_over.wait(WATCH_SECONDS):
            self._send({"used": time.clock_gettime(self._clock) - self._progressed})

    def _send(self, event: dict[str, Any]) -> None:
        self._sent = time.monotonic()
        self._worker.log_event(self._run, {"number": self._number, **event})


def kill_worker(dask_worker: Any) -> None:
    """Run by a nanny: end the process that it watches over, even one that answers nobody; it starts another."""
    os.kill(dask_worker.pid, signal.SIGKILL)


def end_worker() -> None:
    """Run by a worker without a nanny: end it, whatever its threads do."""
    os._exit(1)


def _show_fitness(terms: Terms, fitness: Callable[..., Fitness]) -> Fitness:
    """Each claim in turn; the first that fails is the fault."""
    device = card = ""
    try:
        from ....kernels import compile_kernels

        if (own := code_version()) != terms.maker:  # results of another version are other results
            raise SweepError(f"it has {own} where this sweep is made with {terms.maker}; install the same on both")
        device, card = _find_device(terms.device)
        answer = _answer_token(terms)
        with _compiling, _cache_lock():  # what renders, unless the cache has it
            compile_kernels(device)
    except Exception as error:  # whatever is wrong with that machine: the parent names it
        return fitness(device, card, fault=message_of(error))
    return fitness(device, card, answer)


def _find_device(word: str) -> tuple[str, str]:
    """Warp's name of the device for the word, and which GPU that is."""
    import warp as wp

    from ...runtime.warp_start import start_warp

    start_warp()
    gpus = [str(gpu) for gpu in wp.get_cuda_devices()]
    name = {"auto": (gpus or ["cpu"])[0], "cuda": (gpus or ["cuda"])[0]}.get(word, word)
    there = [str(device) for device in wp.get_devices()]
    if name not in there:
        raise SweepError(f"no device {name!r} there; there is: {', '.join(there)}")
    device = wp.get_device(name)
    return name, str(device.uuid) if device.is_cuda else ""


def _answer_token(terms: Terms) -> str:
    """Read the token, and write an answer beside it; the answer's name."""
    token = Path(terms.token)
    try:
        seen = token.read_text() == terms.run
    except OSError as error:
        raise SweepError(f"it does not see the store {token.parent}: {error.strerror}") from error
    if not seen:
        raise SweepError(f"another folder than the parent's is at {token.parent} there")
    answer = token.with_name(f"{token.name}-{uuid.uuid4().hex}")
    try:
        answer.write_text(terms.run)
    except OSError as error:
        with suppress(OSError):  # nor can it be removed where nothing can be written
            answer.unlink(missing_ok=True)
        raise SweepError(f"it cannot write into the store {token.parent}: {error.strerror}") from error
    return answer.name


_compiling = threading.Lock()


@contextmanager
def _cache_lock() -> Iterator[None]:
    """One process at a time, of all that share Warp's cache; where nothing can be locked, Warp's renames must do."""
    import warp as wp

    folder = Path(wp.config.kernel_cache_dir)
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "palpate.lock", "w") as lock:
        with suppress(OSError):  # some network file systems have no locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def dask_setup(worker: Any) -> None:
    """Preloaded by workers of this host: Ctrl-C reaches them, too, but the parent ends them in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
