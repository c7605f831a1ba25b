"""Real-time scheduling of the calling process, where the system permits it."""

from __future__ import annotations

import ctypes
import gc
import os
from typing import Final

WRITER_PRIORITY: Final = 20
SOURCE_PRIORITY: Final = 15
RENDERER_PRIORITY: Final = 10
"""Priorities of SCHED_FIFO, 1..99: the writer has the shortest work and the hardest deadline, so it goes first."""

_PR_SET_TIMERSLACK: Final = 29
_MCL_CURRENT, _MCL_FUTURE = 1, 2


def enter_realtime(priority: int, *, lock_memory: bool = False) -> bool:
    """Run this process before all ordinary ones, by SCHED_FIFO; True if the system permits it.

    The timer slack becomes 1 ns in any case: a sleep else ends up to 50 us late. Linux permits SCHED_FIFO to root, to
    processes with CAP_SYS_NICE, and up to the limit `rtprio` of /etc/security/limits.conf.

    Args:
        priority: 1..99.
        lock_memory: keep the process in memory, so that no page fault waits for a disk; a refusal is no error.
    """
    library = ctypes.CDLL(None)
    library.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    if lock_memory:
        library.mlockall(_MCL_CURRENT | _MCL_FUTURE)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError):  # AttributeError: a system without such scheduling
        return False
    return True


def stop_collecting() -> None:
    """Let the garbage collector look at nothing from here on: it stops a process for milliseconds."""
    gc.collect()
    gc.freeze()
    gc.disable()
