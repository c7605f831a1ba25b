"""Focal points of a file around an instant or a pose: one draw cycle, what is played of a pose, or one frame."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..focal_spot import NEAREST
from ..hands.hand import Hand, hand_from
from ..playback.drive import Driver, Drives
from ..playback.file_playback import opened
from ..playback.focus_source import ContourRows
from ..playback.placed_arrays import PlacedArray
from ..sampling.contour_sampling import FocalPoints, Sampler, SamplingStrategy, joined
from ..sampling.path import Path as ContourPath
from ..validation import choose
from .transducers import Resonance

AVERAGES = ("cycle", "pose", "instant")
CYCLE_MOST = 16_384  # frames


@dataclass(frozen=True, eq=False)
class DrawnPose:
    """Contours of one pose, and the hand that they lie on."""

    index: int
    pose: np.ndarray
    """Position [m] and quaternion xyzw, shape [7]."""
    time: float | None
    """When it begins [s]; None: the poses have no times."""
    hand: Hand
    batch: ContourBatch
    """Of this pose only."""

    def polylines(self) -> list[np.ndarray]:
        """Contours [m], each of shape [point, 3]."""
        start = self.batch.polyline_start
        return [np.asarray(self.batch.points[a:b], float) for a, b in pairwise(start)]

    def path(self) -> ContourPath | None:
        """What a sampler draws; None without contours."""
        return ContourPath.of(self.batch, 0)


def drawn_pose(file: ContourFile, index: int) -> DrawnPose:
    """One pose of a file; raises StrategyError for a number that it has not."""
    if not 0 <= index < file.pose_count:
        raise StrategyError(f"pose must lie in 0..{file.pose_count - 1} of {file.path}, not {index}")
    return drawn_row(file, index, hand_from(file.hand, file.hand_arrays()))


def drawn_row(rows: ContourRows, index: int, hand: Hand) -> DrawnPose:
    """One pose of contours on a hand."""
    motion = rows.motion(index, index + 1)
    time = None if "time" not in motion else float(motion["time"][0])
    return DrawnPose(index, motion["pose"][0], time, hand, ContourBatch.from_arrays(rows.contours(index, index + 1)))


def pose_at(file: ContourFile, seconds: float) -> int:
    """Number of the pose that is shown at a time [s]; raises StrategyError for a time outside the motion."""
    motion = file.motion()
    if "time" not in motion:
        if file.pose_count == 1 and seconds >= 0:
            return 0
        raise StrategyError(f"{file.path}: its poses have no times: give the number of one with pose")
    time = motion["time"]
    end = float(time[-1]) + (float(np.median(np.diff(time))) if len(time) > 1 else 0.0)
    if not time[0] <= seconds <= end:
        raise StrategyError(f"at must lie in {time[0]:g}..{end:g} s, when {file.path} moves, not {seconds:g}")
    return int(np.searchsorted(time, seconds, side="right")) - 1


def longest_pose(file: ContourFile) -> int:
    """Number of the pose with the longest contours."""
    return int(np.argmax(file.metrics()["length"]))


def cycle_of(drawn: DrawnPose, sampling: SamplingStrategy) -> FocalPoints:
    """Focal points of one draw cycle of a pose that stays; none without contours.

    Where cycles have no common period (some modulations), 16384 frames stand for it.
    """
    path = drawn.path()
    if path is None:
        return FocalPoints(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
    sampler = Sampler(sampling)
    cycle = sampler.cycle(path, drawn.pose, limit=CYCLE_MOST)
    return sampler.draw(path, drawn.pose, CYCLE_MOST) if cycle is None else cycle


def played_between(
    path: Path, sampling: SamplingStrategy | None, arrays: tuple[PlacedArray, ...], first: int, stop: int
) -> FocalPoints:
    """Frames first..stop of a file's playback, sampled from its beginning; raises StrategyError for none."""
    parts, done = [], 0
    rate = arrays[0].model.update_rate(arrays[0].model.divider_default) if sampling is None else sampling.update_rate
    with ContourFile(path) as file:
        static = file.pose_count == 1
    with opened(path, sampling, stop / rate if static else None, arrays) as source:
        for block in source.source:
            end = done + len(block.intensity)
            low, high = max(first - done, 0), min(stop, end) - done
            if low < high:
                parts.append(FocalPoints(block.position[low:high], block.intensity[low:high]))
            done = end
            if done >= stop:
                break
    if not parts:
        raise StrategyError(f"{path}: its playback ends before frame {first}")
    return joined(parts)


def frames_of_average(
    path: Path,
    drawn: DrawnPose,
    seconds: float | None,
    average: str,
    sampling: SamplingStrategy,
    arrays: tuple[PlacedArray, ...],
    resonance: Resonance | None = None,
) -> tuple[FocalPoints, int]:
    """Focal points of an average, after those of the time that resonant transducers need; and how many these are.

    average: cycle (of the pose, as if it stayed), pose (what is played while it is shown), instant (the frame at
    `seconds`, or at the pose's beginning).
    """
    average = choose("average", average, AVERAGES)
    lead = 0 if resonance is None else int(np.ceil(sampling.update_rate * 2.5 / resonance.pole))  # 16 nepers
    if average == "cycle":
        cycle = cycle_of(drawn, sampling)
        again = -(-lead // max(len(cycle.intensity), 1))
        return joined([cycle] * (again + 1)), again * len(cycle.intensity)
    rate = sampling.update_rate
    begin = drawn.time if seconds is None else seconds
    if begin is None or drawn.time is None:
        raise StrategyError(f"average {average} needs poses with times, which {path} has not; cycle does not")
    if average == "instant":
        first, stop = int(begin * rate + 1e-6), int(begin * rate + 1e-6) + 1
    else:
        with ContourFile(path) as file:
            motion = file.motion(drawn.index, min(drawn.index + 2, file.pose_count))["time"]
        end = float(motion[1]) if len(motion) > 1 else drawn.time + 1 / 90
        first = int(np.ceil(drawn.time * rate - 1e-6))
        stop = max(int(np.ceil(end * rate - 1e-6)), first + 1)
    early = max(first - lead, 0)
    return played_between(path, sampling, arrays, early, stop), first - early


def drives_of(driver: Driver, focus: FocalPoints) -> Drives:
    """Drives of focal points, as if the array had played nothing before."""
    driver.reset()
    return driver.drive(focus)


def is_reachable(position: np.ndarray, intensity: np.ndarray, arrays: tuple[PlacedArray, ...]) -> np.ndarray:
    """Which focal points emit and lie 1 cm from all transducers at least; shape [frame, focus]."""
    usable = np.any([placed.model.in_reach(position) for placed in arrays], axis=0) & (intensity > 0)
    for placed in arrays:
        if usable.any():
            apart = np.linalg.norm(position[usable][:, None] - placed.model.position, axis=2).min(axis=1)
            usable[usable] = apart >= NEAREST
    return usable
