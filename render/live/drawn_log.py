"""What the process that draws sends for a record: every pose that it took, every focal point that it drew."""

import os
import pickle
import select
import struct
import time
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

_HEAD = struct.Struct("<I")  # bytes of the record that follows
PIPE_BYTES = 1 << 20  # 1.6 s at 40 kHz, of which the reader may sleep
BACKLOG_MOST = 1 << 28  # [byte] that wait for a reader that is slower still


class LoggedPose(NamedTuple):
    """A pose that was taken."""

    first: int
    """Its first sample."""
    number: int
    stamp_ns: int
    """When the hand was there [ns]."""
    pose: np.ndarray
    """Hand frame -> array frame, float32, shape [7]."""
    patch_pose: np.ndarray | None


class LoggedPoints(NamedTuple):
    """Consecutive focal points."""

    first: int
    position: np.ndarray
    """[m], float32, shape [sample, 3], with several foci [sample, focus, 3]."""
    intensity: np.ndarray
    """As sampled, float32, shape [sample] or [sample, focus]."""
    gain: np.ndarray | None
    """What the person's intensity made of it, float32, shape [sample]; None: 1."""


class DrawnLog:
    """The end of a pipe that records are written to without ever waiting."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        os.set_blocking(descriptor, False)
        self._waiting: deque[memoryview] = deque()
        self._waiting_bytes = 0
        self._has_reader = True
        self.lost = 0
        """Records that the reader was too slow for."""

    def add(self, record: LoggedPose | LoggedPoints) -> None:
        """Send a record."""
        if self._waiting_bytes > BACKLOG_MOST or not self._has_reader:
            self.lost += 1
            return
        content = pickle.dumps((type(record) is LoggedPose, plain(record)), pickle.HIGHEST_PROTOCOL)
        self._waiting.append(memoryview(_HEAD.pack(len(content)) + content))
        self._waiting_bytes += len(self._waiting[-1])
        self.flush()

    def flush(self) -> None:
        """Write what waits, as far as there is room."""
        while self._waiting:
            try:
                sent = os.write(self._descriptor, self._waiting[0])
            except BlockingIOError:
                return
            except BrokenPipeError:  # nobody reads any more
                self._has_reader = False
                return
            self._waiting_bytes -= sent
            if sent < len(self._waiting[0]):
                self._waiting[0] = self._waiting[0][sent:]
                return
            self._waiting.popleft()

    def drain(self, timeout: float) -> None:
        """Write all that waits, for `timeout` [s] at most; what is left then is lost, and counted."""
        end = time.monotonic() + timeout
        poll = select.poll()
        poll.register(self._descriptor, select.POLLOUT)
        self.flush()
        while self._waiting and (left := end - time.monotonic()) > 0 and self._has_reader:
            poll.poll(left * 1e3)
            self.flush()
        self.lost += len(self._waiting)


class LogReader:
    """Puts together what comes out of the pipe in parts of any size."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> Iterator[LoggedPose | LoggedPoints]:
        """The records that these bytes complete."""
        self._data += data
        at = 0
        while len(self._data) - at >= _HEAD.size:
            stop = at + _HEAD.size + _HEAD.unpack_from(self._data, at)[0]
            if len(self._data) < stop:
                break
            is_pose, values = pickle.loads(self._data[at + _HEAD.size : stop])  # of this program's own process
            at = stop
            yield (LoggedPose if is_pose else LoggedPoints)(*restored(values))
        del self._data[:at]


def plain(values: Iterable[Any]) -> list[Any]:
    """Arrays as their types, shapes and bytes, which pickle in a tenth of the time; all else as it is."""
    return [(own.dtype.str, own.shape, own.tobytes()) if isinstance(own, np.ndarray) else own for own in values]


def restored(values: list[Any]) -> list[Any]:
    """The arrays that `plain` made of these, read-only."""
    return [np.frombuffer(own[2], own[0]).reshape(own[1]) if isinstance(own, tuple) else own for own in values]
