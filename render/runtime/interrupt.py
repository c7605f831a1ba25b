"""Ctrl-C between two chunks. Where Python raises it otherwise may be a destructor, and that swallows it: memory of
results is given back in one, which takes a good part of a rendering's time."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


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
        signal.signal(signal.SIGINT, remember)
    try:
        yield raise_if_seen
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
