"""Kernels compiled before they are needed, with Ctrl-C heard."""

import atexit
import threading
from concurrent.futures import Future

from ...kernels import compile_kernels
from .kernel_cache import remove_own_builds


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
