"""Sampling metrics of a whole recipe: jumps by cause, revisits, silence, dwell; counted as `palpate play` does.

Contours are rendered as they are sampled, or read where they are kept.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ....datasets.motions.hand_motion import HandMotion
from ...contour_batch import ContourBatch
from ...hands.hand import Hand
from ...intersection.batch_rendering import rendered_chunks
from ...intersection.job import ContourJob
from ...intersection.scene import Scene
from ...motions.numbers import dwell_grid, sampling_numbers
from ...playback.focal_points import ContourRows, ContourSource
from ...sampling.metrics import FocalPoints, dwell_map
from ...sampling.sampler import SPAN_SAMPLES, Sampler, sample_bounds
from ...sampling.strategy import SamplingStrategy

KEPT_BYTES = 256_000_000  # of a rendering's contours on the host, for the next walk through them


class RenderedContours:
    """Contours of a motion that are rendered as they are read; kept for the next reading if they are small enough."""

    def __init__(self, scene: Scene, motion: HandMotion, device: str, *, name: str = "rendering") -> None:
        self.path = Path(name)
        self.pose_count = len(motion)
        self._scene, self._motion, self._device = scene, motion, device
        self._first, self._batch = 0, None
        self._kept: list[tuple[int, int, ContourBatch]] | None = None

    def motion(self, first: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
        """Poses and times first..stop."""
        rows = {"pose": self._motion.pose[first:stop]}
        return rows if self._motion.time is None else {**rows, "time": self._motion.time[first:stop]}

    def blocks(self, *, point_limit: int = 0) -> Iterator[tuple[int, int]]:
        """Pose ranges as they are rendered; `contours` gives those of the last one."""
        for first, stop, batch in self._chunks():
            self._first, self._batch = first, batch
            yield first, stop

    def contours(self, first: int, stop: int) -> dict[str, np.ndarray]:
        """Contours of poses of the last block; of another range they are rendered."""
        batch, own = self._batch, self._first
        if batch is None or not own <= first <= stop <= own + batch.pose_count:
            return self._scene.contours(self._motion.pose[first:stop], first, self._device)[0].arrays()
        return batch.select(first - own, stop - own).by_name()

    def _chunks(self) -> Iterator[tuple[int, int, ContourBatch]]:
        if self._kept is not None:
            yield from self._kept
            return
        kept: list[tuple[int, int, ContourBatch]] | None = []
        size = 0
        for chunk in rendered_chunks(ContourJob.of(self._scene, self._motion, device=self._device)):
            size += sum(array.nbytes for array in chunk.contours.by_name().values())
            kept = None if kept is None or size > KEPT_BYTES else kept
            if kept is not None:
                kept.append((chunk.first, chunk.stop, chunk.contours))
            yield chunk.first, chunk.stop, chunk.contours
        self._kept = kept


def sample_recipe(
    contours: ContourRows,
    motion: HandMotion,
    hand: Hand,
    strategy: SamplingStrategy,
    takers: Sequence[Callable[[FocalPoints], object]] = (),
    *,
    counted: bool = True,
) -> dict[str, Any]:
    """Go once through all focal points of a motion; returns `NUMBERS`, if they are to be counted, and the seconds.

    takers: are called with the focal points, block by block. Raises what rendering and sampling raise.
    """
    started = perf_counter()
    sampler = Sampler(strategy, revisits=counted)
    source = ContourSource(contours, sampler, block=SPAN_SAMPLES)

    def taken() -> Iterator[FocalPoints]:
        for focus in source:
            for taker in takers:
                taker(focus)
            yield focus

    numbers: dict[str, Any] = {}
    if counted:
        rate, time = strategy.update_rate, np.zeros(len(motion)) if motion.time is None else motion.time
        bounds = sample_bounds(time, source.duration, rate)
        dwell = dwell_map(taken(), motion.pose, bounds, rate, **dwell_grid(hand))
        numbers = sampling_numbers(sampler.count, dwell, rate)
    else:
        deque(taken(), maxlen=0)
    return {**numbers, "seconds": {"sampling": perf_counter() - started}}
