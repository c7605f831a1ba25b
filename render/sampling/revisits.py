"""Revisit rate: how often a place on the skin is drawn, counted on focal points and hand poses alone.

docs/guide/sampling.md has the definition; kernels/sampling/visits.py looks back.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from ...kernels.sampling.spans import SpanRoom
from ...kernels.sampling.visits import count_revisits, picked_sample
from .metrics import FocalPoints, SamplingCount, poses_of_samples, schedule_of
from .strategy import SamplingStrategy

REVISIT_LIMIT = 1.0  # [s] without a visit: a wait that is longer ends without a visit
PICK_INTERVAL = 20e-3  # [s]; 50 picks a second are enough for the mean
COUNTED_AT_ONCE = 1 << 18  # focal points that wait to be counted


class RevisitWatch:
    """Picks places as focal points come, and counts visits; how samples are cut into spans changes nothing.

    goes_on: whether each motion has more than one span; then focal points stay on the host for two limits.
    """

    def __init__(self, motion_count: int, strategy: SamplingStrategy, device: str, *, goes_on: bool = True) -> None:
        rate = strategy.update_rate
        self._interval, self._limit = max(1, round(PICK_INTERVAL * rate)), math.floor(REVISIT_LIMIT * rate)
        self._device, self._period, self._goes_on = device, 1.0 / rate, goes_on
        self._sums = np.zeros((motion_count, 2), np.int64)
        self._tails = [_Tail() for _ in range(motion_count if goes_on else 0)]

    def totals(self) -> tuple[list[int], list[float]]:
        """Of each motion: picked places that had been visited before; how long all had waited [s]."""
        for motion in range(len(self._tails)):
            self._count(motion)
        return self._sums[:, 0].tolist(), (self._sums[:, 1] * self._period).tolist()

    def take(
        self,
        room: SpanRoom,
        position: wp.array,
        intensity: wp.array,
        motion_start: np.ndarray,
        count: np.ndarray,
        row: np.ndarray,
    ) -> None:
        """The samples of a span, in a room's arrays: those of a pose from a row on."""
        start = np.append(row, count.sum())[motion_start]
        if not self._goes_on:
            picks = -(-np.diff(start) // self._interval)
            nothing = np.zeros(len(picks), np.int64)
            given = room.pose, position, intensity
            self._sums = self._counted(room.schedule, given, start, picks, nothing, nothing)
            return
        host = position.numpy(), intensity.numpy(), room.pose.numpy()
        for motion, (a, b) in enumerate(pairwise(start.tolist())):
            first, stop = motion_start[motion : motion + 2]
            self.add(motion, host[0][a:b], host[1][a:b], host[2][first:stop], count[first:stop])

    def add(
        self, motion: int, position: np.ndarray, intensity: np.ndarray, pose: np.ndarray, count: np.ndarray
    ) -> None:
        """More samples of a motion; position, intensity: [sample, focus, ...]; pose, shape [pose, 7], has `count`."""
        tail = self._tails[motion]
        tail.parts.append((position.copy(), intensity.copy(), pose.copy(), np.array(count, np.int64)))
        tail.waiting += intensity.size
        if tail.waiting > max(COUNTED_AT_ONCE, self._limit * intensity.shape[1]):  # less often than each limit
            self._count(motion)

    def _count(self, motion: int) -> None:
        """Count what waits to be counted of a motion, and keep the last two limits of it."""
        tail = self._tails[motion]
        if tail.waiting == 0:
            return
        position, intensity, pose, count = (np.concatenate(part) for part in zip(*tail.parts, strict=True))
        stop = tail.first + len(intensity)
        picks = 0
        while picked_sample(tail.pick + picks, self._interval) < stop:
            picks += 1
        if picks:
            schedule = schedule_of(count, self._device)
            given = [
                wp.array(values, dtype=dtype, device=self._device)
                for values, dtype in ((pose, wp.transformd), (position, wp.vec3), (intensity, wp.float32))
            ]
            numbers = [np.array([value]) for value in (picks, tail.first, tail.pick)]
            self._sums[motion] += self._counted(schedule, given, np.array([0, len(intensity)]), *numbers)[0]
            tail.pick += picks
        ends = np.cumsum(count)
        past = int(np.searchsorted(ends, len(intensity) - 2 * self._limit - 1, side="right"))
        begin = int(ends[past - 1]) if past else 0
        tail.parts = [(position[begin:], intensity[begin:], pose[past:], count[past:])]
        tail.first, tail.waiting = tail.first + begin, 0

    def _counted(self, schedule: Any, given: Sequence[wp.array], start: np.ndarray, *numbers: np.ndarray) -> np.ndarray:
        """See `count_revisits`; given: poses, positions, intensities; numbers: picks, first samples, first picks."""
        picks, samples, first = numbers
        rule = {"interval": self._interval, "limit": self._limit, "sample_start": start}
        return count_revisits(schedule, *given, **rule, pick_count=picks, first_sample=samples, first_pick=first)


class _Tail:
    """The last focal points of a motion, and those that wait to be counted."""

    def __init__(self) -> None:
        self.parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self.first = 0  # number of the first sample that is held
        self.pick = 0  # number of the next pick
        self.waiting = 0  # focal points that are not counted yet


def revisit_rate(
    blocks: Iterable[FocalPoints], pose: np.ndarray, bounds: np.ndarray, update_rate: float
) -> float | None:
    """Rate at which a place on the skin is drawn [Hz]; None if none was drawn again.

    blocks, pose, bounds: as for `dwell_map`. update_rate: of the focal points [Hz].
    Raises StrategyError for more samples than `bounds` has.

    >>> import numpy as np
    >>> from palpate.render import render, revisit_rate, static_pose
    >>> batch = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")  # 0.34 m, drawn at 7 m/s: 20.6 times a second
    >>> sampled = batch.sample("stm", duration=1.0)
    >>> round(revisit_rate([sampled.focus], batch.motion.pose, np.array([0, 10_000]), 10_000.0), 1)
    20.6
    """
    watch = RevisitWatch(1, SamplingStrategy(update_rate=update_rate), "cpu")
    for block, first, count in poses_of_samples(blocks, bounds):
        shape = len(block.intensity), int(np.prod(block.intensity.shape[1:]))
        position, intensity = block.position.reshape(*shape, 3), block.intensity.reshape(shape)
        watch.add(0, position, intensity, np.asarray(pose[first : first + len(count)], np.float64), count)
    (revisits,), (time,) = watch.totals()
    return SamplingCount(revisits=revisits, revisit_time=time).revisit_rate
