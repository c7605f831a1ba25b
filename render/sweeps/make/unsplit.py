"""Results of all poses of one rendering, which cannot be split: its contour file, then all that focal points give.

Recipes of one rendering share its contours; those of one sampling strategy also share its focal points.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ...motions.explorations.explored import TimedPoses
from ...motions.numbers import NUMBERS
from ...playback.focal_points import ContourRows, ContourSource
from ...sampling.sampler import Sampler
from ...sampling.strategy import SamplingStrategy
from .acoustic_metrics import NoiseMeter, measure_pressure
from .keep import DriveKeeper, FocusKeeper, contours_of, keep_contours
from .rendering import AskedResult, sampling_of
from .sampling import sample_recipe

KEEPERS = {"keep-focal-points": FocusKeeper, "keep-drives": DriveKeeper}


Payloads = dict[AskedResult, dict[str, Any] | Exception]
"""The payload of each result, or why there is none."""


def make_unsplit(asked: Sequence[AskedResult], folder: Path, device: str) -> Payloads:
    """Make results of one rendering; the error of one leaves the others. folder: of kept files."""
    rendering = asked[0].rendering
    payloads: Payloads = {}
    for own in asked:
        if own.group == "keep-contours":
            try:
                payloads[own] = keep_contours(rendering, folder, device)
            except Exception as error:  # of this file only
                payloads[own] = error
    sampled = [own for own in asked if own not in payloads]
    if reason := why_not_sampled(rendering.poses):
        return payloads | {own: _absent(own.group, reason) for own in sampled}
    if not sampled:
        return payloads
    try:
        with contours_of(rendering, folder, device) as contours:
            walks = walks_of(sampled)
            while walks:
                strategy, walk = walks.pop(0)
                try:
                    payloads |= _walk(contours, strategy, walk, folder)
                except Exception as error:  # of one result: each is made alone, so that only that one fails
                    if len(walk) == 1:
                        payloads[walk[0]] = error
                    else:
                        walks[:0] = [(strategy, [own]) for own in walk]
    except Exception as error:  # of a kept file that cannot be read
        payloads |= {own: error for own in sampled if own not in payloads}
    return payloads


def why_not_sampled(poses: TimedPoses) -> str | None:
    """Why poses have no focal points over time; None if they have."""
    if poses.time is None:
        return "the poses have no times"
    return "there is one pose only" if poses.count == 1 else None


def _absent(group: str, reason: str) -> dict[str, Any]:
    """The payload of a group that a recipe cannot have."""
    names = {"sampling": NUMBERS, "noise": (), "pressure": ()}.get(group, ("path",))
    return {**dict.fromkeys(names), "reason": reason, "seconds": {}}


def walks_of(sampled: Sequence[AskedResult]) -> list[tuple[SamplingStrategy, list[AskedResult]]]:
    """Results that one walk through the focal points makes: all of one sampling strategy, but one noise at most.

    Noise has all frames of a recipe in memory, up to 4 GiB; further arrays of the same sampling get walks of their own.
    """
    by_sampling: dict[SamplingStrategy, list[list[AskedResult]]] = {}
    for own in sampled:
        walks = by_sampling.setdefault(sampling_of(own.recipe.sampling), [[]])
        if own.group == "noise" and any(other.group == "noise" for other in walks[0]):
            walks.append([own])
        else:
            walks[0].append(own)
    return [(strategy, walk) for strategy, walks in by_sampling.items() for walk in walks]


def _walk(contours: ContourRows, strategy: SamplingStrategy, walk: Sequence[AskedResult], folder: Path) -> Payloads:
    """Sample once for all results of a walk; raises what any of them raises."""
    scene, motion = walk[0].rendering.scene, walk[0].rendering.poses.motion
    frame_count = ContourSource(contours, Sampler(strategy)).frame_count
    payloads: dict[AskedResult, dict[str, Any]] = {}
    takers: dict[AskedResult, FocusKeeper | DriveKeeper | NoiseMeter] = {}
    with ExitStack() as stack:
        for own in walk:
            if own.group in KEEPERS:
                takers[own] = keeper = KEEPERS[own.group](own.recipe, folder, strategy, frame_count)
                stack.enter_context(keeper.file)
            elif own.group == "noise":  # as pressure on the CPU, whatever renders: the same bits on any worker
                takers[own] = NoiseMeter(own.recipe, strategy, frame_count)
            elif own.group == "pressure":
                payloads[own] = measure_pressure(contours, scene.hand, strategy, own.recipe)
        if len(payloads) == len(walk):  # pressure alone needs no focal points but those of its sample
            return dict(payloads)
        is_counted = any(own.group == "sampling" for own in walk)
        takes = [own.take for own in takers.values()]
        numbers = sample_recipe(contours, motion, scene.hand, strategy, takes, counted=is_counted)
        walking = numbers.pop("seconds")
        for own in walk:
            payload = takers[own].publish() if own in takers else payloads.get(own, {**numbers, "seconds": {}})
            payloads[own] = {**payload, "seconds": walking | payload["seconds"]}
            walking = {}  # counted once
    return dict(payloads)
