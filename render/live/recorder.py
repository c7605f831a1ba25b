"""What a live run does, kept on the disk while it runs, and made contour files at its end: one of each rendering."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...datasets.errors import ContourFileError
from ..errors import StrategyError
from .drawn_log import LoggedPoints, LoggedPose
from .recording import EMITTED
from .renderer_process import LiveRendering
from .spool import LiveSpool

Event = tuple[float, str, str]


def record_path(record: str | Path, *, overwrite: bool) -> Path:
    """The path of a recording; raises StrategyError, before anything runs, for one that cannot be written later."""
    path = Path(record)
    if path.suffix not in (".h5", ".hdf5"):
        raise StrategyError(f"{path}: a contour file must end in .h5 or .hdf5")
    if path.exists() and not overwrite:
        raise StrategyError(f"{path}: exists already; overwrite=True replaces it")
    if not path.parent.is_dir():
        raise StrategyError(f"{path}: there is no folder {path.parent}")
    if (folder := spool_folder(path)).exists():
        raise StrategyError(
            f"{folder}: a run that was killed left it: `palpate live OBJECT --record {path} --finish` makes its file"
        )
    return path


class SegmentRecorder:
    """Poses and focal points of one rendering, from when its first sample has a number.

    numbers: of its poses. made: gives the spool.
    """

    def __init__(self, rendering: LiveRendering, numbers: range, made: Callable[[], LiveSpool]) -> None:
        self.rendering, self.numbers = rendering, numbers
        self.spool: LiveSpool | None = None
        self._made = made
        self._waiting: list[LoggedPose | LoggedPoints] = []  # drawn before the first sample's number is known
        self._base = 0
        self.origin_ns = 0
        """When its first sample was due, of CLOCK_MONOTONIC [ns]."""

    def begin(self, base: int, start_ns: int) -> None:
        """Number of the first sample in the ring, and when the ring's first one is due [ns]."""
        rate = self.rendering.sampling.update_rate
        self._base, self.origin_ns = base, start_ns + base * round(1e9 / rate)
        self.spool = self._made()
        for record in self._waiting:
            self.add(record)
        self._waiting.clear()

    def add(self, record: LoggedPose | LoggedPoints) -> None:
        """What was drawn next."""
        if self.spool is None:
            self._waiting.append(record)
        elif isinstance(record, LoggedPose):
            self.spool.add_pose(
                record.first, record.number, self._seconds(record.stamp_ns), record.pose, record.patch_pose
            )
        else:
            self.spool.add_samples(record.first, record.position, record.intensity, record.gain)

    def add_emitted(self, number: int, began_ns: int) -> None:
        """When a pose was played [ns]; one of another rendering is left out."""
        if self.spool is not None and number in self.numbers:
            self.spool.add_emitted(number, self._seconds(began_ns))

    def add_mark(self, first: int, count: int, mark: int) -> None:
        """Samples, by their numbers in the ring, that were not played as drawn; others' are left out when it ends."""
        if self.spool is not None and mark != EMITTED:
            self.spool.add_mark(first - self._base, count, mark)

    def add_event(self, event: Event) -> None:
        """Something that happened, its time of CLOCK_MONOTONIC [s]."""
        if self.spool is not None:
            self.spool.add_event(event[0] - self.origin_ns * 1e-9, event[1], event[2])

    def _seconds(self, time_ns: int) -> float:
        return (time_ns - self.origin_ns) * 1e-9


class RunRecorder:
    """A run of one rendering or several: `path`, and further files of the same name with a number.

    While it runs, everything is in folders beside the files, so that a run that is killed leaves what it drew until
    then: `finish_spool` makes its file. fields: of a LiveSegment, known before.
    """

    def __init__(self, path: Path, *, overwrite: bool, **fields: Any) -> None:
        self.path, self.overwrite, self._fields = path, overwrite, fields
        self.error: BaseException | None = None
        """What kept it from going on; the run itself goes on."""
        self._lock = threading.Lock()
        self._segments: list[SegmentRecorder] = []
        self._events: list[Event] = []

    def segment(self, rendering: LiveRendering, numbers: range) -> SegmentRecorder:
        """Where the poses of another rendering go."""
        place = len(self._segments)
        segment = SegmentRecorder(rendering, numbers, lambda: self._spool(rendering, place))
        self._segments.append(segment)
        return segment

    def begin(self, segment: SegmentRecorder, base: int, start_ns: int) -> None:
        """Number of a segment's first sample in the ring, and when the ring's first one is due [ns]."""
        self._guarded(lambda: self._begin(segment, base, start_ns))

    def add(self, segment: SegmentRecorder, record: LoggedPose | LoggedPoints) -> None:
        """What was drawn next of a segment."""
        self._guarded(lambda: segment.add(record))

    def add_poses(self, rows: list[list[int]]) -> None:
        """Numbers of poses, their stamps, and when they were played [ns]."""
        self._each(lambda segment: [segment.add_emitted(number, began_ns) for number, _, began_ns in rows])

    def add_skipped(self, rows: list[list[int]]) -> None:
        """First sample in the ring, count, and why they were not played."""
        self._each(lambda segment: [segment.add_mark(*row) for row in rows])

    def add_event(self, time: float, kind: str, text: str) -> None:
        """Something that happened; time: of CLOCK_MONOTONIC [s]."""
        self._events.append((time, kind, text))
        self._each(lambda segment: segment.add_event((time, kind, text)))

    def save(self) -> list[Path]:
        """Make the files; returns their paths. Raises what kept the recorder from going on, once they are made."""
        paths = []
        for place, segment in enumerate(self._segments):
            if segment.spool is not None:
                made = segment.spool.finish(numbered(self.path, place), overwrite=self.overwrite)
                paths += [] if made is None else [made]
        if self.error is not None:
            raise self.error
        return paths

    def _spool(self, rendering: LiveRendering, place: int) -> LiveSpool:
        own = rendering
        return LiveSpool(
            spool_folder(numbered(self.path, place)),
            solid=own.solid,
            hand=own.hand,
            strategy=own.strategy,
            sampling=own.sampling,
            hold=own.hold,
            **self._fields,
        )

    def _begin(self, segment: SegmentRecorder, base: int, start_ns: int) -> None:
        segment.begin(base, start_ns)
        for event in self._events:
            segment.add_event(event)

    def _each(self, add: Callable[[SegmentRecorder], object]) -> None:
        self._guarded(lambda: [add(segment) for segment in self._segments])

    def _guarded(self, add: Callable[[], object]) -> None:
        """Add, unless something failed before: a full disk ends the record, not the run."""
        with self._lock:
            if self.error is None:
                try:
                    add()
                except ContourFileError as error:
                    self.error = error


def numbered(path: Path, place: int) -> Path:
    """The file of a rendering, by its place in the run."""
    return path if place == 0 else path.with_name(f"{path.stem}-{place + 1}{path.suffix}")


def spool_folder(path: Path) -> Path:
    """Where a run is kept until its file is made."""
    return path.with_name(f"{path.name}.live")
