"""Executors that make units: this process, processes of this host, Dask, or any other of `concurrent.futures`.

| pool | a worker that dies | a unit that takes too long |
|---|---|---|
| `LocalPool`: this process while little is left, then as `ProcessPool` | - | - |
| `ProcessPool`: processes of this host, by loky | takes all with it; they start anew | all are ended, and start anew |
| `DaskPool`: `Client.get_executor()` | Dask starts another one | its worker is restarted, or else not used any more |
| `OtherPool`: any other executor | as it reports (`BrokenExecutor`) | its worker is not used any more |
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from enum import Enum
from pathlib import Path
from typing import Any, Protocol

from ...errors import PlanError, SweepError
from ...runtime.worker_devices import worker_devices
from ..make.unit import Unit, UnitResult

MEMORY_SHARE = 0.8  # of the machine's memory, for all workers together
MEMORY_LEAST = 4 << 30  # [byte] of a worker by default: a large mesh takes so much
CGROUP_MEMORY = Path("/sys/fs/cgroup/memory.max")  # of a container


def default_memory(worker_count: int) -> int:
    """Limit for each worker of this machine [byte]: an equal share, but MEMORY_LEAST if the machine has that."""
    total = MEMORY_SHARE * machine_memory()
    return int(min(total, max(MEMORY_LEAST, total / worker_count)))


def machine_memory() -> int:
    """Memory of this machine, or of the container that this process is in [byte]."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        text = CGROUP_MEMORY.read_text().strip()
    except OSError:
        return total
    return min(total, int(text)) if text.isdecimal() else total


SINGLE = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""Libraries that would take all cores in each worker; how many they take can also change the last bits of a sum."""
START_SECONDS = 3.0  # of work that is left for processes to be started: starting one takes 1 to 2 s
START_LONGEST = 120.0  # [s] for a process to start
PARENT_LOOK = 0.5  # [s] between two looks of a worker whether its parent lives
COUNT_SECONDS = 1.0  # between two counts of a cluster's workers
RESTART_LONGEST = 60.0  # [s] for a cluster's worker to come back


class Ended(Enum):
    """The result of ending a unit that takes too long."""

    LOST = "its worker was ended"
    STUCK = "its worker cannot be ended, and is not used any more"
    NOWHERE = "no worker has it"


class Pool(Protocol):
    """Workers of one executor, all for one device."""

    device: str
    """Warp's, or "auto" where workers find their own."""
    is_shared: bool
    """Whether the end of one worker ends all units of the pool."""

    @property
    def name(self) -> str:
        """For the report."""
        ...

    @property
    def is_spent(self) -> bool:
        """Whether all its workers are stuck for ever."""
        ...

    @property
    def capacity(self) -> int:
        """Units that it makes at a time."""
        ...

    @property
    def is_ready(self) -> bool:
        """Whether a worker has started: until then no unit takes time. Raises SweepError if none can start."""
        ...

    def submit(self, unit: Unit) -> Future[UnitResult]:
        """Have a unit made."""
        ...

    def is_lost(self, error: BaseException) -> bool:
        """Whether an error, of a future or of `submit`, says that a worker died or cannot be reached."""
        ...

    def end(self, future: Future[UnitResult]) -> Ended:
        """End the worker that makes a unit."""
        ...

    def restart(self) -> None:
        """Have new workers after one died, where the executor does not do that itself; SweepError if none can start."""
        ...

    def close(self) -> None:
        """End all workers that the pool has started, whatever they do."""
        ...


