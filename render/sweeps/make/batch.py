"""Which poses a worker renders together: chunks of renderings, cut to batches that fit the memory and take a second.

How they are cut changes no bit of a result: batches hold whole spans, and a chunk that is cut goes on in the next one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import warp as wp

from ...intersection.batch_rendering import CPU_SPAN_BYTES, POINT_BYTES
from ...motions.explorations.explored import joined_rows
from ...sampling.strategy import SamplingStrategy
from ..plan.recipe import Recipe, is_user_metric
from .metrics import Measured
from .rendering import Rendering, sampling_of
from .unit import CHUNK_POSES, SPAN
from .user_metrics import UserMetric

GPU_POSES = 128 * CHUNK_POSES  # of a batch: 16 M, if the memory has room; launches and waits cost less than 2 % then
GPU_SHARE = 8  # of a GPU's memory, a batch's working arrays take one eighth
POINTS_A_POSE = 32  # supposed, until a batch does not fit
POSES_FIRST = {"cpu": 4 * SPAN, "cuda": 8 * CHUNK_POSES}  # of a batch of a scene, before its speed is known
BATCH_SECONDS = 1.0  # long beside launching a batch, short beside what a smaller limit of memory would lose
GROWTH = 8  # largest ratio of a batch to the one before


class RenderingWants(NamedTuple):
    """What is computed of the contours of a rendering."""

    samplings: tuple[SamplingStrategy, ...]
    """Whose draw frequencies are asked for."""
    user_metrics: tuple[UserMetric, ...]


Wants = dict[str, RenderingWants]
"""By rendering."""


@dataclass(eq=False)
class WantedResult:
    """A result of a chunk that is asked for."""

    sampling: SamplingStrategy | None
    """None where contours are all that it needs."""
    metric: UserMetric | None = None
    """The user's function that computes it, if one does."""
    places: set[int] = field(default_factory=set)
    """Chunks of the unit that ask for it."""


@dataclass(eq=False)
class RenderedChunk:
    """A chunk of a rendering that is to be made, for all recipes that share it."""

    rendering: Rendering
    number: int
    wanted: dict[tuple[str, str], WantedResult] = field(default_factory=dict)
    """By group and key."""
    measured: Measured | None = None
    """Of the poses rendered so far."""
    columns: list[tuple[dict[str, np.ndarray], ...]] = field(default_factory=list)

    @property
    def first(self) -> int:
        """Its first pose."""
        return self.number * CHUNK_POSES

    @property
    def stop(self) -> int:
        """The pose after its last."""
        return min(self.first + CHUNK_POSES, self.rendering.poses.count)

    @property
    def places(self) -> set[int]:
        """Chunks of the unit that ask for any of it."""
        return set().union(*(wanted.places for wanted in self.wanted.values()))

    @property
    def per_pose(self) -> bool:
        """Whether a row a pose is asked for."""
        return any(group == "poses" for group, _ in self.wanted)


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


def want_chunk(
    chunks: dict[tuple[str, int], RenderedChunk],
    place: int,
    number: int,
    groups: Sequence[str],
    recipe: Recipe,
    rendering: Rendering,
    user_metrics: Mapping[str, UserMetric],
) -> None:
    """Add the results that a chunk of a unit asks for; chunks of one rendering become one.

    user_metrics: functions of groups that users define.
    """
    chunk = chunks.setdefault((rendering.key, number), RenderedChunk(rendering, number))
    for group in groups:
        is_of_contours = group == "contours" or is_user_metric(group)
        sampling = None if is_of_contours else sampling_of(recipe.sampling)
        wanted = WantedResult(sampling, user_metrics.get(group))
        chunk.wanted.setdefault((group, recipe.key(group)), wanted).places.add(place)


def wants_of(chunks: Sequence[RenderedChunk]) -> Wants:
    """What is computed of each rendering, for all of its chunks alike: they go on from batch to batch."""
    out: Wants = {}
    for chunk in chunks:
        known = out.get(chunk.rendering.key, RenderingWants((), ()))
        wanted = chunk.wanted.values()
        samplings = [one.sampling for one in wanted if one.sampling is not None]
        metrics = [one.metric for one in wanted if one.metric is not None]
        out[chunk.rendering.key] = RenderingWants(
            tuple(dict.fromkeys((*known.samplings, *samplings))), tuple(dict.fromkeys((*known.user_metrics, *metrics)))
        )
    return out


def join_ranges(ranges: Sequence[PoseRange], by: Callable[[RenderedChunk], object]) -> list[PoseRange]:
    """Ranges; those that follow each other, and have the same in `by` of their chunks, as one, of the first's chunk."""
    out: list[PoseRange] = []
    for own in ranges:
        last = out[-1] if out else None
        if last and last.stop == own.first and by(last.chunk) is by(own.chunk):
            out[-1] = PoseRange(last.chunk, last.first, own.stop)
        else:
            out.append(own)
    return out


def take_batch(left: Sequence[PoseRange], capacity: int) -> tuple[list[PoseRange], list[PoseRange]]:
    """Ranges of up to `capacity` poses, the last one cut between spans, and what is left."""
    batch: list[PoseRange] = []
    room = capacity
    for k, own in enumerate(left):
        if own.count > room:
            cut = own.first + spans_below(room)
            if cut > own.first:
                batch.append(PoseRange(own.chunk, own.first, cut))
                own = PoseRange(own.chunk, cut, own.stop)  # the rest of the same one
            return batch, [own, *left[k + 1 :]]
        batch.append(own)
        room -= own.count
    return batch, []


def poses_of(batch: Sequence[PoseRange], device: str) -> np.ndarray | wp.array:
    """Poses of all ranges, one after the other: on the host if all are there, else on the device."""
    joined = join_ranges(batch, lambda chunk: chunk.rendering)
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
    """How many poses of a scene make a batch: what fits the memory, and takes about BATCH_SECONDS."""

    def __init__(self, capacity: int, first: int, *, is_fixed: bool) -> None:
        """is_fixed: whether a user's stage sees the batches, which must not depend on how fast they are made then."""
        self._capacity, self._is_fixed = capacity, is_fixed
        self.poses = min(capacity, max(SPAN, first))
        """Of the next batch."""

    def learn(self, pose_count: int, seconds: float) -> None:
        """Take note of a batch: the next one is to take BATCH_SECONDS."""
        if self._is_fixed:
            return
        wanted = pose_count * BATCH_SECONDS / max(seconds, 1e-9)
        self.poses = max(SPAN, spans_below(round(min(wanted, GROWTH * pose_count, self._capacity))))

    def shrink(self, pose_count: int) -> None:
        """Take note of a batch that did not fit the memory."""
        self._capacity = self.poses = max(SPAN, spans_below(pose_count // 2))
