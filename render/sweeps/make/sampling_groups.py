"""Sampling metrics of many recipes at once: motions of one scene that are sampled alike, in groups.

| a rendering of which unsplit groups are asked | is made |
|---|---|
| sampling metrics only, of a motion with times on a rigid hand, by kernels | with others of its scene and sampling |
| the same, of contours that the store has | alone, as they are read, which may take less than rendering them again |
| anything else | alone (`unsplit`) |
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import warp as wp

from ...motions.groups import motion_groups, sample_counts
from ...sampling.batch_sampling import why_on_host
from ...sampling.contour_sampling import SamplingStrategy
from ..plan.recipe import Recipe
from .batch import batch_bytes
from .keep import contours_at, is_kept
from .poses import Poses
from .rendering import Rendering, sampling_of
from .sampling import FOCI_AT_ONCE

CPU_BYTES = 256_000_000  # of a group on a CPU: some 20 motions of 30 s, so a sign of progress every half second


class UnsplitChunk(NamedTuple):
    """A chunk of a task that holds all poses of a recipe, as its groups cannot be split."""

    place: int
    """In the task."""
    groups: Sequence[str]
    recipe: Recipe
    rendering: Rendering


@dataclass(eq=False)
class SampledAlike:
    """Motions of one scene that one strategy samples."""

    strategy: SamplingStrategy
    asked: dict[str, list[UnsplitChunk]] = field(default_factory=dict)
    """By key of the result: those that ask for it."""

    def groups(self, device: str) -> Iterator[list[tuple[list[UnsplitChunk], dict[str, Any]]]]:
        """Group by group, the metrics of each result, and who asks for it."""
        asked = list(self.asked.values())
        first = asked[0][0].rendering
        motions = [own[0].rendering.poses for own in asked]
        memory = CPU_BYTES if wp.get_device(device).is_cpu else batch_bytes(device)
        started = perf_counter()
        for group in motion_groups(first.scene, motions, self.strategy, device, memory=memory):
            numbers = group.numbers
            seconds = {"sampling": (perf_counter() - started) / len(numbers)}
            own = asked[group.first : group.stop]
            yield [(chunks, {**one, "seconds": seconds}) for chunks, one in zip(own, numbers, strict=True)]
            started = perf_counter()


def divide_chunks(
    chunks: Sequence[UnsplitChunk], store: Path
) -> tuple[list[SampledAlike], dict[str, list[UnsplitChunk]]]:
    """Chunks that are sampled in groups, and by rendering those that are made alone."""
    by_rendering: dict[str, list[UnsplitChunk]] = {}
    for chunk in chunks:
        by_rendering.setdefault(chunk.rendering.key, []).append(chunk)
    alike: dict[tuple[str, SamplingStrategy], SampledAlike] = {}
    alone: dict[str, list[UnsplitChunk]] = {}
    for key, own in by_rendering.items():
        if is_kept(contours_at(store, key)) or not all(map(_is_grouped, own)):
            alone[key] = own
            continue
        for chunk in own:
            strategy = sampling_of(chunk.recipe.sampling)
            shared = alike.setdefault((chunk.rendering.family, strategy), SampledAlike(strategy))
            shared.asked.setdefault(chunk.recipe.key("sampling"), []).append(chunk)
    return list(alike.values()), alone


def _is_grouped(chunk: UnsplitChunk) -> bool:
    """Whether a chunk is made together with others, by the table above."""
    if tuple(chunk.groups) != ("sampling",) or not chunk.rendering.is_fusable:
        return False
    strategy, poses = sampling_of(chunk.recipe.sampling), chunk.rendering.poses
    return why_on_host(strategy) is None and _is_short(poses, strategy)


def _is_short(poses: Poses, strategy: SamplingStrategy) -> bool:
    """Whether poses are a motion in time whose focal points fit the memory all at once."""
    if poses.time is None or poses.count < 2:
        return False
    return sample_counts([poses], strategy)[0] * strategy.foci <= FOCI_AT_ONCE
