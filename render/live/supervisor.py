"""One thread of the parent that hears all processes of a live run, and whatever else has a file descriptor."""

import os
import select
import threading
import time
from collections.abc import Callable

READ_BYTES = 1 << 18


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
        self._wake = os.eventfd(0, os.EFD_NONBLOCK)
        self._is_ending = False
        self._lock = threading.Lock()
        self.error: BaseException | None = None
        """What a function raised; it is not called again."""
        self._thread = threading.Thread(target=self._run, name="palpate-live", daemon=True)

    def __enter__(self) -> "Supervisor":
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._is_ending = True
        os.eventfd_write(self._wake, 1)
        self._thread.join()
        os.close(self._wake)

    def watch(self, descriptor: int, heard: Callable[[], object]) -> None:
        """Call a function in the thread whenever the descriptor can be read."""
        with self._lock:
            self._watched[descriptor] = heard
        os.eventfd_write(self._wake, 1)

    def forget(self, descriptor: int) -> None:
        """Watch it no more."""
        with self._lock:
            self._watched.pop(descriptor, None)

    def settle(self, timeout: float = 2.0) -> None:
        """Wait until all that can be read now has been heard, for `timeout` [s] at most."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            with self._lock:
                watched = list(self._watched)
            if not select.select(watched, [], [], 0)[0]:
                return
            time.sleep(1e-3)

    def _run(self) -> None:
        while not self._is_ending:
            with self._lock:
                watched = list(self._watched)
            ready, _, _ = select.select([self._wake, *watched], [], [])
            for descriptor in ready:
                if descriptor == self._wake:
                    os.eventfd_read(self._wake)
                    continue
                with self._lock:
                    heard = self._watched.get(descriptor)
                try:
                    goes_on = heard is not None and heard() is not False
                except BaseException as error:  # the thread lives on for the others; `error` says what happened
                    self.error = self.error or error
                    goes_on = False
                if not goes_on:
                    self.forget(descriptor)