class OtherPool:
    """Workers of an executor that the caller has made, and closes. worker_count: None for as many as it has."""

    is_shared, is_ready = False, True

    def __init__(self, executor: Executor, device: str, worker_count: int | None = None) -> None:
        self.name, self.device = f"{type(executor).__name__}, on {device}", device
        self._executor = executor
        # The standard library's executors and loky's have it; there is no public name for the number.
        known = getattr(executor, "_max_workers", None)
        self._capacity = worker_count or (known if isinstance(known, int) else os.cpu_count() or 1)

    @property
    def capacity(self) -> int:
        """Units that it makes at a time."""
        return self._capacity

    def submit(self, unit: Unit) -> Future[UnitResult]:
        """Have a unit made."""
        return self._executor.submit(make_on, unit, self.device)

    def is_lost(self, error: BaseException) -> bool:
        """Whether a future's error says that the worker died."""
        return isinstance(error, BrokenExecutor | CancelledError)

    @property
    def is_spent(self) -> bool:
        """Whether all its workers are stuck for ever."""
        return self._capacity < 1

    def end(self, future: Future[UnitResult]) -> Ended:
        """Give a worker up: nothing ends it."""
        if future.cancel() or not future.running():
            return Ended.NOWHERE
        self._capacity -= 1
        return Ended.STUCK

    def restart(self) -> None:
        """Nothing can be started; a broken executor stays broken."""
        raise SweepError(f"{self.name} is broken, as one of its workers died: give run_sweep a new executor")

    def close(self) -> None:
        """Nothing: the caller closes it."""


