"""Lines for plots beside the timeline: a whole file in a few hundred points, and every pose around a moment."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ..batch_rows import BatchRows
from ..contour_batch import ContourBatch
from ..playback.focal_points import ContourSource
from ..sampling.draw_frequency import file_frequencies
from ..sampling.sampler import Sampler
from .file_scene import FileScene, tilts_of
from .focal_path import steps_of

BINS = 600  # points of the whole file's line
BLOCK = 1 << 16  # poses read at a time
POSES_MOST = 2_000
"""Poses around a moment that are looked at: their focal points take a second."""


@dataclass(frozen=True, eq=False)
class Overview:
    """Length of the contours of a whole file, in bins of consecutive poses."""

    time: np.ndarray
    """When each bin begins [s], or its first pose's number where poses have no times; float64, shape [bin]."""
    pose: np.ndarray
    """Number of each bin's first pose, int64, shape [bin]."""
    longest: np.ndarray
    """Longest length in each bin [m]; NaN where no pose is rendered yet; float64, shape [bin]."""


@dataclass(frozen=True, eq=False)
class PoseWindow:
    """Every pose around a moment, and what the focal point does there."""

    first: int
    """Number of the first pose."""
    time: np.ndarray
    """When each pose begins [s], or its number; float64, shape [pose]."""
    length: np.ndarray
    """Of its contours [m]; NaN where it is not rendered yet; shape [pose]."""
    draw_frequency: np.ndarray
    """How often they are drawn in a second [Hz]; NaN without contours; shape [pose]."""
    tilt: np.ndarray
    """Angle between the palm's skin and the array's face [rad], shape [pose]."""


def overview_of(scene: FileScene, bins: int = BINS) -> Overview:
    """The whole file in bins, read block by block; a pose that is not rendered is in no bin."""
    count = min(bins, scene.pose_count)
    edge = np.linspace(0, scene.pose_count, count + 1).astype(np.int64)
    longest = np.full(count, np.nan)
    for first, stop in scene.file.done:
        for begin in range(first, stop, BLOCK):
            end = min(begin + BLOCK, stop)
            length = scene.file.metrics(begin, end)["length"].astype(np.float64)
            number = np.searchsorted(edge, np.arange(begin, end), side="right") - 1
            np.fmax.at(longest, number, length)
    time = np.concatenate([scene.times(int(i), int(i) + 1) for i in edge[:-1]])
    return Overview(time, edge[:-1], longest)


def longest_pose(scene: FileScene, overview: Overview) -> int:
    """Number of the pose of the longest contours, read from its bin alone; 0 where there are none."""
    if not (overview.longest > 0).any():
        return 0
    number = int(np.nanargmax(overview.longest))
    first = int(overview.pose[number])
    stop = int(overview.pose[number + 1]) if number + 1 < len(overview.pose) else scene.pose_count
    done = [(max(first, low), min(stop, high)) for low, high in scene.file.done if max(first, low) < min(stop, high)]
    lengths = [(scene.file.metrics(low, high)["length"], low) for low, high in done]
    length, low = max(lengths, key=lambda part: float(part[0].max()))
    return low + int(length.argmax())


def window_around(scene: FileScene, index: int, poses_most: int = POSES_MOST) -> PoseWindow:
    """Half of `poses_most` poses before and after a pose, read as one range."""
    half = poses_most // 2
    first, stop = max(0, index - half), min(scene.pose_count, index + half + 1)
    length = np.full(stop - first, np.nan)
    for begin, end in scene.file.done:
        low, high = max(begin, first), min(end, stop)
        if low < high:
            length[low - first : high - first] = scene.file.metrics(low, high)["length"]
    frequency = file_frequencies(scene.file, np.arange(first, stop), scene.sampling)
    tilt = tilts_of(scene.file.motion(first, stop)["pose"])
    return PoseWindow(first, scene.times(first, stop), length, frequency, tilt)


def steps_in(scene: FileScene, window: PoseWindow) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] of jumps and of hops of the focal point in a window, drawn from its first pose on.

    None where poses have no times, or are not all rendered.
    """
    strategy = scene.sampling
    if not scene.has_time or len(window.time) < 2 or np.isnan(window.length).any():
        return np.zeros(0), np.zeros(0)
    stop = window.first + len(window.time)
    batch = ContourBatch.from_arrays(scene.file.contours(window.first, stop))
    pose = scene.file.motion(window.first, stop)["pose"]
    # the window as a motion of its own, which begins at 0 s
    rows = BatchRows(batch, HandMotion(window.time - window.time[0], pose), Path(scene.path))
    found: list[np.ndarray] = []
    done, before = 0, None
    for block in ContourSource(rows, Sampler(strategy)):
        place, level = block.position, block.intensity
        if before is not None:
            place, level = np.concatenate([before[0], place]), np.concatenate([before[1], level])
        kinds = np.stack(steps_of(place, level, strategy))
        number = np.arange(kinds.shape[1]) + done - (0 if before is None else 1)
        found.append(np.concatenate([kinds, number[None]])[:, kinds.any(axis=0)])
        before = place[-1:], level[-1:]
        done += len(block.intensity)
    jump, hop, number = np.concatenate(found, axis=1) if found else np.zeros((3, 0))
    time = window.time[0] + number / strategy.update_rate
    return time[jump > 0], time[hop > 0]
