"""Where a playback's focal points come from, block by block: contours, sampled as they are read, or points."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from ...datasets.focus_files.frame_reader import FrameReader
from ...datasets.motions.last_pose import INTERVALS_LOOKED_AT, end_of_motion, usual_interval
from ..contour_batch import ContourBatch
from ..errors import PoseError, StrategyError
from ..sampling.metrics import FocalPoints
from ..sampling.revisits import REVISIT_LIMIT
from ..sampling.sampler import Sampler, has_contours, sample_contours

FRAMES_MOST = 1e12  # a year at 40 kHz
BLOCK = 1024  # frames; 0.1 s at 10 kHz, 26 ms at 40 kHz: what Python needs a few milliseconds for
POINTS_A_READ = 1 << 16  # of contours; a few milliseconds to read, whatever the size of the file
COUNTED = 5.0  # [s] of a static pose, after what comes before it


class FocusSource(Protocol):
    """Focal points at the update rate. Blocks that are the same object are the same focal points."""

    frame_count: int
    """How many it will give, if it is not stopped before."""

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
    """Focal points that are there already."""

    def __init__(self, focus: FocalPoints) -> None:
        self.frame_count = len(focus.intensity)
        self._blocks = [
            FocalPoints(focus.position[first : first + BLOCK], focus.intensity[first : first + BLOCK])
            for first in range(0, self.frame_count, BLOCK)
        ]

    def __iter__(self) -> Iterator[FocalPoints]:
        """Blocks of focal points."""
        return iter(self._blocks)


class KeptSource:
    """Focal points of a file that a sweep has kept, read block by block; of any size.

    file: opened, of focal points. duration: when to stop [s], if not at its end.
    Raises StrategyError for a duration that is none, or not one frame.
    """

    def __init__(self, file: FrameReader, duration: float | None = None) -> None:
        require_duration(duration)
        self._file = file
        asked = FRAMES_MOST if duration is None else frame_count(duration, file.update_rate, file.path)
        self.frame_count = int(min(file.frame_count, asked))

    def __iter__(self) -> Iterator[FocalPoints]:
        """Blocks of focal points."""
        for first in range(0, self.frame_count, BLOCK):
            yield FocalPoints(*self._file.focal_points(first, min(first + BLOCK, self.frame_count)))


class ContourSource:
    """Focal points of a contour file; only what is about to be played is read, so a file may have any size.

    A static pose is sampled once: whole cycles of it make a block that is given again and again.

    Args:
        file: the opened file, sealed, or another source of contours.
        sampler: draws its poses; keeps the counts.
        block: focal points of a block at most, but for a static pose.
        duration: when to stop [s]; a motion ends by itself, a static pose does not. None is the motion's end
            (`end_of_motion`).

    Raises:
        StrategyError: a duration that is none, one static pose without one, or not one frame.
        PoseError: poses without times, or with times that do not increase; found as they are read.
    """

    def __init__(
        self, file: ContourRows, sampler: Sampler, duration: float | None = None, *, block: int = BLOCK
    ) -> None:
        require_duration(duration)
        self._block = block
        self._file, self._sampler = file, sampler
        self._interval: float | None = None  # [s]; None for one static pose
        self.duration = self._duration(duration)
        """When the playing ends [s]."""
        self.hold = None if self._interval is None else max(sampler.strategy.hold, 2.0 * self._interval)
        """Age at which a pose starts to fade [s]; None for one static pose, which does not."""
        self.frame_count = frame_count(self.duration, sampler.strategy.update_rate, file.path)

    @property
    def is_static(self) -> bool:
        """Whether one pose is drawn all along."""
        return self._interval is None

    def __iter__(self) -> Iterator[FocalPoints]:
        """Blocks of focal points."""
        if self.hold is None:
            yield from self._static()
            return
        for first, stop in self._file.blocks(point_limit=POINTS_A_READ):
            # one time more than poses, so that the last of them knows how long it lasts
            time = self._file.motion(first, min(stop + 1, self._file.pose_count))["time"]
            require_increasing(time, self._file.path)
            end = self.duration if len(time) == stop - first else min(float(time[-1]), self.duration)
            played = int(np.searchsorted(time[: stop - first], self.duration))
            if played == 0:
                return
            batch, pose = self._read(first, first + played)
            yield from sample_contours(
                [batch], pose, time[:played], end, self._sampler, block=self._block, hold=self.hold
            )

    def _read(self, first: int, stop: int) -> tuple[ContourBatch, np.ndarray]:
        batch = ContourBatch.from_arrays(self._file.contours(first, stop))
        return batch, self._file.motion(first, stop)["pose"]

    def _static(self) -> Iterator[FocalPoints]:
        batch, pose = self._read(0, 1)
        sampler = self._sampler
        cycle = sampler.cycle(batch, pose[0]) if has_contours(batch) else None
        if cycle is None or 2 * len(cycle.intensity) > self.frame_count:
            yield from sample_contours(
                [batch], pose, np.zeros(1), self.duration, sampler, block=self._block, hold=np.inf
            )
            return
        count = len(cycle.intensity)
        again = -(-BLOCK // count)
        block = FocalPoints(*(np.tile(x, (again,) + (1,) * (x.ndim - 1)) for x in (cycle.position, cycle.intensity)))
        _count_cycles(sampler, batch, pose[0], count, self.frame_count)
        for first in range(0, self.frame_count, again * count):
            left = self.frame_count - first
            yield block if left >= again * count else FocalPoints(block.position[:left], block.intensity[:left])

    def _duration(self, asked: float | None) -> float:
        path, count = self._file.path, self._file.pose_count
        head = self._file.motion(0, INTERVALS_LOOKED_AT + 1)
        if "time" not in head or count == 1:
            if count > 1:
                raise PoseError(f"{path}: has {count} poses without times, which cannot be played")
            if asked is None:
                raise StrategyError(f"{path}: holds one static pose: say how long to play it with duration=SECONDS")
            return asked
        require_increasing(head["time"], path)
        self._interval = usual_interval(head["time"])
        end = end_of_motion(head["time"], float(self._file.motion(count - 1, count)["time"][0]))
        if not np.isfinite(end):
            raise PoseError(f"{path}: the last of /motion/time is not finite; palpate check tells where")
        return end if asked is None else min(end, asked)


def _count_cycles(sampler: Sampler, contours: ContourBatch, pose: np.ndarray, count: int, frame_count: int) -> None:
    """Let a sampler count all frames of a static pose: after a run-in, those of COUNTED stand for all later ones.

    One cycle would do for all but the revisits, which are looked for in few places of each; and before REVISIT_LIMIT is
    over, only places that are soon drawn again are counted.
    """
    rate = sampler.strategy.update_rate
    run_in, part = (count * math.ceil(seconds * rate / count) for seconds in (REVISIT_LIMIT, COUNTED))
    if run_in + part > frame_count:
        sampler.draw(contours, pose, frame_count)
        return
    again, rest = divmod(frame_count - run_in - part, part)
    sampler.draw(contours, pose, run_in)
    before = sampler.count
    sampler.draw(contours, pose, part)
    after = sampler.count
    sampler.draw(contours, pose, rest)
    sampler.repeat(before, after, again)


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
