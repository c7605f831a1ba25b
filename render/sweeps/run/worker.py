"""The worker's end of a sweep in several processes: tasks come through a socket, outcomes and progress go back.

| what happens to the worker              | what it does                                                               |
|-----------------------------------------|----------------------------------------------------------------------------|
| its parent ends, however, or closes     | ends at once, whatever it does: a thread listens while another works       |
| a task raises, or calls exit            | reports that, takes the next                                               |
| a task leaves its GPU out of order      | reports the task as lost, ends: in this process nothing works any more     |
| Ctrl-C on the terminal                  | nothing: its parent decides                                                |

Not by PR_SET_PDEATHSIG: that kills workers when the *thread* that started them ends, as in a notebook.
"""

import importlib
import os
import queue
import select
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NoReturn, Protocol

from ....datasets.errors import DatasetError
from ...errors import RenderError
from ..make.task import Outcome, Task, text_of
from .messages import Assignment, Done, Frames, Progress, Ready, Unfit, Warned, frame

PARENT_LOOK = 0.5  # [s]; how often a worker looks whether its parent lives, should a third process hold the socket open
OUTPUT_MOST = 2**20  # [byte] that a worker keeps of what is printed in it


class Work(Protocol):
    """Makes a task on a Warp device; `worker` is its name in sentences. Importable by its name."""

    def __call__(self, task: Task, device: str, /, *, worker: str, progress: Any) -> Outcome:
        """Make it, and show progress (`work.Progress`); what it raises becomes the outcome's error."""
        ...


class WorkerPort:
    """A worker's connection to its parent. A thread of its own receives what the parent sends, also during work."""

    def __init__(self, port: socket.socket, parent: int) -> None:
        self._port, self._parent = port, parent
        self._received: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._sending = threading.Lock()
        threading.Thread(target=self._listen, name="palpate sweep port", daemon=True).start()

    def take(self) -> Any:
        """The next message, waited for."""
        return self._received.get()

    def send(self, message: object) -> None:
        """Send to the parent; if there is none any more, end."""
        with self._sending:
            try:
                self._port.sendall(frame(message))
            except OSError:
                os._exit(0)

    def show_progress(self, places: Sequence[int] | None) -> None:
        """Report to the parent which chunks are begun, or that they go on."""
        self.send(Progress(None if places is None else tuple(places)))

    def _listen(self) -> NoReturn:
        frames, poll = Frames(), select.poll()
        poll.register(self._port, select.POLLIN)
        while True:
            try:
                arrived = self._port.recv(2**16) if poll.poll(PARENT_LOOK * 1e3) else None
            except OSError:  # the parent ended before it had read all that was sent
                arrived = b""
            if arrived == b"" or os.getppid() != self._parent:
                os._exit(0)  # nothing is tidied up: readers of the store know unfinished files
            for message in frames.take(arrived or b""):
                self._received.put(message)


def main(descriptor: int, parent: int) -> NoReturn:
    """Be a worker, for a parent at the other end of a socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    port = WorkerPort(socket.socket(fileno=descriptor), parent)
    assignment = port.take()
    try:
        work, device = prepare(assignment, port)
    except Exception as error:
        port.send(Unfit(f"{assignment.name}: {message_of(error)}"))
        os._exit(1)
    port.send(Ready(device))
    is_last = False
    while not is_last:
        task = port.take()
        outcome = attempt(work, task, device, assignment.name, port.show_progress)
        is_last = outcome.error is not None and not is_usable(device)
        if is_last:
            outcome = replace(outcome, is_lost=True, error=f"{outcome.error} (it left {device} unusable)")
        port.send(Done(outcome, is_last))
        forget_output()
    os._exit(1)  # tidying up would ask the GPU


def prepare(assignment: Assignment, port: WorkerPort) -> tuple[Work, str]:
    """Start Warp on the worker's device, and find what it is to do; raises what keeps it from that."""
    import warp as wp

    from ...runtime.span_workers import warp_device
    from ...runtime.warp_start import start_warp
    from ...terminal.console import SHOWN_WARNINGS

    for kind in SHOWN_WARNINGS:
        warnings.simplefilter("always", kind)
    otherwise = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        for kind in SHOWN_WARNINGS:
            if issubclass(category, kind):
                port.send(Warned(kind, str(message)))
                return
        otherwise(message, category, *place)

    warnings.showwarning = show
    start_warp()
    device = warp_device(assignment.device)
    wp.set_device(device)
    return find_work(assignment.work), device


def find_work(name: str) -> Work:
    """What `module:name` names."""
    module, _, inside = name.partition(":")
    found: Any = importlib.import_module(module)
    for part in inside.split("."):
        found = getattr(found, part)
    return found


def attempt(work: Work, task: Task, device: str, worker: str, progress: Any) -> Outcome:
    """The outcome of a task; whatever it raises is one sentence."""
    started = time.perf_counter()
    try:
        return work(task, device, worker=worker, progress=progress)
    except SystemExit as error:  # of a user's own function: no reason to end a sweep
        message = f"something in it called exit({error.code!r:.80})"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            raise  # of the terminal, in the command's own process; in a worker it is a user's function's own
        message = message_of(error)
    return Outcome(task.number, worker, seconds=time.perf_counter() - started, error=f"{worker}: {message}")


def message_of(error: BaseException) -> str:
    """An exception in a sentence."""
    words = text_of(error)
    return words if isinstance(error, (RenderError, DatasetError)) else f"{type(error).__name__}: {words}"


def is_usable(device: str) -> bool:
    """Whether Warp can still work on a device; on a GPU, nothing does after a fault in a kernel."""
    import warp as wp

    if wp.get_device(device).is_cpu:
        return True
    try:
        return wp.full(1, 7, dtype=wp.int32, device=device).numpy()[0] == 7
    except Exception:
        return False


def forget_output() -> None:
    """Keep what is printed in this process from growing without bound; the parent reads the end of it."""
    sys.stdout.flush()
    if os.fstat(2).st_size > OUTPUT_MOST:
        os.ftruncate(2, 0)
        os.lseek(2, 0, os.SEEK_SET)
