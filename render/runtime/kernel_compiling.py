"""Kernels compiled before they are needed: by a process beside a rendering, or at once and with Ctrl-C heard.

The process beside a rendering ends by itself, whatever happens to the one that renders:

| event                                   | result                                                               |
|-----------------------------------------|----------------------------------------------------------------------|
| Warp's cache has the kernels            | no process is started                                                |
| the rendering ends within DELAY         | the process ends, too, and has compiled nothing                      |
| the rendering ends later                | the module under way is finished; those after it are left            |
| Ctrl-C, an error, or a killed rendering | the same, and nobody waits for it                                    |
| a module cannot be compiled             | the process ends; the command that needs the module shows the error  |
"""

import atexit
import os
import select
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from types import TracebackType
from typing import Self

from ...kernels import compile_kernels, uncompiled
from .kernel_cache import is_temporary, remove_own_builds

DELAY = 1.5  # [s] of rendering before the process begins: shorter ones need no help, and are not slowed down
_NICENESS = 10  # the rendering goes first


class CompilingAhead:
    """While active, a process compiles kernels that a later command needs for the CPU, where the cache lacks them.

    Warp must have been started. Nothing is compiled into a temporary cache, which ends with this process.
    """

    def __init__(self, stages: tuple[str, ...]) -> None:
        self._stages = stages
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        missing = () if is_temporary() else uncompiled(self._stages)
        words = [sys.executable, "-P", "-m", __name__, *missing]  # -P: no module of the current folder is imported
        if missing:
            with suppress(OSError):  # the system allows no more processes: the later command compiles
                self._process = subprocess.Popen(
                    words,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,  # the terminal's SIGINT is not for it: it would break off a module
                )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Have the process end after the module under way."""
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()

    def wait(self, report: Callable[[int], object] | None = None) -> None:
        """Wait for the process to end: while active, until all is compiled; afterwards, for the module under way.

        report: called before, if there is something to wait for, with the number of modules that the cache lacks.
        """
        if self._process is None or self._process.poll() is not None:
            return
        if report is not None:
            report(len(uncompiled(self._stages)))
        self._process.wait()


def compile_now(stages: tuple[str, ...], device: str = "cpu") -> None:
    """Compile kernels that Warp's cache lacks for a device; Ctrl-C raises KeyboardInterrupt at once, as elsewhere.

    Native code hears no signal, so another thread compiles. After Ctrl-C it goes on until the process ends, which
    removes what is half compiled. It is one thread, since each translates the headers of Warp first: 1.4 s of CPU.
    """
    compiled: Future[None] = Future()

    def compile_all() -> None:
        try:
            for stage in stages:
                compile_kernels(device, (stage,))
            compiled.set_result(None)
        except BaseException as error:  # the calling thread raises it
            compiled.set_exception(error)

    threading.Thread(target=compile_all, name="palpate compiling", daemon=True).start()
    try:
        compiled.result()
    except KeyboardInterrupt:
        atexit.register(remove_own_builds)
        raise


def _is_asked_to_end(timeout: float) -> bool:
    """Whether the process that started this one has closed the pipe, or does so within a time [s]."""
    return bool(select.select([sys.stdin], [], [], timeout)[0])


def main(stages: list[str]) -> None:
    """Compile stages one after the other until the pipe at standard input closes."""
    if _is_asked_to_end(DELAY):
        return
    from .warp_start import start_warp  # a second, which a short rendering does without

    os.nice(_NICENESS)
    start_warp()
    for stage in stages:
        if _is_asked_to_end(0.0):
            return
        compile_kernels("cpu", (stage,))


if __name__ == "__main__":
    main(sys.argv[1:])
