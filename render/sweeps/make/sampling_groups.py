"""Sampling metrics and kept focal points of many recipes: motions of one scene that are sampled alike, in groups.

| a rendering of which unsplit groups are asked | is made |
|---|---|
| only these two, of a motion with times on a rigid hand, by kernels | with others of its scene and sampling |
| focal points on a GPU, modulated by sines, which round otherwise there | alone (`unsplit`), on the CPU |
| anything else, such as drives, which take 20 times as long as their focal points | alone |
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import warp as wp

from ...motions.groups import MotionGroup, motion_groups, sample_counts
from ...sampling.strategy import SamplingStrategy
from .batch import batch_bytes
from .keep import keep_focal_points
from .rendering import AskedResult, sampling_of
from .unsplit import Payloads, why_not_sampled

FOCI_AT_ONCE = 5_000_000  # 0.2 GB of focal points of a motion; more are made alone, block by block
CPU_BYTES = 256_000_000  # of a group on a CPU: some 10 motions of 30 s
SAMPLING, FOCAL_POINTS = "sampling", "keep-focal-points"


@dataclass(eq=False)
class SampledAlike:
    """Motions of one scene that one strategy samples."""

    strategy: SamplingStrategy
    motions: dict[str, list[AskedResult]] = field(default_factory=dict)
    """The results that are asked for of each, by the key that they have in common."""

    def make(self, device: str, folder: Path) -> Iterator[Payloads]:
        """Results of each motion, made group by group; raises what sampling raises. folder: of kept files."""
        asked = list(self.motions.values())
        is_kept = any(own.group == FOCAL_POINTS for results in asked for own in results)
        memory = CPU_BYTES if is_kept or wp.get_device(device).is_cpu else batch_bytes(device)
        scene, poses = asked[0][0].rendering.scene, [results[0].rendering.poses for results in asked]
        started = perf_counter()
        for group in motion_groups(scene, poses, self.strategy, device, memory=memory):
            own = asked[group.first : group.stop]
            made = [self._payloads(group, number, results, folder) for number, results in enumerate(own)]
            del group  # before the next takes as much memory
            share = {"sampling": (perf_counter() - started) / len(own)}
            for payloads in made:
                seconds = share
                for payload in payloads.values():
                    if not isinstance(payload, Exception):
                        payload["seconds"], seconds = seconds, {}  # counted once
            yield from made
            started = perf_counter()

    def _payloads(self, group: MotionGroup, number: int, asked: Sequence[AskedResult], folder: Path) -> Payloads:
        """Results of one motion of a group."""
        samples, payloads = group.samples, Payloads()
        for own in asked:
            if own.group == SAMPLING:
                payloads[own] = dict(group.numbers[number])
                continue
            try:
                payloads[own] = keep_focal_points(own.recipe, folder, self.strategy, samples.focus(number))
            except Exception as error:  # of this file only
                payloads[own] = error
        return payloads


def divide_results(
    asked: Sequence[AskedResult], device: str
) -> tuple[list[SampledAlike], dict[str, list[AskedResult]]]:
    """Results that are made in groups, and by rendering those that are made alone."""
    by_rendering: dict[str, list[AskedResult]] = {}
    for own in asked:
        by_rendering.setdefault(own.rendering.key, []).append(own)
    alike: dict[tuple[str, SamplingStrategy], SampledAlike] = {}
    alone: dict[str, list[AskedResult]] = {}
    for key, results in by_rendering.items():
        if not all(_is_grouped(own, device) for own in results):
            alone[key] = results
            continue
        for own in results:
            strategy = sampling_of(own.recipe.sampling)
            shared = alike.setdefault((own.rendering.family, strategy), SampledAlike(strategy))
            shared.motions.setdefault(own.key, []).append(own)
    return list(alike.values()), alone


def _is_grouped(own: AskedResult, device: str) -> bool:
    """Whether a result is made together with others, by the table above."""
    if own.group not in (SAMPLING, FOCAL_POINTS) or not own.rendering.is_fusable:
        return False
    strategy, poses = sampling_of(own.recipe.sampling), own.rendering.poses
    has_sines = strategy.am is not None or strategy.lm is not None
    if own.group == FOCAL_POINTS and has_sines and not wp.get_device(device).is_cpu:
        return False
    if why_not_sampled(poses) is not None:
        return False
    return 0 < sample_counts([poses], strategy)[0] * strategy.foci <= FOCI_AT_ONCE
