"""Which frames stand for a moment of a rendering: a draw cycle of its pose, what is played meanwhile, or one."""

from pathlib import Path

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ..errors import StrategyError
from ..playback.focal_points import open_focal_points, sampling_for
from ..playback.placed_arrays import PlacedArray
from ..sampling.metrics import FocalPoints
from ..sampling.sampler import joined
from ..sampling.strategy import SamplingStrategy
from ..validation import choose
from .drawn_frames import DrawnPose, cycle_of
from .transducers import Resonance

AVERAGES = ("cycle", "pose", "instant")


def played_between(
    path: Path, sampling: SamplingStrategy | None, arrays: tuple[PlacedArray, ...], first: int, stop: int
) -> FocalPoints:
    """Frames first..stop of a file's playback, sampled from its beginning; raises StrategyError for none."""
    parts, done = [], 0
    rate = sampling_for(sampling, arrays).update_rate
    with ContourFile(path) as file:
        static = file.pose_count == 1
    with open_focal_points(path, sampling, stop / rate if static else None, arrays) as (source, _):
        for block in source:
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
