"""What the process that draws sends for a record: every pose that it took, every focal point that it drew."""

import os
import select
import struct
import time
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

_HEAD = struct.Struct("<cI")
_POSE = struct.Struct("<qqqI")  # first sample, pose number, stamp, patches
_POINTS = struct.Struct("<qIIB")  # first sample, count, foci, whether a gain follows
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
    """[m], float32, shape [sample, foci, 3]."""
    intensity: np.ndarray
    """As sampled, float32, shape [sample, foci]."""
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

    def add_pose(self, pose: LoggedPose) -> None:
        """Send a pose."""
        patches = b"" if pose.patch_pose is None else np.ascontiguousarray(pose.patch_pose, "<f4").tobytes()
        head = _POSE.pack(pose.first, pose.number, pose.stamp_ns, len(patches) // 28)
        self._add(b"P", head + np.ascontiguousarray(pose.pose, "<f4").tobytes() + patches)

    def add_points(self, points: LoggedPoints) -> None:
        """Send focal points."""
        count = len(points.intensity)
        foci = points.intensity.size // max(count, 1)
        arrays = [points.position, points.intensity] + ([] if points.gain is None else [points.gain])
        head = _POINTS.pack(points.first, count, foci, points.gain is not None)
        self._add(b"S", head + b"".join(np.ascontiguousarray(array, "<f4").tobytes() for array in arrays))

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

    def _add(self, kind: bytes, body: bytes) -> None:
        if self._waiting_bytes > BACKLOG_MOST or not self._has_reader:
            self.lost += 1
            return
        self._waiting.append(memoryview(_HEAD.pack(kind, len(body)) + body))
        self._waiting_bytes += _HEAD.size + len(body)
        self.flush()


class LogReader:
    """Puts together what comes out of the pipe in parts of any size."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> Iterator[LoggedPose | LoggedPoints]:
        """The records that these bytes complete."""
        self._data += data
        at = 0
        while len(self._data) - at >= _HEAD.size:
            kind, size = _HEAD.unpack_from(self._data, at)
            if len(self._data) - at - _HEAD.size < size:
                break
            body = bytes(self._data[at + _HEAD.size : at + _HEAD.size + size])
            at += _HEAD.size + size
            yield _pose_of(body) if kind == b"P" else _points_of(body)
        del self._data[:at]


def _pose_of(body: bytes) -> LoggedPose:
    first, number, stamp_ns, patches = _POSE.unpack_from(body)
    values = np.frombuffer(body, "<f4", offset=_POSE.size)
    return LoggedPose(first, number, stamp_ns, values[:7], values[7:].reshape(patches, 7) if patches else None)


def _points_of(body: bytes) -> LoggedPoints:
    first, count, foci, has_gain = _POINTS.unpack_from(body)
    values, row = np.frombuffer(body, "<f4", offset=_POINTS.size), count * foci
    position, intensity = values[: 3 * row].reshape(count, foci, 3), values[3 * row : 4 * row].reshape(count, foci)
    return LoggedPoints(first, position, intensity, values[4 * row :] if has_gain else None)
