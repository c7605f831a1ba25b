"""Sampling metrics and kept focal points of many recipes: motions of one scene that are sampled alike, in groups.

| a rendering of which unsplit groups are asked | is made |
|---|---|
| only these two, of a motion with times on a rigid hand, by kernels | with others of its scene and sampling |
| focal points on a GPU, modulated by sines, which round otherwise there | alone (`unsplit`), on the CPU |
| anything else, as kept drives, which take 20 times as long as their focal points | alone |
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import warp as wp

from ...motions.groups import MotionGroup, motion_groups, sample_counts
from ...sampling.strategy import SamplingStrategy
from ..plan.recipe import Recipe
from .batch import batch_bytes
from .keep import keep_focal_points
from .rendering import Rendering, sampling_of

FOCI_AT_ONCE = 5_000_000  # 0.2 GB of focal points of a motion; more are made alone, block by block
CPU_BYTES = 256_000_000  # of a group on a CPU: some 10 motions of 30 s
SAMPLING, FOCAL_POINTS = "sampling", "keep-focal-points"
Results = dict[str, dict[str, Any] | Exception]
"""Of a motion, by group: the payload, or why there is none."""


class UnsplitChunk(NamedTuple):
    """A chunk of a unit that holds all poses of a recipe, as its groups cannot be split."""

    place: int
    """In the unit."""
    groups: Sequence[str]
    recipe: Recipe
    rendering: Rendering


@dataclass(eq=False)
class SampledAlike:
    """Motions of one scene that one strategy samples."""

    strategy: SamplingStrategy
    asked: dict[str, list[UnsplitChunk]] = field(default_factory=dict)
    """By key of the result: those that ask for it."""

    def groups(self, device: str, folder: Path) -> Iterator[list[tuple[list[UnsplitChunk], Results]]]:
        """Group by group, the results of each motion, and the chunks that ask for them. folder: of kept files."""
        asked = list(self.asked.values())
        first = asked[0][0].rendering
        motions = [own[0].rendering.poses for own in asked]
        is_small = wp.get_device(device).is_cpu or any(FOCAL_POINTS in groups_of(own) for own in asked)
        memory = CPU_BYTES if is_small else batch_bytes(device)
        started = perf_counter()
        for group in motion_groups(first.scene, motions, self.strategy, device, memory=memory):
            own = asked[group.first : group.stop]
            made = self._results(group, own, folder)
            seconds = {"sampling": (perf_counter() - started) / len(own)}
            del group  # before the next takes as much memory
            yield [(chunks, _timed(results, seconds)) for chunks, results in zip(own, made, strict=True)]
            started = perf_counter()

    def _results(self, group: MotionGroup, asked: Sequence[list[UnsplitChunk]], folder: Path) -> list[Results]:
        """Of each motion of a group. Raises what sampling raises: whose fault that is, making each alone tells."""
        samples = group.samples
        is_counted = any(SAMPLING in groups_of(own) for own in asked)
        numbers = group.numbers if is_counted else [{} for _ in asked]
        results: list[Results] = []
        for number, own in enumerate(asked):
            made: Results = {}
            for name in groups_of(own):
                if name == SAMPLING:
                    made[name] = dict(numbers[number])
                    continue
                try:
                    made[name] = keep_focal_points(own[0].recipe, folder, self.strategy, samples.focus(number))
                except Exception as error:  # of this file only
                    made[name] = error
            results.append(made)
        return results


def groups_of(chunks: Sequence[UnsplitChunk]) -> list[str]:
    """Groups that chunks ask for, each once."""
    return list(dict.fromkeys(group for chunk in chunks for group in chunk.groups))


def _timed(results: Results, seconds: dict[str, float]) -> Results:
    """The same with seconds, which the first payload has."""
    out = dict(results)
    for name, payload in results.items():
        if not isinstance(payload, Exception):
            out[name], seconds = {**payload, "seconds": seconds}, {}
    return out


def divide_chunks(
    chunks: Sequence[UnsplitChunk], device: str
) -> tuple[list[SampledAlike], dict[str, list[UnsplitChunk]]]:
    """Chunks that are sampled in groups, and by rendering those that are made alone."""
    by_rendering: dict[str, list[UnsplitChunk]] = {}
    for chunk in chunks:
        by_rendering.setdefault(chunk.rendering.key, []).append(chunk)
    alike: dict[tuple[str, SamplingStrategy], SampledAlike] = {}
    alone: dict[str, list[UnsplitChunk]] = {}
    for key, own in by_rendering.items():
        if not all(_is_grouped(chunk, device) for chunk in own):
            alone[key] = own
            continue
        for chunk in own:
            strategy = sampling_of(chunk.recipe.sampling)
            shared = alike.setdefault((chunk.rendering.family, strategy), SampledAlike(strategy))
            shared.asked.setdefault(chunk.recipe.key("sampling"), []).append(chunk)
    return list(alike.values()), alone


def _is_grouped(chunk: UnsplitChunk, device: str) -> bool:
    """Whether a chunk is made together with others, by the table above."""
    if not {SAMPLING, FOCAL_POINTS}.issuperset(chunk.groups) or not chunk.rendering.is_fusable:
        return False
    strategy, poses = sampling_of(chunk.recipe.sampling), chunk.rendering.poses
    has_sines = strategy.am is not None or strategy.lm is not None
    if FOCAL_POINTS in chunk.groups and has_sines and not wp.get_device(device).is_cpu:
        return False
    if poses.time is None or poses.count < 2:  # no motion in time, so no focal points
        return False
    return 0 < sample_counts([poses], strategy)[0] * strategy.foci <= FOCI_AT_ONCE
