"""Focal points of a playback, block by block: those of contours, sampled as they are read, or those of a file."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from ...datasets.contour_file.header_live import RecordedRun
from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.focus_files.frame_reader import FOCAL_POINTS, FrameReader, frame_format
from ...datasets.focus_files.ptlist import read_ptlist
from ...datasets.motions.last_pose import INTERVALS_LOOKED_AT, end_of_motion, usual_interval
from ...device.array import ArrayModel
from ...kernels.driving.solve import POINTS_MOST
from ..contour_batch import ContourBatch
from ..errors import PoseError, StrategyError
from ..file_kinds import is_point_list
from ..sampling.metrics import FocalPoints, SamplingCount
from ..sampling.presets import sampling_of, sets_rate
from ..sampling.sampler import Sampler, sample_contours
from ..sampling.strategy import SamplingStrategy
from .placed_arrays import PlacedArray

FRAMES_MOST = 1e12  # a year at 40 kHz
BLOCK = 1024  # frames; 0.1 s at 10 kHz, 26 ms at 40 kHz: what Python needs a few milliseconds for
POINTS_A_READ = 1 << 16  # of contours; a few milliseconds to read, whatever the size of the file


class FocusSource(Protocol):
    """Focal points at the update rate, which can be gone through again and again."""

    @property
    def frame_count(self) -> int:
        """How many it gives each time, if it is not stopped before."""
        ...

    @property
    def update_rate(self) -> float:
        """[Hz]"""
        ...

    @property
    def foci(self) -> int:
        """Focal points of a frame."""
        ...

    @property
    def sampling(self) -> SamplingStrategy | None:
        """How contours were sampled; None for focal points of a file."""
        ...

    @property
    def count(self) -> SamplingCount | None:
        """Counts of the sampler so far, of the first time only; None without one."""
        ...

    @property
    def is_static(self) -> bool:
        """Whether one pose is drawn all along."""
        ...

    def __iter__(self) -> Iterator[FocalPoints]:
        """Blocks of consecutive focal points, from the first on."""
        ...


class ContourRows(Protocol):
    """Contours of a motion, read pose range by pose range: a ContourFile, or what renders them as they are read."""

    @property
    def path(self) -> Path:
        """Where they lie, for messages."""
        ...

    @property
    def pose_count(self) -> int:
        """Number of poses."""
        ...

    def motion(self, first: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
        """Poses first..stop: `pose`, shape [pose, 7], and `time` [s], if there is one."""
        ...

    def blocks(self, *, point_limit: int) -> Iterator[tuple[int, int]]:
        """Pose ranges (first, stop) in order, of up to about so many points."""
        ...

    def contours(self, first: int, stop: int) -> dict[str, np.ndarray]:
        """Contours of a range that `blocks` gave, or of the beginning of one, by the names of ContourBatch."""
        ...


class PointSource:
    """Focal points that are there already, or are read from a file.

    read: the focal points, or a function that gives those of frames first..stop. foci: of a frame. block: frames that
    are given at once at most.
    """

    sampling = None
    count = None
    is_static = False

    def __init__(
        self,
        read: FocalPoints | Callable[[int, int], FocalPoints],
        *,
        update_rate: float,
        frame_count: int | None = None,
        foci: int = 1,
        block: int = BLOCK,
    ) -> None:
        self._read, self.update_rate, self.foci, self._block = read, update_rate, foci, block
        self.frame_count = frame_count or 0
        if isinstance(read, FocalPoints):
            self.frame_count = min(len(read.intensity), frame_count or len(read.intensity))
            self.foci = 1 if read.intensity.ndim == 1 else read.intensity.shape[1]

    def __iter__(self) -> Iterator[FocalPoints]:
        """Blocks of focal points."""
        read = self._read
        for first in range(0, self.frame_count, self._block):
            stop = min(first + self._block, self.frame_count)
            is_there = isinstance(read, FocalPoints)
            yield FocalPoints(*(own[first:stop] for own in read)) if is_there else read(first, stop)


class ContourSource:
    """Focal points of a contour file; only what is about to be played is read, so a file may have any size.

    Args:
        file: the opened file, sealed, or another source of contours.
        sampler: draws its poses the first time, and keeps the counts; another one of its strategy does so again.
        block: focal points of a block at most.
        duration: when to stop [s]; a motion ends by itself, a static pose does not. None is the motion's end
            (`end_of_motion`).
        run: the live run that the contours are the recording of, if they are of one: then its poses fade at the same
            ages, and end when it ended, so that its own sampling strategy gives its focal points, bit for bit.

    Raises:
        StrategyError: a duration that is none, one static pose without one, or not one frame.
        PoseError: poses without times, or with times that do not increase; found as they are read.
    """

    def __init__(
        self,
        file: ContourRows,
        sampler: Sampler,
        duration: float | None = None,
        *,
        block: int = BLOCK,
        run: RecordedRun | None = None,
    ) -> None:
        require_duration(duration)
        self._block = block
        self._file, self.sampler = file, sampler
        self.sampling, self.foci = sampler.strategy, sampler.strategy.foci
        self.update_rate = sampler.strategy.update_rate
        self._times = 0  # that the focal points were asked for
        self._interval: float | None = None  # [s]; None for one static pose
        self.duration = self._duration(duration, run)
        """When the playing ends [s]."""
        self.hold = None if self._interval is None else max(sampler.strategy.hold, 2.0 * self._interval)
        """Age at which a pose starts to fade [s]; None for one static pose, which does not."""
        if run is not None:
            self.hold = max(sampler.strategy.hold, run.hold)
        self.frame_count = frame_count(self.duration, self.update_rate, file.path)

    @property
    def is_static(self) -> bool:
        """Whether one pose is drawn all along."""
        return self._interval is None

    @property
    def count(self) -> SamplingCount:
        """Counts of the sampler so far, of the first time only."""
        return self.sampler.count

    def __iter__(self) -> Iterator[FocalPoints]:
        """Blocks of focal points."""
        self._times += 1
        sampler = self.sampler if self._times == 1 else Sampler(self.sampling, revisits=False)
        if self.is_static:
            batch, pose = self._rows(0, 1)
            time, hold = np.zeros(1), np.inf if self.hold is None else self.hold
            yield from sample_contours([batch], pose, time, self.duration, sampler, block=self._block, hold=hold)
            return
        for first, stop in self._file.blocks(point_limit=POINTS_A_READ):
            # one time more than poses, so that the last of them knows how long it lasts
            time = self._file.motion(first, min(stop + 1, self._file.pose_count))["time"]
            require_increasing(time, self._file.path)
            end = self.duration if len(time) == stop - first else min(float(time[-1]), self.duration)
            played = int(np.searchsorted(time[: stop - first], self.duration))
            if played == 0:
                return
            batch, pose = self._rows(first, first + played)
            yield from sample_contours([batch], pose, time[:played], end, sampler, block=self._block, hold=self.hold)

    def _rows(self, first: int, stop: int) -> tuple[ContourBatch, np.ndarray]:
        batch = ContourBatch.from_arrays(self._file.contours(first, stop))
        return batch, self._file.motion(first, stop)["pose"]

    def _duration(self, asked: float | None, run: RecordedRun | None) -> float:
        path, count = self._file.path, self._file.pose_count
        head = self._file.motion(0, INTERVALS_LOOKED_AT + 1)
        if "time" not in head or count == 1:
            if count > 1:
                raise PoseError(f"{path}: has {count} poses without times, which cannot be played")
            if asked is None and run is not None:
                return run.duration
            if asked is None:
                raise StrategyError(f"{path}: holds one static pose: say how long to play it with duration=SECONDS")
            return asked
        require_increasing(head["time"], path)
        self._interval = usual_interval(head["time"])
        end = end_of_motion(head["time"], float(self._file.motion(count - 1, count)["time"][0]))
        if not np.isfinite(end):
            raise PoseError(f"{path}: the last of /motion/time is not finite; palpate check tells where")
        end = end if run is None else run.duration
        return end if asked is None else min(end, asked)


@contextmanager
def open_focal_points(
    path: Path,
    sampling: SamplingStrategy | str | None,
    duration: float | None,
    arrays: Sequence[PlacedArray],
    *,
    has_points: bool | None = None,
) -> Iterator[tuple[FocusSource, ContourFile | FrameReader | None]]:
    """Open a file: what gives its focal points, and what is read meanwhile, None if all was read before.

    By default the update rate is the first array's. has_points: whether its `frame_format` is FOCAL_POINTS, if that is
    known. Raises StrategyError for a file that is not finished, for a sampling of focal points that are there, for more
    focal points a frame than can be solved, and as `ContourSource`.
    """
    if has_points is None:
        has_points = frame_format(path) == FOCAL_POINTS
    if sampling is not None and (has_points or is_point_list(path)):
        raise StrategyError(f"{path}: holds focal points, which no sampling strategy changes")
    if is_point_list(path):
        points = read_ptlist(path)
        require_duration(duration)
        count = None if duration is None else frame_count(duration, points.update_rate, path)
        focus = FocalPoints(points.position, points.intensity * np.float32(points.intensity_peak))
        yield PointSource(focus, update_rate=points.update_rate, frame_count=count), None
    elif has_points:
        with FrameReader(path) as reader:
            yield stored_points(reader, duration), reader
    else:
        with ContourFile(path) as file:
            if not file.sealed:
                raise StrategyError(f'{path}: is not finished and cannot be played; mode="resume" finishes it')
            yield contour_source(file, sampling, duration, arrays), file


def stored_points(reader: FrameReader, duration: float | None = None) -> PointSource:
    """Focal points of a file that a sweep has stored, read block by block; of any size.

    duration: when to stop [s], if not at its end. Raises StrategyError for a duration that is none, or not one frame.
    """
    require_duration(duration)
    _require_solvable(reader.foci)
    count = reader.frame_count
    if duration is not None:
        count = min(count, frame_count(duration, reader.update_rate, reader.path))

    def read(first: int, stop: int) -> FocalPoints:
        return FocalPoints(*reader.focal_points(first, stop))

    return PointSource(read, update_rate=reader.update_rate, frame_count=count, foci=reader.foci)


def contour_source(
    contours: ContourRows,
    sampling: SamplingStrategy | str | None,
    duration: float | None,
    arrays: Sequence[PlacedArray],
) -> ContourSource:
    """Focal points of contours; sampling: names take the first array's rate; None is stm at this rate, or the sampling
    of the live run that a file is the recording of."""
    run = contours.live_run if isinstance(contours, ContourFile) else None
    strategy = sampling_for(sampling, arrays) if run is None or sampling is not None else sampling_of_run(run)
    _require_solvable(strategy.foci)
    source = ContourSource(contours, Sampler(strategy), duration, run=run)
    for placed in arrays:
        _require_one_pattern(contours, source, strategy, placed.model)
    return source


def sampling_for(sampling: SamplingStrategy | str | None, arrays: Sequence[PlacedArray]) -> SamplingStrategy:
    """A sampling strategy; None (stm) and names take the first array's rate, as a playback does."""
    strategy = sampling_of(sampling or "stm")
    if isinstance(sampling, SamplingStrategy) or (sampling is not None and sets_rate(sampling)):
        return strategy
    return replace(strategy, update_rate=usual_rate(arrays[0].model, strategy))


