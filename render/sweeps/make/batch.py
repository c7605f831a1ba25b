"""Batches of poses that are rendered together: chunks of renderings, cut to fit the memory and to take a second.

The cuts change no bit of a result: batches hold whole spans, and a chunk that is cut goes on in the next one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import warp as wp

from ...intersection.batch_rendering import CPU_SPAN_BYTES, POINT_BYTES
from ...motions.explorations.explored import joined_rows
from ...sampling.strategy import SamplingStrategy
from .metrics import Measured, UserMetric
from .rendering import AskedResult, Rendering
from .unit import CHUNK_POSES, SPAN

GPU_POSES = 128 * CHUNK_POSES  # of a batch: 16 M, if the memory has room; launches and waits cost less than 2 % then
GPU_SHARE = 8  # of a GPU's memory, a batch's working arrays take one eighth
POINTS_A_POSE = 32  # supposed, until a batch does not fit
POSES_FIRST = {"cpu": 4 * SPAN, "cuda": 8 * CHUNK_POSES}  # of a batch of a scene, before its speed is known
BATCH_SECONDS = 1.0  # long beside launching a batch, short beside what a smaller limit of memory would lose
GROWTH = 8  # largest ratio of a batch to the one before


@dataclass(eq=False)
class AskedMetrics:
    """What is measured of the contours of a rendering, of all of its chunks alike."""

    samplings: tuple[SamplingStrategy, ...] = ()
    """Strategies whose draw frequencies are asked for."""
    user_metrics: tuple[UserMetric, ...] = ()


@dataclass(eq=False)
class RenderedChunk:
    """A chunk of a rendering that is to be made, for all recipes that share it."""

    rendering: Rendering
    number: int
    metrics: AskedMetrics
    """Of the rendering."""
    asked: dict[tuple[str, str], AskedResult] = field(default_factory=dict)
    """By group and key."""
    measured: Measured | None = None
    """Of the poses rendered so far."""
    columns: list[tuple[dict[str, np.ndarray], ...]] = field(default_factory=list)
    """Of these poses, block by block, for each sampling strategy."""

    @property
    def first(self) -> int:
        """Its first pose."""
        return self.number * CHUNK_POSES

    @property
    def stop(self) -> int:
        """The pose after its last."""
        return min(self.first + CHUNK_POSES, self.rendering.poses.count)

    @property
    def reached(self) -> int:
        """The first pose that has not been measured."""
        return self.first + (0 if self.measured is None else self.measured.contours["poses"])

    @property
    def places(self) -> set[int]:
        """Chunks of the unit that ask for any of it."""
        return set().union(*(asked.places for asked in self.asked.values()))

    def ask(self, own: AskedResult, place: int) -> None:
        """Have a result made. place: of the unit's chunk that asks for it."""
        if own.sampling is not None and own.sampling not in self.metrics.samplings:
            self.metrics.samplings += (own.sampling,)
        if own.metric is not None and own.metric not in self.metrics.user_metrics:
            self.metrics.user_metrics += (own.metric,)
        self.asked.setdefault((own.group, own.key), own).places.add(place)


@dataclass(frozen=True)
class PoseRange:
    """Poses of a chunk that are rendered in one batch."""

    chunk: RenderedChunk
    first: int
    stop: int

    @property
    def count(self) -> int:
        """Number of poses."""
        return self.stop - self.first


def take_batch(chunks: Sequence[RenderedChunk], capacity: int) -> list[PoseRange]:
    """The next poses of chunks in their order, `capacity` at most; a chunk that does not fit is cut between spans."""
    batch: list[PoseRange] = []
    room = capacity
    for chunk in chunks:
        own = PoseRange(chunk, chunk.reached, chunk.stop)
        if own.count > room:
            cut = own.first + spans_below(room)
            return [*batch, PoseRange(chunk, own.first, cut)] if cut > own.first else batch
        batch.append(own)
        room -= own.count
    return batch


def poses_of(batch: Sequence[PoseRange], device: str) -> np.ndarray | wp.array:
    """Poses of all ranges, one after the other: on the host if all are there, else on the device."""
    joined: list[PoseRange] = []  # ranges that follow each other in one rendering are made at once
    for own in batch:
        last = joined[-1] if joined else None
        if last and last.stop == own.first and last.chunk.rendering is own.chunk.rendering:
            joined[-1] = PoseRange(last.chunk, last.first, own.stop)
        else:
            joined.append(own)
    return joined_rows([(own.chunk.rendering.poses, own.first, own.stop) for own in joined], device)


def spans_below(count: int) -> int:
    """Poses of as many whole spans as `count` has."""
    return count // SPAN * SPAN


def batch_bytes(device: str) -> int:
    """Working memory of a batch [byte]."""
    place = wp.get_device(device)
    return CPU_SPAN_BYTES if place.is_cpu else place.total_memory // GPU_SHARE


def batch_capacity(pose_bytes: int, device: str) -> int:
    """Poses of a batch for which the memory has room, if a pose has POINTS_A_POSE points; one span at least."""
    fitting = batch_bytes(device) // (pose_bytes + POINT_BYTES * POINTS_A_POSE)
    return max(SPAN, spans_below(fitting if wp.get_device(device).is_cpu else min(fitting, GPU_POSES)))


def point_limit(device: str) -> int:
    """Points of a batch of more than one span."""
    return batch_bytes(device) // POINT_BYTES


class BatchSize:
    """The number of poses of a scene that make a batch: they fit the memory, and take about BATCH_SECONDS.

    capacity: see `batch_capacity`. is_fixed: whether a user's stage sees the batches, which then must not depend on how
    fast they are made.
    """

    def __init__(self, capacity: int, device: str, *, is_fixed: bool) -> None:
        self._capacity, self._is_fixed = capacity, is_fixed
        self.poses = min(capacity, POSES_FIRST["cpu" if device == "cpu" else "cuda"])
        """Of the next batch."""

    def learn(self, pose_count: int, seconds: float) -> None:
        """Take note of a batch: the next one is to take BATCH_SECONDS."""
        if not self._is_fixed:
            wanted = pose_count * BATCH_SECONDS / max(seconds, 1e-9)
            self.poses = max(SPAN, spans_below(round(min(wanted, GROWTH * pose_count, self._capacity))))

    def shrink(self, pose_count: int) -> None:
        """Take note of a batch that did not fit the memory."""
        self._capacity = self.poses = max(SPAN, spans_below(pose_count // 2))


@lru_cache(maxsize=4096)
def learned_size(family: str, device: str, capacity: int) -> BatchSize:
    """The batch size of a family of renderings, kept from unit to unit."""
    del family
    return BatchSize(capacity, device, is_fixed=False)
