"""One thread of the parent that hears all processes of a live run, and whatever else has a file descriptor."""

import os
import select
import threading
import time
from collections.abc import Callable


class Supervisor:
    """Calls functions when something can be read; each until it returns False.

    >>> import os, time
    >>> from palpate.render.live.supervisor import Supervisor
    >>> heard, (end, other) = [], os.pipe()
    >>> with Supervisor() as supervisor:
    ...     supervisor.watch(end, lambda: heard.append(os.read(end, 9)))  # None is no False
    ...     _ = os.write(other, b"pose")
    ...     time.sleep(0.1)
    >>> heard
    [b'pose']
    """

    def __init__(self) -> None:
        self._watched: dict[int, Callable[[], object]] = {}
        self._poll = select.epoll()  # `select` refuses descriptors from 1,024 on, and those that are closed meanwhile
        self._wake = os.eventfd(0, os.EFD_NONBLOCK)
        self._poll.register(self._wake, select.EPOLLIN)
        self._is_ending = False
        self._lock = threading.RLock()  # held while a function runs, so that nobody closes what it reads
        self.error: BaseException | None = None
        """What a function raised; it is not called again."""
        self._thread = threading.Thread(target=self._run, name="palpate-live", daemon=True)

    def __enter__(self) -> "Supervisor":
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._is_ending = True
        os.eventfd_write(self._wake, 1)
        if threading.current_thread() is not self._thread:  # a function may end what watches it
            self._thread.join()
            self._poll.close()
            os.close(self._wake)

    def watch(self, descriptor: int, heard: Callable[[], object]) -> None:
        """Call a function in the thread whenever the descriptor can be read."""
        with self._lock:
            self._watched[descriptor] = heard
            self._poll.register(descriptor, select.EPOLLIN)

    def forget(self, descriptor: int) -> None:
        """Watch it no more; it may be closed once this returns."""
        with self._lock:
            if self._watched.pop(descriptor, None) is not None:
                self._poll.unregister(descriptor)

    def settle(self, timeout: float = 2.0) -> None:
        """Wait until all that can be read now has been heard, for `timeout` [s] at most."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            with self._lock:
                poll = select.poll()
                for descriptor in self._watched:
                    poll.register(descriptor, select.POLLIN)
                if not poll.poll(0):
                    return
            time.sleep(1e-3)

    def _run(self) -> None:
        while not self._is_ending:
            for descriptor, _ in self._poll.poll():
                if descriptor == self._wake:
                    os.eventfd_read(self._wake)
                    continue
                with self._lock:
                    heard = self._watched.get(descriptor)  # None: forgotten since
                    try:
                        goes_on = heard is None or heard() is not False
                    except BaseException as error:  # the thread lives on for others; `error` says what happened
                        self.error = self.error or error
                        goes_on = False
                    if not goes_on:
                        self.forget(descriptor)
