"""Memory that each process of a sweep may allocate."""

import os
from pathlib import Path

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
