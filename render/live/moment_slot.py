"""Memory in which the process that draws leaves the newest moment for a viewer in another process.

The process that draws copies a moment at most 40 times a second, so that a reader at 30 Hz finds another one each time,
and only while a reader has asked within the last half second; without a reader it writes a few numbers. Neither process
ever waits for the other: there are two slots, the older of which is overwritten, and a reader whose slot was written
meanwhile reads again.
"""

import mmap
import os
import pickle
import threading
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..contour_batch import ContourBatch
from ..sampling.metrics import FocalPoints
from .drawn_log import LoggedPose, plain, restored

COPY_NS = 25_000_000  # between copies at least, on average
FOCUS_SECONDS = 1 / 30  # of focal points in a moment
ASKED_NS = 500_000_000  # for which a reader's question counts
POINTS_MOST = 16_384  # of the contours of a moment
LINES_MOST = 4_096
FOCUS_MOST = 512  # focal points of a moment
RESTING, WAITING, DRAWING = range(3)
"""States of the process that draws: it draws nothing; it waits for the first pose; it has a pose to draw."""

_CONTROL_BYTES: Final = 4096
_SLOT_BYTES: Final = 1 << 23  # a moment of all the points above takes 0.5 MB, and a patch of the hand 28 bytes
_COPIED, _BEGUN, _ASKED, _STATE, _IS_LOST, _POSE_DUE = range(6)
_SEQUENCE, _LENGTH = 6, 8  # each and the next one: of the two slots


@dataclass(frozen=True, eq=False)
class CopiedMoment:
    """A pose that is drawn, as it was copied."""

    number: int
    """Of the copy, from 1."""
    index: int
    """Of the rendering."""
    time: float
    """When the newest focal point is due, from the run's first one [s]."""
    copied_ns: int
    """When it was copied, on the monotonic clock [ns]."""
    pose: LoggedPose
    contours: ContourBatch
    """Of this pose, on the host."""
    points_left_out: int
    """Points of polylines for which there was no room."""
    focus: FocalPoints
    """Drawn in the last 1/30 s, evenly thinned where they are many; fewer where a reader has just begun to ask."""


class MomentSlot:
    """Moments from one process that draws to one that shows them, without a lock between the two.

    fd: of the memory that another process made; None makes it. Contours of more than POINTS_MOST points or LINES_MOST
    polylines lose those polylines that come last, and the moment says how many points they had.
    """

    def __init__(self, *, fd: int | None = None) -> None:
        size = _CONTROL_BYTES + 2 * _SLOT_BYTES
        self.fd = os.memfd_create("palpate-moments") if fd is None else fd
        if fd is None:
            os.ftruncate(self.fd, size)
        self._map = mmap.mmap(self.fd, size)
        self._memory = memoryview(self._map)
        self._control = self._memory[:_CONTROL_BYTES].cast("q")
        self._lock = threading.Lock()  # of the reader's threads: none reads what another one closes
        self._is_closed = False

    def ask(self, now_ns: int) -> None:
        """Let moments be copied for the next half second; now_ns: on the monotonic clock [ns]."""
        with self._lock:
            if not self._is_closed:
                self._control[_ASKED] = now_ns

    def is_asked(self, now_ns: int) -> bool:
        """Whether a reader has asked within the last half second."""
        return now_ns - self._control[_ASKED] < ASKED_NS

    def begin(self) -> None:
        """A run begins: moments that were copied before are of another one."""
        self._control[_BEGUN] = self._control[_COPIED]

    def note(self, state: int, *, is_lost: bool, pose_due_ns: int) -> None:
        """What the process that draws does; pose_due_ns: when the newest pose's first focal point is due [ns]."""
        control = self._control
        control[_STATE], control[_IS_LOST], control[_POSE_DUE] = state, is_lost, pose_due_ns

    def noted(self) -> tuple[int, bool, int]:
        """State, whether the tracker sees no hand, and when the newest pose's first focal point is due [ns].

        Once closed, RESTING.
        """
        with self._lock:
            if self._is_closed:
                return RESTING, True, 0
            return self._control[_STATE], bool(self._control[_IS_LOST]), self._control[_POSE_DUE]

    def copy(
        self, pose: LoggedPose, contours: ContourBatch, focus: FocalPoints, *, index: int, time: float, now_ns: int
    ) -> None:
        """Leave a moment, unless it is larger than a slot; arguments as `CopiedMoment` has them."""
        copied = self._control[_COPIED]
        kept = _with_room(contours)
        left_out = contours.point_count - len(kept[0])
        values = plain((*pose, *kept, *focus))
        content = pickle.dumps((copied + 1, index, time, now_ns, left_out, values), pickle.HIGHEST_PROTOCOL)
        if len(content) > _SLOT_BYTES:
            return  # drawing goes on; a viewer keeps the moment before
        place = copied % 2  # the newest moment is in the other slot
        first, sequence = _CONTROL_BYTES + place * _SLOT_BYTES, self._control[_SEQUENCE + place]
        self._control[_SEQUENCE + place] = sequence + 1  # odd: the slot is being written
        self._control[_LENGTH + place] = len(content)
        self._memory[first : first + len(content)] = content
        self._control[_SEQUENCE + place] = sequence + 2
        self._control[_COPIED] = copied + 1

    @property
    def copied(self) -> int:
        """Moments copied so far."""
        return self._control[_COPIED]

    def read(self) -> CopiedMoment | None:
        """The newest moment of this run; None where none has been copied, and once closed.

        Ends even where the process that draws was killed while it copied: the slot that is named last is complete.
        """
        with self._lock:
            while not self._is_closed:
                copied = self._control[_COPIED]
                if copied <= self._control[_BEGUN]:
                    return None
                place = (copied - 1) % 2
                first, before = _CONTROL_BYTES + place * _SLOT_BYTES, self._control[_SEQUENCE + place]
                content = bytes(self._memory[first : first + self._control[_LENGTH + place]])
                if before % 2 == 0 and before == self._control[_SEQUENCE + place]:
                    number, index, time, copied_ns, left_out, values = pickle.loads(content)  # of our own process
                    values = restored(values)
                    pose, contours = LoggedPose(*values[:5]), ContourBatch(*values[5:-2])
                    focus = FocalPoints(*values[-2:])
                    return CopiedMoment(number, index, time, copied_ns, pose, contours, left_out, focus)
        return None

    def close(self) -> None:
        """Let go of the memory."""
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
            self._control.release()
            self._memory.release()
            self._map.close()
            os.close(self.fd)


