"""What ends a worker of a sweep: no progress for too long, or too much memory."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

TASK_TIMEOUT = 600.0  # [s] of processor time without a sign of progress
WAITING_FACTOR = 8.0  # times the timeout, on the wall, for a worker that sleeps or waits for a lock or a network
STEP_LONGEST = 5.0  # [s] that two readings of an AwakeClock count at most: they are 0.5 s apart while the parent runs
MEMORY_SHARE = 0.8  # of the machine's memory, for all workers together
MEMORY_LEAST = 4 << 30  # [byte] of a worker by default: a large mesh takes so much
CGROUP_MEMORY = Path("/sys/fs/cgroup/memory.max")  # of a container


@dataclass(frozen=True)
class WorkerLimits:
    """What ends a worker."""

    timeout: float = TASK_TIMEOUT
    """Processor time [s] that it may take between two signs of progress, and WAITING_FACTOR times as long on the wall;
    0: no limit."""
    memory: int = 0
    """That its process may hold [byte]; 0: no limit."""


class AwakeClock:
    """Seconds during which this process ran: a suspended machine, or a process stopped by Ctrl-Z, counts STEP_LONGEST.

    Workers are suspended with their parent, so the time of a suspension is not time that they wasted.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._read = clock()
        self._seconds = 0.0

    def __call__(self) -> float:
        """Seconds since the clock was made [s]; it must be read more often than every STEP_LONGEST."""
        now = self._clock()
        self._seconds += min(max(0.0, now - self._read), STEP_LONGEST)
        self._read = now
        return self._seconds


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
