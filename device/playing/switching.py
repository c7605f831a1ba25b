"""How fast threads of this process take turns, while something plays."""

from __future__ import annotations

import sys
import threading
from types import TracebackType
from typing import Final

SWITCH_INTERVAL: Final = 5e-4  # [s]


class PromptThreads:
    """While active, a thread that wants the interpreter's lock gets it after 0.5 ms instead of 5.

    The writer of a playback wants it once in the 5 ms of frames of a transfer or oftener, whatever else computes in
    the process. Several may be active at once; the last one restores what was before the first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._active = 0
        self._before = 0.0

    def __enter__(self) -> None:
        with self._lock:
            self._active += 1
            if self._active == 1:
                self._before = sys.getswitchinterval()
                sys.setswitchinterval(min(self._before, SWITCH_INTERVAL))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with self._lock:
            self._active -= 1
            if self._active == 0:
                sys.setswitchinterval(self._before)


PROMPT_THREADS: Final = PromptThreads()
