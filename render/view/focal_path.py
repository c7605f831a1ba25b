"""Focal points around a pose, for the point in slow motion: where it is, how strong, and where it jumps or hops."""

from dataclasses import dataclass

import numpy as np

from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..sampling.sampler import Sampler, joined, sample_contours
from ..sampling.strategy import SamplingStrategy
from .file_scene import FileScene

LEAD = 2
"""Poses drawn before the one that is shown, so that the focal point enters it from somewhere."""
POSE_LONGEST = 0.1  # [s] of focal points of one pose: a pose that lasts longer is drawn for that long
STILL = 0.05  # [s] of a pose without times


@dataclass(frozen=True, eq=False)
class FocalPath:
    """Focal points that are played while a pose is shown.

    They are sampled from a few poses before it on, not from the file's beginning: the focal point may be at another
    place of the same contours than in the playback of the whole file.
    """

    position: np.ndarray
    """[m], float32, shape [sample, 3]; with several foci [sample, focus, 3]."""
    intensity: np.ndarray
    """0..1, float32, shape [sample] or [sample, focus]."""
    rate: float
    """Samples a second [Hz]."""
    jump: np.ndarray
    """Samples that a jump ends in: a step longer than the strategy's threshold; bool, shape [sample]."""
    hop: np.ndarray
    """Samples that a hop ends in: a step over twice the ordinary one, which is no jump; bool, shape [sample]."""


def focal_path(scene: FileScene, index: int, sampling: SamplingStrategy | None = None) -> FocalPath | None:
    """Focal points of a pose of a file; None where the file has no contours of it yet.

    Raises StrategyError for a sampling strategy that cannot draw it.
    """
    strategy = sampling or scene.sampling
    first = index
    while first > max(0, index - LEAD) and scene.is_done(first - 1):
        first -= 1
    if not scene.is_done(index):
        return None
    batch = ContourBatch.from_arrays(scene.file.contours(first, index + 1))
    pose = scene.file.motion(first, index + 1)["pose"]
    time, end = _span(scene, first, index)
    blocks = list(sample_contours([batch], pose, time, end, Sampler(strategy), hold=np.inf))
    if not blocks:
        raise StrategyError(f"{scene.path}: pose {index} lasts less than one sample at {strategy.update_rate:g} Hz")
    focus = joined(blocks)
    begin = int(np.ceil(time[-1] * strategy.update_rate - 1e-6))
    jump, hop = steps_of(focus.position, focus.intensity, strategy)
    return FocalPath(focus.position[begin:], focus.intensity[begin:], strategy.update_rate, jump[begin:], hop[begin:])


def _span(scene: FileScene, first: int, index: int) -> tuple[np.ndarray, float]:
    """Times of poses first..index from 0 on, and when the last one ends [s]."""
    if not scene.has_time:
        return STILL * np.arange(index + 1 - first, dtype=np.float64), STILL * (index + 1 - first)
    time = scene.times(first, min(index + 2, scene.pose_count))
    lasts = float(time[-1] - time[-2]) if len(time) > 1 else STILL  # the last pose lasts as long as that before it
    poses = index + 1 - first
    steps = np.minimum(np.diff(time, append=time[-1] + lasts)[:poses], POSE_LONGEST)
    start = np.concatenate([[0.0], np.cumsum(steps)])
    return start[:-1], float(start[-1])


def steps_of(position: np.ndarray, intensity: np.ndarray, strategy: SamplingStrategy) -> tuple[np.ndarray, np.ndarray]:
    """Which samples end a jump, and which a hop, of any focus that sounds before and after; bool, shape [sample].

    A jump is longer than the strategy's threshold; a hop is no jump, but over twice the ordinary step.
    """
    place = position.reshape(len(position), -1, 3)
    sounds = intensity.reshape(len(intensity), -1) > 0
    length = np.linalg.norm(np.diff(place, axis=0), axis=2) * (sounds[1:] & sounds[:-1])
    longest = np.concatenate([[0.0], length.max(axis=1)]) if len(length) else np.zeros(len(place))
    jump = longest > strategy.jump_threshold
    return jump, ~jump & (longest > 2.0 * strategy.step_ordinary)
