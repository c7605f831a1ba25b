"""Focal points of a file around an instant or a pose: one draw cycle, what is played of a pose, or one frame."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.motions.last_pose import end_of_motion
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..focal_spot import NEAREST
from ..hands.hand import Hand
from ..hands.stored_hand import hand_from
from ..playback.drive import Driver, Drives
from ..playback.focal_points import ContourRows
from ..playback.placed_arrays import PlacedArray
from ..sampling.metrics import FocalPoints
from ..sampling.sampler import Sampler, has_contours
from ..sampling.strategy import SamplingStrategy

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
    end = end_of_motion(time)
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
    return cycle_along(drawn.batch, drawn.pose, sampling)


def cycle_along(contours: ContourBatch, pose: np.ndarray, sampling: SamplingStrategy) -> FocalPoints:
    """The same of a batch of one pose. pose: position [m] and quaternion xyzw of the hand, shape [7]."""
    if not has_contours(contours):
        return FocalPoints(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
    sampler = Sampler(sampling, revisits=False)
    cycle = sampler.cycle(contours, pose, limit=CYCLE_MOST)
    return sampler.draw(contours, pose, CYCLE_MOST) if cycle is None else cycle


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