def sampling_of_run(run: RecordedRun) -> SamplingStrategy:
    """The sampling strategy of a live run; raises StrategyError for one that this version does not know."""
    return SamplingStrategy.from_json(json.dumps(dict(run.sampling)))


def live_run_of(path: Path) -> RecordedRun | None:
    """The live run that a contour file is the recording of; None for any other file, or what cannot be read."""
    try:
        with ContourFile(path) as file:
            return file.live_run
    except ContourFileError:
        return None


def _require_one_pattern(
    contours: ContourRows, source: ContourSource, strategy: SamplingStrategy, model: ArrayModel
) -> None:
    """Refuse a motion, before any of it is played, at a rate at which an array only switches one pattern on and off."""
    if not model.alternates or source.is_static:
        return
    sustained = model.update_rate(model.divider_sustained)
    if model.divider(strategy.update_rate) >= model.divider_sustained or not _moves(contours, source.duration):
        return
    asked, slower = f"{strategy.update_rate:g} Hz", f"up to {sustained:.3g} Hz"
    if strategy.am is not None:
        asked, slower = "am", f"am of up to {sustained / 2:.3g} Hz (am.frequency)"
    raise StrategyError(
        f"{contours.path}: {asked} on a {model.name} needs a single pose that does not move, as it switches one "
        f"pattern on and off, but contours are at poses that differ. A motion takes {slower}, or another array"
    )


