"""A worker of a sweep as its parent sees it: an interpreter with a socket and a device (worker.py is its end).

Not the standard library's `spawn`, which runs the user's script once more in every worker.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO, Any, Self

from ...errors import SweepError
from ..make.task import Task
from . import worker
from .messages import Assignment, Frames, frame, worker_name

END_LONGEST = 0.5  # [s] for a worker to end by itself, which takes it milliseconds
KILL_LONGEST = 5.0  # [s] for the system to end what was killed; a GPU's memory is given back then
WORDS_TOLD = 4096  # [byte] of what a worker printed last
SINGLE = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""Libraries that would take all cores in each worker; how many they take can also change the last bits of a sum."""
# Until it has the parent's path, -P keeps modules of the current folder from being imported.
BOOT = (
    "import sys; sys.path[:] = sys.argv[4:]; "
    f"from {worker.__name__} import main; main(int(sys.argv[2]), int(sys.argv[3]))"
)


@dataclass(eq=False)
class WorkerProcess:
    """A process, what was sent to it, and what it has said."""

    index: int
    device: str
    process: subprocess.Popen[bytes]
    port: socket.socket
    words: IO[bytes]
    """What it prints."""
    frames: Frames = field(default_factory=Frames)
    outgoing: bytearray = field(default_factory=bytearray)
    is_ready: bool = False
    is_leaving: bool = False
    """Whether it said that it ends."""
    begun: Task | None = None
    since: float = 0.0
    """When that was [s], of `time.monotonic`."""
    handed: deque[Task] = field(default_factory=deque)
    """Sent, and not begun as far as we know."""
    asked: set[int] = field(default_factory=set)
    """Which of these it was asked to give back."""
    dropped: set[int] = field(default_factory=set)
    """Tasks whose outcome nobody waits for any more."""
    ending: str | None = None
    """Why we killed it."""

    @classmethod
    def launch(cls, index: int, device: str, work: str, *, compiles: bool) -> Self:
        """Start a process and tell it what it is; raises SweepError if the system has no room for one."""
        here, there = socket.socketpair()
        words = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `end`
        command = [sys.executable, "-P", "-c", BOOT, f"palpate sweep worker {index} on {device}", str(there.fileno())]
        # Ctrl-C is for this process; blocked here, it is blocked there from the first instruction on.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            process = subprocess.Popen(
                [*command, str(os.getpid()), *sys.path],
                stdin=subprocess.DEVNULL,
                stdout=words,
                stderr=words,
                pass_fds=(there.fileno(),),
                env={**dict.fromkeys(SINGLE, "1"), **os.environ},
            )
        except OSError as error:
            here.close()
            words.close()
            raise SweepError(f"worker {index} ({device}) cannot be started: {error.strerror or error}") from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            there.close()
        here.setblocking(False)
        worker = cls(index, device, process, here, words)
        worker.send(Assignment(index, device, work, compiles))
        return worker

    @property
    def name(self) -> str:
        """In sentences, as it calls itself."""
        return worker_name(self.index, self.process.pid, self.device)

    @property
    def load(self) -> int:
        """Tasks it has."""
        return len(self.handed) + (self.begun is not None)

    @property
    def takes_tasks(self) -> bool:
        """Whether it can be given one."""
        return self.is_ready and not self.is_leaving and self.ending is None

    def send(self, message: object) -> None:
        """Tell it something, as far as it listens; `flush` sends the rest."""
        self.outgoing += frame(message)
        self.flush()

    def flush(self) -> None:
        """Send as much as the socket takes now: a worker that does not listen must not stop us."""
        with contextlib.suppress(BlockingIOError):
            try:
                while self.outgoing:
                    del self.outgoing[: self.port.send(self.outgoing)]
            except (BrokenPipeError, ConnectionResetError):
                self.outgoing.clear()  # it is dead, as reading will tell

    def messages(self) -> Iterator[Any]:
        """What it has said by now; raises EOFError at the end of all that it will ever say."""
        with contextlib.suppress(BlockingIOError, ConnectionResetError):
            while arrived := self.port.recv(2**16):
                yield from self.frames.take(arrived)
        try:
            if not self.port.recv(1, socket.MSG_PEEK):
                raise EOFError
        except BlockingIOError:
            pass
        except ConnectionResetError as error:
            raise EOFError from error

    def taken(self, number: int) -> Task:
        """A task it was handed, which it does not hold in advance any more."""
        task = next(task for task in self.handed if task.number == number)
        self.handed.remove(task)
        self.asked.discard(number)
        return task

    def kill(self, why: str) -> None:
        """End it now; the rest is heard of as of any death."""
        self.ending = why
        self.process.kill()

    def told_of_end(self) -> str:
        """How it ended, in a sentence; it has, or will within moments."""
        code = end_process(self.process, END_LONGEST)
        if self.ending is not None:
            return f"{self.name} {self.ending}"
        if code is None:
            told = "does not end, though it was killed"
        else:
            told = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        words = self._last_words(1 if self.is_ready else 5)
        return f"{self.name} {told}" + (f"; its last words: {words}" if words else "")

    def end(self, patience: float) -> None:
        """Close its socket, wait so long [s] for it to end by itself, then kill it. Nothing is left open."""
        self.port.close()
        end_process(self.process, patience)
        self.words.close()

    def _last_words(self, line_count: int) -> str:
        descriptor = self.words.fileno()
        start = max(0, os.fstat(descriptor).st_size - WORDS_TOLD)
        text = os.pread(descriptor, WORDS_TOLD, start).decode(errors="replace")  # a seek would move its end of the file
        return "\n".join([line.strip("\0") for line in text.splitlines() if line.strip()][-line_count:])


def end_process(process: subprocess.Popen[bytes], patience: float) -> int | None:
    """Wait so long [s] for a process to end by itself, then kill it; its exit code, None if that cannot be done."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(patience)
    process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):  # the system itself may be stuck with it
        return process.wait(KILL_LONGEST)
    return None