def _with_room(contours: ContourBatch) -> tuple[Any, ...]:
    """The fields of a ContourBatch of the first polylines of a pose, as many as a slot has room for."""
    start = contours.polyline_start
    lines = min(contours.polyline_count, LINES_MOST, int(np.searchsorted(start, POINTS_MOST, side="right")) - 1)
    points = int(start[lines])
    return (
        contours.points[:points],
        contours.kind[:points],
        start[: lines + 1],
        contours.polyline_patch[:lines],
        contours.polyline_closed[:lines],
        np.array([0, lines], np.int64),
        None if contours.intensity is None else contours.intensity[:points],
        None if contours.dwell is None else contours.dwell[:points],
        contours.raw_error,
    )


class MomentTap:
    """The renderer's side: gathers focal points while a reader asks, and copies a moment when it is time.

    rate: of focal points [Hz].
    """

    def __init__(self, slot: MomentSlot, rate: float) -> None:
        self._slot = slot
        self._most = round(rate * FOCUS_SECONDS)
        self._points: list[FocalPoints] = []
        self._is_asked = False
        self._due_ns = 0

    def begin(self) -> None:
        """A run begins."""
        self._slot.begin()
        self._points.clear()
        self._due_ns = 0

    def add_points(self, focus: FocalPoints) -> None:
        """What was drawn next."""
        if self._is_asked:
            self._points.append(focus)

    def is_due(self, state: int, *, is_lost: bool, pose_due_ns: int, now_ns: int) -> bool:
        """Note what the renderer does, as `MomentSlot.note`; whether a moment is to be copied now."""
        self._slot.note(state, is_lost=is_lost, pose_due_ns=pose_due_ns)
        self._is_asked = state == DRAWING and self._slot.is_asked(now_ns)
        if not self._is_asked:
            self._points.clear()
        return self._is_asked and now_ns >= self._due_ns

    def copy(self, pose: LoggedPose, contours: ContourBatch, *, index: int, time: float, now_ns: int) -> None:
        """Copy a moment; the next one is due 25 ms after this one was, or after now where this one is that late."""
        self._due_ns = (now_ns if now_ns - self._due_ns > COPY_NS else self._due_ns) + COPY_NS
        self._slot.copy(pose, contours, self._thinned(), index=index, time=time, now_ns=now_ns)

    def _thinned(self) -> FocalPoints:
        """The newest focal points, evenly thinned to those that a slot has room for."""
        if not self._points:
            return FocalPoints(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
        newest = FocalPoints(*(np.concatenate(part)[-self._most :] for part in zip(*self._points, strict=True)))
        self._points = [newest]
        position, intensity = newest
        foci = 1 if intensity.ndim == 1 else intensity.shape[1]
        step = -(-len(intensity) // (FOCUS_MOST // foci))
        return FocalPoints(position[::-step][::-1], intensity[::-step][::-1])