class ProcessPool:
    """Processes of this host. memory: that each may allocate [byte], 0 for no limit; not of workers of a GPU."""

    is_shared, is_spent = True, False

    def __init__(self, device: str, worker_count: int, memory: int = 0) -> None:
        self.device, self._worker_count = device, worker_count
        self._memory = memory if device == "cpu" else 0  # a GPU's driver maps more than any machine has
        self._pool: Any = None
        self._starting: list[Future[None]] = []
        """One for each process, before all units."""
        self._started_at = 0.0
        self._failed_starts = 0

    @property
    def name(self) -> str:
        """For the report."""
        return f"{self._worker_count} process{'es' if self._worker_count > 1 else ''}, on {self.device}"

    @property
    def capacity(self) -> int:
        """Units that it makes at a time."""
        return self._worker_count

    @property
    def is_ready(self) -> bool:
        """Whether a process has started; raises SweepError if none does for START_LONGEST."""
        if any(own.done() and own.exception() is None for own in self._starting):
            return True
        if self._pool is not None and time.monotonic() > self._started_at + START_LONGEST:
            raise SweepError(f"{self.name}: no process has started in {START_LONGEST:.0f} s")
        return False

    def submit(self, unit: Unit) -> Future[UnitResult]:
        """Have a unit made; the processes start with the first."""
        from loky.process_executor import ProcessPoolExecutor

        if self._pool is None:
            # PYTHONSAFEPATH keeps modules of the current folder from being imported.
            environment = {**dict.fromkeys(SINGLE, "1"), **os.environ, "PYTHONSAFEPATH": "1"}
            given = (os.getpid(), self._memory)
            with _safe_path():
                self._pool = ProcessPoolExecutor(
                    self.capacity, timeout=None, initializer=start_worker, initargs=given, env=environment
                )
                self._starting = [self._pool.submit(start_only) for _ in range(self.capacity)]
            self._started_at = time.monotonic()
        return self._pool.submit(make_on, unit, self.device)

    def is_lost(self, error: BaseException) -> bool:
        """Whether an error says that a process died, or was ended with the pool."""
        return isinstance(error, BrokenExecutor | CancelledError) or type(error).__name__ == "ShutdownExecutorError"

    def end(self, future: Future[UnitResult]) -> Ended:
        """End all processes."""
        if not future.running():
            future.cancel()
            return Ended.NOWHERE
        self.close()
        return Ended.LOST

    def restart(self) -> None:
        """Start anew, with the next unit."""
        self._failed_starts = 0 if self.is_ready else self._failed_starts + 1
        if self._failed_starts > 1:
            reasons = [str(own.exception()) for own in self._starting if own.done() and own.exception() is not None]
            raise SweepError(f"{self.name}: no process can start: {' '.join(' '.join(reasons[:1]).split())}")
        self.close()

    def close(self) -> None:
        """End all processes, whatever they do."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True, kill_workers=True)


class LocalPool(ProcessPool):
    """This process while seconds of work are left, then processes of this host.

    Starting a process takes longer than making a few hundred poses. It is worth that for seconds of work, and for
    chunks that run Python: a stage that crashes, or never ends, must not take the sweep with it.

    seconds_left: of work, for one worker.
    """

    def __init__(self, worker_count: int, memory: int, seconds_left: Callable[[], float]) -> None:
        super().__init__("cpu", worker_count, memory)
        self._most, self._seconds_left = worker_count, seconds_left
        self._is_here = True

    @property
    def name(self) -> str:
        """For the report."""
        return f"in this process, on {self.device}" if self._is_here else super().name

    @property
    def capacity(self) -> int:
        """Units that it makes at a time."""
        return 1 if self._is_here else super().capacity

    def submit(self, unit: Unit) -> Future[UnitResult]:
        """Have a unit made, in this process before this returns."""
        from ...runtime.warp_start import start_warp
        from ..make.unit_making import make_unit, runs_python

        if self._is_here:
            start_warp()
            is_much = self._most > 1 and self._seconds_left() > START_SECONDS
            self._is_here = not (is_much or any(map(runs_python, unit.chunks)))
        if not self._is_here:
            return super().submit(unit)
        future: Future[UnitResult] = Future()
        future.set_result(make_unit(unit, self.device))
        return future


class DaskPool:
    """Workers of a Dask cluster. executor: from `Client.get_executor()`.

    Each unit is for one worker: so it is known which one has it, and Dask does not give a unit that ends its worker to
    others. One whose worker has left the cluster is cancelled.
    """

    is_shared, is_ready, is_spent = False, True, False

    def __init__(self, executor: Any, device: str) -> None:
        # An executor does not say whose it is, and only the client can restart a worker.
        self._executor, self._client = executor, executor._client
        self.name, self.device = f"Dask at {self._client.scheduler.address}, on {device}", device
        self._given: dict[Future[Any], str] = {}
        """Address of the worker of each unit."""
        self._starting: dict[str, Future[None]] = {}
        """By address of the worker."""
        self._stuck: set[str] = set()
        self._workers: list[str] = []
        self._counted = -COUNT_SECONDS

    @property
    def capacity(self) -> int:
        """Workers of the cluster that have started Warp, one unit each. They may come and go.

        Raises SweepError, naming the worker, for one that cannot start.
        """
        if (now := time.monotonic()) > self._counted + COUNT_SECONDS:
            self._counted = now
            try:
                there = [address for address in self._client.nthreads() if address not in self._stuck]
            except OSError as error:
                raise SweepError(f"{self.name}: its scheduler does not answer: {error}") from error
            for future in [future for future, address in self._given.items() if address not in there]:
                future.cancel()
            self._starting = {address: own for address, own in self._starting.items() if address in there}
            for address in there:
                if address not in self._starting:
                    self._starting[address] = self._submit(address, start_only)
            self._workers = [address for address in there if self._has_started(address)]
        return len(self._workers)

    def _has_started(self, address: str) -> bool:
        own = self._starting[address]
        if not own.done():
            return False
        error = None if own.cancelled() else own.exception()
        if error is not None and not self.is_lost(error):
            raise SweepError(f"{self.name}: worker {address} cannot make units: {type(error).__name__}: {error}")
        if own.cancelled() or error is not None:  # it died, and has come back
            del self._starting[address]
            return False
        return True

    def _submit(self, address: str, function: Callable[..., Any], *arguments: object) -> Future[Any]:
        return self._executor.submit(
            function,
            *arguments,
            key=f"palpate-{os.urandom(8).hex()}",
            pure=False,
            retries=0,
            workers=[address],
            allow_other_workers=False,
        )

    def submit(self, unit: Unit) -> Future[UnitResult]:
        """Have a unit made by a worker that has none."""
        busy = {address for future, address in self._given.items() if not future.done()}
        address = next((own for own in self._workers if own not in busy), self._workers[0])
        future = self._submit(address, make_on, unit, self.device)
        self._given[future] = address
        future.add_done_callback(lambda own: self._given.pop(own, None))
        return future

    def is_lost(self, error: BaseException) -> bool:
        """Whether a future's error says that the worker died, or that the cluster forgot the unit."""
        return isinstance(error, CancelledError | OSError) or type(error).__name__ == "KilledWorker"

    def end(self, future: Future[UnitResult]) -> Ended:
        """Restart the worker that makes a unit, by the client; one that cannot be restarted is not used any more."""
        address = self._given.get(future, "")
        future.cancel()
        self._counted = -COUNT_SECONDS
        if address not in self._client.nthreads():
            return Ended.NOWHERE
        self._starting.pop(address, None)
        try:
            outcome = self._client.restart_workers([address], timeout=RESTART_LONGEST, raise_for_error=False)
            if "timed out" not in outcome.values():
                return Ended.LOST
        except Exception:  # no nanny, no answer: whatever it is, the worker is not used any more
            pass
        self._stuck.add(address)
        return Ended.STUCK

    def restart(self) -> None:
        """Count workers again, as Dask starts another one."""
        self._counted = -COUNT_SECONDS

    def close(self) -> None:
        """Nothing: the caller closes the client."""


