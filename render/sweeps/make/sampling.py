"""What sampling comes to over a whole recipe: jumps by cause, revisits, silence, dwell; counted as `palpate play` does.

Contours are rendered as they are sampled, or read where they are kept.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import numpy as np

from ....datasets.motions.hand_motion import HandMotion
from ...contour_batch import ContourBatch
from ...hands.hand import Hand
from ...intersection.batch_rendering import rendered_chunks
from ...intersection.job import ContourJob
from ...intersection.scene import Scene
from ...motions.numbers import dwell_grid, sampling_numbers
from ...playback.focus_source import (
    POINTS_A_READ,
    ContourRows,
    ContourSource,
    FocusSource,
    PointSource,
    require_increasing,
)
from ...sampling.batch_dwell import dwell_maps
from ...sampling.batch_sampling import MotionSamples, sample_motions
from ...sampling.contour_sampling import DwellMap, FocalPoints, Sampler, SamplingStrategy, dwell_map, sample_bounds

KEPT_BYTES = 256_000_000  # of a rendering's contours on the host, for whoever samples it next
FOCI_AT_ONCE = 5_000_000  # 0.2 GB of focal points; more are made block by block
POINTS_AT_ONCE = 5_000_000  # 0.5 GB of contours and what is laid along them; with more, too


class FocusTaker(Protocol):
    """Who takes focal points as they are made."""

    def take(self, focus: FocalPoints) -> None:
        """The next ones."""
        ...


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


def why_not_sampled(motion: HandMotion | None) -> str | None:
    """Why a motion has no focal points over time; None if it has. None as the motion: random poses."""
    if motion is None or motion.time is None:
        return "the poses have no times"
    return "there is one pose only" if len(motion) == 1 else None


def sample_recipe(
    contours: ContourRows,
    motion: HandMotion,
    hand: Hand,
    strategy: SamplingStrategy,
    takers: Sequence[FocusTaker] = (),
    *,
    counted: bool = True,
    tick: Callable[[], object] = lambda: None,
) -> dict[str, Any]:
    """Go once through all focal points of a motion; returns `NUMBERS`, if they are to be counted, and the seconds.

    takers: who else takes the focal points. tick: called after every block of poses, as a sign of progress. Raises what
    rendering and sampling raise.
    """
    started = perf_counter()
    sampler = Sampler(strategy)
    source = ContourSource(contours, sampler)
    grid = dwell_grid(hand)
    samples = _sampled_at_once(contours, source, strategy, tick)
    if samples is not None:
        for _ in _taken(PointSource(samples.focus(0)), takers):
            pass
        count = samples.counts[0]
        dwell = dwell_maps(samples, strategy.update_rate, **grid)[0] if counted else None
    else:
        count, dwell = sampler.count, _streamed(source, motion, strategy, takers, counted, grid)
    if dwell is None:
        return {"seconds": {"sampling": perf_counter() - started}}
    numbers = sampling_numbers(count, dwell, strategy.update_rate)
    return {**numbers, "seconds": {"sampling": perf_counter() - started}}


def _sampled_at_once(
    contours: ContourRows, source: ContourSource, strategy: SamplingStrategy, tick: Callable[[], object]
) -> MotionSamples | None:
    """All focal points of a motion, and what they are counted as; None where memory may not hold all at once."""
    if source.hold is None or source.frame_count * strategy.foci > FOCI_AT_ONCE:
        return None
    batches, point_count = [], 0
    for first, stop in contours.blocks(point_limit=POINTS_A_READ):
        batches.append(ContourBatch.from_arrays(contours.contours(first, stop)))
        point_count += batches[-1].point_count
        if point_count > POINTS_AT_ONCE:
            return None
        tick()
    rows = contours.motion()
    require_increasing(rows["time"], contours.path)
    ends, holds = np.array([source.duration]), np.array([source.hold])
    start = np.array([0, contours.pose_count])
    return sample_motions(batches, rows["pose"], rows["time"], start, ends, strategy, hold=holds)


def _streamed(
    source: ContourSource,
    motion: HandMotion,
    strategy: SamplingStrategy,
    takers: Sequence[FocusTaker],
    counted: bool,
    grid: dict[str, float],
) -> DwellMap | None:
    """Go through more focal points than memory may hold; the dwell map, if they are to be counted."""
    if not counted:
        for _ in _taken(source, takers):
            pass
        return None
    time = motion.time if motion.time is not None else np.zeros(len(motion))
    bounds = sample_bounds(time, source.duration, strategy.update_rate)
    return dwell_map(_taken(source, takers), motion.pose, bounds, strategy.update_rate, **grid)


def _taken(source: FocusSource, takers: Sequence[FocusTaker]) -> Iterator[FocalPoints]:
    """Focal points, once all takers have had them."""
    for focus in source:
        for taker in takers:
            taker.take(focus)
        yield focus
