"""What a live run did, gathered while it runs, saved as contour files at its end: one of each rendering."""

import threading
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import StrategyError
from .drawn_log import LoggedPoints, LoggedPose
from .recording import LiveSegment, save_segment
from .renderer_process import LiveRendering


def record_path(record: str | Path, *, overwrite: bool) -> Path:
    """The path of a recording; raises StrategyError, before anything runs, for one that cannot be written later."""
    path = Path(record)
    if path.suffix not in (".h5", ".hdf5"):
        raise StrategyError(f"{path}: a contour file must end in .h5 or .hdf5")
    if path.exists() and not overwrite:
        raise StrategyError(f"{path}: exists already; overwrite=True replaces it")
    if not path.parent.is_dir():
        raise StrategyError(f"{path}: there is no folder {path.parent}")
    return path


class SegmentRecorder:
    """Poses and focal points of one rendering."""

    def __init__(self, rendering: LiveRendering) -> None:
        self.rendering = rendering
        self._base: int | None = None
        self._start_ns = 0
        self._poses: list[LoggedPose] = []
        self._points: list[LoggedPoints] = []

    def begin(self, base: int, start_ns: int) -> None:
        """Number of the first sample in the ring, and when the ring's first one is due [ns]."""
        self._base, self._start_ns = base, start_ns

    def add(self, record: LoggedPose | LoggedPoints) -> None:
        """What was drawn next."""
        if isinstance(record, LoggedPose):
            self._poses.append(record)
        else:
            self._points.append(record)

    def made(
        self, began_ns: dict[int, int], skipped: list[list[int]], events: list[tuple[float, str, str]], **fields: Any
    ) -> LiveSegment | None:
        """All of it; None where nothing was drawn. began_ns: when poses were played, by number."""
        if self._base is None or not self._poses:
            return None
        own, rate = self.rendering, self.rendering.sampling.update_rate
        period_ns = round(1e9 / rate)
        origin_ns = self._start_ns + self._base * period_ns
        position = np.concatenate([points.position for points in self._points])
        intensity = np.concatenate([points.intensity for points in self._points])
        gains = [np.ones(len(p.intensity), np.float32) if p.gain is None else p.gain for p in self._points]
        mark = np.zeros(len(intensity), np.uint8)
        for first, count, why in skipped:
            low = max(first - self._base, 0)
            mark[low : max(first - self._base + count, low)] = why
        if position.shape[1] == 1:
            position, intensity = position[:, 0], intensity[:, 0]
        has_gain = any(points.gain is not None for points in self._points)
        numbers = [pose.number for pose in self._poses]
        return LiveSegment(
            solid=own.solid,
            hand=own.hand,
            strategy=own.strategy,
            sampling=own.sampling,
            hold=max(own.sampling.hold, 2.0 / 90.0),
            time=np.array([pose.first for pose in self._poses]) / rate,
            pose=np.array([pose.pose for pose in self._poses], np.float32),
            patch_pose=None
            if self._poses[0].patch_pose is None
            else np.array([pose.patch_pose for pose in self._poses], np.float32),
            stamp=np.array([(pose.stamp_ns - origin_ns) * 1e-9 for pose in self._poses]),
            emitted=np.array([(began_ns[n] - origin_ns) * 1e-9 if n in began_ns else np.nan for n in numbers]),
            position=position,
            intensity=intensity,
            gain=np.concatenate(gains) if has_gain else None,
            mark=mark,
            events=[(time - origin_ns * 1e-9, kind, text) for time, kind, text in events],
            **fields,
        )


class RunRecorder:
    """A run of one rendering or several: `path`, and further files of the same name with a number."""

    def __init__(self, path: Path, *, overwrite: bool, **fields: Any) -> None:
        self.path, self.overwrite, self._fields = path, overwrite, fields
        self._lock = threading.Lock()
        self._segments: list[SegmentRecorder] = []
        self._began_ns: dict[int, int] = {}
        self._skipped: list[list[int]] = []
        self._events: list[tuple[float, str, str]] = []

    def segment(self, rendering: LiveRendering) -> SegmentRecorder:
        """Where the poses of another rendering go."""
        segment = SegmentRecorder(rendering)
        self._segments.append(segment)
        return segment

    def add_poses(self, rows: list[list[int]]) -> None:
        """Numbers of poses, their stamps, and when they were played [ns]."""
        self._began_ns.update({number: began_ns for number, _, began_ns in rows})

    def add_skipped(self, rows: list[list[int]]) -> None:
        """First sample in the ring, count, and why they were not played."""
        self._skipped += rows

    def add_event(self, time: float, kind: str, text: str) -> None:
        """Something that happened; time: of CLOCK_MONOTONIC [s]."""
        self._events.append((time, kind, text))

    def save(self) -> list[Path]:
        """Write the files; returns their paths."""
        paths = []
        for segment in self._segments:
            made = segment.made(self._began_ns, self._skipped, self._events, **self._fields)
            if made is not None:
                name = self.path.stem if not paths else f"{self.path.stem}-{len(paths) + 1}"
                path = self.path.with_name(name + self.path.suffix)
                paths.append(save_segment(path, made, overwrite=self.overwrite))
        return paths
