"""Signals that end a process: while something plays, they switch the array off first."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Final, Protocol, Self, TypeVar

T = TypeVar("T")

_STOP_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


_ended_by: list[str] = []
"""The signal that `end_process` has handled, while `ending_on_signals` is active."""


def end_process(signum: int, frame: FrameType | None) -> None:
    """Handler for a program that the first signal ends: it raises KeyboardInterrupt, and later signals are ignored.

    A second signal would else meet the program while it closes the array, or the interpreter while it ends. Where a
    playback is under way the first signal stops that, by `StopSignals`, with the same effect on later ones. Python
    swallows the exception where it meets a destructor, as 1 of 1,260 starts did: then the next playback does not begin.
    """
    _ended_by.append(signal.Signals(signum).name)
    for each in _STOP_SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt(signal.Signals(signum).name)


@contextmanager
def ending_on_signals() -> Generator[None]:
    """While active, `end_process` handles SIGINT, SIGTERM and SIGHUP, but for those that were ignored (nohup, `&`).

    After a signal they stay ignored: the process ends. Away from the main thread, which alone may set handlers, nothing
    happens.
    """
    previous: dict[int, object] = {}
    if threading.current_thread() is threading.main_thread():
        for signum in _STOP_SIGNALS:
            if signal.getsignal(signum) != signal.SIG_IGN:
                previous[signum] = signal.signal(signum, end_process)
    try:
        yield
    finally:
        _ended_by.clear()
        for signum, handler in previous.items():
            if signal.getsignal(signum) is end_process:
                _restore(signum, handler)


def _restore(signum: int, handler: object) -> None:
    # None: it was not installed from Python, and cannot be put back
    signal.signal(signum, signal.SIG_DFL if handler is None else handler)  # pyright: ignore[reportArgumentType]  # what signal.signal gave


class Stoppable(Protocol):
    """What plays."""

    def request_stop(self, reason: str) -> None:
        """Stop as soon as possible; called in a signal handler."""
        ...


class _Interrupted(BaseException):
    """Breaks off the making of blocks; never leaves this module."""


class StopSignals:
    """While active: the signals that end a process stop what plays instead, and break off the making of blocks.

    The handler only sets attributes: a lock it took could be held by the very code it interrupts. It raises only
    where code of the caller's runs, which may take arbitrarily long; this package's own loops look at what plays.
    """

    def __init__(self, target: Stoppable, *, enabled: bool) -> None:
        self.signum: int | None = None
        self._target = target
        self._enabled = enabled and threading.current_thread() is threading.main_thread()
        self._breakable = False
        self._previous: dict[int, object] = {}

    def __enter__(self) -> Self:
        if self._enabled and _ended_by:
            raise KeyboardInterrupt(_ended_by[0])
        for signum in _STOP_SIGNALS if self._enabled else ():
            if signal.getsignal(signum) == signal.SIG_IGN:
                continue  # whoever started this process wants it so: nohup, or a shell's `&`
            self._previous[signum] = signal.signal(signum, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for signum, handler in self._previous.items():
            if self.signum is not None and handler is end_process:
                handler = signal.SIG_IGN  # it ends already
            _restore(signum, handler)

    def iterate(self, blocks: Iterable[T]) -> Iterator[T]:
        """The blocks, until a signal comes."""
        try:
            self._breakable = True
            source = iter(blocks)
            self._breakable = False
            while self.signum is None:
                self._breakable = True
                block = next(source)
                self._breakable = False
                yield block
        except (StopIteration, _Interrupted):
            return
        finally:
            self._breakable = False

    def _handle(self, signum: int, frame: FrameType | None) -> None:
        if self.signum is not None:
            return
        self.signum = signum
        self._target.request_stop(signal.Signals(signum).name)
        if self._breakable:
            self._breakable = False
            raise _Interrupted
