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
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO, Any, Self

from ...errors import SweepError
from ..make.task import Running, Task
from .limits import AwakeClock
from .messages import Assignment, Frames, frame, worker_name

END_LONGEST = 0.5  # [s] for a worker to end by itself, which takes it milliseconds
KILL_LONGEST = 5.0  # [s] for the system to end what was killed; a GPU's memory is given back then
OUTPUT_SHOWN = 4096  # [byte] of what a worker printed last
SINGLE = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""Libraries that would take all cores in each worker; how many they take can also change the last bits of a sum."""
# Until it has the parent's path, -P keeps modules of the current folder from being imported.
MAIN = f"{__name__.removesuffix('worker_process')}worker"
BOOT = f"import sys; sys.path[:] = sys.argv[4:]; from {MAIN} import main; main(int(sys.argv[2]), int(sys.argv[3]))"


@dataclass(eq=False)
class WorkerProcess:
    """A process, its task, and what it has sent."""

    index: int
    device: str
    process: subprocess.Popen[bytes]
    port: socket.socket
    output: IO[bytes]
    """What it prints."""
    frames: Frames = field(default_factory=Frames)
    outgoing: bytearray = field(default_factory=bytearray)
    is_ready: bool = False
    is_leaving: bool = False
    """Whether it reported that it ends."""
    task: Task | None = None
    begun: float = 0.0
    """When it was given the task [s, `time.monotonic`]."""
    clock: AwakeClock = field(default_factory=AwakeClock)
    progressed: float = 0.0
    """When it last showed progress [s, `clock`]."""
    progressed_cpu: float = 0.0
    """Processor time that it had used then [s]."""
    places: tuple[int, ...] = ()
    """Chunks of the task that it is making."""
    ending: str | None = None
    """Why we killed it."""

    @classmethod
    def launch(cls, index: int, device: str, work: str) -> Self:
        """Start a process and send it its assignment; raises SweepError if the system has no room for one."""
        here, there = socket.socketpair()
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `end`
        command = [sys.executable, "-P", "-c", BOOT, f"palpate sweep worker {index} on {device}", str(there.fileno())]
        # Ctrl-C is for this process; blocked here, it is blocked there from the first instruction on.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            process = subprocess.Popen(
                [*command, str(os.getpid()), *sys.path],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                pass_fds=(there.fileno(),),
                env={**dict.fromkeys(SINGLE, "1"), **os.environ},
            )
        except OSError as error:
            here.close()
            output.close()
            raise SweepError(f"worker {index} ({device}) cannot be started: {error.strerror or error}") from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            there.close()
        here.setblocking(False)
        worker = cls(index, device, process, here, output)
        worker.send(Assignment(index, device, work))
        return worker

    @property
    def name(self) -> str:
        """In sentences, as it calls itself."""
        return worker_name(self.index, self.process.pid, self.device)

    @property
    def is_free(self) -> bool:
        """Whether it can be given a task."""
        return self.is_ready and not self.is_leaving and self.ending is None and self.task is None

    def give(self, task: Task) -> None:
        """Have it make a task."""
        self.task, self.begun, self.places = task, time.monotonic(), ()
        self.note_progress(None)
        self.send(task)

    def note_progress(self, places: tuple[int, ...] | None) -> None:
        """Take note of a sign of progress."""
        self.progressed, self.progressed_cpu = self.clock(), cpu_seconds(self.process.pid)
        if places is not None:
            self.places = places

    def running(self) -> Running:
        """How far it is with its task."""
        pid = self.process.pid
        used, waited = cpu_seconds(pid) - self.progressed_cpu, self.clock() - self.progressed
        return Running(time.monotonic() - self.begun, used, memory_bytes(pid), waited)

    def send(self, message: object) -> None:
        """Send it a message, as far as it listens; `flush` sends the rest."""
        self.outgoing += frame(message)
        self.flush()

    def flush(self) -> None:
        """Send as much as the socket takes now: a worker that does not listen must not stop us."""
        with contextlib.suppress(BlockingIOError):
            try:
                while self.outgoing:
                    del self.outgoing[: self.port.send(self.outgoing)]
            except (BrokenPipeError, ConnectionResetError):
                self.outgoing.clear()  # it is dead, which reading shows

    def messages(self) -> Iterator[Any]:
        """What it has sent by now; raises EOFError at the end of all that it will ever send."""
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

    def kill(self, why: str) -> None:
        """End it now; the rest follows as after any death."""
        self.ending = why
        self.process.kill()

    def ending_sentence(self) -> str:
        """How it ended; it has, or will within moments."""
        code = end_process(self.process, END_LONGEST)
        if self.ending is not None:
            return f"{self.name} was ended: {self.ending}"
        if code is None:
            text = "does not end, though it was killed"
        else:
            text = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        output = self._last_output(1 if self.is_ready else 5)
        return f"{self.name} {text}" + (f"; its last output: {output}" if output else "")

    def end(self, patience: float) -> None:
        """Close its socket, wait so long [s] for it to end by itself, then kill it. Nothing is left open."""
        self.port.close()
        end_process(self.process, patience)
        self.output.close()

    def _last_output(self, line_count: int) -> str:
        descriptor = self.output.fileno()
        start = max(0, os.fstat(descriptor).st_size - OUTPUT_SHOWN)
        text = os.pread(descriptor, OUTPUT_SHOWN, start).decode(errors="replace")  # a seek would move its end of file
        return "\n".join([line.strip("\0") for line in text.splitlines() if line.strip()][-line_count:])


def end_process(process: subprocess.Popen[bytes], patience: float) -> int | None:
    """Wait so long [s] for a process to end by itself, then kill it; its exit code, None if that cannot be done."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(patience)
    process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):  # the system itself may be stuck with it
        return process.wait(KILL_LONGEST)
    return None


def cpu_seconds(pid: int) -> float:
    """Processor time that a process has used [s]; 0 where the system has no /proc: only the wall's time counts then."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            fields = file.read().rpartition(b")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_bytes(pid: int) -> int:
    """Memory that a process holds, shared files left out [byte]; 0 where the system has no /proc."""
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            fields = file.read().split()
    except OSError:
        return 0
    return (int(fields[1]) - int(fields[2])) * os.sysconf("SC_PAGE_SIZE")