def pools_of(
    executor: Executor | None, devices: Sequence[str], memory: int, seconds_left: Callable[[], float]
) -> list[Pool]:
    """The pools for an executor of the caller's; without one, this process and processes of this host.

    devices: of each worker; of an executor of the caller's, one that every worker uses. memory: see `ProcessPool`.
    seconds_left: see `LocalPool`.
    """
    if executor is not None:
        is_dask = type(executor).__module__.startswith("distributed.")
        return [DaskPool(executor, devices[0]) if is_dask else OtherPool(executor, devices[0])]
    counts = {device: devices.count(device) for device in devices}
    if set(counts) == {"cpu"}:
        return [LocalPool(len(devices), memory, seconds_left)]
    return [ProcessPool(device, count, memory) for device, count in counts.items()]


def dask_executor(scheduler: str) -> Executor:
    """The executor of a Dask cluster. scheduler: its address, or its scheduler file.

    Raises PlanError where Dask is not installed, SweepError where nobody answers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise PlanError("--scheduler needs Dask: pip install -e '.[cluster]' in palpate's folder") from error
    given = {"scheduler_file": scheduler} if scheduler.endswith(".json") else {"address": scheduler}
    try:
        return Client(**given, set_as_default=False).get_executor(pure=False, retries=0)
    except Exception as error:  # a file that is missing, an address that nobody answers: Dask has many
        raise SweepError(f"no Dask scheduler at {scheduler}: {error}") from error


def make_on(unit: Unit, device: str) -> UnitResult:
    """Make a unit in a worker, which has Warp started. device: see `Pool.device`."""
    from ...runtime.warp_start import start_warp
    from ..make.unit_making import make_unit

    start_warp()
    return make_unit(unit, worker_devices(device, 1)[0])  # an error of all units where there is no such device


@contextlib.contextmanager
def _safe_path() -> Generator[None, None, None]:
    """Set PYTHONSAFEPATH in this process: the resource tracker that loky starts has this environment."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        del os.environ["PYTHONSAFEPATH"]
        if before is not None:
            os.environ["PYTHONSAFEPATH"] = before


def start_only() -> None:
    """Start Warp in a worker, and do nothing else."""
    from ...runtime.warp_start import start_warp

    start_warp()


def start_worker(parent: int, memory: int) -> None:
    """Prepare a process of a `ProcessPool`: it leaves Ctrl-C and standard output to its parent, and ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)  # a stage that prints must not disturb JSON on the command's standard output
    if memory:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, resource.getrlimit(resource.RLIMIT_DATA)[1]))

    def watch() -> None:
        # Not PR_SET_PDEATHSIG, which ends workers when the thread that started them ends, as in a notebook.
        while os.getppid() == parent:
            time.sleep(PARENT_LOOK)
        os._exit(0)

    threading.Thread(target=watch, name="palpate parent", daemon=True).start()
