"""Which Dask cluster makes a sweep's tasks: processes of this host, or one that is there already.

| scheduler                      | cluster                          | workers                     | device of each     |
|--------------------------------|----------------------------------|-----------------------------|--------------------|
| None, "local"                  | Dask's own, on 127.0.0.1         | one for each GPU, each core | one of those named |
| "tcp://host:port", "host:port" | one that runs; it stays          | at least so many must come  | the word, there    |
| "scheduler.json"               | the same; Dask's file has where  | the same                    | the word, there    |
| a Client (Python)              | the client's; it stays           | at least so many must come  | the word, there    |
"""

from __future__ import annotations

import importlib.util
import logging
import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import PlanError, StrategyError, SweepError
from ...user_warnings import warn_user

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 30.0  # [s] for a scheduler to answer, and workers to be there
SIGHT = 5.0  # [s] until a file that a worker has written must be seen here: network file systems remember
GRACE = 0.5  # [s] for workers of this host to go by themselves
HOST = "127.0.0.1"
ADDRESS = re.compile(r"^[\w.-]+:\d+$")
INSTALL = "sweeps on a cluster need Dask: pip install -e '.[cluster]' in palpate's folder"
COMPARED = ("python", "dask", "distributed", "msgpack", "cloudpickle")  # what must understand each other
SAFE_PATH = "PYTHONSAFEPATH"  # does what -P does
SILENT = logging.CRITICAL + 1


@dataclass(frozen=True)
class DaskConnection:
    """A cluster that is ours to use."""

    client: Any  # Dask's Client, which is typed for both its uses, waiting and not
    name: str
    device: str
    """The word that each worker finds its device by."""
    worker_count: int
    """Workers that must be there before anything begins."""
    patience: float
    """[s] that they may take, and that none may be there for later on."""
    cluster: Any = None
    """What we started, so what we close; None for a cluster that was there."""
    is_client_ours: bool = True
    restore: Callable[[], object] = lambda: None
    """Undoes what starting it has changed in this process."""

    def close(self) -> None:
        """Close what we started, whatever runs there; leave what we found."""
        if self.is_client_ours:
            self.client.close()
        if self.cluster is not None:
            _close_cluster(self.cluster)
        self.restore()


def connect_cluster(
    scheduler: str | Client | None, *, devices: str = "auto", workers: int | None = None, patience: float | None = None
) -> DaskConnection:
    """Start a cluster or find one; see the table above.

    Raises PlanError, a SweepError, for a missing extra, an unknown word, a device that this host lacks (local) or
    several of them (elsewhere), no workers; SweepError for a scheduler that does not answer within `patience` [s], and
    jobs that cannot be submitted.
    """
    try:
        import distributed
    except ImportError as error:
        raise PlanError(INSTALL) from error
    if workers is not None and workers < 1:
        raise PlanError(f"workers must be at least 1, not {workers}")
    if scheduler in (None, "local"):
        return _start_here(devices, workers, patience or PATIENCE)
    _require_one_device(devices)
    if isinstance(scheduler, distributed.Client):
        address = str(scheduler.scheduler_info()["address"])
        return DaskConnection(scheduler, address, devices, workers or 1, patience or PATIENCE, is_client_ours=False)
    require_scheduler(scheduler, devices=devices)
    return _find(scheduler, devices, workers or 1, patience or PATIENCE)


def require_scheduler(scheduler: str, *, devices: str = "auto") -> None:
    """Refuse what can be seen to be wrong of `connect_cluster`'s arguments before anything runs; raises PlanError."""
    if importlib.util.find_spec("distributed") is None:
        raise PlanError(INSTALL)
    if scheduler == "local":
        return
    _require_one_device(devices)
    if "://" not in scheduler and ADDRESS.match(scheduler) is None and not scheduler.endswith(".json"):
        raise PlanError(
            f"unknown scheduler {scheduler!r}; known: local, tcp://host:port, FILE.json (Dask's scheduler file). "
            "Kubernetes, SLURM and clouds: start their Dask cluster by their own package, and give its address"
        )


def _require_one_device(devices: str) -> None:
    if "," in devices:
        raise PlanError(f"a worker of a cluster has one device, so device {devices!r} cannot be; name one, or 'cuda'")


def _start_here(devices: str, workers: int | None, patience: float) -> DaskConnection:
    """A scheduler in this process, and a process for each GPU, or for each core."""
    from distributed import Nanny, Scheduler, SpecCluster

    names = _devices_here(devices)
    each = workers or (len(os.sched_getaffinity(0)) if names == ["cpu"] else 1)
    word = "cpu" if names == ["cpu"] else "cuda:0"  # each sees its own GPU only
    security = _new_keys()
    bound = {"host": HOST, "dashboard": False, "dashboard_address": f"{HOST}:0"}  # 0: any port that is free
    bound |= {"protocol": "tls://", "security": security}
    options = bound | {"nthreads": 1, "memory_limit": 0, "silence_logs": SILENT}
    options |= {"preload": f"{__package__}.dask_worker", "preload_argv": []}
    spec = {
        f"{name}-{number}": {"cls": Nanny, "options": options | {"env": _environment(name)}}
        for name in names
        for number in range(each)
    }
    # Tasks of workers that die are given out again by the schedule, not by Dask.
    ours = {"cls": Scheduler, "options": bound | {"port": 0, "allowed_failures": 0}}
    with ExitStack() as stack:
        stack.callback(_put_safe_path())
        cluster = SpecCluster(workers=spec, scheduler=ours, security=security, silence_logs=SILENT)
        client = _client(patience, address=cluster)
        return DaskConnection(client, "local", word, len(spec), patience, cluster, restore=stack.pop_all().close)


