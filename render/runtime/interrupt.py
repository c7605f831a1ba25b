"""Ctrl-C between two chunks, and within a second also where native code hears no signal, as while kernels are compiled.

Where Python raises KeyboardInterrupt otherwise may be a destructor, and that swallows it: memory of results is given
back in one, which takes a good part of a rendering's time.
"""

import os
import select
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

GRACE_SECONDS = 1.0
"""From Ctrl-C until a process that is in `abandonable` work is ended [s]."""

_READ_BYTES = 64  # signals read at once

_is_interrupted = threading.Event()
_changing = threading.Lock()
_abandonable: list[int] = []  # threads in such work
_remembering: list[object] = []  # handlers of interrupt_between


@contextmanager
def interrupt_between() -> Iterator[Callable[[], None]]:
    """While active, SIGINT is remembered; what this gives raises it as KeyboardInterrupt, where it can do no harm.

    A second SIGINT is raised at once. Off the main thread, and where the application handles SIGINT by itself, nothing
    changes.
    """
    seen = False

    def remember(signum: int, frame: FrameType | None) -> None:
        nonlocal seen
        if seen:
            signal.default_int_handler(signum, frame)
        seen = True

    def raise_if_seen() -> None:
        if seen:
            raise KeyboardInterrupt

    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if ours:
        _remembering.append(remember)
        signal.signal(signal.SIGINT, remember)
    try:
        yield raise_if_seen
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            _remembering.remove(remember)


@contextmanager
def abandonable() -> Iterator[None]:
    """Work in native code that answers no signal, and that may end with the process at any moment without harm.

    Raises KeyboardInterrupt instead of beginning while `ended_promptly` waits for such work.
    """
    if _is_interrupted.is_set():
        raise KeyboardInterrupt
    thread = threading.get_ident()
    with _changing:
        _abandonable.append(thread)
    try:
        yield
    finally:
        with _changing:
            _abandonable.remove(thread)


@contextmanager
def ended_promptly(end: Callable[[], int]) -> Iterator[None]:
    """While active, SIGINT ends this process GRACE_SECONDS later if `abandonable` work is then under way in any thread.

    Python raises KeyboardInterrupt only when native code returns, so a thread of its own waits. end: called before the
    process ends, to tell the user and to remove what is half written; gives the exit code. A second SIGINT does not
    wait. Off the main thread, where the application handles SIGINT by itself, and where another wake-up descriptor is
    set, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    before = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    if before != -1:
        signal.set_wakeup_fd(before)
    thread = threading.Thread(target=_watch, args=(reader, end), name="palpate Ctrl-C", daemon=True)
    thread.start()
    try:
        yield
    finally:
        if before == -1:
            signal.set_wakeup_fd(-1)
        os.close(writer)  # which the thread reads as the end
        thread.join()
        os.close(reader)


def _watch(reader: int, end: Callable[[], int]) -> None:
    while signals := _read(reader, None):
        if signal.SIGINT not in signals or not _raises_interrupt():
            continue
        _is_interrupted.set()
        try:
            deadline = time.monotonic() + GRACE_SECONDS
            while (left := deadline - time.monotonic()) > 0:
                if (signals := _read(reader, left)) == b"":
                    return
                if signals and signal.SIGINT in signals:
                    break
        finally:
            _is_interrupted.clear()
        if _abandonable and _raises_interrupt():
            code = 1
            try:
                code = end()
            finally:
                os._exit(code)


def _read(reader: int, timeout: float | None) -> bytes | None:
    """Signals that came within a time [s]; nothing at all at the end of the pipe; None if none came."""
    return os.read(reader, _READ_BYTES) if select.select([reader], [], [], timeout)[0] else None


def _raises_interrupt() -> bool:
    """Whether SIGINT ends what runs, now or between two chunks, and no handler of an application decides about it."""
    handler = signal.getsignal(signal.SIGINT)
    return handler is signal.default_int_handler or handler in _remembering
