"""Memory in which the process that draws leaves the newest moment for a viewer in another process.

The process that draws copies a moment at most 40 times a second, so that a reader at 30 Hz finds another one each time,
and only while a reader has asked within the last half second; without a reader it writes a few numbers. Neither process
ever waits for the other: there are two slots, the older of which is overwritten, and a reader whose slot was written
meanwhile reads again.
"""

import math
import mmap
import os
import threading
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..contour_batch import ContourBatch
from ..sampling.metrics import FocalPoints
from .drawn_log import LoggedPose

COPY_NS = 25_000_000  # between copies at least, on average
FOCUS_SECONDS = 1 / 30  # of focal points in a moment
ASKED_NS = 500_000_000  # for which a reader's question counts
POINTS_MOST = 16_384  # of the contours of a moment
LINES_MOST = 4_096
FOCUS_MOST = 512  # focal points of a moment
RESTING, WAITING, DRAWING = range(3)
"""States of the process that draws: it draws nothing; it waits for the first pose; it has a pose to draw."""

_CONTROL_BYTES: Final = 4096
_COPIED, _BEGUN, _ASKED, _STATE, _IS_LOST, _POSE_DUE, _SEQUENCE = range(7)  # _SEQUENCE and the next: of the two slots
_CONTOURS: Final = {"point": ("points", "kind", "intensity", "dwell"), "line": ("polyline_patch", "polyline_closed")}


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

    patch_count: most patches of a hand. fd: of the memory that another process made; None makes it. Contours of more
    than POINTS_MOST points or LINES_MOST polylines lose those polylines that come last, and the moment says how many
    points they had.
    """

    def __init__(self, patch_count: int, *, fd: int | None = None) -> None:
        layout = _layout(patch_count)
        size = _CONTROL_BYTES + 2 * layout.itemsize
        self.fd = os.memfd_create("palpate-moments") if fd is None else fd
        if fd is None:
            os.ftruncate(self.fd, size)
        self._map = mmap.mmap(self.fd, size)
        self._memory = memoryview(self._map)
        self._control = self._memory[:_CONTROL_BYTES].cast("q")
        slots = np.frombuffer(self._map, layout, 2, _CONTROL_BYTES)
        names = layout.names or ()
        self._slots = [{name: slots[name][place] for name in names} for place in (0, 1)]
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
        """Leave a moment; arguments as `CopiedMoment` has them."""
        copied = self._control[_COPIED]
        place = copied % 2  # the newest moment is in the other slot
        slot, sequence = self._slots[place], self._control[_SEQUENCE + place]
        self._control[_SEQUENCE + place] = sequence + 1  # odd: the slot is being written
        slot["number"][0], slot["index"][0], slot["time"][0], slot["copied_ns"][0] = copied + 1, index, time, now_ns
        slot["pose_first"][0], slot["pose_number"][0], slot["stamp_ns"][0] = pose.first, pose.number, pose.stamp_ns
        slot["pose"][:] = pose.pose
        slot["patches"][0] = -1 if pose.patch_pose is None else len(pose.patch_pose)
        if pose.patch_pose is not None:
            slot["patch_pose"][: len(pose.patch_pose)] = pose.patch_pose
        lines = min(contours.polyline_count, LINES_MOST)
        start = contours.polyline_start
        if start[lines] > POINTS_MOST:
            lines = int(np.searchsorted(start, POINTS_MOST, side="right")) - 1
        counts = {"line": lines, "point": int(start[lines])}
        slot["lines"][0], slot["point_count"][0] = lines, counts["point"]
        slot["left_out"][0] = contours.point_count - counts["point"]
        slot["raw_error"][0] = math.nan if contours.raw_error is None else contours.raw_error
        slot["polyline_start"][: lines + 1] = start[: lines + 1]
        for of, names in _CONTOURS.items():
            for name in names:
                values = getattr(contours, name)
                if name in ("intensity", "dwell"):
                    slot[f"has_{name}"][0] = values is not None
                if values is not None:
                    slot[name][: counts[of]] = values[: counts[of]]
        samples, foci = len(focus.intensity), 0 if focus.intensity.ndim == 1 else focus.intensity.shape[1]
        slot["samples"][0], slot["foci"][0] = samples, foci  # no foci: focal points have no axis for them
        most = samples * max(foci, 1)
        slot["position"][:most], slot["level"][:most] = focus.position.reshape(-1, 3), focus.intensity.reshape(-1)
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
                before = self._control[_SEQUENCE + place]
                moment = _read_slot(self._slots[place])
                if before % 2 == 0 and before == self._control[_SEQUENCE + place]:
                    return moment
        return None

    def close(self) -> None:
        """Let go of the memory."""
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
            self._slots.clear()  # arrays in the memory keep it from being closed
            self._control.release()
            self._memory.release()
            self._map.close()
            os.close(self.fd)


def _layout(patch_count: int) -> np.dtype:
    """A slot's fields; what is one number is an array of one, so that the field is a view of the memory."""
    names = "number index copied_ns pose_first pose_number stamp_ns patches lines point_count left_out samples foci"
    return np.dtype(
        [
            *((name, "<i8", 1) for name in [*names.split(), "has_intensity", "has_dwell"]),
            ("time", "<f8", 1),
            ("raw_error", "<f8", 1),
            ("pose", "<f4", 7),
            ("patch_pose", "<f4", (patch_count, 7)),
            ("polyline_start", "<i8", LINES_MOST + 1),
            ("polyline_patch", "<i4", LINES_MOST),
            ("polyline_closed", "<u1", LINES_MOST),
            ("points", "<f4", (POINTS_MOST, 3)),
            ("intensity", "<f4", POINTS_MOST),
            ("dwell", "<f4", POINTS_MOST),
            ("kind", "<u1", POINTS_MOST),
            ("position", "<f4", (FOCUS_MOST, 3)),
            ("level", "<f4", FOCUS_MOST),
        ],
        align=True,
    )


def _read_slot(slot: dict[str, np.ndarray]) -> CopiedMoment:
    """Copies of what a slot holds, which may be mixed: the caller looks whether it was written meanwhile."""

    def number(name: str) -> int:
        return int(slot[name][0])

    lines, points, samples, foci = (max(number(name), 0) for name in ("lines", "point_count", "samples", "foci"))
    counts = {"point": points, "line": lines}
    given = {name: slot[name][: counts[of]].copy() for of, names in _CONTOURS.items() for name in names}
    for name in ("intensity", "dwell"):
        if not number(f"has_{name}"):
            given[name] = None
    patches, error, count = number("patches"), float(slot["raw_error"][0]), samples * max(foci, 1)
    position, level = slot["position"][:count].copy(), slot["level"][:count].copy()
    if foci and count <= FOCUS_MOST:
        position, level = position.reshape(-1, foci, 3), level.reshape(-1, foci)
    return CopiedMoment(
        number=number("number"),
        index=number("index"),
        time=float(slot["time"][0]),
        copied_ns=number("copied_ns"),
        pose=LoggedPose(
            number("pose_first"),
            number("pose_number"),
            number("stamp_ns"),
            slot["pose"].copy(),
            None if patches < 0 else slot["patch_pose"][:patches].copy(),
        ),
        contours=ContourBatch(
            polyline_start=slot["polyline_start"][: lines + 1].copy(),
            pose_start=np.array([0, lines], np.int64),
            raw_error=None if math.isnan(error) else error,
            **given,
        ),
        points_left_out=number("left_out"),
        focus=FocalPoints(position, level),
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
