"""Draw frequency of many poses at once, from their lengths where a cycle need not be laid.

| strategy | samples a cycle follow from |
|---|---|
| pace "frequency" or "still" | the strategy alone |
| gap "jump", no pauses | the length; twice that for order "pendulum" |
| gap "pendulum", no pauses | the length, open polylines twice |
| gap "close", no pauses | the length and the chords of open polylines |
| gap "return", no pauses | the same for poses of one polyline; of several, the route's jumps: a cycle |
| pauses, at pace "speed" or "capped" | where the corners are: a cycle |
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from ....kernels.metrics.tally import Pacing, measure_gaps, pace_poses
from ...contour_batch import ContourBatch
from ...sampling.sampler import laid_cycles
from ...sampling.strategy import SEAM, SamplingStrategy

AGES, INSTANT = 1e9, 1e-9  # [s]; cycles longer and shorter than any


def is_fixed(strategy: SamplingStrategy) -> bool:
    """Whether every cycle has as many samples."""
    return strategy.pace.kind in ("frequency", "still")


def needs_gaps(strategy: SamplingStrategy) -> bool:
    """Whether samples depend on where polylines begin and end."""
    return strategy.gap.kind != "jump" and not is_fixed(strategy)


def pacing_of(strategy: SamplingStrategy) -> Any:
    """A strategy as the kernel takes it, `Pacing`."""
    pace, gap, capped = strategy.pace, strategy.gap.kind, strategy.pace.kind == "capped"
    frequency = pace.frequency if pace.kind == "frequency" else 0.0
    pacing = Pacing()
    pacing.speed, pacing.update_rate = strategy.speed, strategy.update_rate
    pacing.return_speed = strategy.gap.speed if gap == "return" and strategy.order.kind != "pendulum" else math.inf
    pacing.turns = 2.0 if strategy.order.kind == "pendulum" else 1.0
    pacing.again, pacing.chord = float(gap == "pendulum"), float(gap == "close")
    pacing.samples_least = float(strategy.samples_of(INSTANT))
    pacing.samples_most = float(strategy.samples_of(AGES)) if capped or is_fixed(strategy) else math.inf
    pacing.seam = SEAM
    pacing.nominal_lowest = pace.lowest if capped else frequency
    pacing.nominal_highest = pace.highest if capped else frequency if is_fixed(strategy) else math.inf
    pacing.moves = float(pace.kind != "still")
    return pacing


@dataclass
class Pacer:
    """Draw frequencies of one batch, strategy by strategy; what they have in common is made once."""

    batch: ContourBatch
    """On the device."""
    length: wp.array
    """Of each pose's contours [m], float64, shape [pose]."""

    def frequencies(self, strategy: SamplingStrategy, value: wp.array | None = None) -> wp.array:
        """Draw frequency nominal and actual [Hz], float32, shape [2, pose]; NaN for poses without contours.

        Nominal is what the strategy asks for, pauses left out; actual is update rate / samples of a cycle. value: takes
        them, if given.
        """
        gaps = self._gaps[:2] if needs_gaps(strategy) else None
        value = pace_poses(pacing_of(strategy), self.length, gaps, value)
        rows = self._rows_of_cycles(strategy)
        if len(rows):
            host = value.numpy()
            cycles = laid_cycles(self.batch, strategy)[rows]
            host[1, rows] = np.where(
                cycles["count"] > 0, strategy.update_rate / np.maximum(cycles["samples"], 1), np.nan
            )
            value.assign(host)
        return value

    @cached_property
    def _gaps(self) -> tuple[wp.array, wp.array, wp.array]:
        """Lengths between the ends of polylines, and their number; see `measure_gaps`."""
        return measure_gaps(self.batch.struct)

    def _rows_of_cycles(self, strategy: SamplingStrategy) -> np.ndarray:
        """Poses whose samples are known only from a cycle."""
        if is_fixed(strategy):
            return np.zeros(0, np.int64)
        paused = self.batch.dwell is not None
        if paused or strategy.dwell.time > 0 or strategy.dwell.share > 0:
            return np.flatnonzero(self.length.numpy() > 0)
        return np.flatnonzero(self._gaps[2].numpy() > 1) if strategy.gap.kind == "return" else np.zeros(0, np.int64)
