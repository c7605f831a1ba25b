"""Contours over time -> focal points at the update rate (Frier et al. 2019, Mulot et al. 2021).

Sample k is shown at time k / update rate, independent of the poses' times, so the two clocks do not drift apart.
`SamplingStrategy` defines the motion along contours; `Sampler` continues it from pose to pose.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from ...datasets.motions.last_pose import usual_interval
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from .fading import age_at
from .metrics import CAUSES, DwellMap, FocalPoints, SamplingCount, dwell_map
from .path import Path, paths_of
from .presets import PRESETS, load_sampling, preset, sets_rate
from .sampler import Sampler
from .strategy import (
    AmplitudeModulation,
    Dwell,
    Gap,
    LateralModulation,
    Order,
    Pace,
    SamplingStrategy,
    Sections,
)

__all__ = [
    "CAUSES",
    "PRESETS",
    "AmplitudeModulation",
    "Dwell",
    "DwellMap",
    "FocalPoints",
    "Gap",
    "LateralModulation",
    "Order",
    "Pace",
    "Path",
    "Sampler",
    "SamplingCount",
    "SamplingStrategy",
    "Sections",
    "StrategyError",
    "dwell_map",
    "joined",
    "load_sampling",
    "paths_of",
    "preset",
    "sample_bounds",
    "sample_contours",
    "sets_rate",
]


def sample_bounds(time: np.ndarray, duration: float, update_rate: float) -> np.ndarray:
    """First sample of each pose, and the end of the last pose's samples, int64, shape [pose + 1].

    time: of each pose [s]; duration: how long the samples go on [s]; update_rate [Hz].
    Sample k lies on the contours of the latest pose at time k / update rate.

    >>> from palpate.render import exploration, sample_bounds
    >>> motion = exploration("tube", duration=1.0, rate=90.0)
    >>> sample_bounds(motion.time[:3], motion.duration, 10_000.0)  # 111 or 112 samples a pose
    array([    0,   112,   223, 10000])
    """
    return np.ceil(np.append(time, duration) * update_rate - 1e-6).astype(np.int64)


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

    >>> import numpy as np
    >>> from palpate.render import Sampler, render, sample_contours, static_pose
    >>> batch = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")
    >>> blocks = sample_contours([batch], batch.motion.pose, np.zeros(1), 0.2, Sampler("stm"))
    >>> [len(focus.position) for focus in blocks]  # 0.2 s at 10 kHz
    [1024, 976]
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