def _put_safe_path() -> Callable[[], object]:
    """Have all that this process starts from now on import nothing from the current folder; gives what undoes it.

    Python starts workers and what watches over their semaphores as `python -c`, to which no option can be given.
    """
    if os.environ.get(SAFE_PATH):
        return lambda: None
    os.environ[SAFE_PATH] = "1"
    return lambda: os.environ.pop(SAFE_PATH, None)


def _devices_here(devices: str) -> list[str]:
    """Devices of this host by the command line's words, all of one kind."""
    if devices == "cpu":  # Warp is not needed here then
        return ["cpu"]
    from ...runtime.warp_start import start_warp
    from ...runtime.worker_devices import worker_devices

    start_warp()
    try:
        names = worker_devices(devices, 1)
    except StrategyError as error:
        raise PlanError(str(error)) from error
    if "cpu" in names and len(names) > 1:
        raise PlanError(f"workers of a cluster are all of one kind, so device {devices!r} cannot be")
    return names


def _environment(name: str) -> dict[str, str]:
    """What makes a GPU the only one that a worker sees; ours may be hidden from us already."""
    if name == "cpu":
        return {"CUDA_VISIBLE_DEVICES": ""}
    visible = [word for word in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if word]
    index = int(name.removeprefix("cuda:"))
    return {"CUDA_VISIBLE_DEVICES": visible[index].strip() if visible else str(index)}


def _find(address: str, devices: str, workers: int, patience: float) -> DaskConnection:
    """A scheduler that runs already."""
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    try:
        client = _client(patience, **where)
    except (OSError, TimeoutError, ValueError, TypeError) as error:  # the last: tls:// without keys
        reason = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
        raise SweepError(f"no scheduler answers at {address} ({reason}); `dask scheduler` starts one") from error
    try:
        _compare_versions(client)
    except SweepError:
        client.close()
        raise
    return DaskConnection(client, address, devices, workers, patience)


def _new_keys() -> Any:
    """Keys for one cluster, kept in memory.

    Without them, whoever reaches the scheduler's or a worker's port runs code there, other users of this host too.
    """
    from distributed.security import Security

    try:
        return Security.temporary()
    except ImportError as error:
        raise PlanError(INSTALL) from error


def _close_cluster(cluster: Any) -> None:
    """Close it; workers of this host that have not gone then are ended: their nannies would wait for them."""
    closing = threading.Thread(target=cluster.close)
    closing.start()
    closing.join(GRACE)
    if closing.is_alive():
        for worker in cluster.workers.values():
            pid = getattr(worker, "pid", None)
            if isinstance(pid, int):
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
    closing.join()


def _client(patience: float, **where: Any) -> Any:
    """A client of ours; versions are compared in one sentence, not in Dask's table."""
    from distributed import Client
    from distributed.versions import VersionMismatchWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VersionMismatchWarning)
        return Client(timeout=patience, set_as_default=False, **where)


def _compare_versions(client: Any) -> None:
    """One sentence where Dask writes a table; code cannot travel between two Pythons, so that is an error."""
    versions = client.get_versions(check=False)
    mine = versions["client"]["packages"]
    others = {"its scheduler": versions["scheduler"]} | versions["workers"]
    theirs = {who: other["packages"] for who, other in others.items() if other}
    for who in versions["workers"].keys() & theirs.keys():
        if _minor(theirs[who]) != _minor(mine):
            raise SweepError(f"worker {who} has Python {_minor(theirs[who])}, this process {_minor(mine)}; take one")
    differing = sorted(
        f"{package} {packages.get(package)} of {who} ({mine.get(package)} here)"
        for who, packages in theirs.items()
        for package in COMPARED
        if packages.get(package) != mine.get(package)
    )
    if differing:
        more = f" and {len(differing) - 1} more" if len(differing) > 1 else ""
        warn_user(f"the cluster has other versions: {differing[0]}{more}")


def _minor(packages: dict[str, str]) -> str:
    """Python's version, its first two numbers."""
    return ".".join(packages["python"].split(".")[:2])


@contextmanager
def hushed_logs() -> Iterator[None]:
    """Without Dask's own log lines: what matters becomes an error or an outcome."""
    handlers = logging.getLogger("distributed").handlers
    levels = [handler.level for handler in handlers]
    for handler in handlers:
        handler.setLevel(SILENT)
    try:
        yield
    finally:
        for handler, level in zip(handlers, levels, strict=True):
            handler.setLevel(level)


def remove_token(token: Path) -> None:
    """Take our files out of the store."""
    for path in token.parent.glob(f"{token.name}*"):
        path.unlink(missing_ok=True)


def is_seen(answer: Path) -> bool:
    """Whether what a worker has written comes to be seen here."""
    until = time.monotonic() + SIGHT
    while not answer.exists():
        if time.monotonic() > until:
            return False
        time.sleep(0.1)
    return True


def end_process(client: Any, address: str) -> None:
    """End a worker's process, whatever it does; it may be gone already, by this or by itself."""
    from .dask_worker import end_worker, kill_worker

    with suppress(Exception):
        has_nanny = client.scheduler_info(n_workers=-1)["workers"][address]["nanny"]
        end = kill_worker if has_nanny else end_worker
        client.run(end, workers=[address], nanny=bool(has_nanny), on_error="ignore")
