"""The worker's end of a sweep in several processes: tasks come through a socket, outcomes go back, nothing else does.

| what happens to the worker              | what it does                                                              |
|-----------------------------------------|---------------------------------------------------------------------------|
| its parent ends, however, or closes     | ends at once, whatever it is at: a thread listens while another works      |
| a task raises, or calls exit            | says so, takes the next                                                    |
| a task leaves its GPU out of order      | says that the task is lost, ends: in this process nothing works any more   |
| Ctrl-C on the terminal                  | nothing: its parent decides                                                |

Not by PR_SET_PDEATHSIG: that kills workers when the *thread* that started them ends, as in a notebook.
"""

import importlib
import os
import select
import signal
import socket
import sys
import threading
import time
import warnings
from collections import deque
from dataclasses import replace
from typing import Any, NoReturn, Protocol

from ....datasets.errors import DatasetError
from ...errors import RenderError
from ..make.task import Outcome, Task
from .messages import Assignment, Begun, Done, Frames, Ready, Return, Returned, Told, Unfit, frame

PARENT_LOOK = 0.5  # [s]; how often a worker looks whether its parent lives, should a third process hold the socket open
WORDS_MOST = 2**20  # [byte] that a worker keeps of what is printed in it


class Work(Protocol):
    """Makes a task on a Warp device; `worker` is its name in sentences. Importable by its name."""

    def __call__(self, task: Task, device: str, /, *, worker: str) -> Outcome:
        """Make it; what it raises becomes the outcome's error."""
        ...


class Wire:
    """A worker's way to its parent. What the parent says is heard by a thread of its own, also during work."""

    def __init__(self, port: socket.socket, parent: int) -> None:
        self._port, self._parent = port, parent
        self._sending = threading.Lock()
        self._changed = threading.Condition()
        self._waiting: deque[Any] = deque()
        threading.Thread(target=self._listen, name="palpate sweep wire", daemon=True).start()

    def take(self) -> Any:
        """The next thing to do, waited for."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting)
            return self._waiting.popleft()

    def send(self, message: object) -> None:
        """Tell the parent; if there is none any more, end."""
        with self._sending:
            try:
                self._port.sendall(frame(message))
            except OSError:
                os._exit(0)

    def _listen(self) -> NoReturn:
        frames, poll = Frames(), select.poll()
        poll.register(self._port, select.POLLIN)
        while True:
            arrived = self._port.recv(2**16) if poll.poll(PARENT_LOOK * 1e3) else None
            if arrived == b"" or os.getppid() != self._parent:
                os._exit(0)  # nothing is tidied up: who reads the store knows what an unfinished file is
            for message in frames.take(arrived or b""):
                self._hear(message)

    def _hear(self, message: object) -> None:
        with self._changed:
            if not isinstance(message, Return):
                self._waiting.append(message)
                self._changed.notify()
                return
            kept = [task for task in self._waiting if task.number != message.number]
            was_waiting = len(kept) < len(self._waiting)
            self._waiting = deque(kept)
        if was_waiting:
            self.send(Returned(message.number))


def main(descriptor: int, parent: int) -> NoReturn:
    """Be a worker, for a parent at the other end of a socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wire = Wire(socket.socket(fileno=descriptor), parent)
    assignment = wire.take()
    try:
        work = prepare(assignment, wire)
    except Exception as error:
        wire.send(Unfit(f"{assignment.name}: {said(error)}"))
        os._exit(1)
    wire.send(Ready())
    is_last = False
    while not is_last:
        task = wire.take()
        wire.send(Begun(task.number, time.monotonic()))
        outcome = attempt(work, task, assignment.device, assignment.name)
        is_last = outcome.error is not None and not is_usable(assignment.device)
        if is_last:
            outcome = replace(outcome, is_lost=True, error=f"{outcome.error} (it left {assignment.device} unusable)")
        wire.send(Done(outcome, is_last))
        forget_words()
    os._exit(1)  # tidying up would ask the GPU


def prepare(assignment: Assignment, wire: Wire) -> Work:
    """Start Warp on the worker's device, and find what it is to do; raises what keeps it from that."""
    import warp as wp

    from ....kernels import compile_kernels
    from ...runtime.span_workers import warp_device
    from ...terminal.console import SHOWN_WARNINGS, start_warp

    for kind in SHOWN_WARNINGS:
        warnings.simplefilter("always", kind)
    otherwise = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        for kind in SHOWN_WARNINGS:
            if issubclass(category, kind):
                wire.send(Told(kind, str(message)))
                return
        otherwise(message, category, *place)

    warnings.showwarning = show
    start_warp()
    device = warp_device(assignment.device)
    wp.set_device(device)
    if assignment.compiles:
        compile_kernels(device)
    return find_work(assignment.work)


def find_work(name: str) -> Work:
    """What `module:name` names."""
    module, _, inside = name.partition(":")
    found: Any = importlib.import_module(module)
    for part in inside.split("."):
        found = getattr(found, part)
    return found


def attempt(work: Work, task: Task, device: str, worker: str) -> Outcome:
    """What comes of a task; whatever it raises is one sentence, but KeyboardInterrupt."""
    started = time.perf_counter()
    try:
        return work(task, device, worker=worker)
    except SystemExit as error:  # of a user's own function: no reason to end a sweep
        sentence = f"something in it called exit({error.code!r})"
    except Exception as error:
        sentence = said(error)
    return Outcome(task.number, worker, seconds=time.perf_counter() - started, error=f"{worker}: {sentence}")


def said(error: BaseException) -> str:
    """An exception in a sentence."""
    return str(error) if isinstance(error, (RenderError, DatasetError)) else f"{type(error).__name__}: {error}"


def is_usable(device: str) -> bool:
    """Whether Warp can still work on a device; on a GPU, nothing does after a fault in a kernel."""
    import warp as wp

    if wp.get_device(device).is_cpu:
        return True
    try:
        return wp.full(1, 7, dtype=wp.int32, device=device).numpy()[0] == 7
    except Exception:
        return False


def forget_words() -> None:
    """Keep what is printed in this process from growing without bound; the parent reads the end of it."""
    sys.stdout.flush()
    if os.fstat(2).st_size > WORDS_MOST:
        os.ftruncate(2, 0)
        os.lseek(2, 0, os.SEEK_SET)
