"""Ctrl-C between two chunks, and within a second also where native code hears no signal, as while kernels are compiled.

Otherwise Python may raise KeyboardInterrupt within a destructor, which swallows it: results give back their memory in
one, and that takes a good part of a rendering's time.
"""

import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

GRACE_SECONDS = 1.0
"""From Ctrl-C until a process that is in `abandonable` work is ended [s]."""

_is_interrupted = threading.Event()
_abandonable: list[int] = []  # threads in such work
_remembering: list[object] = []  # handlers of interrupt_between


@contextmanager
def interrupt_between() -> Iterator[Callable[[], None]]:
    """While active, SIGINT is remembered; the function that this gives raises it as KeyboardInterrupt, between chunks.

    A second SIGINT is raised at once. Off the main thread, and where the application handles SIGINT by itself, nothing
    changes.
    """
    is_remembered = False

    def remember(signum: int, frame: FrameType | None) -> None:
        nonlocal is_remembered
        if is_remembered:
            signal.default_int_handler(signum, frame)
        is_remembered = True

    def raise_if_remembered() -> None:
        if is_remembered:
            raise KeyboardInterrupt

    is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if threading.current_thread() is not threading.main_thread() or not is_default:
        yield raise_if_remembered
        return
    _remembering.append(remember)
    signal.signal(signal.SIGINT, remember)
    try:
        yield raise_if_remembered
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _remembering.remove(remember)


@contextmanager
def abandonable() -> Iterator[None]:
    """Work in native code that hears no signal, and that does no harm if the process ends in the middle of it.

    Raises KeyboardInterrupt instead of beginning while `ended_promptly` waits for such work.
    """
    if _is_interrupted.is_set():
        raise KeyboardInterrupt
    _abandonable.append(threading.get_ident())
    try:
        yield
    finally:
        _abandonable.remove(threading.get_ident())


@contextmanager
def ended_promptly(end: Callable[[], int]) -> Iterator[None]:
    """While active, SIGINT ends this process GRACE_SECONDS later if `abandonable` work is then under way in any thread.

    Python raises KeyboardInterrupt only when native code returns, so a thread of its own waits. A second signal does
    not wait. end: called before the process ends, to tell the user and to remove what is half written; gives the exit
    code. Off the main thread, where the application handles SIGINT by itself, and where another wake-up descriptor is
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
            if _read(reader, GRACE_SECONDS) == b"":
                return
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
    return os.read(reader, 64) if select.select([reader], [], [], timeout)[0] else None


def _raises_interrupt() -> bool:
    """Whether SIGINT ends what runs, now or between two chunks, and no handler of an application decides about it."""
    handler = signal.getsignal(signal.SIGINT)
    return handler is signal.default_int_handler or handler in _remembering
