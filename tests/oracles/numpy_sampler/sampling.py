"""Contours over time -> focal points at the update rate (Frier et al. 2019, Mulot et al. 2021).

Sample k is shown at time k / update rate, independent of the poses' times, so the two clocks do not drift apart.
`SamplingStrategy` defines the motion along contours; `Sampler` continues it from pose to pose.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from palpate.datasets.motions.last_pose import usual_interval
from palpate.render.contour_batch import ContourBatch
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sampling.sampler import sample_bounds

from .fading import age_at
from .path import paths_of
from .sampler import Sampler


def sample_contours(
    batches: Iterable[ContourBatch],
    pose: np.ndarray,
    time: np.ndarray,
    duration: float,
    sampler: Sampler,
    *,
    block: int = 1024,
    hold: float | None = None,
) -> Iterator[FocalPoints]:
    """Focal points of a motion's contours, in blocks of at least `block` samples.

    batches: contours of consecutive poses on the host. pose: shape [pose, 7]. time: of the poses, from 0 [s], shape
    [pose]. duration: when the last pose ends [s]. hold: age at which a pose starts to fade [s]; None: the
    strategy's value, or twice their usual interval if that is longer.

    """
    rate = sampler.strategy.update_rate
    bounds = sample_bounds(time, duration, rate).tolist()
    if hold is None:  # after a single pose no next one is missing
        hold = max(sampler.strategy.hold, 2.0 * usual_interval(time)) if len(time) > 1 else np.inf
    pose = np.asarray(pose, np.float64)
    waiting: list[FocalPoints] = []
    ready, index = 0, 0
    for batch in batches:
        for path in paths_of(batch):
            first, stop = bounds[index], bounds[index + 1]
            while first < stop:  # a pose that lasts long is divided into blocks
                count = min(stop - first, block)
                age = age_at(first, time[index], rate)
                waiting.append(sampler.draw(path, pose[index], count, age=age, hold=hold))
                first += count
                ready += count
                if ready >= block:
                    yield joined(waiting)
                    waiting, ready = [], 0
            index += 1
    if waiting:
        yield joined(waiting)


def joined(parts: list[FocalPoints]) -> FocalPoints:
    """Join consecutive focal points."""
    return parts[0] if len(parts) == 1 else FocalPoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))
