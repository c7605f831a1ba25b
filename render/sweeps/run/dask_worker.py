"""What a worker of a cluster does: shows once that it is fit for the sweep, then makes tasks. Small things go back.

The check runs on every worker before the first task, and at the first task of a worker that joins later.

| what a worker must bring       | how it is seen                                                                |
|--------------------------------|-------------------------------------------------------------------------------|
| the same code version          | `code_version()` gives the same                                               |
| the device that the plan names | Warp lists it                                                                 |
| the store, at the same path    | it reads the parent's token there, and writes an answer that the parent sees  |
| compiled kernels               | one process of a host compiles, under a lock beside Warp's cache; others wait |
"""

from __future__ import annotations

import fcntl
import os
import pickle
import platform
import signal
import threading
import time
import uuid
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...errors import SweepError
from ..make.task import Outcome, Task
from .worker import attempt, is_usable, said

LAST_WORDS = 0.5  # [s] for an event to leave a process that ends

Work = Callable[..., Outcome]
"""Makes a task: `work(task, device, worker=name)`, importable by name on every worker."""


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


_known: dict[str, Fitness] = {}  # by run: this process was judged already
_judging = threading.Lock()


def pack_task(task: Task, terms: Terms, work: Work) -> bytes:
    """A task as it travels: its recipes are much alike, so that it shrinks to a few kilobytes."""
    return zlib.compress(pickle.dumps((task, terms, work)), 1)


def make_task(packed: bytes) -> Outcome | Fitness:
    """Make a task on the worker that runs this; its `Fitness` instead if that worker is not fit."""
    from distributed import get_worker

    task, terms, work = pickle.loads(zlib.decompress(packed))
    worker = get_worker()
    fitness = judge_worker(terms, worker.address)
    if fitness.fault is not None:
        return fitness
    begun = {"number": task.number, "fitness": asdict(fitness)}
    worker.log_event(terms.run, begun)
    outcome = attempt(work, task, fitness.device, fitness.name)
    if outcome.error is not None and not is_usable(fitness.device):
        worker.log_event(terms.run, begun | {"words": f"{outcome.error} (it left {fitness.device} unusable)"})
        time.sleep(LAST_WORDS)
        os._exit(1)  # in this process nothing works any more; a nanny starts another
    return outcome


def kill_worker(dask_worker: Any) -> None:
    """Run by a nanny: end the process that it watches over, even one that answers nobody; it starts another."""
    os.kill(dask_worker.pid, signal.SIGKILL)


def end_process() -> None:
    """Run by a worker without a nanny: end it, whatever its threads do."""
    os._exit(1)


def judge_worker(terms: Terms, address: str) -> Fitness:
    """Whether this worker can do the work; judged once a process."""
    with _judging:
        if terms.run not in _known:
            _known[terms.run] = _judge(terms, partial(Fitness, address, platform.node()))
        return _known[terms.run]


def _judge(terms: Terms, fitness: Callable[..., Fitness]) -> Fitness:
    """Each claim in turn; the first that fails is the fault."""
    device = card = ""
    try:
        _check_maker(terms.maker)
        device, card = _find_device(terms.device)
        answer = _answer_token(terms)
        _compile_once(device)
    except Exception as error:  # whatever is wrong with that machine: the parent names it
        return fitness(device, card, fault=said(error))
    return fitness(device, card, answer)


def _check_maker(wanted: str) -> None:
    """Results of another version are other results."""
    from ..plan.code_version import code_version

    if code_version() != wanted:
        raise SweepError(f"it has {code_version()} where this sweep is made with {wanted}; install the same on both")


def _find_device(word: str) -> tuple[str, str]:
    """Warp's name of the device for the word, and which GPU that is."""
    import warp as wp

    from ...terminal.console import start_warp

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


def _compile_once(device: str) -> None:
    """Compile what renders, unless the cache has it."""
    from ....kernels import compile_kernels

    with _cache_lock():
        compile_kernels(device)


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


def answer_terms(packed: bytes, address: str) -> Fitness:
    """`judge_worker` for terms that travelled."""
    return judge_worker(pickle.loads(packed), address)


def travelling() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """What is sent instead of `make_task` and `answer_terms`.

    Both travel by value, and what they are given as bytes, so that a worker without palpate can still say so: they
    return what a `Fitness` is made of.
    """
    module = __name__

    def load(address: str) -> tuple[Any, tuple[str, ...]]:
        import importlib
        import platform

        try:
            return importlib.import_module(module), ()
        except ImportError as error:
            fault = f"it cannot import palpate ({error}); install the same there as here"
            return None, (address, platform.node(), "", "", "", fault)

    def make(packed: bytes) -> Any:
        from distributed import get_worker

        palpate, fault = load(get_worker().address)
        return palpate.make_task(packed) if palpate else fault

    async def judge(packed: bytes, dask_worker: Any) -> Any:
        import asyncio

        address = dask_worker.address  # on a thread: a worker that compiles still answers its scheduler
        palpate, fault = await asyncio.to_thread(load, address)
        return await asyncio.to_thread(palpate.answer_terms, packed, address) if palpate else fault

    return make, judge


def dask_setup(worker: Any) -> None:
    """Preloaded by workers of this host: Ctrl-C reaches them, too, but the parent ends them in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