def _moves(contours: ContourRows, duration: float) -> bool:
    """Whether contours of different poses come before the duration [s] is over; reads no more than shows it."""
    seen: np.ndarray | None = None
    for first, stop in contours.blocks(point_limit=POINTS_A_READ):
        start = contours.contours(first, stop)["pose_start"]
        motion = contours.motion(first, stop)
        drawn = motion["pose"][(np.diff(start) > 0) & (motion["time"] < duration)]
        if len(drawn):
            seen = drawn[0] if seen is None else seen
            if (drawn != seen).any():
                return True
        if motion["time"][-1] >= duration:
            break
    return False


def usual_rate(model: ArrayModel, strategy: SamplingStrategy) -> float:
    """Update rate [Hz] where none is asked for: the array's default.

    Amplitude modulation of a focal point at rest, which is one pattern and off in turns, gets the fastest rate of an
    array that plays any number of those, where the default is too slow for it.
    """
    rate = model.update_rate(model.divider_default)
    is_one_pattern = strategy.pace.kind == "still" and strategy.lm is None
    if model.alternates and is_one_pattern and strategy.am is not None and strategy.am.frequency > rate / 2:
        return model.update_rate(max(model.divider_min, math.ceil(model.frame_clock / model.carrier)))
    return rate


def _require_solvable(foci: int) -> None:
    if foci > POINTS_MOST:
        raise StrategyError(f"foci must be at most {POINTS_MOST} to be solved for an array, not {foci}")


def require_duration(duration: float | None) -> None:
    """Refuse a duration [s] that is none."""
    if duration is not None and not (np.isfinite(duration) and duration > 0):
        raise StrategyError(f"duration must be positive, not {duration} s")


def require_increasing(time: np.ndarray, path: Path) -> None:
    """Refuse times of poses that do not increase."""
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise PoseError(f"{path}: /motion/time does not increase all the way; palpate check tells where")


def frame_count(duration: float, update_rate: float, path: Path) -> int:
    """Frames of a playback of that duration [s]; refused where there is none, or more than a count can hold."""
    if duration * update_rate > FRAMES_MOST:
        raise StrategyError(f"{path}: {duration:g} s at {update_rate:g} Hz is over {FRAMES_MOST:g} frames")
    count = int(np.ceil(duration * update_rate - 1e-6))
    if count < 1:
        raise StrategyError(f"{path}: {duration:g} s at {update_rate:g} Hz is not one frame")
    return count
